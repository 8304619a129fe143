"""The benchmark: workers that succeed, crash, hang or eat memory; resuming; tables."""

import csv
import gzip
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import fake_worker
import pytest

from mpcplan.bench import bench, compare, summary
from mpcplan.bench.cells import with_cells
from mpcplan.bench.comparison import read_results
from mpcplan.bench.find import benchmark_id, find_scenarios
from mpcplan.bench.job import Job, worker_command
from mpcplan.bench.process import GRACE_S
from mpcplan.bench.store import COLUMNS, CUT, STATUSES, cluster_of, empty_row
from mpcplan.bench.worker import Worker, write_trace
from mpcplan.errors import InputError


@pytest.fixture
def notes(tmp_path: Path) -> Path:
    """Where fake workers note their starts."""
    path = tmp_path / "notes"
    path.mkdir()
    return path


@pytest.fixture
def worker(notes: Path):
    return fake_worker.command(notes)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "scenarios"
    path.mkdir()
    for name in ("good", "segfault", "exit", "hang", "memory", "killed", "full", "politehang"):
        _write(path, f"ZAM_{name}-1_1_T-1")
    return path


def _write(folder: Path, name: str, root: str = "commonRoad") -> Path:
    path = folder / f"{name}.xml"
    path.write_text(f"<?xml version='1.0'?>\n<!-- <other> --><{root} benchmarkID='{name}'/>")
    return path


def test_each_failure_costs_one_row_with_its_cause(folder, worker, tmp_path, capfd):
    out = tmp_path / "out"
    path, rows = bench([folder], out, 2, timeout_s=3, memory_mb=2000, command=worker)
    found = {row["cluster"]: (row["status"], row["cause"]) for row in rows}
    killed = "killed by the system (signal 9), most likely for lack of memory"
    assert found == {
        "ZAM_good": ("solved", ""),
        "ZAM_segfault": ("crash", "the process crashed (signal 11, SIGSEGV): about to die"),
        "ZAM_exit": ("crash", "the process crashed (exit code 7)"),
        "ZAM_hang": ("timeout", "not finished within 3 s"),
        "ZAM_politehang": (
            "timeout", "not finished within 3 s (in the drive, at step 5 of at most 40)",
        ),
        "ZAM_memory": ("memory", "needs more than 2000 MB of memory"),
        "ZAM_killed": ("aborted", killed),
        "ZAM_full": ("aborted", "no space left for the files of the run"),
    }  # fmt: skip
    assert all(row["status"] in STATUSES and row["wall_s"] > 0 for row in rows)
    assert all(row["peak_mb"] > 1 for row in rows)
    shown = capfd.readouterr()
    assert shown.out == "" and shown.err.count("\n") == 8 and "[8/8]" in shown.err
    assert path == out / "results.csv"
    assert [file.name for file in (out / "solutions").iterdir()] == [
        fake_worker.solution_name("ZAM_good-1_1_T-1")
    ]
    assert "about to die" in (out / "logs" / "ZAM_segfault-1_1_T-1.log").read_text()


def test_a_process_that_ignores_the_request_to_end_is_killed(tmp_path, notes, worker):
    scenario = _write(tmp_path, "ZAM_stubbornhang-1")
    start = time.monotonic()
    _, rows = bench([scenario], tmp_path / "out", timeout_s=1, command=worker)
    assert rows[0]["status"] == "timeout" and time.monotonic() - start < 1 + 3 * GRACE_S
    assert not fake_worker.alive(fake_worker.pids(notes)[0])


def test_temporary_files_go_with_the_process_that_was_killed(tmp_path, worker, monkeypatch):
    scenario, temporary = _write(tmp_path, "ZAM_killed-1"), tmp_path / "tmp"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    bench([scenario], tmp_path / "out", command=worker)
    assert list(temporary.iterdir()) == []


def test_a_solution_that_could_not_be_judged_is_kept(tmp_path, worker):
    scenario, out = _write(tmp_path, "ZAM_candidatehang-1"), tmp_path / "out"
    _, rows = bench([scenario], out, timeout_s=2, command=worker)
    assert (rows[0]["status"], rows[0]["valid"]) == ("unjudged", False)
    assert rows[0]["cause"] == "not judged: not finished within 2 s"
    assert (out / "solutions" / fake_worker.solution_name("ZAM_candidatehang-1")).exists()


def test_results_csv_has_all_columns_sorted_by_scenario(tmp_path, worker):
    for name in ("ZAM_c-1", "ZAM_a-1", "ZAM_b-1"):
        _write(tmp_path, name)
    path, _ = bench([tmp_path], tmp_path / "out", 2, command=worker)
    with path.open(newline="") as file:
        reader = csv.DictReader(file)
        names = [row["scenario"] for row in reader]
    assert tuple(reader.fieldnames or ()) == COLUMNS
    assert names == ["ZAM_a-1", "ZAM_b-1", "ZAM_c-1"]


def test_second_call_runs_only_what_is_missing(tmp_path, notes, worker):
    folder, out = tmp_path / "scenarios", tmp_path / "out"
    folder.mkdir()
    for name in ("ZAM_a-1", "ZAM_b-1"):
        _write(folder, name)
    bench([folder], out, command=worker)
    (out / "rows" / "ZAM_b-1.json").write_text("{ cut off")
    _write(folder, "ZAM_c-1")
    _, rows = bench([folder], out, command=worker)
    assert fake_worker.started(notes) == ["ZAM_a-1", "ZAM_b-1", "ZAM_b-1", "ZAM_c-1"]
    assert [row["scenario"] for row in rows] == ["ZAM_a-1", "ZAM_b-1", "ZAM_c-1"]


def test_another_configuration_or_planner_in_the_same_folder_is_refused(tmp_path, worker):
    scenario, out = _write(tmp_path, "ZAM_a-1"), tmp_path / "out"
    bench([scenario], out, command=worker)
    with pytest.raises(InputError, match=r"now: jerk: 0\.123.*choose another folder"):
        bench([scenario], out, command=worker, overrides=["cost.jerk=0.123"])
    with pytest.raises(InputError, match=r"now: planner: some\.module:Class"):
        bench([scenario], out, command=worker, planner="some.module:Class")


def test_the_planner_is_in_the_workers_command_and_in_the_row(tmp_path, worker):
    seen = []

    def command(job: Job) -> list[str]:
        seen.append(worker_command(job))
        return [sys.executable, "-c", ""]

    scenario = _write(tmp_path, "ZAM_a-1")
    _, rows = bench([scenario], tmp_path / "out", planner="my.module:Class", command=command)
    assert seen[0][seen[0].index("--planner") + 1] == "my.module:Class"
    assert rows[0]["planner"] == "my.module:Class"
    _, rows = bench([scenario], tmp_path / "out2", command=worker)
    assert rows[0]["planner"] == "mpcplan"


@pytest.mark.parametrize("limit", [{"jobs": 0}, {"timeout_s": 0}, {"memory_mb": -1}])
def test_limits_must_be_positive(tmp_path, worker, limit):
    with pytest.raises(InputError, match="positive"):
        bench([_write(tmp_path, "ZAM_a-1")], tmp_path / "out", command=worker, **limit)


def test_out_that_is_a_file_is_refused(tmp_path, worker):
    (tmp_path / "out").write_text("")
    with pytest.raises(InputError, match="cannot write"):
        bench([_write(tmp_path, "ZAM_a-1")], tmp_path / "out", command=worker)


INTERRUPTED = """
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
import fake_worker
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it
from mpcplan.bench import bench
bench([{folder!r}], {out!r}, 2, command=fake_worker.command(Path({notes!r})))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_interruption_stops_the_workers_and_keeps_what_is_done(tmp_path, notes, number):
    folder, out = tmp_path / "scenarios", tmp_path / "out"
    folder.mkdir()
    for name in ("ZAM_a-1", "ZAM_hang-1"):
        _write(folder, name)
    code = INTERRUPTED.format(
        tests=str(Path(__file__).parent), folder=str(folder), out=str(out), notes=str(notes)
    )
    environment = {**os.environ, "TMPDIR": str(tmp_path)}  # SIGKILL leaves temporary files behind
    process = subprocess.Popen(
        [sys.executable, "-c", code], stderr=subprocess.PIPE, env=environment
    )
    row = out / "rows" / "ZAM_a-1.json"
    fake_worker.until(lambda: row.exists() and len(fake_worker.started(notes)) == 2)
    process.send_signal(number)
    process.communicate(timeout=10)
    fake_worker.until(lambda: not any(map(fake_worker.alive, fake_worker.pids(notes))), 5.0)
    assert [path.name for path in (out / "rows").iterdir()] == [row.name]


def test_find_looks_into_folders_and_passes_over_other_files(tmp_path):
    deep = tmp_path / "deep" / "er"
    deep.mkdir(parents=True)
    _write(deep, "ZAM_deep-1_1_I-1.cr")
    _write(tmp_path, "solution", "CommonRoadSolution")
    _write(tmp_path, "net", "net")
    (tmp_path / "broken.xml").write_text("")
    assert list(find_scenarios([tmp_path])) == ["ZAM_deep-1_1_I-1", "broken"]


def _interactive(folder: Path, name: str) -> Path:
    """An interactive scenario's folder, as far as finding it goes."""
    path = folder / name
    path.mkdir(parents=True)
    _write(path, f"{name}.cr")
    _write(path, f"{name}.net", "net")
    return path


def test_find_takes_interactive_folders_whole(tmp_path):
    inside = _interactive(tmp_path / "deep", "ZAM_folder-1_1_I-1")
    _write(tmp_path / "deep", "ZAM_file-1_1_T-1.cr")
    wanted = {"ZAM_file-1_1_T-1": "ZAM_file-1_1_T-1.cr.xml", "ZAM_folder-1_1_I-1": inside.name}
    assert {name: p.name for name, p in find_scenarios([tmp_path]).items()} == wanted
    assert find_scenarios([inside]) == {inside.name: inside}
    renamed = inside.rename(tmp_path / "another name")
    assert find_scenarios([renamed]) == {"ZAM_folder-1_1_I-1": renamed}


def test_find_passes_over_results_hidden_folders_and_circles(tmp_path):
    _write(tmp_path, "ZAM_a-1")
    for name in (".hidden", "out"):
        (tmp_path / name).mkdir()
        _write(tmp_path / name, "ZAM_b-1")
    (tmp_path / "circle").symlink_to(tmp_path)
    assert list(find_scenarios([tmp_path], exclude=tmp_path / "out")) == ["ZAM_a-1"]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (
            "<?xml?><!-- x -->\n<commonRoad author='a'\n benchmarkID = \"ZAM_X-1_1_T-1\">",
            "ZAM_X-1_1_T-1",
        ),
        ("<commonRoad benchmarkID='../evil'>", "file"),
        ("<net benchmarkID='ZAM_X-1'>", "file"),
        ("", "file"),
    ],
)
def test_the_id_is_read_from_the_file(tmp_path, text, found):
    path = tmp_path / "file.xml"
    path.write_text(text)
    assert benchmark_id(path) == found


def test_rows_have_the_id_however_they_end(tmp_path, worker):
    path = tmp_path / "hang another name.xml"
    path.write_text("<commonRoad benchmarkID='ZAM_X-1_1_T-1'/>")
    _, rows = bench([path], tmp_path / "out", timeout_s=1, command=worker)
    assert (rows[0]["scenario"], rows[0]["status"]) == ("ZAM_X-1_1_T-1", "timeout")


def test_find_refuses_missing_empty_and_ambiguous(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        find_scenarios([tmp_path / "none.xml"])
    with pytest.raises(InputError, match="no scenario found"):
        find_scenarios([tmp_path])
    (tmp_path / "sub").mkdir()
    _write(tmp_path, "ZAM_a-1")
    _write(tmp_path / "sub", "ZAM_a-1")
    with pytest.raises(InputError, match="same file name"):
        find_scenarios([tmp_path])
    assert len(find_scenarios([tmp_path / "sub", tmp_path / "sub" / "ZAM_a-1.xml"])) == 1


@pytest.mark.parametrize(
    ("scenario", "cluster"),
    [
        ("DEU_Flensburg-67_1_T-1", "DEU_Flensburg"),
        ("USA_US101-5_1_T-1", "USA_US101"),
        ("C-DEU_A9-2_1_T-1", "DEU_A9"),
    ],
)
def test_cluster_is_country_and_map(scenario, cluster):
    assert cluster_of(scenario) == cluster


def test_worker_makes_a_row_of_bad_input(tmp_path):
    bad, row = _write(tmp_path, "ZAM_bad-1"), tmp_path / "row.json"
    (tmp_path / "config.yaml").write_text("")
    command = [sys.executable, "-m", "mpcplan.bench.worker", str(bad), str(tmp_path), str(row)]
    subprocess.run([*command, "--config", str(tmp_path / "config.yaml")], check=True)
    cells = json.loads(row.read_text())
    assert cells["status"] == "bad_input" and "ZAM_bad-1.xml" in cells["cause"]
    assert set(cells) == set(COLUMNS)


def test_worker_makes_a_row_of_a_planner_that_is_not_there(tmp_path):
    row = tmp_path / "row.json"
    (tmp_path / "config.yaml").write_text("")
    scenario = Path(__file__).parents[1] / "scenarios" / "ZAM_FreeRoad-1_1_T-1.xml"
    command = [sys.executable, "-m", "mpcplan.bench.worker", str(scenario), str(tmp_path), str(row)]
    more = ["--config", str(tmp_path / "config.yaml"), "--planner", "no.such:Thing"]
    subprocess.run([*command, *more], check=True)
    cells = json.loads(row.read_text())
    assert (cells["status"], cells["planner"]) == ("bad_input", "no.such:Thing")
    assert "no.such:Thing" in cells["cause"]


def test_a_valid_row_without_a_cost_says_why(tmp_path, monkeypatch):
    """The official evaluator fails on some valid solutions, which have no TR1 then."""
    from mpcplan.score import official

    def outside(case):
        raise ValueError("outside of the projection domain")

    monkeypatch.setattr(official, "partial_costs", outside)  # the judging child is a fork
    (tmp_path / "config.yaml").write_text("")
    scenario = Path(__file__).parents[1] / "scenarios" / "ZAM_FreeRoad-1_1_T-1.xml"
    files = tmp_path, tmp_path / "row.json", tmp_path / "config.yaml"
    row = Worker(scenario, *files, bound=True).work()
    assert (row["status"], row["valid"], row["TR1"], row["cause"]) == ("solved", True, "", "")
    assert row["notes"] == "no cost: ValueError: outside of the projection domain"
    assert row["bound_by"] == "no bound: the run has no cost"


def test_notes_are_added_to_each_other():
    row = with_cells({"notes": "", "cycles": 1}, {"notes": "a repair"}, {}, {"notes": "no cost"})
    assert row == {"notes": "a repair; no cost", "cycles": 1}


def test_worker_that_is_asked_to_end_says_how_far_it_came(tmp_path, monkeypatch):
    row = tmp_path / "row.json"
    worker = Worker(_write(tmp_path, "ZAM_a-1"), tmp_path, row, tmp_path / "config.yaml")
    worker._progress(5, 40)
    sent = []
    monkeypatch.setattr(os, "kill", lambda *args: sent.append(args))
    monkeypatch.setattr(signal, "signal", lambda *args: None)
    worker.cut(signal.SIGTERM, None)
    cells = json.loads(row.read_text())
    assert cells["status"] == CUT and cells["cause"] == "in the drive, at step 5 of at most 40"
    assert sent == [(os.getpid(), signal.SIGTERM)]
    row.write_text(json.dumps(cells | {"status": "unjudged"}))
    worker.cut(signal.SIGTERM, None)  # a candidate's row stays
    assert json.loads(row.read_text())["status"] == "unjudged"


def test_same_trace_same_bytes(tmp_path):
    paths = [tmp_path / "a.json.gz", tmp_path / "b.json.gz"]
    for path in paths:
        write_trace({"b": 1, "a": [1.5]}, path)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert json.loads(gzip.decompress(paths[0].read_bytes())) == {"a": [1.5], "b": 1}


def _rows() -> list[dict]:
    cost = {"status": "solved", "valid": True, "plan_p50_ms": 10.0, "plan_p95_ms": 20.0}
    return [
        empty_row("A_X-1") | cost | {"TR1": 1.0, "TR1_report": 2.0, "plan_max_ms": 30.0},
        empty_row("A_X-2") | cost | {"TR1": 3.0, "TR1_report": 4.0, "plan_max_ms": 50.0},
        empty_row("A_Y-1", "invalid", "no_collision: problem 3: hits obstacle 44 at step 7"),
        empty_row("B_Z-1", "invalid", "no_collision: problem 9: hits obstacle 2 at step 13"),
        empty_row("B_Z-2", "timeout", "not finished within 5 s"),
    ]


def test_summary_counts_costs_times_and_causes():
    lines = summary(_rows()).splitlines()
    cells = {line.split()[0]: line.split()[1:] for line in lines[:5]}
    assert cells["A_X"] == ["2", "2", "2.000", "1.000", "2.000", "3.000", "3.000"]
    assert cells["B_Z"] == ["2", "0", "-", "-", "-", "-", "-"]
    assert cells["all"][:2] == ["5", "2"]
    text = "\n".join(lines)
    assert "p50 10.0 ms, p95 20.0 ms" in text and "longest 50.0 ms" in text
    assert "2 x invalid: no_collision: problem 3: hits obstacle 44 at step 7 (A_Y-1)" in text
    assert "1 x timeout: not finished within 5 s (B_Z-2)" in text
    assert "recorded: 5 scenarios: solved 2, invalid 2, timeout 1" in text
    assert "interactive" not in text


def test_summary_of_interactive_scenarios_tells_what_is_valid_late():
    rows = [row | {"kind": "interactive"} for row in _rows()[:3]]
    rows[0] |= {"valid_late": True, "sim_ms_p50": 0.5, "sim_ms_max": 3.0}
    rows[1] |= {"valid_late": False, "cause_late": "no_collision: obstacle 4 at step 5"}
    text = summary(rows)
    assert "valid on time 2 of 3 (66.7%), also with the ego one step late 1 of 3 (33.3%)" in text
    assert "1 x late: no_collision: obstacle # at step #" in text
    assert "simulation per step: p50 0.50 ms (median over the scenarios), longest 3.0 ms" in text


def test_summary_tells_the_parts_of_tr1_weighted():
    rows = [row | {"Jlon": 100.0, "SR": 1.0, "D": 0.5, "LC": 2.0} for row in _rows()[:2]]
    lines = {line.split()[0]: line.split()[-3:] for line in summary(rows).splitlines() if line}
    assert lines["TR1"] == ["2.000", "2.000", "3.000"]
    assert lines["Jlon"] == ["1.000"] * 3 and lines["SR"] == ["22.000"] * 3
    assert lines["D"] == ["4.000"] * 3 and lines["LC"] == ["1.000"] * 3


def test_summary_of_nothing_solved():
    assert "not solved: 1 of 1" in summary(_rows()[-1:])


def _table(path: Path, rows: list[tuple], columns: str = "scenario,valid,TR1") -> Path:
    path.write_text("\n".join([columns, *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


def test_compare_uses_what_both_solved(tmp_path):
    ours = [("X_A-1", True, 1.0), ("X_A-2", True, 2.0), ("X_A-3", True, 9.0), ("X_A-4", False, "")]
    theirs = [("X_A-1", True, 2.0), ("X_A-2", True, 2.0), ("X_A-3", False, 1.0), ("X_A-4", True, 5)]
    text = compare(_table(tmp_path / "a.csv", ours), _table(tmp_path / "b.csv", theirs))
    assert "4 scenarios in common: both solved 2, only A 1, only B 1, neither 0" in text
    assert "only A: X_A-3" in text and "only B: X_A-4" in text
    assert "ratio of the means 0.750, median of the ratios 0.750" in text
    assert "A is better on 1, B on 0, equal on 1" in text


def test_compare_with_one_or_all_planners(tmp_path):
    a = _table(tmp_path / "a.csv", [("X_A-1", True, 1.0)])
    columns = "scenario,planner,valid,TR1"
    rows = [("X_A-1", "fast", True, 2.0), ("X_A-1", "slow", True, 4.0)]
    b = _table(tmp_path / "b.csv", rows, columns)
    assert "ratio of the means 0.500" in compare(a, b, "fast")
    text = compare(a, b)
    assert "B = fast" in text and "B = slow" in text
    with pytest.raises(InputError, match="it has: fast, slow"):
        compare(a, b, "none")


def test_compare_without_common_scenarios(tmp_path):
    a = _table(tmp_path / "a.csv", [("X_A-1", True, 1.0)])
    b = _table(tmp_path / "b.csv", [("X_A-2", True, 1.0)])
    assert "no scenario in common" in compare(a, b)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("scenario,TR1\nX,1\n", "no column valid"),
        ("", "no column"),
        ("scenario,valid,TR1\n", "no rows"),
        ("scenario,valid,TR1\nX\n", "line 2.*incomplete"),
        ("scenario,valid,TR1\nX,perhaps,1\n", "perhaps"),
        ("scenario,valid,TR1\nX,True,many\n", "line 2: TR1 is 'many'"),
        ("\udcff\udcfe", "not a CSV"),
    ],
)
def test_broken_tables_are_input_errors(tmp_path, text, words):
    path = tmp_path / "a.csv"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(InputError, match=words):
        read_results(path)
    with pytest.raises(InputError, match=os.strerror(2)):
        read_results(tmp_path / "none.csv")
