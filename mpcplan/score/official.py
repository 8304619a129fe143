"""The official checks and the official cost of one solution (imports commonroad_dc).

For use in the referee's child process only: the extension modules may crash the process.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import commonroad_dc.feasibility.solution_checker as checker
from commonroad.common.solution import CostFunction, PlanningProblemSolution, Solution
from commonroad.planning.planning_problem import PlanningProblemSet
from commonroad.scenario.scenario import Scenario

from mpcplan.errors import InputError
from mpcplan.scenario import load
from mpcplan.score.solution_file import read_solution
from mpcplan.trajectory import Array


@dataclass(frozen=True)
class Case:
    """A scenario with its problems and a solution, all in the same local coordinates.

    ``origin`` holds the file coordinates [m] of the local frame's origin.
    """

    scenario: Scenario
    problems: PlanningProblemSet
    solution: Solution
    origin: Array

    @property
    def id(self) -> str:
        """The scenario's id."""
        return str(self.scenario.scenario_id)

    @property
    def solutions(self) -> list[PlanningProblemSolution]:
        """The solutions of the single problems."""
        return list(self.solution.planning_problem_solutions)

    @property
    def duration_s(self) -> float:
        """Driven time, summed over the problems [s]."""
        lists = [s.trajectory.state_list for s in self.solutions]
        return float(sum(x[-1].time_step - x[0].time_step for x in lists) * self.scenario.dt)


def read_case(scenario_path: Path, solution_path: Path) -> Case:
    """Read both files; raises InputError when one is unusable or they do not match.

    The case is in the loader's local coordinates: the checker's boundary construction crashes at
    UTM coordinates, and commonroad-io leaves the lanelets' spatial index behind when it moves a
    scenario itself.
    """
    scenario, problems, origin = read_scenario(scenario_path)
    solution = read_solution(solution_path)
    ours, theirs = str(scenario.scenario_id), str(solution.scenario_id)
    if ours != theirs:
        raise InputError(
            f"{solution_path} solves {theirs}, but {scenario_path} is {ours}: "
            "give the scenario and its own solution"
        )
    for part in solution.planning_problem_solutions:
        part.trajectory.translate_rotate(-origin, 0.0)
    return Case(scenario, problems, solution, origin)


def read_scenario(path: Path) -> tuple[Scenario, PlanningProblemSet, Array]:
    """Scenario, problems and the file coordinates [m] of their origin; raises InputError."""
    loaded = load(path)
    return loaded.scenario, loaded.problem_set, loaded.origin


_built: dict[int, Any] = {}
_build_boundary = checker._construct_boundary_checker


def road_boundary(scenario: Scenario) -> Any:
    """The checker's off-road area, built once: the triangulation takes seconds."""
    if id(scenario) not in _built:
        _built[id(scenario)] = _build_boundary(scenario)
    return _built[id(scenario)]


checker._construct_boundary_checker = road_boundary


def feasibility(case: Case) -> dict[int, tuple[bool, Any, Any]]:
    """The checker's feasibility result per problem: passed, inputs, trajectory."""
    result: dict[int, tuple[bool, Any, Any]] = checker.solution_feasible(
        case.solution, case.scenario.dt, case.problems
    )
    return result


def _collision_free(case: Case) -> bool:
    # several problems in one scenario: valid_solution of the checker also tests the egos' boxes
    # against each other, and solutions with such a collision are refused
    hit = checker.obstacle_collision(case.scenario, case.problems, case.solution)
    return not (hit or checker.ego_collision(case.scenario, case.problems, case.solution))


CHECKS: dict[str, Callable[[Case], bool]] = {
    "all_problems": lambda c: bool(checker.solved_all_problems(c.problems, c.solution)),
    "goal": lambda c: bool(checker.goal_reached(c.scenario, c.problems, c.solution)),
    "start": lambda c: bool(checker.starts_at_correct_state(c.solution, c.problems)),
    "no_collision": _collision_free,
    "on_road": lambda c: not checker.boundary_collision(c.scenario, c.problems, c.solution),
    "feasible": lambda c: all(r[0] for r in feasibility(c).values()),
}


def partial_costs(case: Case) -> dict[str, float]:
    """Unweighted Jlon, SR, D, LC, summed over the problems; raises where the checker does."""
    from commonroad_dc.costs.evaluation import CostFunctionEvaluator

    total: dict[str, float] = {}
    for part in case.solutions:
        evaluator = CostFunctionEvaluator(CostFunction.TR1, part.vehicle_type)
        problem = case.problems.planning_problem_dict[part.planning_problem_id]
        result = evaluator.evaluate_pp_solution(case.scenario, problem, part.trajectory)
        for cost, value in result.partial_costs.items():
            total[cost.name] = total.get(cost.name, 0.0) + float(value)
    if not total or not all(math.isfinite(value) for value in total.values()):
        raise ValueError(f"the evaluation gave {total or 'nothing'}")
    return total
