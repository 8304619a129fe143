"""Solutions before the official verdict: our own verification, and what is left without a judge."""

from pathlib import Path

import numpy as np
import pytest
import straight_road as road

from mpcplan import evaluate, load
from mpcplan.bench import worker as worker_module
from mpcplan.bench.candidate import verify_run
from mpcplan.bench.worker import Worker
from mpcplan.config import Config
from mpcplan.errors import MpcplanError, RefereeError
from mpcplan.scenario import LoadedScenario
from mpcplan.simulate.recorded import RecordedTraffic
from mpcplan.simulate.run import Drive, Run
from mpcplan.trajectory import Trajectory
from mpcplan.vehicle import simulate

EASY = Path(__file__).parents[1] / "scenarios" / "ZAM_FreeRoad-1_1_T-1.xml"


@pytest.fixture(scope="module")
def loaded(tmp_path_factory) -> LoadedScenario:
    return load(road.write_scenario(tmp_path_factory.mktemp("road")))


def _run(loaded: LoadedScenario, driven: Trajectory, reached: bool = True) -> Run:
    traffic = RecordedTraffic(loaded.scenario)
    others = tuple(traffic.at(int(step)) for step in driven.steps)
    step, cause = (driven.last_step, "") if reached else (None, "the goal was not reached")
    drive = Drive(road.PROBLEM, driven, step, cause, (), False, others)
    return Run(loaded, Config(), (drive,))


def _driven(loaded: LoadedScenario, steering_rate: float = 0.0, steps: int = 20) -> Trajectory:
    inputs = np.column_stack([np.zeros(steps), np.full(steps, steering_rate)])
    return simulate(loaded.problems[0].start.tolist(), inputs, loaded.dt)


def test_a_clean_drive_passes(loaded):
    assert verify_run(_run(loaded, _driven(loaded))).ok


def test_the_goal_must_have_been_reached(loaded):
    finding = verify_run(_run(loaded, _driven(loaded), reached=False))
    assert finding.check == "goal" and "not reached" in str(finding)


def test_states_must_follow_from_the_inputs(loaded):
    driven = _driven(loaded)
    states = driven.states.copy()
    states[7, 0] += 0.1
    broken = Trajectory(driven.first_step, states, driven.inputs, driven.dt)
    assert verify_run(_run(loaded, broken)).check == "kinematics"


def test_nobody_may_be_touched(loaded):
    start = loaded.problems[0].start.copy()
    start[1] += road.WIDTH  # the lane with the parked car
    driven = simulate(start.tolist(), np.zeros((25, 2)), loaded.dt)
    finding = verify_run(_run(loaded, driven))
    assert finding.check == "collision" and finding.obstacle == road.PARKED
    assert finding.step is not None and 10 < finding.step < 20 and finding.amount < 0


def test_the_road_must_not_be_left(loaded):
    assert verify_run(_run(loaded, _driven(loaded, steering_rate=-0.1))).check == "road"


@pytest.mark.slow
@pytest.mark.parametrize(
    "error", [RefereeError("the checker died twice"), MpcplanError("no net"), MemoryError()]
)
def test_without_a_judge_a_verified_solution_stays(tmp_path, monkeypatch, error):
    def fail(run, folder):
        raise error

    monkeypatch.setattr(worker_module, "_judge", fail)
    (tmp_path / "config.yaml").write_text("")
    row = Worker(EASY, tmp_path, tmp_path / "row.json", tmp_path / "config.yaml").work()
    assert (row["status"], row["valid"]) == ("unjudged", False) and row["cycles"] > 0
    assert row["cause"] == f"not judged: {str(error) or 'ran out of memory'}"
    (solution,) = (tmp_path / "solutions").iterdir()
    assert evaluate(EASY, solution).valid


def test_without_a_judge_an_unverified_solution_is_a_failure(tmp_path, monkeypatch):
    def fail(run, folder):
        raise RefereeError("the checker died twice")

    monkeypatch.setattr(worker_module, "_judge", fail)
    monkeypatch.setattr(worker_module, "_verified", lambda run: False)
    (tmp_path / "config.yaml").write_text("")
    row = Worker(EASY, tmp_path, tmp_path / "row.json", tmp_path / "config.yaml").work()
    assert (row["status"], row["cause"]) == ("crash", "the checker died twice")


def test_a_mistake_in_our_own_verification_costs_no_solution(loaded, monkeypatch):
    def fail(run):
        raise ZeroDivisionError

    monkeypatch.setattr("mpcplan.bench.candidate.verify_run", fail)
    assert worker_module._verified(_run(loaded, _driven(loaded))) is False
