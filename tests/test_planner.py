"""Planner and closed loop: verified plans, determinism, no knowledge of the future, fallbacks."""

import hashlib
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import made
import numpy as np
import pytest
from commonroad.common.solution import CommonRoadSolutionWriter
from commonroad.geometry.shape import Rectangle
from commonroad.scenario.obstacle import ObstacleType, StaticObstacle

from mpcplan import seeking
from mpcplan.config import Config
from mpcplan.develop import KEPT, Developer
from mpcplan.guessing import in_the_last_moment
from mpcplan.observation import Box, Observation, Snapshot
from mpcplan.plan import Option, Plan
from mpcplan.planner import Planner
from mpcplan.predict.recorded import record
from mpcplan.refine.backends import Answer
from mpcplan.refine.qp import QpSolver
from mpcplan.road.goal import is_reached
from mpcplan.scenario import LoadedScenario, load
from mpcplan.seed.candidates import Effort
from mpcplan.seeking import HOPEFUL, LAST_MOMENT
from mpcplan.simulate.loop import HISTORY, drive
from mpcplan.simulate.recorded import RecordedTraffic
from mpcplan.simulate.run import Run
from mpcplan.task import Task, task_of
from mpcplan.trajectory import State, Trajectory
from mpcplan.vehicle import FORD_ESCORT
from mpcplan.verify.drivability import Finding, separation, verify

FOLDER = Path(__file__).resolve().parents[1] / "scenarios"


def bundled(name: str) -> LoadedScenario:
    """A bundled scenario, read anew."""
    return load(FOLDER / f"ZAM_{name}-1_1_T-1.xml")


def configured(**sections: dict) -> Config:
    """A configuration with other parameters in some sections."""
    config = Config()
    changed = {n: getattr(config, n).model_copy(update=values) for n, values in sections.items()}
    return config.model_copy(update=changed)


BLIND = configured(predict={"kind": "constant_input"})


def first_look(loaded: LoadedScenario) -> Observation:
    """What is seen at the start."""
    problem = loaded.problems[0]
    now = RecordedTraffic(loaded.scenario).at(problem.first_step)
    return Observation(problem.first_step, problem.start, 0.0, (now,))


def planned(loaded: LoadedScenario, config: Config | None = None) -> Plan:
    """The first plan of a scenario's first problem."""
    return Planner(task_of(loaded, loaded.problems[0]), config).plan(first_look(loaded))


def solution_bytes(run: Run) -> bytes:
    """The solution file of a run."""
    return CommonRoadSolutionWriter(run.solution()).dump().encode()


# -- plans ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["FreeRoad", "TimeOnly", "Follow", "HardBrake"])
def test_a_plan_starts_now_and_passes_verification(name):
    loaded = bundled(name)
    planner = Planner(task_of(loaded, loaded.problems[0]))
    plan = planner.plan(first_look(loaded))
    assert plan.trajectory.first_step == 0
    assert np.array_equal(plan.trajectory.states[0], loaded.problems[0].start)
    assert plan.finding.ok and plan.trace["fallback"] is None
    forecast = record(loaded.scenario)
    assert verify(plan.trajectory, forecast, planner.roads[0].area, planner.config.verify).ok


@pytest.mark.parametrize("name", ["FreeRoad", "TimeOnly", "Follow"])
def test_a_plan_ends_in_the_goal_or_at_rest(name):
    loaded = bundled(name)
    plan = planned(loaded)
    last = plan.trajectory.states[-1]
    goal = loaded.problems[0].planning_problem
    if plan.reaches_goal:
        assert is_reached(goal, last, plan.trajectory.last_step)
    else:
        assert last[State.V] == pytest.approx(0.0, abs=1e-6)
    assert plan.reaches_goal  # these three have an easy way to the goal


def test_a_lane_change_that_can_wait_waits():
    """Beside a car in the lane of the goal: where no move may begin later, it is a harder drive."""
    loaded = bundled("LaneChange")
    early = configured(seed={"delays": ()})
    now, later = (drive(loaded, config).drives[0] for config in (early, Config()))
    assert now.reached_step is not None and later.reached_step is not None

    def aside(trajectory: Trajectory) -> float:
        """How far the vehicle has left its lane after three seconds [m]."""
        start, state = trajectory.states[0], trajectory.state_at(30)
        way = state[[State.X, State.Y]] - start[[State.X, State.Y]]
        return abs(float(way @ [-np.sin(start[State.PSI]), np.cos(start[State.PSI])]))

    def steering(trajectory: Trajectory) -> float:
        """Sum of the squared steering rates [rad^2/s^2]."""
        return float((trajectory.inputs[:, 1] ** 2).sum())

    assert aside(later.trajectory) < 0.2
    assert steering(later.trajectory) < 0.5 * steering(now.trajectory)


def test_where_motion_is_a_guess_there_are_fewer_routes_and_no_delays():
    loaded = bundled("LaneChange")
    task = task_of(loaded, loaded.problems[0])
    known, guessed = Planner(task), Planner(task, BLIND)
    assert known.config == Config()
    assert guessed.config.seed.delays == ()
    assert guessed.config.road.variants == Config().predict.variants


@pytest.mark.parametrize("name", ["reserve", "haste"])
def test_where_motion_is_a_guess_caution_costs_at_least_what_is_configured(name):
    loaded = bundled("LaneChange")
    task = task_of(loaded, loaded.problems[0])
    least = getattr(Config().predict, name)
    assert least > getattr(Config().cost, name) == getattr(Planner(task).config.cost, name) == 0
    for own, expected in ((0.0, least), (0.9, max(0.9, least))):
        config = configured(cost={name: own}, predict={"kind": "constant_input"})
        assert getattr(Planner(task, config).config.cost, name) == expected


def test_where_motion_is_a_guess_the_distance_holds_until_the_next_cycle():
    loaded = bundled("LaneChange")
    task = task_of(loaded, loaded.problems[0])
    known, guessed = Planner(task).config, Planner(task, BLIND).config
    assert known.cost == Config().cost
    assert guessed.cost.rules_delay == guessed.drive.replan > 0
    assert guessed.cost.rules_horizon == guessed.predict.rules_horizon < known.cost.rules_horizon


def test_plans_in_haste_that_fail_give_way_to_plans_that_take_their_time():
    """Only plans without haste pass: they are driven, before any fallback is."""
    loaded = bundled("Follow")
    planner = Planner(task_of(loaded, loaded.problems[0]), BLIND)
    planner._developer = Refusing(planner._developer)
    planner._resorts = replace(planner._resorts, developer=planner._developer)
    plan = planner.plan(first_look(loaded))
    assert plan.finding.ok and plan.reaches_goal
    assert plan.trace["fallback"] is None


class Refusing:
    """A developer all of whose options are refused."""

    def __init__(self, real: Developer) -> None:
        self._real = real

    def develop(self, cycle, seed, options, refused, *more) -> None:
        """As the real one, but nothing passes."""
        passed: list[Option] = []
        self._real.develop(cycle, seed, passed, refused, *more)
        failed = Finding(False, "road", cycle.observation.step)
        refused += [replace(option, finding=failed) for option in passed]


def test_where_a_plan_has_become_much_dearer_all_ways_are_looked_at_again(monkeypatch):
    """A guess that turns out wrong is a reason to decide anew, once; an exact forecast is none."""
    efforts: list[Effort] = []
    real = seeking.find_seeds

    def spied(*args: object) -> object:
        efforts.extend(arg for arg in args if isinstance(arg, Effort))
        return real(*args)

    monkeypatch.setattr(seeking, "find_seeds", spied)
    loaded = bundled("Follow")
    config = configured(predict={"kind": "constant_input", "safe_distance": 0.0})
    planner = Planner(task_of(loaded, loaded.problems[0]), config)
    seen = first_look(loaded)
    plan, asked = planner.plan(seen), []
    for step, nearer in ((3, 0.0), (6, 16.0), (9, 16.0)):  # the leader is where none was guessed
        efforts.clear()
        state, a = plan.trajectory.state_at(step), float(plan.trajectory.inputs[2, 0])
        boxes = seen.now.boxes.copy()
        way = boxes[:, Box.V] * step * planner.dt - nearer
        boxes[:, Box.X] += way * np.cos(boxes[:, Box.PSI])
        boxes[:, Box.Y] += way * np.sin(boxes[:, Box.PSI])
        now = replace(seen.now, step=step, boxes=boxes)
        plan = planner.plan(Observation(step, state, a, (now,)))
        assert plan.reaches_goal
        asked.append(list(efforts))
    assert asked == [[Effort.NEVER], [Effort.PLAIN], [Effort.NEVER]]


def test_a_new_plan_is_refined_the_whole_way_again():
    """In the second cycle, once at least; with 'settle' at 1 only what is near."""
    loaded = bundled("Oncoming")

    def lengths(settle: float) -> list[int]:
        """Steps of the problems of the second cycle."""
        problems: list[tuple[int, int]] = []
        config = configured(refine={"settle": settle}, drive={"steps_max": 6})

        def planner(task: Task, config: Config) -> Planner:
            return Planner(task, config, lambda problem, _: problems.append(
                (problem.seed.first_step, problem.n)
            ))  # fmt: skip

        drive(loaded, config, planner=planner)
        return [n for step, n in problems if step == 3]

    near = round(Config().refine.horizon / loaded.dt)
    assert set(lengths(1.0)) == {near}
    assert max(lengths(Config().refine.settle)) > near


def test_where_all_is_known_a_settled_plan_is_carried_on_without_new_seeds():
    """Nothing new can be learnt; where the others' motion is a guess seeds are sought as ever."""
    loaded = bundled("Oncoming")
    for given, anew in ((Config(), False), (BLIND, True)):
        traces = [cycle.plan.trace for cycle in drive(loaded, given).drives[0].cycles]
        later = [t for t in traces[3:] if t["source"].startswith("last plan")]
        assert later and all(bool(trace["seeds"]) is anew for trace in later)


def test_a_plan_that_gains_nothing_is_refined_only_once_a_cycle():
    """Wider margins than those that it keeps already would gain less."""
    loaded, steps = bundled("FreeRoad"), []

    def planner(task: Task, config: Config) -> Planner:
        return Planner(task, config, lambda problem, _: steps.append(problem.seed.first_step))

    cycles = drive(loaded, planner=planner).drives[0].cycles
    kept = [cycle.step for cycle in cycles if cycle.plan.source == KEPT]
    counts = [steps.count(step) for step in kept[1:]]
    assert 1 in counts and max(counts) == 1


@pytest.mark.parametrize("passes", [0.0, 0.2, 0.1, None])
def test_margins_are_widened_one_after_the_other_until_a_plan_passes(monkeypatch, passes):
    margins = (0.2, 0.1)
    config = configured(refine={"retry_margins": margins}, predict={"kind": "constant_input"})
    loaded, tried, real = bundled("Follow"), [], Developer._refined

    def refused_but_one(self, cycle, seed, extra, whole, aside=None):
        option = real(self, cycle, seed, extra, whole, aside)
        tried.append((id(seed), extra))
        if option is None:
            return None
        return replace(option, finding=Finding(extra == passes, "road", 3))

    monkeypatch.setattr(Developer, "_refined", refused_but_one)
    Planner(task_of(loaded, loaded.problems[0]), config).plan(first_look(loaded))
    first, all_of_them = [extra for seed, extra in tried if seed == tried[0][0]], [0.0, *margins]
    end = all_of_them.index(passes) + 1 if passes is not None else None
    assert first == all_of_them[:end]


def test_a_plan_that_cannot_reach_its_goal_ends_at_rest(tmp_path):
    plan = planned(walled(tmp_path, 34.0))
    assert not plan.reaches_goal and plan.finding.ok
    assert plan.trajectory.states[-1, State.V] == pytest.approx(0.0, abs=1e-6)


def test_the_trace_explains_a_plan_in_json():
    trace = json.loads(json.dumps(planned(bundled("Follow")).trace))
    assert trace["source"] == trace["chosen"]["source"]
    assert trace["seeds"]["lattice"]["candidates"] > 1000
    assert trace["seeds"]["lattice"]["rejected"]["collision"]["obstacle"] > 0
    assert {"status", "iterations", "kkt", "tr1_before", "tr1_after"} <= set(trace["refine"])
    assert {"predict", "seed", "refine", "verify", "total"} <= set(trace["times_ms"])
    assert trace["verify"]["ok"] is True


def test_without_refinement_the_lattice_drives_alone():
    plan = planned(bundled("FreeRoad"), configured(refine={"enabled": False}))
    assert plan.source in ("lattice", "search") and plan.finding.ok
    assert plan.trace["refine"] is None and plan.trace["fallback"] is None


# -- determinism ----------------------------------------------------------------------------------


def test_two_planners_give_the_same_bits():
    a, b = planned(bundled("Follow")), planned(bundled("Follow"))
    assert a.trajectory.states.tobytes() == b.trajectory.states.tobytes()
    assert a.source == b.source


SHORT = configured(drive={"steps_max": 9})
FINGERPRINT = """
import hashlib, sys
from commonroad.common.solution import CommonRoadSolutionWriter
from mpcplan import drive, load
run = drive(load(sys.argv[1]))
text = CommonRoadSolutionWriter(run.solution()).dump()
print(hashlib.sha256(text.encode()).hexdigest())
"""


def test_two_drives_give_the_same_bytes():
    first, second = (drive(bundled("HardBrake"), SHORT) for _ in range(2))
    assert solution_bytes(first) == solution_bytes(second)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["TimeOnly", "CutIn"])
def test_a_fresh_process_with_another_hash_seed_gives_the_same_bytes(name):
    here = hashlib.sha256(solution_bytes(drive(bundled(name)))).hexdigest()
    path = str(FOLDER / f"ZAM_{name}-1_1_T-1.xml")
    for seed in ("1", "4711"):
        done = subprocess.run(
            [sys.executable, "-c", FINGERPRINT, path], capture_output=True, text=True, check=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        )  # fmt: skip
        assert done.stdout.split()[-1] == here


# -- no future ------------------------------------------------------------------------------------


def nonsense_after(loaded: LoadedScenario, step: int) -> LoadedScenario:
    """The scenario with all recorded futures after a step replaced by nonsense."""
    for obstacle in loaded.scenario.dynamic_obstacles:
        for state in obstacle.prediction.trajectory.state_list:
            if state.time_step > step:
                state.position = loaded.problems[0].start[:2] + np.array([1.0, 0.5])
                state.orientation, state.velocity = 2.0, 30.0
    return loaded


@pytest.mark.parametrize("name", ["CutIn", "HardBrake"])
def test_with_constant_input_a_plan_depends_on_the_observation_alone(name):
    seen = first_look(bundled(name))
    plans = []
    for loaded in (bundled(name), nonsense_after(bundled(name), 0)):
        plans.append(Planner(task_of(loaded, loaded.problems[0]), BLIND).plan(seen))
    assert np.array_equal(plans[0].trajectory.states, plans[1].trajectory.states)
    assert plans[0].trace["seeds"] == plans[1].trace["seeds"]


def test_with_constant_input_a_drive_does_not_see_what_comes():
    config = BLIND.model_copy(update={"drive": SHORT.drive})
    honest = drive(bundled("CutIn"), config)
    fooled = drive(nonsense_after(bundled("CutIn"), 9), config)
    assert solution_bytes(honest) == solution_bytes(fooled)
    assert honest.drives[0].trajectory.last_step == 9


def test_with_the_record_it_does():
    """The counterpart: the same change shows at once where the record is the prediction."""
    honest, fooled = planned(bundled("CutIn")), planned(nonsense_after(bundled("CutIn"), 9))
    states = honest.trajectory.states, fooled.trajectory.states
    assert states[0].shape != states[1].shape or not np.array_equal(*states)


def test_observations_in_the_loop_hold_past_and_present_only(monkeypatch):
    seen: list[Observation] = []
    plan = Planner.plan

    def watched(self: Planner, observation: Observation) -> Plan:
        seen.append(observation)
        return plan(self, observation)

    monkeypatch.setattr(Planner, "plan", watched)
    run = drive(bundled("TimeOnly"), configured(drive={"steps_max": 15}))
    driven = run.drives[0].trajectory
    assert [observation.step for observation in seen] == [0, 3, 6, 9, 12]
    for observation in seen:
        steps = [snapshot.step for snapshot in observation.others]
        first = max(0, observation.step - HISTORY)
        assert steps == list(range(first, observation.step + 1))
        assert np.array_equal(observation.state, driven.state_at(observation.step))
        if observation.step:
            assert observation.acceleration == driven.inputs[observation.step - 1, 0]


# -- fallbacks ------------------------------------------------------------------------------------


def after_one_cycle(wall: np.ndarray | None) -> tuple[Plan, Plan]:
    """Plans before and after something stands on the free road where nothing was."""
    loaded = bundled("FreeRoad")
    planner = Planner(task_of(loaded, loaded.problems[0]), BLIND)
    first = planner.plan(first_look(loaded))
    state = first.trajectory.state_at(3)
    ids, boxes = ((), np.empty((0, 6))) if wall is None else ((99,), wall[None])
    history = (Snapshot(0, (), np.empty((0, 6))), Snapshot(3, ids, boxes))
    acceleration = float(first.trajectory.inputs[2, 0])
    return first, planner.plan(Observation(3, state, acceleration, history))


def in_front(distance: float, length: float = 2.0) -> np.ndarray:
    """A wall across both lanes this far ahead of the bumper of the vehicle at step 3."""
    start = bundled("FreeRoad").problems[0].start
    psi = start[State.PSI]
    ahead, left = np.array([np.cos(psi), np.sin(psi)]), np.array([-np.sin(psi), np.cos(psi)])
    way = 3 * 0.1 * start[State.V] + FORD_ESCORT.front + distance + length / 2
    x, y = start[:2] + way * ahead + 1.75 * left
    return np.array([x, y, psi, 0.0, length, 7.0])


def test_without_a_surprise_the_last_plan_goes_on():
    second = after_one_cycle(None)[1]
    assert second.finding.ok and second.trace["fallback"] is None
    assert second.trace["source"].startswith("last plan")
    assert second.trajectory.first_step == 3


def test_a_wall_far_ahead_is_stopped_for():
    _, plan = after_one_cycle(in_front(25.0))
    assert plan.finding.ok
    gap = separation(plan.trajectory.states, in_front(25.0)[None, None])
    assert gap.min() > 0.0
    assert plan.trajectory.states[-1, State.V] < 0.1  # the goal is time alone: nearly at rest


def test_a_wall_too_close_is_braked_for_as_hard_as_possible():
    _, plan = after_one_cycle(in_front(3.0))
    assert not plan.finding.ok and plan.finding.obstacle == 99
    assert plan.trajectory.inputs[:3, 0].max() < -7.5
    assert plan.trace["fallback"] is not None and "obstacle 99" in plan.trace["fallback"]


def test_a_wall_just_close_enough_leads_to_emergency_braking_or_a_stop():
    """12 m/s: 8 m/s^2 needs 9 m, the lattice's gentlest stops need more."""
    _, plan = after_one_cycle(in_front(9.6))
    assert plan.finding.ok
    assert separation(plan.trajectory.states, in_front(9.6)[None, None]).min() > 0.0


def test_failed_subproblems_fall_back_to_the_seed_and_say_so(monkeypatch):
    def failing(self: QpSolver, *_: object) -> Answer:
        return Answer(np.zeros(1), np.zeros(1), "failed", 0)

    monkeypatch.setattr(QpSolver, "solve", failing)
    plan = planned(bundled("Follow"))
    assert plan.finding.ok
    assert plan.source.endswith("unrefined")
    assert plan.trace["fallback"].startswith("the seed is driven")
    assert "failed" in plan.trace["fallback"]


def test_after_emergency_braking_planning_starts_afresh():
    loaded = bundled("FreeRoad")
    planner = Planner(task_of(loaded, loaded.problems[0]), BLIND)
    wall = Snapshot(0, (99,), in_front(-0.6)[None])
    braking = planner.plan(Observation(0, loaded.problems[0].start, 0.0, (wall,)))
    assert not braking.finding.ok
    state = braking.trajectory.state_at(3)
    free = Snapshot(3, (), np.empty((0, 6)))
    plan = planner.plan(Observation(3, state, -8.0, (free,)))
    assert plan.finding.ok and plan.source.startswith(("lattice", "search"))


def test_the_last_step_of_a_plan_is_still_driven():
    loaded = bundled("StopInGoal")
    planner = Planner(task_of(loaded, loaded.problems[0]))
    first = planner.plan(first_look(loaded))
    assert first.reaches_goal
    end = first.trajectory.last_step
    traffic = RecordedTraffic(loaded.scenario)
    state, before = first.trajectory.state_at(end - 1), first.trajectory.inputs[-2, 0]
    plan = planner.plan(Observation(end - 1, state, float(before), (traffic.at(end - 1),)))
    assert plan.reaches_goal and plan.source == "last plan kept"
    assert np.array_equal(plan.trajectory.states, first.trajectory.states[-2:])


def blocked(folder: Path, kind: str) -> Plan:
    """A plan where both lanes are taken 35 m ahead, and the goal lies behind."""
    goal = made.goal(Rectangle(10, 3, made.at(70, made.LANE / 2)), 75)
    problem = made.problem(100, made.state(10, made.LANE / 2, 8), goal)
    loaded = load(made.write(folder, problem, obstacles=[]))
    task = replace(task_of(loaded, loaded.problems[0]), recorded=None)
    x, y, psi = loaded.problems[0].start[[State.X, State.Y, State.PSI]]
    boxes = np.array([[x + 35, y + side, psi, 0.0, 4.5, 2.5] for side in (0.0, made.LANE)])
    seen = tuple(Snapshot(step, (1, 2), boxes, (kind, kind)) for step in range(-5, 1))
    config = configured(verify={"waiting": False}, predict={"safe_distance": 0.0})
    return Planner(task, config).plan(Observation(0, loaded.problems[0].start, 0.0, seen))


def test_the_goal_is_not_given_up_for_cars_that_stand_in_the_way_now(tmp_path):
    """They may drive on; until they do, every plan can be broken off before them."""
    plan = blocked(tmp_path, "car")
    assert plan.reaches_goal and plan.finding.ok and plan.trace["fallback"] is None
    assert plan.source.startswith(HOPEFUL) and plan.trajectory.last_step > 30


def test_what_will_never_move_is_no_hope(tmp_path):
    plan = blocked(tmp_path, "parkedVehicle")
    assert plan.finding.ok and not plan.reaches_goal


@pytest.mark.parametrize(("kept", "reaches"), [((6.0,), True), ((), False)])
def test_the_last_moment_asks_for_accelerations_that_are_kept_for_it(tmp_path, kept, reaches):
    """Both lanes are taken for two seconds; after that only hard acceleration is in time."""
    sides = (made.LANE / 2, 1.5 * made.LANE)
    taken = [made.car(30 + k, 30, y, 0.0, steps=20) for k, y in enumerate(sides)]
    start, goal = made.state(10, made.LANE / 2, 4), made.goal(Rectangle(10, 3, made.at(56, 2)))
    loaded = load(made.write(tmp_path, made.problem(9, start, goal), obstacles=taken))
    plan = planned(loaded, configured(seed={"last_accelerations": kept}))
    assert plan.finding.ok and plan.reaches_goal == reaches
    assert plan.source.startswith(LAST_MOMENT) == reaches


def test_nobody_accelerates_as_in_the_last_moment_while_another_plan_reaches_the_goal():
    for name in ("Follow", "CutIn", "Merge"):
        plan = planned(bundled(name))
        assert plan.reaches_goal and not plan.source.startswith(LAST_MOMENT)
        told = [option["source"] for option in plan.trace["options"]]
        assert not any(source.startswith(LAST_MOMENT) for source in told)


def test_the_last_moment_adds_accelerations_once():
    config = configured(seed={"search_actions": (-3.0, 0.0, 3.0), "last_accelerations": (6.0, 3.0)})
    assert in_the_last_moment(config).seed.search_actions == (-3.0, 0.0, 3.0, 6.0)
    none = configured(seed={"last_accelerations": ()})
    assert in_the_last_moment(none) is none


# -- closed loop ----------------------------------------------------------------------------------


def walled(folder: Path, x: float) -> LoadedScenario:
    """The straight road with a wall across both lanes, and the goal behind it."""
    shape = Rectangle(2.0, 7.0)
    wall = StaticObstacle(55, ObstacleType.CONSTRUCTION_ZONE, shape, made.state(x, made.LANE, 0))
    problem = made.problem(100, made.state(10, made.LANE / 2, 10), made.rectangle_goal(x + 12.0))
    return load(made.write(folder, problem, obstacles=[wall]))


def test_an_infeasible_problem_leaves_a_cause(tmp_path):
    run = drive(walled(tmp_path, 34.0))
    driven = run.drives[0]
    assert not run.solved and driven.reached_step is None and not driven.collided
    assert run.cause.startswith("the goal was not reached at step 40; ")
    assert "with obstacle 55" in run.cause
    assert driven.cycles[-1].plan.finding.ok  # what is left of the way leads to a stop
    assert driven.trajectory.states[-1, State.V] < 3.0


@pytest.mark.parametrize(
    ("gap", "v", "driven"),
    [
        (3.6, 10.0, "a plan that trusts who follows is driven"),
        (2.0, 13.0, "no plan is safe to its end; the one safe longest is driven"),
    ],
)
def test_before_braking_a_plan_is_driven_that_trusts_who_follows(tmp_path, gap, v, driven):
    """A guess in which who follows never brakes runs into whatever the vehicle does."""
    start = made.state(40, made.LANE / 2, 10)
    follower = made.car(30, 40 - (FORD_ESCORT.length + 4.5) / 2 - gap, made.LANE / 2, v, steps=80)
    goal = made.goal(Rectangle(10, 3, made.at(120, made.LANE / 2)), end=110)
    path = made.write(tmp_path, made.problem(9, start, goal), obstacles=[follower])
    blind = {"kind": "constant_input", "horizon": 12.0, "reserve": 0.0, "haste": 0.0}
    # accelerating as in the last moment would be trusted, too
    config = configured(predict=blind, seed={"last_accelerations": ()})
    plan = planned(load(path), config)
    assert plan.trace["fallback"].startswith(f"{driven}: ")
    assert "collision with obstacle 30" in plan.trace["fallback"]


def test_a_goal_out_of_reach_leaves_the_candidates_as_the_cause(tmp_path):
    """Nothing is in the way; the goal is 80 m ahead and due within 4 s."""
    start = made.state(10, made.LANE / 2, 5)
    path = made.write(tmp_path, made.problem(100, start, made.rectangle_goal(90)), obstacles=[])
    cause = drive(load(path)).cause
    assert cause.startswith("the goal was not reached at step 40; no plan reached the goal")
    assert "candidates of the lattice were drivable, 0 reached the goal" in cause
    assert "refused by" in cause


def test_a_collision_that_cannot_be_helped_ends_the_drive_with_its_cause(tmp_path):
    run = drive(walled(tmp_path, 15.5))
    driven = run.drives[0]
    assert driven.collided and not run.solved
    assert driven.cause.startswith(f"collided at step {driven.trajectory.last_step}")
    assert "fallback at step 0" in driven.cause and "obstacle 55" in driven.cause
    assert driven.trajectory.inputs[0, 0] < -7.0


def test_no_road_leaves_its_error_as_the_cause(tmp_path):
    start = made.state(150, made.LANE / 2, 10)
    path = made.write(tmp_path, made.problem(100, start, made.rectangle_goal(50)))
    run = drive(load(path))
    assert run.cause.startswith("planning problem 100: no route from lanelets [3]")
    assert run.drives[0].cycles == () and len(run.drives[0].trajectory) == 1
    assert run.trace()["drives"][0]["cause"] == run.cause


def test_the_drive_ends_at_the_first_step_in_the_goal(tmp_path):
    goal = made.rectangle_goal(45)
    run = drive(load(made.write(tmp_path, made.problem(9, made.state(10, 1.75, 10), goal))))
    driven, problem = run.drives[0], run.loaded.problems[0].planning_problem
    assert run.solved and run.cause == ""
    assert driven.reached_step == driven.trajectory.last_step
    reached = [
        is_reached(problem, state, int(step))
        for step, state in zip(driven.trajectory.steps, driven.trajectory.states, strict=True)
    ]
    assert reached[-1] and not any(reached[:-1])


@pytest.mark.parametrize(("replan", "expected"), [(0.1, [0, 1, 2, 3, 4, 5]), (0.5, [0, 5])])
def test_cycles_come_at_the_configured_interval(replan, expected):
    config = configured(drive={"replan": replan, "steps_max": 6 if replan == 0.1 else 10})
    run = drive(bundled("FreeRoad"), config)
    assert [cycle.step for cycle in run.drives[0].cycles] == expected
    assert run.drives[0].trajectory.last_step == config.drive.steps_max
    assert run.planning_ms.shape == (len(expected),) and (run.planning_ms > 0).all()


def test_what_is_driven_is_what_was_planned():
    run = drive(bundled("FreeRoad"), SHORT)
    driven = run.drives[0].trajectory
    for cycle in run.drives[0].cycles:
        plan = cycle.plan.trajectory
        for step in range(cycle.step, min(cycle.step + 3, driven.last_step) + 1):
            assert np.array_equal(plan.state_at(step), driven.state_at(step))


def test_progress_is_told_after_every_cycle():
    told: list[tuple[int, int]] = []
    drive(bundled("FreeRoad"), SHORT, lambda step, last: told.append((step, last)))
    assert told == [(3, 9), (6, 9), (9, 9)]


def test_every_problem_of_a_scenario_is_driven():
    loaded = load(FOLDER / "C-ZAM_ParallelEgos-1_1_T-1.xml")
    run = drive(loaded, SHORT)
    assert [d.problem_id for d in run.drives] == [problem.id for problem in loaded.problems]
    assert "problem 2001: " in run.cause and "problem 2002: " in run.cause


def test_standing_still_is_a_plan(tmp_path):
    """At rest behind a wall, with a goal of time alone: wait."""
    wall = StaticObstacle(
        55, ObstacleType.CONSTRUCTION_ZONE, Rectangle(2, 7), made.state(17, made.LANE, 0)
    )
    problem = made.problem(100, made.state(10, made.LANE / 2, 0.0), made.goal(end=30))
    run = drive(load(made.write(tmp_path, problem, obstacles=[wall])))
    assert run.solved
    moved = np.ptp(run.drives[0].trajectory.states[:, State.X])
    assert moved < 2.5
    assert run.drives[0].trajectory.states[:, State.V].min() >= 0.0
