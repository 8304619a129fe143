"""Classes of one's own in the configuration: found, given what they may know, checked."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import made
import numpy as np
import pytest

from mpcplan.cli.classes import check_classes
from mpcplan.config import Config, PredictConfig
from mpcplan.config.files import load_config
from mpcplan.errors import ConfigError, InputError, PlannerError
from mpcplan.observation import Forecast, Observation, Snapshot
from mpcplan.predict.occupancy import occupancy
from mpcplan.predict.predictor import make_predictor
from mpcplan.refine.backends import EXACT, Answer, make_backend
from mpcplan.refine.compiled import functions
from mpcplan.refine.layout import layout
from mpcplan.scenario import load
from mpcplan.seed.foreign import Proposal, foreign_seeds
from mpcplan.seed.seed import Stage
from mpcplan.show.cycles import look_into
from mpcplan.simulate.loop import drive
from mpcplan.task import task_of

HERE = __name__
ROOT = Path(__file__).resolve().parents[1]
DT = 0.1


class Standing:
    """Everybody stands where it is, for a second."""

    tasks: list = []  # noqa: RUF012 (what the test looks at)

    def __init__(self, task, config):
        self.tasks.append((task, config))

    def __call__(self, observation):
        now = observation.now
        return Forecast(observation.step, now.ids, np.repeat(now.boxes[:, None], 11, axis=1))


class Broken:
    """Answers what its attribute says."""

    answer: object = None

    def __init__(self, *args):
        pass

    def __call__(self, *args):
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


class Nothing:
    """Has no method."""

    def __init__(self, *args):
        pass


class Cruise:
    """Proposes to go on as now along the reference."""

    def __init__(self, config, dt):
        self.dt = dt

    def __call__(self, road, state, acceleration, step, occupancy):
        count = road.last_step - step + 1
        s, d = (values[0] for values in road.frame.to_frenet(state[None, :2]))
        states = np.zeros((count, len(Stage)))
        states[:, Stage.S] = s + state[3] * self.dt * np.arange(count)
        states[:, Stage.D], states[:, Stage.V] = d, state[3]
        return [Proposal(states, "cruise")]


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """4 s along a straight road."""
    problem = made.problem(100, made.state(10, made.LANE / 2, 10), made.rectangle_goal(48))
    car = made.car(30, 80, made.LANE / 2, 12)
    return made.write(tmp_path_factory.mktemp("scenario"), problem, obstacles=[car])


@pytest.fixture(scope="module")
def task(path):
    loaded = load(path)
    return task_of(loaded, loaded.problems[0])


@pytest.fixture
def seen(task):
    box = np.array([[30.0, 2.0, 0.0, 5.0, 4.0, 2.0]])
    return Observation(3, task.problem.start, 0.0, (Snapshot(3, (7,), box, ("car",)),))


# ---------------------------------------------------------------- names


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("predict.kind", "lanefollow", "or the name of a class of yours, package.module:Class"),
        ("predict.kind", "a/b.py:B", "package.module:Class"),
        ("refine.backend", "simplex", "or the name of a class of yours, package.module:Class"),
        ("seed.sources", "['a:b:c']", "package.module:Class"),
        ("seed.sources", "[one]", "package.module:Class"),
    ],
)
def test_malformed_names_are_refused_by_the_configuration(key, value, words):
    with pytest.raises(ConfigError, match=key.replace(".", r"\.")) as caught:
        load_config(overrides=[f"{key}={value}"])
    assert words in str(caught.value)


@pytest.mark.parametrize("key", ["predict.kind", "refine.backend", "refine.fresh_backend"])
def test_wrong_names_say_what_is_wrong(key):
    part = "refine backend" if key.startswith("refine") else key
    for name, words in (
        ("no_such_module:A", "there is no module no_such_module"),
        (f"{HERE}:Missing", f"module {HERE} has no Missing; it has Standing, Broken, Cruise"),
        (f"{HERE}:Nothing", r"class Nothing has no method __call__\("),
        (f"{HERE}:DT", "DT is a float, not a class"),
    ):
        config = load_config(overrides=[f"{key}={name}"])
        with pytest.raises(InputError, match=words) as caught:
            check_classes(config)
        assert str(caught.value).startswith(f"{part} '{name}'")


def test_sources_are_looked_up_too():
    with pytest.raises(InputError, match=r"seed\.sources 'no_such:A': there is no module no_such"):
        check_classes(load_config(overrides=["seed.sources=['no_such:A']"]))
    check_classes(load_config(overrides=[f"seed.sources=['{HERE}:Cruise']"]))
    check_classes(Config())


@pytest.mark.slow
def test_the_command_line_refuses_a_wrong_name_at_once(tmp_path, path):
    done = subprocess.run(
        [sys.executable, "-m", "mpcplan", "solve", path, "--set", "predict.kind=nothing_here:A"],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2 and not list(tmp_path.glob("out/*/*"))
    assert "predict.kind 'nothing_here:A': there is no module nothing_here" in done.stderr
    assert "Traceback" not in done.stderr


# ---------------------------------------------------------------- predictors


def test_a_predictor_predicts_and_never_sees_the_recording(task, seen):
    Standing.tasks.clear()
    config = PredictConfig(kind=f"{HERE}:Standing")
    predictor = make_predictor(task, config)
    assert task.recorded is not None
    ((given, section),) = Standing.tasks
    assert given.recorded is None and section is config
    forecast = predictor(seen)
    assert predictor(seen) is forecast
    np.testing.assert_array_equal(forecast.boxes, np.repeat(seen.now.boxes[:, None], 11, axis=1))


def test_its_forecast_is_a_guess(task, seen, monkeypatch):
    boxes = np.repeat(seen.now.boxes[:, None], 3, axis=1)
    monkeypatch.setattr(Broken, "answer", Forecast(3, (7,), boxes, exact=True))
    assert not make_predictor(task, PredictConfig(kind=f"{HERE}:Broken"))(seen).exact


def test_lateness_applies_to_it(task, seen):
    late = make_predictor(task, PredictConfig(kind=f"{HERE}:Standing", lateness=0.1))
    assert late(seen).boxes[0, 1, 4] == pytest.approx(4.0 + 0.5)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (None, "it answered a NoneType, expected a Forecast"),
        (Forecast(2, (7,), np.zeros((1, 3, 6))), "begins at step 2, expected 3"),
        (Forecast(3, (7,), np.zeros((1, 3, 5))), r"boxes are \(1, 3, 5\), expected"),
        (Forecast(3, (7,), np.zeros((2, 3, 6))), r"boxes are \(2, 3, 6\), expected"),
        (Forecast(3, (7,), np.zeros((1, 0, 6))), r"boxes are \(1, 0, 6\), expected"),
        (Forecast(3, (7,), np.full((1, 3, 6), np.inf)), "infinite"),
        (Forecast(3, (8,), np.zeros((1, 3, 6))), "leaves out obstacle 7"),
        (KeyError("lane"), r"KeyError: 'lane' \(test_plug.py:\d+\)"),
    ],
)
def test_wrong_forecasts_say_what_is_wrong(task, seen, monkeypatch, answer, words):
    monkeypatch.setattr(Broken, "answer", answer)
    predictor = make_predictor(task, PredictConfig(kind=f"{HERE}:Broken"))
    with pytest.raises(PlannerError, match=words) as caught:
        predictor(seen)
    assert f"predict.kind '{HERE}:Broken', step 3" in str(caught.value)


def test_a_drive_ends_with_the_cause(path, monkeypatch):
    monkeypatch.setattr(Broken, "answer", None)
    run = drive(load(path), load_config(overrides=[f"predict.kind={HERE}:Broken"]))
    assert not run.solved and "expected a Forecast" in run.cause


# ---------------------------------------------------------------- seeds


def test_a_source_is_asked_and_its_seeds_judged(path):
    config = load_config(overrides=[f"seed.sources=['{HERE}:Cruise']"])
    looked = look_into(path, config)
    assert looked.run.solved
    cycle = looked.moments[0].plan.trace
    assert cycle["seeds"]["Cruise"] == {
        "candidates": 1, "accepted": 1, "reaching_goal": 1, "rejected": {},
    }  # fmt: skip


def test_a_proposal_is_cut_at_the_goal_and_costs_what_it_is(path):
    looked = look_into(path, load_config(overrides=["drive.steps_max=3"]))
    moment = looked.moments[0]
    seen, road = moment.observation, moment.road
    around = occupancy(moment.forecast, road.frame)
    (seed,), report = foreign_seeds(
        f"{HERE}:Cruise", road, seen.state, 0.0, seen.step, around, moment.config, DT
    )
    assert seed.reaches_goal and seed.source == "Cruise" and report.reaching_goal == 1
    goal = road.goals[0]
    last = seed.first_step + len(seed.states) - 1
    assert goal.first <= last <= goal.last < road.last_step + 1
    assert 0 < seed.cost < moment.config.seed.goal_missed


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (["x"], "it proposed a str, expected a Proposal"),
        ([Proposal(np.zeros((2, 6)), "")], r"states are \(2, 6\), expected \(at least 3, 6\)"),
        ([Proposal(np.full((5, 6), np.nan), "")], "not finite"),
        ([Proposal(np.zeros((5, 6)), "")], "the first state's s is .* off the present one"),
        (None, "TypeError"),
        (ValueError("no way"), "ValueError: no way"),
    ],
)
def test_wrong_proposals_say_what_is_wrong(path, monkeypatch, answer, words):
    monkeypatch.setattr(Broken, "answer", answer)
    run = drive(load(path), load_config(overrides=[f"seed.sources=['{HERE}:Broken']"]))
    assert not run.solved and re.search(words, run.cause)
    assert f"seed.sources '{HERE}:Broken', step 0" in run.cause


# ---------------------------------------------------------------- solvers


@pytest.fixture(scope="module")
def made_layout():
    return layout(functions(Config(), DT), 5)


def test_a_solver_answers(made_layout, monkeypatch):
    answer = Answer(np.zeros(made_layout.n_vars), np.zeros(made_layout.n_rows), EXACT, 1)
    monkeypatch.setattr(Broken, "answer", answer)
    assert make_backend(f"{HERE}:Broken", made_layout, 10, 1e-4)(None, None) is answer


def test_wrong_answers_say_what_is_wrong(made_layout, monkeypatch):
    good = Answer(np.zeros(made_layout.n_vars), np.zeros(made_layout.n_rows), EXACT, 1)
    solver = make_backend(f"{HERE}:Broken", made_layout, 10, 1e-4)
    for answer, words in (
        (None, "p of its answer is NoneType, expected an array"),
        (replace(good, p=np.zeros(3)), r"p of its answer is \(3,\), expected an array"),
        (replace(good, y=[0.0]), "y of its answer is list, expected an array"),
        (replace(good, status=1), "has no status"),
        (ZeroDivisionError("0"), "ZeroDivisionError: 0"),
    ):
        monkeypatch.setattr(Broken, "answer", answer)
        with pytest.raises(PlannerError, match=words):
            solver(None, None)
