"""The competition run: budget, order, two passes, and that nothing is lost, whatever happens."""

import csv
import errno
import math
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import fake_worker
import pytest

from mpcplan.bench import files
from mpcplan.compete import compete, parse_budget
from mpcplan.compete.budget import Rule
from mpcplan.compete.estimate import estimate
from mpcplan.compete.results import REPORT_COLUMNS, WORK
from mpcplan.compete.run import Result
from mpcplan.compete.schedule import Schedule, Turn
from mpcplan.errors import InputError

ROOT = Path(__file__).parents[1]
QUICK = Rule(floor_s=3.0, first_cap_s=3.0, second_cap_s=4.0, growth=1.2, reserve_s=0.5, least_s=0.1)


# ------------------------------------------------------------------------------ budget and order


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("6h", 21600), ("90m", 5400), ("90min", 5400), ("45s", 45), ("600", 600), ("1h30m", 5400),
     ("0.5 h", 1800), ("1H 1M 1S", 3661)],
)  # fmt: skip
def test_budgets(text, seconds):
    assert parse_budget(text) == seconds


@pytest.mark.parametrize("text", ["", "0", "-1h", "6 days", "h", "1.2.3h", "30m1h", "inf", "nan"])
def test_what_is_no_budget(text):
    with pytest.raises(InputError, match=r"is no time; expected e\.g\. 6h"):
        parse_budget(text)


def test_first_limits_lie_between_floor_and_cap_and_within_what_remains():
    rule = Rule()
    assert rule.first(3605.0, 2, 72) == 0.5 * 3600 * 2 / 72
    assert rule.first(3605.0, 2, 1000) == rule.floor_s
    assert rule.first(3605.0, 2, 1) == rule.first_cap_s
    assert rule.first(25.0, 2, 1000) == 20.0
    assert rule.first(rule.reserve_s + rule.least_s - 0.1, 2, 1) is None


def test_second_limits_grow_or_are_not_given():
    rule = Rule()
    assert rule.second(3605.0, 2, 10, 100.0) == 720.0
    assert rule.second(3605.0, 2, 1000, 100.0) == 200.0
    assert rule.second(36005.0, 2, 1, 100.0) == rule.second_cap_s
    assert rule.second(155.0, 2, 1, 100.0) == 150.0  # all that is left
    assert rule.second(100.0, 2, 1, 100.0) is None
    assert rule.second(1000.0, 1, 1000, 0.0) == rule.floor_s  # it did not end for lack of time


def _turns(count: int) -> list[Turn]:
    turns = [Turn(1, False, float(i), f"s{i:03}") for i in range(count)]
    random.Random(1).shuffle(turns)
    return turns


@pytest.mark.parametrize("count", [1, 7, 200])
def test_if_nothing_ends_in_time_all_are_tried_and_the_budget_is_kept(count):
    left, tried = 6 * 3600.0, []
    schedule = Schedule(Rule(), 1, _turns(count))
    while (turn := schedule.next(left)) is not None:
        left -= turn.limit_s
        tried.append(turn)
        schedule.again(turn, {"status": "timeout", "limit_s": turn.limit_s})
    assert left >= Rule().reserve_s
    first = [turn for turn in tried if turn.round == 1]
    assert [turn.name for turn in first] == [f"s{i:03}" for i in range(count)]
    second = {turn.name: turn for turn in tried if turn.round == 2}
    assert second and all(t.limit_s >= 1.5 * t.previous_s for t in list(second.values())[:-1])


def test_the_easiest_come_first_and_those_without_a_solution_before_those_with_one():
    turns = [Turn(2, True, 1.0, "a"), Turn(2, False, 9.0, "b"), Turn(1, False, 8.0, "c"),
             Turn(1, False, math.inf, "d"), Turn(1, False, 2.0, "e")]  # fmt: skip
    schedule = Schedule(Rule(), 2, turns)
    order = []
    while (turn := schedule.next(1000.0)) is not None:
        order.append(turn.name)
    assert order == ["e", "c", "d", "b", "a"]


def test_when_time_is_short_the_first_pass_does_not_go_on_and_the_second_takes_what_fits():
    schedule = Schedule(Rule(), 1, [Turn(1, False, 1.0, "a")])
    assert schedule.next(6.0) is None
    turns = [Turn(2, False, 1.0, "long", 500.0), Turn(2, False, 2.0, "short", 50.0)]
    turn = Schedule(Rule(), 1, turns).next(305.0)
    assert turn is not None and (turn.name, turn.limit_s) == ("short", 300.0)


def test_only_what_was_ended_from_outside_is_tried_again():
    for status, again in (("timeout", True), ("aborted", True), ("unjudged", True),
                          ("invalid", False), ("crash", False), ("memory", False)):  # fmt: skip
        schedule = Schedule(Rule(), 1, [])
        schedule.again(Turn(1, False, 1.0, "a"), {"status": status, "limit_s": 30.0})
        assert (schedule.next(1000.0) is not None) == again, status
    schedule.again(Turn(2, False, 1.0, "a"), {"status": "timeout", "limit_s": 30.0})
    assert schedule.next(1000.0) is None


GOAL = "<goalState><time><intervalStart>5</intervalStart><intervalEnd>{}</intervalEnd></time>"


def _file(folder: Path, name: str, steps: int = 30, cars: int = 0, lanelets: int = 1) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}.xml"
    path.write_text(
        f"<commonRoad benchmarkID='{name}' timeStepSize='0.1'>"
        + "".join(f"<lanelet id='{i}'/>" for i in range(lanelets))
        + "".join(f"<dynamicObstacle id='{i}'/>" for i in range(cars))
        + f"<planningProblem id='1'>{GOAL.format(steps)}</goalState></planningProblem></commonRoad>"
    )
    return path


def test_estimates_grow_with_time_traffic_and_map(tmp_path):
    base = estimate(_file(tmp_path, "a", 30, 2, 10)).seconds
    for more in ((60, 2, 10), (30, 20, 10), (30, 2, 100)):
        assert estimate(_file(tmp_path, "b", *more)).seconds > base
    assert 2.0 < base < 10.0
    folder = tmp_path / "ZAM_x-1_1_I-1"
    _file(folder, "ZAM_x-1_1_I-1.cr", 30, 2, 10)
    assert estimate(folder).seconds == base


@pytest.mark.parametrize(
    "text",
    ["<commonRoad", "", "<commonRoad timeStepSize='x'/>", "<!DOCTYPE a []><commonRoad/>",
     "<commonRoad timeStepSize='nan'><planningProblem/></commonRoad>"],
)  # fmt: skip
def test_what_cannot_be_estimated_comes_last(tmp_path, text):
    path = tmp_path / "broken.xml"
    path.write_text(text)
    assert estimate(path).seconds == math.inf


def test_bundled_scenarios_have_estimates():
    known = {path.stem: estimate(path) for path in (ROOT / "scenarios").glob("*.xml")}
    assert len(known) > 5 and all(2.0 < e.seconds < 60.0 for e in known.values())
    assert all(e.benchmark == name for name, e in known.items())


# -------------------------------------------------------------------- runs with replaced workers


@pytest.fixture
def given(tmp_path: Path) -> Path:
    path = tmp_path / "in"
    path.mkdir()
    return path


@pytest.fixture
def notes(tmp_path: Path) -> Path:
    path = tmp_path / "notes"
    path.mkdir()
    return path


@pytest.fixture
def run(given: Path, notes: Path, tmp_path: Path):
    def run(**changes) -> Result:
        values = {
            "budget_s": 60.0, "rule": QUICK, "memory_mb": 2000.0,
            "command": fake_worker.command(notes), **changes,
        }  # fmt: skip
        return compete(given, tmp_path / "out", **values)

    return run


def _solutions(out: Path) -> set[str]:
    """Names of the scenarios that have a solution file; every one must be whole."""
    paths = [path for path in out.iterdir() if path.name not in (WORK, "report.csv")]
    for path in paths:
        assert path.read_text().startswith("<CommonRoadSolution") and path.stat().st_size > 500
    return {path.name.split(":")[2] for path in paths}


def _report(out: Path) -> dict[str, dict[str, str]]:
    with (out / "report.csv").open(newline="") as file:
        reader = csv.DictReader(file)
        rows = {row["scenario"]: row for row in reader}
    assert tuple(reader.fieldnames or ()) == REPORT_COLUMNS
    assert all(None not in row.values() for row in rows.values())
    return rows


def _rows(out: Path) -> set[str]:
    return {path.stem for path in (out / WORK / "rows").iterdir()}


def test_one_file_per_solution_and_one_line_per_scenario(given, run, tmp_path, capfd):
    for name in ("good", "invalid", "segfault", "memory", "exit"):
        _file(given, f"ZAM_{name}-1")
    result, out = run(), tmp_path / "out"
    assert _solutions(out) == {"ZAM_good-1"} and result.solutions == 1 and not result.interrupted
    report = _report(out)
    assert {name[4:-2]: row["status"] for name, row in report.items()} == {
        "good": "solved", "invalid": "invalid", "segfault": "crash", "memory": "memory",
        "exit": "crash",
    }  # fmt: skip
    good = report["ZAM_good-1"]
    assert good["solution"] == fake_worker.solution_name("ZAM_good-1") and good["pass"] == "1"
    assert good["limit_s"] == "3.0" and float(good["estimate_s"]) > 2
    assert report["ZAM_invalid-1"]["solution"] == ""
    assert report["ZAM_invalid-1"]["cause"] == "no_collision: of a test"
    kept = {path.name.split(":")[2] for path in (out / WORK / "solutions").iterdir()}
    assert kept == {"ZAM_good-1", "ZAM_invalid-1"}  # for who wants to see why
    shown = capfd.readouterr()
    assert shown.out == "" and shown.err.count("\n") == 5 and "[5/5, 1 min left]" in shown.err


def test_the_order_is_that_of_the_estimates(given, notes, run):
    for name, steps in (("a", 90), ("b", 30), ("c", 60)):
        _file(given, f"ZAM_{name}-1", steps)
    (given / "ZAM_broken-1.xml").write_text("<commonRoad")
    run(jobs=1)
    assert fake_worker.started(notes) == [f"ZAM_{name}-1" for name in ("b", "c", "a", "broken")]


def test_a_second_pass_for_those_that_ran_out_of_time_or_were_killed(given, notes, run, tmp_path):
    for name, steps in (("later", 30), ("killed", 40), ("hang", 50), ("good", 60)):
        _file(given, f"ZAM_{name}-1", steps)
    result, out = run(), tmp_path / "out"
    assert _solutions(out) == {"ZAM_later-1", "ZAM_good-1"}
    report = _report(out)
    assert {name[4:-2]: (row["status"], row["pass"]) for name, row in report.items()} == {
        "later": ("solved", "2"), "killed": ("aborted", "2"), "hang": ("timeout", "2"),
        "good": ("solved", "1"),
    }  # fmt: skip
    assert float(report["ZAM_hang-1"]["limit_s"]) == 4.0
    assert "signal 9" in report["ZAM_killed-1"]["cause"]
    assert sorted(fake_worker.started(notes)) == sorted(
        [*["ZAM_later-1", "ZAM_killed-1", "ZAM_hang-1"] * 2, "ZAM_good-1"]
    )
    assert len(result.rows) == 4


def test_the_budget_ends_the_run_and_a_second_one_goes_on(given, notes, run, tmp_path):
    out = tmp_path / "out"
    for name, steps in (("good", 30), ("hang", 40), ("last", 50)):
        _file(given, f"ZAM_{name}-1", steps)
    start = time.monotonic()
    result = run(jobs=1, budget_s=4.0, rule=Rule(3.0, 3.0, 3.0, 6.0, 2.0, 0.5, 0.6))
    assert time.monotonic() - start < 5.0
    assert {row["scenario"][4:-2]: row["status"] for row in result.rows} == {
        "good": "solved", "hang": "timeout", "last": "not_run",
    }  # fmt: skip
    assert "the budget ended" in _report(out)["ZAM_last-1"]["cause"]
    run(jobs=1)
    assert fake_worker.started(notes) == [
        *("ZAM_good-1", "ZAM_hang-1"), *("ZAM_last-1", "ZAM_hang-1"),
    ]  # fmt: skip
    assert _solutions(out) == {"ZAM_good-1", "ZAM_last-1"}


def test_what_is_done_is_not_run_again(given, notes, run, tmp_path):
    for name in ("good", "invalid", "exit"):
        _file(given, f"ZAM_{name}-1")
    run()
    first = fake_worker.started(notes)
    run()
    assert fake_worker.started(notes) == first
    (tmp_path / "out" / fake_worker.solution_name("ZAM_good-1")).unlink()
    run()
    assert fake_worker.started(notes) == [*first, "ZAM_good-1"]
    assert _solutions(tmp_path / "out") == {"ZAM_good-1"}


def test_a_solution_that_was_not_judged_counts_until_it_is(given, run, tmp_path):
    out = tmp_path / "out"
    _file(given, "ZAM_latercandidate-1")
    result = run(budget_s=6.5)  # no time for a second attempt
    (row,) = result.rows
    assert (row["status"], row["valid"], row["pass"]) == ("unjudged", False, 1)
    assert row["cause"] == "not judged: not finished within 3 s"
    assert result.solutions == result.unjudged == 1
    path = out / fake_worker.solution_name("ZAM_latercandidate-1")
    assert "attempt='1'" in path.read_text()
    (row,) = run().rows
    assert row["status"] == "solved" and "attempt='2'" in path.read_text()


def test_a_solution_that_turns_out_invalid_is_taken_back(given, run, tmp_path):
    _file(given, "ZAM_latercandidateinvalid-1")
    result = run(budget_s=6.5)
    assert result.unjudged == 1 and len(_solutions(tmp_path / "out")) == 1
    (row,) = run().rows
    assert (row["status"], row["solution"]) == ("invalid", "")
    assert _solutions(tmp_path / "out") == set()


def test_an_attempt_that_says_nothing_leaves_an_earlier_solution(given, run, tmp_path):
    _file(given, "ZAM_candidatehang-1")
    result = run(budget_s=6.5)
    assert result.unjudged == 1

    def hang(job) -> list[str]:
        return [sys.executable, "-c", "import time; time.sleep(600)"]

    (row,) = run(command=hang).rows
    assert (row["status"], row["pass"], row["limit_s"]) == ("unjudged", 2, 4.0)
    assert _solutions(tmp_path / "out") == {"ZAM_candidatehang-1"}


def test_scenarios_of_one_id_cannot_both_have_a_solution(given, notes, run):
    _file(given, "ZAM_a-1").rename(given / "second.xml")
    _file(given, "ZAM_a-1")
    rows = {row["scenario"]: row for row in run().rows}
    assert rows["ZAM_a-1"]["status"] == "solved" and rows["second"]["status"] == "bad_input"
    assert "same id as ZAM_a-1" in rows["second"]["cause"]
    assert fake_worker.started(notes) == ["ZAM_a-1"]


def test_another_planner_or_configuration_is_refused(given, run):
    _file(given, "ZAM_a-1")
    run()
    for change in ({"planner": "some.module:Class"}, {"overrides": ["cost.jerk=0.123"]}):
        with pytest.raises(InputError, match="choose another folder"):
            run(**change)
    run()  # and the folder is free again


@pytest.mark.parametrize("change", [{"jobs": 0}, {"budget_s": 0.0}, {"memory_mb": -1.0}])
def test_limits_must_be_positive(given, run, change):
    _file(given, "ZAM_a-1")
    with pytest.raises(InputError, match="positive"):
        run(**change)


def test_two_runs_in_one_folder_are_refused(given, run, tmp_path):
    _file(given, "ZAM_slow-1")
    held: list[str] = []

    def second() -> bool:
        if not held:
            held.append("tried")
            with pytest.raises(InputError, match=r"another run of mpcplan writes to .*out"):
                run()
        return False

    assert run(stop=second).solutions == 1 and held


# ------------------------------------------------------------------------------------- full disks


def test_out_that_is_a_file_is_refused(given, run, tmp_path):
    _file(given, "ZAM_a-1")
    (tmp_path / "out").write_text("")
    with pytest.raises(InputError, match=r"cannot write to .*out"):
        run()


def test_wherever_the_disk_is_full_nothing_is_half_written_and_a_rerun_goes_on(
    given, run, tmp_path, monkeypatch
):
    out, names = tmp_path / "out", {"ZAM_a-1", "ZAM_b-1"}
    for name in names:
        _file(given, name)
    really, count, full_at = os.fsync, 0, 0

    def fsync(descriptor: int) -> None:
        nonlocal count
        count += 1
        if count == full_at:
            os.ftruncate(descriptor, 3)  # as if the rest had found no room
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        really(descriptor)

    monkeypatch.setattr(files.os, "fsync", fsync)
    monkeypatch.setattr(files, "_sync_folder", lambda folder: None)  # counts files alone
    failures = 0
    while failures < 100:
        count, full_at = 0, full_at + 1
        try:
            result = run(jobs=1)
        except InputError as error:
            failures += 1
            assert "No space left on device" in str(error) and "start the same" in str(error)
            if out.is_dir():
                assert _solutions(out) <= names and not list(out.rglob("*.part"))
                if (out / "report.csv").exists():
                    assert set(_report(out)) == names
            continue
        break
    assert failures > 5 and result.solutions == 2 and _solutions(out) == names


@contextmanager
def _small_disk(folder: Path, kilobytes: int) -> Iterator[None]:
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "none", str(folder)]
    try:
        done = subprocess.run(mount, capture_output=True, check=False)
    except FileNotFoundError:
        pytest.skip("there is no mount")
    if done.returncode:
        pytest.skip("no right to mount a small disk")
    try:
        yield
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def test_a_disk_that_is_really_full(given, run, tmp_path):
    out = tmp_path / "out"
    for name in "abcdefgh":
        _file(given, f"ZAM_{name}-1")
    with _small_disk(out, kilobytes=64):
        with pytest.raises(InputError, match="No space left on device"):
            run()
        done = _solutions(out)
        assert 0 < len(done) < 8 and not list(out.rglob("*.part"))
        assert set(_report(out)) == {f"ZAM_{name}-1" for name in "abcdefgh"}
        subprocess.run(["mount", "-o", "remount,size=4096k", str(out)], check=True)
        assert run().solutions == 8 and done < _solutions(out)


# --------------------------------------------------------------------- signals, as the user's own

RUN = """
import functools
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
import fake_worker
import mpcplan.compete
from mpcplan import cli
command = fake_worker.command(Path({notes!r}))
mpcplan.compete.compete = functools.partial(mpcplan.compete.compete, command=command)
sys.exit(cli.main(["compete", {given!r}, {out!r}, "--budget", "60s"]))
"""


def _start(given: Path, out: Path, notes: Path) -> subprocess.Popen[str]:
    code = RUN.format(
        tests=str(Path(__file__).parent), notes=str(notes), given=str(given), out=str(out)
    )
    return subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "TMPDIR": str(given.parent)},  # SIGKILL leaves temporary files behind
    )  # fmt: skip


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_a_run_that_is_ended_keeps_what_is_done_and_goes_on(given, notes, run, tmp_path, number):
    out = tmp_path / "out"
    names = [f"ZAM_{name}-1" for name in ("a", "b", "latercandidate", "later", "z")]
    for i, name in enumerate(names):
        _file(given, name, 30 + 10 * i)
    process = _start(given, out, notes)
    fake_worker.until(lambda: len(fake_worker.started(notes)) == 4)
    candidate = [p for p in fake_worker.started(notes) if "candidate" in p]
    time.sleep(0.7)  # the candidate is written, both workers hang
    process.send_signal(number)
    told, errors = process.communicate(timeout=20)
    fake_worker.until(lambda: not any(map(fake_worker.alive, fake_worker.pids(notes))), 5.0)
    orderly = number != signal.SIGKILL
    assert process.returncode == (130 if orderly else -number), errors
    done = set(names[:2]) | (set(candidate) if orderly else set())
    assert _solutions(out) == done == _rows(out)
    report = _report(out)
    assert set(report) == set(names)
    if orderly:
        assert f"{len(done)} solutions, 1 of them not judged" in told
        assert report["ZAM_latercandidate-1"]["status"] == "unjudged"
        assert "it was stopped" in report["ZAM_z-1"]["cause"]
        assert "Traceback" not in errors
    run()
    assert _solutions(out) == set(names)
    assert {row["status"] for row in _report(out).values()} == {"solved"}
    again = fake_worker.started(notes)[4:]
    assert sorted(again) == ["ZAM_later-1", "ZAM_latercandidate-1", "ZAM_z-1"]


def _call(*args: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mpcplan", "compete", *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--budget", "soon"], "the budget 'soon' is no time"),
        (["--jobs", "0"], "jobs must be positive"),
        (["--engine", "dask"], "belong together"),
        (["--planner", "no.such.module:Class"], "no.such.module:Class"),
        (["--set", "no.such=1"], "no"),
    ],
)
def test_bad_arguments_are_exit_code_2(tmp_path, more, words):
    _file(tmp_path / "in", "ZAM_a-1")
    done = _call(tmp_path / "in", tmp_path / "out", *more)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("error: ") and done.stderr.count("\n") == 1
    assert words in done.stderr and not list(tmp_path.glob("out/*.xml"))


def test_an_empty_folder_and_no_folder_are_exit_code_2(tmp_path):
    assert "no such file" in _call(tmp_path / "none", tmp_path / "out").stderr
    assert "no scenario found" in _call(tmp_path, tmp_path / "out").stderr


@pytest.mark.slow
def test_bundled_scenarios_interrupted_and_resumed(tmp_path):
    from mpcplan import evaluate

    given, out = tmp_path / "in", tmp_path / "out"
    given.mkdir()
    names = [f"ZAM_{name}-1_1_T-1" for name in ("FreeRoad", "TimeOnly", "Follow", "StopInGoal")]
    for name in names:
        (given / f"{name}.xml").symlink_to(ROOT / "scenarios" / f"{name}.xml")
    (given / "ZAM_broken-1_1_T-1.xml").write_text("<commonRoad")
    process = subprocess.Popen(
        [sys.executable, "-m", "mpcplan", "compete", str(given), str(out), "--budget", "10m"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    fake_worker.until(lambda: list(out.glob("solution_*")), 120.0)
    process.send_signal(signal.SIGTERM)
    told, errors = process.communicate(timeout=20)
    assert process.returncode == 130 and "cluster" in told and "Traceback" not in errors
    early = {path.name for path in out.glob("solution_*")}
    assert 0 < len(early) < len(names)
    done = _call(given, out, "--budget", "10m")
    assert done.returncode == 0, done.stderr
    assert "4 solutions in" in done.stdout and "1 x bad_input" in done.stdout
    solved = {path.name for path in out.glob("solution_*")}
    assert solved == {f"solution_KS1:TR1:{name}:2020a.xml" for name in names} and early <= solved
    for name in names:
        path = out / f"solution_KS1:TR1:{name}:2020a.xml"
        assert evaluate(given / f"{name}.xml", path).valid
    assert {path.name for path in out.iterdir()} == solved | {WORK, "report.csv"}
