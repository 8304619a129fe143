"""Interactive scenarios as a user drives them: the same bytes again, no knowledge of the future."""

import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from mpcplan.scenario import LoadedScenario, load
from mpcplan.simulate import loop
from mpcplan.simulate.loop import drive
from mpcplan.simulate.simulated_scenario import write_simulated
from mpcplan.task import task_of

FOLDER = Path(__file__).resolve().parents[1] / "scenarios" / "interactive"
SHORT = "ZAM_SlowTraffic-1_1_I-1-1"
NAMES = sorted(path.name for path in FOLDER.iterdir() if path.is_dir())


def solved_files(name: str, out: Path, seed: str) -> dict[str, bytes]:
    """What `mpcplan solve` writes of a bundled scenario in a fresh process."""
    done = subprocess.run(
        [sys.executable, "-m", "mpcplan", "solve", str(FOLDER / name), "--out", str(out)],
        capture_output=True, text=True, check=False,
        env={"PYTHONHASHSEED": seed, "PATH": "/usr/bin:/bin", "HOME": str(out.parent)},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert not done.stderr, "no library's noise"
    return {path.name: path.read_bytes() for path in out.iterdir() if path.suffix == ".xml"}


@pytest.mark.slow
def test_three_fresh_processes_write_the_same_bytes(tmp_path: Path) -> None:
    first, *others = [solved_files(SHORT, tmp_path / seed, seed) for seed in ("1", "2", "3")]
    assert len(first) == 3  # the solution, and the traffic on time and late
    for other in others:
        assert other == first


def with_nonsense(text: str) -> str:
    """The scenario's text with recorded trajectories that lead elsewhere."""
    head, *obstacles = text.split("<trajectory>")
    return head + "".join(
        "<trajectory>" + part.replace("<x>", "<x>9", 1).replace("<y>", "<y>7", 1)
        for part in obstacles
    )


def without_futures(text: str) -> str:
    """The scenario's text without recorded trajectories."""
    parts = text.split("<trajectory>")
    return parts[0] + "".join(part.split("</trajectory>", 1)[1] for part in parts[1:])


@pytest.mark.slow
@pytest.mark.parametrize("change", [with_nonsense, without_futures])
def test_recorded_futures_change_no_byte(change, tmp_path: Path, monkeypatch) -> None:
    loaded = load(FOLDER / SHORT)
    told = told_otherwise(loaded, change, tmp_path)
    assert futures(told) != futures(loaded)
    expected = written(drive(loaded), tmp_path / "expected")
    monkeypatch.setattr(loop, "task_of", lambda _, problem: task_of(told, told.problems[0]))
    assert written(drive(loaded), tmp_path / "again") == expected


def told_otherwise(loaded: LoadedScenario, change, tmp_path: Path) -> LoadedScenario:
    """The scenario as its planner would know it from a changed file."""
    folder = tmp_path / "changed" / SHORT
    shutil.copytree(FOLDER / SHORT, folder)
    file = folder / loaded.path.name
    file.chmod(0o644)
    file.write_text(change(file.read_text()))
    return load(folder)


def futures(loaded: LoadedScenario) -> list[list[float]]:
    """Where the file says that the others will be."""
    return [
        [float(x) for s in o.prediction.trajectory.state_list for x in s.position]
        for o in loaded.scenario.dynamic_obstacles
        if o.prediction is not None
    ]


def written(run, folder: Path) -> tuple[bytes, bytes]:
    """Solution and simulated traffic as bytes."""
    folder.mkdir()
    traffic = write_simulated(run.loaded, run.drives[0].others, folder / "traffic.xml")
    return run.write_solution(folder).read_bytes(), traffic.read_bytes()


def test_an_interactive_planner_that_asks_for_the_recording_is_told_what_to_do() -> None:
    from mpcplan.config.files import load_config

    run = drive(load(FOLDER / SHORT), load_config(None, ["predict.kind=recorded"]))
    assert not run.solved
    assert "lane_follow" in run.cause


def test_a_scenario_with_two_problems_is_refused_as_interactive(tmp_path: Path) -> None:
    folder = tmp_path / SHORT
    shutil.copytree(FOLDER / SHORT, folder)
    file = folder / f"{SHORT}.cr.xml"
    file.chmod(0o644)
    text = file.read_text()
    begin, end = text.index("<planningProblem"), text.index("</planningProblem>")
    problem = text[begin : end + len("</planningProblem>")]
    number = problem.split('id="')[1].split('"')[0]
    second = problem.replace(f'id="{number}"', 'id="987654"', 1)
    file.write_text(text.replace(problem, problem + second))
    with pytest.raises(Exception, match="2 planning problems"):
        load(folder)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_bundled_interactive_scenarios_are_solved(name: str, tmp_path: Path) -> None:
    from mpcplan.score.judge import judge_run

    run = drive(load(FOLDER / name))
    assert run.solved, run.cause
    judgement = judge_run(run, tmp_path)
    assert judgement.verdict.valid, judgement.verdict.cause
    assert judgement.late is not None and judgement.late.valid, judgement.late


def test_the_input_is_only_read(tmp_path: Path) -> None:
    loaded = load(FOLDER / SHORT)
    before = {path: path.read_bytes() for path in (FOLDER / SHORT).iterdir()}
    loop.drive(replace(loaded), progress=None)
    assert {path: path.read_bytes() for path in (FOLDER / SHORT).iterdir()} == before
