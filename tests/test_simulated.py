"""Simulated traffic in the closed loop: what is kept, written, replayed late and judged."""

from pathlib import Path

import numpy as np
import pytest
from fake_traffic import FakeTraffic, interactive

from mpcplan.config import Config
from mpcplan.errors import TrafficError
from mpcplan.observation import Box, Snapshot, as_forecast
from mpcplan.predict.recorded import kinds_of, record, static_ids
from mpcplan.scenario import LoadedScenario, load
from mpcplan.score import judge
from mpcplan.score.referee import evaluate
from mpcplan.simulate import loop
from mpcplan.simulate import replay as replaying
from mpcplan.simulate.loop import drive
from mpcplan.simulate.run import Run
from mpcplan.simulate.simulated_scenario import write_simulated
from mpcplan.task import task_of
from mpcplan.trajectory import Array, State

FOLDER = Path(__file__).resolve().parents[1] / "scenarios"
BLIND = Config().model_copy(
    update={"predict": Config().predict.model_copy(update={"kind": "constant_input"})}
)


def bundled(name: str) -> LoadedScenario:
    return load(FOLDER / f"ZAM_{name}-1_1_T-1.xml")


def ahead(loaded: LoadedScenario, gap: float, speed: float) -> Array:
    """A truck in front of the start, (6,)."""
    state = loaded.problems[0].start
    c, s = np.cos(state[State.PSI]), np.sin(state[State.PSI])
    x, y = state[State.X] + gap * c, state[State.Y] + gap * s
    return np.array([x, y, state[State.PSI], speed, 8.0, 2.4])


def driven_behind(monkeypatch: pytest.MonkeyPatch, gap: float, speed: float) -> tuple:
    """A drive on the free road behind a truck, and its traffic."""
    loaded = interactive(bundled("FreeRoad"))
    traffic = FakeTraffic(ahead(loaded, gap, speed))
    monkeypatch.setattr(loop, "open_traffic", lambda *_: traffic)
    return drive(loaded, BLIND), traffic


def seen_boxes(steps: list[int], number: int, loaded: LoadedScenario) -> list[Snapshot]:
    """An obstacle at some of the time steps 0..5."""
    box = ahead(loaded, 30.0, 5.0)
    snapshots = []
    for step in range(6):
        there = step in steps
        boxes = (box + step * np.eye(6)[Box.X])[None] if there else np.empty((0, 6))
        snapshots.append(Snapshot(step, (number,) * there, boxes, ("bicycle",) * there))
    return snapshots


def test_an_interactive_task_holds_no_trajectory_and_no_obstacle() -> None:
    loaded = bundled("Follow")
    task = task_of(interactive(loaded), loaded.problems[0])
    assert task.recorded is None
    assert not task.road_map.obstacles
    assert task_of(loaded, loaded.problems[0]).recorded is not None


def test_the_ego_moves_with_the_traffic_step_by_step(monkeypatch: pytest.MonkeyPatch) -> None:
    run, traffic = driven_behind(monkeypatch, 40.0, 9.0)
    driven = run.drives[0].trajectory
    assert traffic.closed
    assert np.array_equal(np.array(traffic.egos)[: len(driven) - 1], driven.states[1:])
    assert [seen.step for seen in run.drives[0].others] == driven.steps.tolist()
    assert len(run.step_ms) >= len(driven) - 1
    assert "fake traffic" in run.trace()["notes"]


def test_a_simulator_that_fails_ends_the_drive_with_its_cause(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    loaded = interactive(bundled("FreeRoad"))
    traffic = FakeTraffic(ahead(loaded, 60.0, 15.0))

    def fail(step: int, state: Array) -> None:
        raise TrafficError(f"the simulator stopped at step {step}")

    traffic.advance = fail  # type: ignore[method-assign]
    monkeypatch.setattr(loop, "open_traffic", lambda *_: traffic)
    run = drive(loaded, BLIND)
    assert not run.solved
    assert run.cause == "the simulator stopped at step 1"
    assert len(run.drives[0].others) == len(run.drives[0].trajectory)
    assert traffic.closed


def test_a_simulator_that_cannot_begin_is_a_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise TrafficError("obstacle 7 stands where the ego starts")

    monkeypatch.setattr(loop, "open_traffic", refuse)
    run = drive(interactive(bundled("FreeRoad")), BLIND)
    assert run.cause == "obstacle 7 stands where the ego starts"


def test_written_traffic_is_read_back_as_it_was(tmp_path: Path) -> None:
    loaded = bundled("StaticBlock")
    others = seen_boxes([1, 2, 3, 4], 901, loaded)
    again = load(write_simulated(loaded, others, tmp_path / "a.cr.xml", "for a test"))
    assert np.array_equal(again.origin, loaded.origin)
    number = next(iter(set(kinds_of(again.scenario)) - static_ids(again.scenario)))
    assert number == 901
    assert kinds_of(again.scenario)[901] == "bicycle"
    boxes = record(again.scenario).at(np.arange(6))
    row = record(again.scenario).ids.index(901)
    expected = as_forecast(others).boxes[0]
    np.testing.assert_allclose(boxes[row], expected, atol=1e-9)
    assert static_ids(again.scenario) == static_ids(loaded.scenario)
    assert again.problems[0].start.tolist() == loaded.problems[0].start.tolist()
    before, after = (x.scenario.lanelet_network.lanelets for x in (loaded, again))
    assert [lanelet.lanelet_id for lanelet in before] == [lanelet.lanelet_id for lanelet in after]


def test_who_was_away_for_a_while_comes_back_under_another_id(tmp_path: Path) -> None:
    loaded = bundled("FreeRoad")
    others = seen_boxes([0, 1, 4, 5], 77, loaded)
    again = load(write_simulated(loaded, others, tmp_path / "a.cr.xml"))
    forecast = record(again.scenario)
    assert len(forecast.ids) == 2
    there = np.isfinite(forecast.at(np.arange(6))[..., Box.X])
    assert there.tolist() == [[True, True, False, False, False, False],
                              [False, False, False, False, True, True]]  # fmt: skip


def test_recorded_trajectories_do_not_stay_in_the_written_file(tmp_path: Path) -> None:
    loaded = bundled("Follow")
    again = load(write_simulated(loaded, [Snapshot(0, (), np.empty((0, 6)))], tmp_path / "a.xml"))
    assert not again.scenario.dynamic_obstacles
    assert loaded.scenario.dynamic_obstacles


def test_the_written_file_is_the_same_for_the_same_traffic(tmp_path: Path) -> None:
    loaded = bundled("FreeRoad")
    files = [
        write_simulated(loaded, seen_boxes([0, 1], 5, loaded), tmp_path / name)
        for name in ("a.xml", "b.xml")
    ]
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.parametrize("lag", [0, 1, 3])
def test_a_replay_is_late_by_the_lag(monkeypatch: pytest.MonkeyPatch, lag: int) -> None:
    run, _ = driven_behind(monkeypatch, 40.0, 9.0)
    driven, traffic = run.drives[0].trajectory, FakeTraffic(ahead(run.loaded, 40.0, 9.0))
    monkeypatch.setattr(replaying, "open_traffic", lambda *_: traffic)
    late = replaying.replay(run.loaded, run.loaded.problems[0], driven, lag)
    expected = np.vstack([np.repeat(driven.states[:1], lag, axis=0), driven.states])[1:]
    assert np.array_equal(np.array(traffic.egos), expected[: len(driven) - 1])
    assert len(late.others) == len(driven)
    assert late.hit is None
    assert traffic.closed


def test_a_late_ego_that_is_hit_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    run, _ = driven_behind(monkeypatch, 60.0, 15.0)
    traffic = FakeTraffic(ahead(run.loaded, -12.0, 40.0))  # someone who does not brake, from behind
    monkeypatch.setattr(replaying, "open_traffic", lambda *_: traffic)
    late = replaying.replay(run.loaded, run.loaded.problems[0], run.drives[0].trajectory, 1)
    assert late.hit is not None
    assert late.hit[1] == 5001


def judged(run: Run, box: Array, folder: Path, monkeypatch: pytest.MonkeyPatch) -> judge.Judgement:
    """The judgement of a run whose replay meets another car."""
    monkeypatch.setattr(replaying, "open_traffic", lambda *_: FakeTraffic(box))
    return judge.judge_run(run, folder)


@pytest.mark.slow
def test_a_run_is_judged_on_its_own_traffic_and_late(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    run, _ = driven_behind(monkeypatch, 40.0, 9.0)
    well = judged(run, ahead(run.loaded, 40.0, 9.0), tmp_path / "well", monkeypatch)
    assert well.verdict.valid, well.verdict.cause
    assert well.late == judge.Late(True, "")
    assert [path.suffix for path in well.files] == [".xml"] * 3
    badly = judged(run, ahead(run.loaded, -12.0, 40.0), tmp_path / "badly", monkeypatch)
    assert badly.verdict.valid
    assert badly.late is not None
    assert not badly.late.valid
    assert "5001" in badly.late.cause


@pytest.mark.slow
def test_a_collision_with_simulated_traffic_is_seen_by_the_checker(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    run, _ = driven_behind(monkeypatch, 40.0, 9.0)
    drive_, wall = run.drives[0], run.drives[0].trajectory.state_at(5)
    box = np.array([*wall[[State.X, State.Y]], wall[State.PSI], 0.0, 4.0, 2.0])
    others = [
        Snapshot(step, (9,), box[None], ("car",)) for step in drive_.trajectory.steps.tolist()
    ]
    path = write_simulated(run.loaded, others, tmp_path / "wall.xml")
    verdict = evaluate(path, run.write_solution(tmp_path))
    assert not verdict.checks["no_collision"]
    assert "obstacle 9 " in verdict.reasons["no_collision"]
