"""Planners that are not ours: found by name, given what they may know, checked, never a crash."""

import gc
import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from types import FunctionType, ModuleType
from typing import ClassVar

import numpy as np
import pytest
from commonroad.common.solution import CommonRoadSolutionWriter
from commonroad.prediction.prediction import Prediction
from commonroad.scenario.obstacle import Obstacle
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcplan.baselines.constant_velocity import ConstantVelocity
from mpcplan.config import Config
from mpcplan.errors import InputError, PlannerError, RoadError
from mpcplan.observation import Forecast, Observation, Snapshot
from mpcplan.planner import Planner
from mpcplan.scenario import LoadedScenario, load
from mpcplan.simulate.foreign import ForeignDriver, load_planner, sealed
from mpcplan.simulate.foreign_states import as_driven
from mpcplan.simulate.loop import drive
from mpcplan.simulate.recorded import RecordedTraffic
from mpcplan.simulate.run import Run
from mpcplan.task import task_of
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import simulate
from mpcplan.verify.drivability import check_kinematics

ROOT = Path(__file__).resolve().parents[1]
FILE = ROOT / "scenarios" / "ZAM_FreeRoad-1_1_T-1.xml"
DT = 0.1


@cache
def free_road() -> LoadedScenario:
    """An empty straight road."""
    return load(FILE)


def driven_by(make: type) -> Run:
    """The empty road driven by a foreign class."""
    return drive(free_road(), planner=partial(ForeignDriver, make))


def straight_on(observation: Observation, steps: int = 30) -> Array:
    """States at constant speed and steering angle."""
    return simulate(observation.state, np.zeros((steps, 2)), DT).states


class StraightOn:
    """The least planner that works on a straight road; the others below break one thing of it."""

    def __init__(self, task, config):
        self.task = task

    def plan(self, observation):
        return self.changed(straight_on(observation), observation)

    def changed(self, states, observation):
        return states


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty current directory whose modules are forgotten afterwards."""
    known = set(sys.modules)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [p for p in sys.path if p not in ("", str(ROOT))])
    yield tmp_path
    for name in set(sys.modules) - known:
        if str(getattr(sys.modules[name], "__file__", "")).startswith(str(tmp_path)):
            del sys.modules[name]


# -- the class behind a name ------------------------------------------------------------------


@pytest.mark.parametrize("spec", ["mpcplan", "mpcplan:Planner", "mpcplan.planner:Planner"])
def test_our_own_planner_is_not_wrapped(spec):
    assert load_planner(spec) is Planner


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("", "expected package.module:Class"),
        ("idn", "or one of mpcplan, constant_velocity, idm"),
        ("a.b:", "expected package.module:Class"),
        (":B", "expected package.module:Class"),
        ("a:b:C", "expected package.module:Class"),
        ("folder/file.py:C", "expected package.module:Class"),
        ("a..b:C", "expected package.module:Class"),
        ("1a:C", "expected package.module:Class"),
        ("no_such_module:C", "no module no_such_module; install it, or start in the folder"),
        ("json.no_such_part:C", "no module json.no_such_part;"),
        ("os:Nothing", "module os has no Nothing"),
        ("mpcplan.baselines.idm:Idm", "has no Idm; it has IdmPurePursuit"),
        ("os:getcwd", "getcwd is a builtin_function_or_method, not a class"),
        ("builtins:dict", "class dict has no method plan(observation)"),
        ("mpcplan.simulate.foreign_class:SHIPPED", "SHIPPED is a dict, not a class"),
    ],
)
def test_bad_specs_say_what_is_wrong(spec, words):
    with pytest.raises(InputError) as caught:
        load_planner(spec)
    assert f"planner {spec!r}" in str(caught.value) and words in str(caught.value)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("def f(:\n", "SyntaxError"),
        ("import no_such_dependency\n", "its import failed: ModuleNotFoundError"),
        ("from json import nothing_there\n", "ImportError: cannot import name 'nothing_there'"),
        ("x = 1\ny = x / 0\n", "ZeroDivisionError: division by zero (broken_here.py:2)"),
        ("import sys\nsys.exit(3)\n", "SystemExit: 3 (broken_here.py:2)"),
        ("raise RuntimeError('one\\ntwo')\n", "RuntimeError: one two (broken_here.py:1)"),
    ],
)
def test_modules_that_cannot_be_imported(here, source, words):
    (here / "broken_here.py").write_text(source)
    with pytest.raises(InputError) as caught:
        load_planner("broken_here:C")
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_a_module_of_the_current_directory_is_found(here):
    (here / "mine").mkdir()
    (here / "mine" / "own.py").write_text("class A:\n    def plan(self, observation): ...\n")
    make = load_planner("mine.own:A")
    assert make.args[0].__name__ == "A"


# -- what a planner knows -------------------------------------------------------------------------


class Spy(StraightOn):
    """Keeps what it is given."""

    seen: ClassVar[list] = []

    def __init__(self, task, config):
        super().__init__(task, config)
        Spy.seen = [task]

    def changed(self, states, observation):
        Spy.seen.append(observation)
        return states


def reachable(start: object) -> list[object]:
    """All objects that can be reached from one, without going through code."""
    found, queue = {}, [start]
    while queue:
        value = queue.pop()
        if id(value) in found or isinstance(value, type | ModuleType | FunctionType):
            continue
        found[id(value)] = value
        queue.extend(gc.get_referents(value))
    return list(found.values())


def test_task_and_observation_are_all_there_is():
    loaded = load(FILE.with_name("ZAM_Follow-1_1_T-1.xml"))
    assert loaded.scenario.obstacles
    drive(loaded, planner=partial(ForeignDriver, Spy))
    task, *observations = Spy.seen
    assert isinstance(task.recorded, Forecast) and len(observations) > 3
    hidden = (Obstacle, Prediction, RecordedTraffic, LoadedScenario)
    assert not [v for v in reachable(Spy.seen) if isinstance(v, hidden)]
    assert [v for v in reachable(loaded) if isinstance(v, Obstacle)]  # it would be found
    assert all(o.now.step == o.step == o.others[-1].step for o in observations)


def test_interactive_tasks_hold_no_trajectory():
    loaded = load(FILE.with_name("ZAM_Follow-1_1_T-1.xml"))
    interactive = replace(loaded, folder=object())
    task = task_of(interactive, interactive.problems[0])
    ForeignDriver(Spy, task, Config())
    assert Spy.seen[0].recorded is None
    hidden = (Obstacle, Prediction, Forecast, LoadedScenario)
    assert not [v for v in reachable(Spy.seen) if isinstance(v, hidden)]
    for lanelet in Spy.seen[0].road_map.lanelet_network.lanelets:
        assert not lanelet.dynamic_obstacles_on_lanelet and not lanelet.static_obstacles_on_lanelet


def test_a_planner_cannot_change_the_world():
    class Vandal(StraightOn):
        def __init__(self, task, config):
            task.road_map.translate_rotate(np.array([5.0, 5.0]), 1.0)
            task.problem.planning_problem.goal.state_list.clear()
            task.problem.start[:] = 7.0

    loaded = load(FILE)
    run = drive(loaded, planner=partial(ForeignDriver, Vandal))
    assert run.solved and np.array_equal(
        run.drives[0].trajectory.states[0], free_road().problems[0].start
    )
    lane, same = (s.scenario.lanelet_network.lanelets[0] for s in (loaded, free_road()))
    assert np.array_equal(lane.center_vertices, same.center_vertices)


def test_an_observation_cannot_be_written_to():
    boxes = np.ones((1, 6))
    seen = Observation(3, np.ones(5), 0.5, (Snapshot(3, (7,), boxes, ("car",)),))
    copy = sealed(seen)
    for values in (copy.state, copy.now.boxes):
        with pytest.raises(ValueError, match="read-only"):
            values[:] = 0.0
    assert copy.step == 3 and copy.acceleration == 0.5 and copy.now.kind_of(7) == "car"
    assert seen.state.flags.writeable and boxes.flags.writeable


# -- what is checked ------------------------------------------------------------------------------

NOW = Observation(
    20, np.array([3.0, -2.0, 0.05, 8.0, 0.4]), 0.0, (Snapshot(20, (), np.empty((0, 6))),)
)


def good() -> Array:
    """States that the vehicle can drive from NOW."""
    inputs = np.column_stack([np.linspace(-2.0, 1.0, 12), np.linspace(0.3, -0.3, 12)])
    return simulate(NOW.state, inputs, DT).states


def with_value(k: int, column: State, value: float) -> Callable[[Array], Array]:
    """States with another value."""

    def change(states: Array) -> Array:
        states[k, column] = value
        return states

    return change


def shifted(k: int, column: State, by: float) -> Callable[[Array], Array]:
    """States with a jump before row k."""

    def change(states: Array) -> Array:
        states[k:, column] += by
        return states

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (with_value(4, State.V, np.nan), "v is nan at step 24"),
        (with_value(0, State.Y, np.inf), "y is inf at step 20"),
        (shifted(5, State.X, 0.02), "x at step 25 is 0.02 m from where the kinematic"),
        (shifted(5, State.Y, -3.0), "y at step 25 is 3 m from where"),
        (shifted(1, State.PSI, 0.05), "psi at step 21 is 0.05 rad from where"),
        (shifted(0, State.X, 0.5), "the first state must be the present one"),
        (lambda states: states[1:], "the first state must be the present one"),
        (lambda states: states[:1], "only the present state was returned, at 8 m/s"),
        (shifted(6, State.V, 3.0), "acceleration"),
        (shifted(6, State.V, -3.0), "braking"),
        (shifted(6, State.DELTA, 0.08), "steering rate"),
        (lambda states: np.repeat(states, 2, axis=0), "x at step 21 is"),
    ],
)
def test_states_that_cannot_be_driven(change, words):
    with pytest.raises(PlannerError) as caught:
        as_driven(change(good()), NOW, DT)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("state", "inputs", "words"),
    [
        ((0, 0, 0.88, 1.0, 0), np.full((2, 2), (0.0, 0.3)), "steering angle 0.03 rad over the"),
        ((0, 0, 0, 0.1, 0), np.full((3, 2), (-1.0, 0.0)), "speed 0.1 m/s over the limit at step 2"),
        ((0, 0, 0.2, 13.0, 0), np.zeros((3, 2)), "friction 2.82 m/s^2 over the limit at step 20"),
        ((0, 0, 0, 20.0, 0), np.full((3, 2), (3.0, 0.0)), "acceleration 0.306 m/s^2 over"),
    ],
)
def test_limits_are_named(state, inputs, words):
    seen = Observation(20, np.array(state, float), 0.0, NOW.others)
    with pytest.raises(PlannerError) as caught:
        as_driven(simulate(seen.state, inputs, DT).states, seen, DT)
    assert words in str(caught.value)


@given(
    a=st.lists(st.floats(-6.0, 2.0), min_size=1, max_size=15),
    w=st.floats(-0.39, 0.39),
    v=st.floats(9.0, 12.0),
    row=st.integers(1, 15),
    column=st.sampled_from([State.X, State.Y, State.PSI]),
    jump=st.sampled_from([-1.0, -0.03, 0.03, 1.0]),
)
@settings(max_examples=60, deadline=None)
def test_the_models_own_states_pass_and_jumps_do_not(a, w, v, row, column, jump):
    seen = Observation(0, np.array([0.0, 0.0, 0.0, v, 1.0]), 0.0, NOW.others)
    inputs = np.column_stack([np.array(a), w * (-1.0) ** np.arange(len(a))])
    states = simulate(seen.state, inputs, DT).states
    if states[:, State.V].min() < 0:
        return
    assert np.allclose(as_driven(states, seen, DT).states, states, rtol=0, atol=1e-9)
    k = min(row, len(a))
    states[k:, column] += jump
    with pytest.raises(PlannerError, match=f"{column.name.lower()} at step {k} is"):
        as_driven(states, seen, DT)


def test_what_is_driven_is_the_model_itself():
    states = good()
    exact = simulate(NOW.state, np.diff(states[:, [State.V, State.DELTA]], axis=0) / DT, DT, 20)
    states[1:, State.X] += 0.004 * (-1.0) ** np.arange(12)
    states[3:, State.PSI] += 2 * np.pi
    states[0, State.PSI] -= 4 * np.pi
    driven = as_driven(states, NOW, DT)
    assert driven.first_step == 20 and np.array_equal(driven.states, exact.states)
    assert check_kinematics(driven, 1e-12).ok


def test_at_rest_the_present_state_is_enough():
    class Waits:
        def __init__(self, task, config):
            pass

        def plan(self, observation):
            return observation.state[None]

    loaded = load(FILE.with_name("ZAM_StandingStart-1_1_T-1.xml"))
    (driven,) = drive(loaded, planner=partial(ForeignDriver, Waits)).drives
    assert driven.trajectory.last_step == 120 and not driven.collided
    assert np.array_equal(driven.trajectory.states[-1], driven.trajectory.states[0])
    assert driven.cause.startswith("the goal was not reached at step 120; no plan reached the goal")


# -- planners that fail ---------------------------------------------------------------------------


def answering(answer: object) -> type:
    """A planner that answers something else."""

    class Answers(StraightOn):
        def changed(self, states, observation):
            return answer

    return Answers


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (None, "plan() returned a NoneType of shape ()"),
        ("forward", "plan() returned a str that is no array of numbers"),
        ([[1, 2], [3]], "plan() returned a list that is no array of numbers"),
        ([], "plan() returned a list of shape (0,); expected (n, 5) states: x, y, delta, v, psi"),
        (np.zeros((0, 5)), "of shape (0, 5)"),
        (np.zeros((4, 4)), "of shape (4, 4)"),
        (np.zeros(5), "of shape (5,)"),
        (np.zeros((2, 3, 5)), "of shape (2, 3, 5)"),
        (np.full((3, 5), np.nan), "x is nan at step 0"),
        ({"states": 1}, "plan() returned a dict"),
        (np.zeros((3, 5)), "the first state must be the present one"),
    ],
)
def test_garbage_is_a_cause(answer, words):
    run = driven_by(answering(answer))
    (driven,) = run.drives
    assert not run.solved and driven.cycles == () and len(driven.trajectory) == 1
    assert driven.cause.startswith("Answers, step 0: ") and words in driven.cause


class Teleports(StraightOn):
    """Jumps in its fifth cycle."""

    def changed(self, states, observation):
        states[2:, State.X] += 5.0 * (observation.step >= 12)
        return states


class Raises(StraightOn):
    """Fails in its fifth cycle, in a function that it calls."""

    def changed(self, states, observation):
        return states if observation.step < 12 else self.fail()

    def fail(self):
        raise KeyError("lane\nof nobody")


class Leaves(StraightOn):
    """Ends the process, as it thinks."""

    def changed(self, states, observation):
        sys.exit("done")


class Refuses(StraightOn):
    """Raises one of the package's own errors, as build_roads does."""

    def __init__(self, task, config):
        raise RoadError("no route from here")


class Fails(StraightOn):
    """Cannot be built."""

    def __init__(self, task):
        pass


class Unsettled(StraightOn):
    """Its own word on safety fails."""

    def still_safe(self, observation):
        return 1 / 0


@pytest.mark.parametrize(
    ("make", "steps", "words"),
    [
        (Teleports, 12, "Teleports, step 12: x at step 14 is 5 m from where the kinematic"),
        (Raises, 12, "Raises failed at step 12: KeyError: 'lane\\nof nobody' (test_foreign.py:"),
        (Leaves, 0, "Leaves failed at step 0: SystemExit: done (test_foreign.py:"),
        (Refuses, 0, "no route from here"),
        (Fails, 0, "Fails failed at set-up: TypeError: "),
        (Unsettled, 0, "Unsettled failed at step 1: ZeroDivisionError: division by zero (test_"),
    ],
)
def test_failures_are_causes_and_what_was_driven_stays(make, steps, words):
    run = driven_by(make)
    (driven,) = run.drives
    assert not run.solved and driven.trajectory.last_step == steps
    assert driven.cause.startswith(words) and "\n" not in driven.cause
    json.dumps(run.trace(), allow_nan=False)


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
def test_what_is_no_fault_of_the_planner_goes_on(error):
    class Stopped(StraightOn):
        def changed(self, states, observation):
            raise error

    with pytest.raises(error):
        driven_by(Stopped)


# -- what a planner tells -------------------------------------------------------------------------


def test_the_trace_of_a_planner_is_kept():
    class Talks(StraightOn):
        def changed(self, states, observation):
            self.trace = {"gap": np.float32(2.5), "path": states[:2, :2], "why": {1: FILE}}
            return states

    run = driven_by(Talks)
    cycle = run.trace()["drives"][0]["cycles"][2]
    assert cycle["step"] == 6 and cycle["source"] == "Talks" and cycle["fallback"] is None
    assert cycle["planner"]["gap"] == 2.5 and cycle["planner"]["why"] == {"1": str(FILE)}
    assert np.shape(cycle["planner"]["path"]) == (2, 2)
    assert set(cycle["times_ms"]) == {"plan", "verify", "total"}
    json.dumps(run.trace(), allow_nan=False)


def test_the_trace_has_the_fields_of_our_own():
    class Silent(StraightOn):
        pass

    loaded = free_road()
    own = Planner(task_of(loaded, loaded.problems[0]), Config())
    other = ForeignDriver(Silent, task_of(loaded, loaded.problems[0]), Config())
    now = RecordedTraffic(loaded.scenario).at(0)
    seen = Observation(0, loaded.problems[0].start, 0.0, (now,))
    ours, theirs = own.plan(seen).trace, other.plan(seen).trace
    assert set(ours) <= set(theirs) and set(theirs) - set(ours) == {"planner"}
    assert set(ours["chosen"]) == set(theirs["chosen"])


@pytest.mark.parametrize("trace", [{"x": np.nan}, {(1, 2): 3}, [1, 2]])
def test_a_trace_that_is_no_json_does_no_harm(trace):
    class Talks(StraightOn):
        pass

    Talks.trace = trace
    run = driven_by(Talks)
    assert run.solved
    told = run.trace()["drives"][0]["cycles"][0]["planner"]
    assert told == {"trace": [1, 2]} if isinstance(trace, list) else "no JSON" in told["left out"]


def test_reasons_enter_the_cause():
    class Brakes(StraightOn):
        trace: ClassVar[dict] = {"fallback": "nothing was free"}

        def plan(self, observation):
            v = observation.state[State.V]
            return simulate(observation.state, np.array([[max(-8.0, -v / DT), 0.0]]), DT).states

    loaded = load(FILE.with_name("ZAM_Follow-1_1_T-1.xml"))
    run = drive(loaded, planner=partial(ForeignDriver, Brakes))
    assert not run.solved and "first fallback at step 0: nothing was free" in run.cause


def test_its_own_word_on_safety_counts():
    class Unsafe(StraightOn):
        def still_safe(self, observation):
            return False

    steps = [cycle.step for cycle in driven_by(Unsafe).drives[0].cycles]
    assert steps == list(range(len(steps)))
    steps = [cycle.step for cycle in driven_by(StraightOn).drives[0].cycles]
    assert steps == list(range(0, 3 * len(steps), 3))


def test_whether_a_plan_reaches_the_goal_is_known():
    cycles = driven_by(StraightOn).drives[0].cycles
    assert [c.plan.reaches_goal for c in cycles] == [c.step + 30 >= 60 for c in cycles]


# -- the documented example and the command line ---------------------------------------------------


def solution_bytes(run: Run) -> bytes:
    """The solution file of a run."""
    return CommonRoadSolutionWriter(run.solution()).dump().encode()


def test_the_documented_example_is_the_shipped_one(here):
    text = (ROOT / "docs" / "planners.md").read_text(encoding="utf-8")
    example = text.split('```python title="my_planner.py"\n')[1].split("```")[0]
    (here / "my_planner.py").write_text(example)
    make = load_planner("my_planner:ConstantVelocity")
    assert make.args[0] is not ConstantVelocity
    name = FILE.with_name("ZAM_SBend-1_1_T-1.xml")
    theirs, ours = (drive(load(name), planner=p) for p in (make, load_planner("constant_velocity")))
    assert theirs.solved and solution_bytes(theirs) == solution_bytes(ours)
    body = example.split("class ConstantVelocity:\n")[1]
    assert len([line for line in body.splitlines() if line.strip()]) <= 10


def call(cwd: Path, *args: object) -> subprocess.CompletedProcess[str]:
    """The installed command, which does not have the current directory on its path."""
    code = "import sys; from mpcplan.cli import entry; sys.path.remove(''); entry()"
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, args)], capture_output=True, text=True, cwd=cwd,
        env={**os.environ, "PYTHONPATH": path}, timeout=300, check=False,
    )  # fmt: skip


def test_a_bad_planner_is_bad_input(tmp_path):
    done = call(tmp_path, "solve", FILE, "--planner", "nobody:Home")
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("error: planner 'nobody:Home': there is no module nobody;")
    assert done.stderr.count("\n") == 1 and not list(tmp_path.iterdir())


@pytest.mark.slow
def test_solve_with_another_planner(tmp_path):
    done = call(tmp_path, "solve", FILE, "--planner", "idm")
    assert done.returncode == 0 and done.stderr == "", done.stderr
    assert done.stdout.startswith(f"{FILE.stem}: solved, valid\n")
    assert len(list((tmp_path / "out" / FILE.stem).iterdir())) == 3


@pytest.mark.slow
def test_solve_with_a_planner_that_raises(tmp_path):
    source = "class P:\n def __init__(self, task, config): print('hi')\n def plan(self, o): 1 / 0\n"
    (tmp_path / "mine.py").write_text(source)
    done = call(tmp_path, "solve", FILE, "--planner", "mine:P")
    assert done.returncode == 1 and done.stderr == ""
    assert done.stdout.startswith(
        f"{FILE.stem}: not solved: P failed at step 0: ZeroDivisionError: division by zero "
        "(mine.py:3)\n"
    )
