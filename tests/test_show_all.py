"""`mpcplan show` on the folder of a benchmark: all its runs at once, for the report to lead to."""

import argparse
import multiprocessing
import os
from pathlib import Path

import made_results as made
import pytest
from PIL import Image

from mpcplan.bench.worker import write_trace
from mpcplan.cli import BAD_INPUT, FAILED, OK, main
from mpcplan.cli.show_all import _apart
from mpcplan.config import Config
from mpcplan.report.files import files_of
from mpcplan.report.read import read_all
from mpcplan.scenario import load
from mpcplan.simulate.loop import drive

SCENARIOS = Path(__file__).resolve().parents[1] / "scenarios"
GOOD, BROKEN = "ZAM_CutIn-1_1_T-1", "ZAM_Broken-1_1_T-1"
UNTOUCHED = b"drawn before"


@pytest.fixture(scope="module")
def driven():
    return drive(load(SCENARIOS / f"{GOOD}.xml"), Config())


@pytest.fixture
def folder(driven, tmp_path):
    """Results of two scenarios, one with a broken trace."""
    folder = made.write(
        tmp_path / "results", [made.solved(GOOD, 1.0), made.failed(BROKEN, "collided at step 4")]
    )
    write_trace(driven.trace(), folder / "traces" / f"{GOOD}.json.gz")
    driven.write_solution(folder / "solutions")
    (folder / "traces" / f"{BROKEN}.json.gz").write_bytes(b"no trace")
    return folder


def picture_of(folder: Path, scenario: str, end: str = ".png") -> Path:
    return folder / ("pictures" if end == ".png" else "animations") / f"{scenario}{end}"


def test_a_run_that_fails_is_named_and_the_others_are_drawn_where_the_report_looks(folder, capsys):
    assert main(["show", str(folder)]) == FAILED
    said = capsys.readouterr()
    first, second = said.out.splitlines()
    assert first == f"pictures  1 drawn: {folder / 'pictures'}" and said.err == ""
    assert second.startswith(f"failed    {BROKEN}: ") and "cannot be read as a trace" in second
    (run,) = read_all([folder])
    found = files_of(run, GOOD).picture
    assert found == picture_of(folder, GOOD) and Image.open(found).width > 1000
    assert files_of(run, BROKEN).picture is None


def test_what_is_there_is_kept_until_it_is_asked_for_again(folder, capsys):
    picture = picture_of(folder, GOOD)
    (folder / "traces" / f"{BROKEN}.json.gz").unlink()
    picture.parent.mkdir()
    picture.write_bytes(UNTOUCHED)
    assert main(["show", str(folder)]) == OK
    assert "0 drawn, 1 were there already" in capsys.readouterr().out
    assert picture.read_bytes() == UNTOUCHED
    assert main(["show", str(folder), "--again"]) == OK
    assert picture.read_bytes() != UNTOUCHED
    assert [path.name for path in picture.parent.iterdir()] == [picture.name]


def test_only_those_that_failed(folder, capsys):
    assert main(["show", str(folder), "--failed"]) == FAILED  # its trace is the broken one
    assert capsys.readouterr().out.startswith("pictures  0 drawn: ")
    assert not picture_of(folder, GOOD).exists()


def test_films_lie_where_the_report_looks(folder, capsys):
    (folder / "traces" / f"{BROKEN}.json.gz").unlink()
    assert main(["show", str(folder), "--animate", "gif", "--jobs", "2"]) == OK
    assert capsys.readouterr().out == f"films     1 drawn: {folder / 'animations'}\n"
    (run,) = read_all([folder])
    found = files_of(run, GOOD).animation
    assert found == picture_of(folder, GOOD, ".gif")
    with Image.open(found) as shown:
        assert shown.n_frames > 10


def test_notes_of_several_runs_are_told_once(driven, tmp_path, capsys):
    trace = driven.trace()
    for cycle in trace["drives"][0]["cycles"]:
        cycle["planner"] = "another"  # whose plans cannot be planned again
    for scenario in (GOOD, f"{GOOD}-again"):  # two files of one run will do
        write_trace(trace, tmp_path / "traces" / f"{scenario}.json.gz")
    driven.write_solution(tmp_path / "solutions")
    main(["show", str(tmp_path)])
    notes = [x for x in capsys.readouterr().out.splitlines() if x.startswith("note")]
    assert len(notes) == 1 and notes[0].startswith("note      2 of them: plans of ")


def test_scenarios_that_have_moved_are_found_in_the_folder_that_is_named(driven, tmp_path, capsys):
    trace = driven.trace() | {"file": f"/nowhere/{GOOD}.xml"}
    write_trace(trace, tmp_path / "traces" / f"{GOOD}.json.gz")
    driven.write_solution(tmp_path / "solutions")
    assert main(["show", str(tmp_path)]) == FAILED
    assert "name it with --scenario" in capsys.readouterr().out
    assert main(["show", str(tmp_path), "--scenario", str(SCENARIOS)]) == OK
    assert picture_of(tmp_path, GOOD).is_file()


class _Deadly:
    """What ends the process in which it is unpickled, as a crash in a library would."""

    def __reduce__(self):
        return os._exit, (3,)


def test_a_crash_is_the_failure_of_one_run():
    context = multiprocessing.get_context("forkserver")
    drawn = _apart(context, argparse.Namespace(run_folder=_Deadly()))
    assert drawn.failure == "the process that drew it crashed"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--step", "3"], "--step is for one run"),
        (["--scenario", "nowhere"], "nowhere"),
        (["--problem", "0"], "--problem is for one run"),
        (["--animate", "film.mp4"], "of many runs expected just mp4 or gif"),
        (["--animate", "avi"], "of many runs expected just mp4 or gif"),
        (["--animate", "gif", "--fps", "0"], "--fps 0"),
        (["--animate", "gif", "--radius", "1"], "--radius 1: expected 10 to 500 m"),
        (["--jobs", "0"], "--jobs 0: expected at least 1"),
    ],
)
def test_bad_input_is_one_line(folder, capsys, arguments, told):
    assert main(["show", str(folder), *arguments]) == BAD_INPUT
    said = capsys.readouterr()
    assert said.err.startswith("error: ") and said.err.count("\n") == 1 and told in said.err
    assert not (folder / "pictures").exists()


@pytest.mark.parametrize("option", [["--failed"], ["--again"], ["--jobs", "2"]])
def test_options_for_many_runs_are_refused_for_one(folder, capsys, option):
    trace = folder / "traces" / f"{GOOD}.json.gz"
    assert main(["show", str(trace), *option]) == BAD_INPUT
    assert f"{option[0]} is for the folder of a benchmark" in capsys.readouterr().err


def test_a_folder_without_traces_or_results(tmp_path, capsys):
    (tmp_path / "traces").mkdir()
    assert main(["show", str(tmp_path)]) == BAD_INPUT
    assert "holds no traces" in capsys.readouterr().err
    (tmp_path / "traces" / f"{GOOD}.json.gz").touch()
    assert main(["show", str(tmp_path), "--failed"]) == BAD_INPUT
    assert "has no results.csv" in capsys.readouterr().err
