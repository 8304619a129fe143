"""Where a failed official check fails: problem, time step, obstacle, and by how much.

The official checker only says 'no'. Each finder here goes through the same objects step by step
and returns a sentence, or '' when it finds nothing wrong. For use in the referee's child only.
"""

import re
from collections.abc import Callable, Iterator
from itertools import combinations
from typing import Any

import commonroad_dc.feasibility.solution_checker as checker
import numpy as np
from commonroad.common.solution import PlanningProblemSolution
from commonroad.geometry.shape import Shape, ShapeGroup
from commonroad_dc.collision.collision_detection.pycrcc_collision_dispatch import (
    create_collision_object,
)
from commonroad_dc.feasibility.vehicle_dynamics import VehicleDynamics
from shapely.geometry import Point

from mpcplan.score.official import Case, feasibility, road_boundary


def missing_problems(case: Case) -> str:
    """Problems without a solution, and solutions of problems that do not exist."""
    asked = set(case.problems.planning_problem_dict)
    solved = set(case.solution.planning_problem_ids)
    parts = [f"problem {i} has no solution" for i in sorted(asked - solved)]
    parts += [f"the scenario has no problem {i}" for i in sorted(solved - asked)]
    return ", ".join(parts)


def missed_goal(case: Case) -> str:
    """How far the last state is from the nearest goal, attribute by attribute."""
    for part in case.solutions:
        problem = case.problems.planning_problem_dict[part.planning_problem_id]
        if problem.goal_reached(part.trajectory)[0]:
            continue
        last = part.trajectory.state_list[-1]
        gaps = min((_gaps(goal, last) for goal in problem.goal.state_list), key=len)
        return (
            f"problem {part.planning_problem_id}: no state is in the goal; "
            f"the last one (step {last.time_step}) misses it: "
            + ("; ".join(gaps) or "the state is in the goal, the checker disagrees")
        )
    return ""


def _gaps(goal: Any, state: Any) -> list[str]:
    """Each attribute of a goal state that a state misses."""
    gaps = []
    if not goal.time_step.contains(state.time_step):
        gaps.append(f"time step {state.time_step} not in {_interval(goal.time_step)}")
    if goal.has_value("position") and not goal.position.contains_point(state.position):
        gaps.append(f"position {_distance(goal.position, state.position):.2f} m away")
    for name, unit in (("velocity", "m/s"), ("orientation", "rad")):
        if goal.has_value(name) and not getattr(goal, name).contains(getattr(state, name)):
            wanted = _interval(getattr(goal, name))
            gaps.append(f"{name} {getattr(state, name):.3f} {unit} not in {wanted}")
    return gaps


def _interval(interval: Any) -> str:
    return f"[{interval.start:g}, {interval.end:g}]"


def _distance(shape: Shape, position: np.ndarray) -> float:
    """Distance of a point from a shape [m]."""
    if isinstance(shape, ShapeGroup):
        return min(_distance(member, position) for member in shape.shapes)
    return float(shape.shapely_object.distance(Point(position)))


def wrong_start(case: Case) -> str:
    """The attribute of the first state that is not the problem's, in the checker's words."""
    try:
        checker.starts_at_correct_state(case.solution, case.problems)
    except checker.SolutionCheckerException as error:
        text = " ".join(str(error).split())
        found = re.search(r"ID: (\d+) Expected (.*?)=(.*) Received \2=(.*)", text)
        if found:
            problem, name, wanted, given = found.groups()
            return f"problem {problem}: starts with {name} {given}, the problem asks for {wanted}"
    return ""


def _egos(case: Case) -> Iterator[tuple[PlanningProblemSolution, Any]]:
    """The driven box over time as a collision object, per problem."""
    for part in case.solutions:
        yield (
            part,
            checker._create_pp_solution_collision_object(case.problems, part, case.scenario.dt),
        )


def _first_step(ego: Any, hits: Callable[[Any, int], bool]) -> int | None:
    """First time step at which the ego's box meets something."""
    steps = range(ego.time_start_idx(), ego.time_end_idx() + 1)
    return next((k for k in steps if hits(ego.obstacle_at_time(k), k)), None)


def _meets(other: Any) -> Callable[[Any, int], bool]:
    """Test of a box at a step against a collision object, which may move."""
    if not hasattr(other, "obstacle_at_time"):
        return lambda box, _: bool(box.collide(other))

    def test(box: Any, step: int) -> bool:
        if not other.time_start_idx() <= step <= other.time_end_idx():
            return False
        return bool(box.collide(other.obstacle_at_time(step)))

    return test


def first_collision(case: Case) -> str:
    """Problem, first colliding step and obstacle; or the two problems that meet."""
    others = {o.obstacle_id: create_collision_object(o) for o in case.scenario.obstacles}
    egos = list(_egos(case))
    for part, ego in egos:
        hits = [
            (step, name)
            for name, other in others.items()
            if ego.collide(other) and (step := _first_step(ego, _meets(other))) is not None
        ]
        if hits:
            step, name = min(hits)
            return f"problem {part.planning_problem_id}: hits obstacle {name} at step {step}"
    return _ego_collision(egos)


def _ego_collision(egos: list[tuple[PlanningProblemSolution, Any]]) -> str:
    """The first two problems whose vehicles meet."""
    for (a, ego), (b, other) in combinations(egos, 2):
        step = _first_step(ego, _meets(other))
        if step is not None:
            ids = f"{a.planning_problem_id} and {b.planning_problem_id}"
            return f"the vehicles of problems {ids} collide at step {step}"
    return ""


def first_off_road(case: Case) -> str:
    """Problem and first time step at which the box touches the area outside the lanelets."""
    road = road_boundary(case.scenario)
    for part, ego in _egos(case):
        step = _first_step(ego, lambda box, _: bool(road.collide(box)))
        if step is not None:
            x, y = part.trajectory.state_list[step - ego.time_start_idx()].position + case.origin
            problem = part.planning_problem_id
            return f"problem {problem}: leaves the road at step {step}, x {x:.2f} m, y {y:.2f} m"
    return ""


def first_infeasible(case: Case) -> str:
    """Problem, step of the first transition that the vehicle cannot drive, and its deviation."""
    parts = {part.planning_problem_id: part for part in case.solutions}
    for problem, (passed, inputs, _) in feasibility(case).items():
        if passed:
            continue
        last = inputs.state_list[-1]
        return (
            f"problem {problem}: the {parts[problem].vehicle_model.name} model cannot drive from "
            f"step {last.time_step} to {last.time_step + 1}"
            + _deviation(parts[problem], last, case.scenario.dt)
        )
    return ""


def _deviation(part: PlanningProblemSolution, best: Any, dt: float) -> str:
    """How far the best input that the checker found stays from the asked state."""
    vehicle = VehicleDynamics.from_model(part.vehicle_model, part.vehicle_type)
    states = part.trajectory.state_list
    k = best.time_step - states[0].time_step
    x0, x1 = (vehicle.state_to_array(state)[0] for state in states[k : k + 2])
    u = np.array([best.steering_angle_speed, best.acceleration])
    reached = vehicle.forward_simulation(x0, u, dt, throw=False)
    if reached is None:
        return " (needs an input beyond the limits)"
    turn = float(np.arctan2(np.sin(x1[4] - reached[4]), np.cos(x1[4] - reached[4])))
    offset = float(np.hypot(*(x1[:2] - reached[:2])))
    return f" (closest it gets: {offset:.3f} m and {abs(turn):.4f} rad off)"


FINDERS: dict[str, Callable[[Case], str]] = {
    "all_problems": missing_problems,
    "goal": missed_goal,
    "start": wrong_start,
    "no_collision": first_collision,
    "on_road": first_off_road,
    "feasible": first_infeasible,
}
