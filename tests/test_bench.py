"""The benchmark: workers that succeed, crash, hang or eat memory; resuming; tables."""

import csv
import gzip
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mpcplan.bench import bench, compare, summary
from mpcplan.bench.comparison import read_results
from mpcplan.bench.find import find_scenarios
from mpcplan.bench.run import Job
from mpcplan.bench.store import COLUMNS, STATUSES, cluster_of, empty_row
from mpcplan.bench.worker import write_trace
from mpcplan.errors import InputError

FAKE_WORKER = """
import json, os, signal, sys, time
from pathlib import Path
from mpcplan.bench.store import empty_row
name, out, row = sys.argv[1:4]
with open(Path(out, "started.txt"), "a") as file:
    file.write(name + "\\n")
if "crash" in name:
    print("about to die", flush=True)
    os.kill(os.getpid(), signal.SIGSEGV)
if "exit" in name:
    sys.exit(7)
if "hang" in name:
    time.sleep(600)
if "memory" in name:
    bytearray(10**10)
cells = empty_row(name, "solved") | {"valid": True, "TR1": 1.5, "cycles": 3, "plan_max_ms": 9.0}
Path(row).write_text(json.dumps(cells))
"""


@pytest.fixture
def worker(tmp_path: Path):
    script = tmp_path / "fake_worker.py"
    script.write_text(FAKE_WORKER)

    def command(job: Job) -> list[str]:
        return [sys.executable, str(script), job.name, str(job.out), str(job.row)]

    return command


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "scenarios"
    path.mkdir()
    for name in ("good", "crash", "exit", "hang", "memory"):
        _write(path, f"ZAM_{name}-1_1_T-1")
    return path


def _write(folder: Path, name: str, root: str = "commonRoad") -> Path:
    path = folder / f"{name}.xml"
    path.write_text(f"<?xml version='1.0'?>\n<!-- <other> --><{root} benchmarkID='{name}'/>")
    return path


def _started(out: Path) -> list[str]:
    return sorted((out / "started.txt").read_text().split())


def test_each_failure_costs_one_row_with_its_cause(folder, worker, tmp_path, capfd):
    out = tmp_path / "out"
    path, rows = bench([folder], out, 2, timeout_s=5, memory_mb=2000, command=worker)
    found = {row["cluster"]: (row["status"], row["cause"]) for row in rows}
    assert found == {
        "ZAM_good": ("solved", ""),
        "ZAM_crash": ("crash", "the process crashed (signal 11, SIGSEGV): about to die"),
        "ZAM_exit": ("crash", "the process crashed (exit code 7)"),
        "ZAM_hang": ("timeout", "not finished within 5 s"),
        "ZAM_memory": ("memory", "needs more than 2000 MB of memory"),
    }
    assert all(row["status"] in STATUSES and row["wall_s"] > 0 for row in rows)
    assert all(row["peak_mb"] > 1 for row in rows)
    shown = capfd.readouterr()
    assert shown.out == "" and shown.err.count("\n") == 5 and "[5/5]" in shown.err
    assert path == out / "results.csv"


def test_results_csv_has_all_columns_sorted_by_scenario(folder, worker, tmp_path):
    path, _ = bench([folder], tmp_path / "out", 2, timeout_s=5, memory_mb=2000, command=worker)
    with path.open(newline="") as file:
        reader = csv.DictReader(file)
        names = [row["scenario"] for row in reader]
    assert tuple(reader.fieldnames or ()) == COLUMNS
    assert names == sorted(names) and len(names) == 5


def test_second_call_runs_only_what_is_missing(tmp_path, worker):
    folder, out = tmp_path / "scenarios", tmp_path / "out"
    folder.mkdir()
    for name in ("ZAM_a-1", "ZAM_b-1"):
        _write(folder, name)
    bench([folder], out, command=worker)
    (out / "rows" / "ZAM_b-1.json").write_text("{ cut off")
    _write(folder, "ZAM_c-1")
    _, rows = bench([folder], out, command=worker)
    assert _started(out) == ["ZAM_a-1", "ZAM_b-1", "ZAM_b-1", "ZAM_c-1"]
    assert [row["scenario"] for row in rows] == ["ZAM_a-1", "ZAM_b-1", "ZAM_c-1"]


def test_another_configuration_in_the_same_folder_is_refused(tmp_path, worker):
    scenario, out = _write(tmp_path, "ZAM_a-1"), tmp_path / "out"
    bench([scenario], out, command=worker)
    config = out / "config.yaml"
    config.write_text(config.read_text() + "other: 1\n")
    with pytest.raises(InputError, match=r"another configuration.*choose another folder"):
        bench([scenario], out, command=worker)


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
sys.path.insert(0, {tests!r})
from mpcplan.bench import bench
bench([{folder!r}], {out!r}, 2, command=lambda job: [
    sys.executable, {script!r}, job.name, str(job.out), str(job.row)])
"""


def test_interruption_stops_the_workers_and_keeps_what_is_done(tmp_path, worker):
    folder, out = tmp_path / "scenarios", tmp_path / "out"
    folder.mkdir()
    for name in ("ZAM_a-1", "ZAM_hang-1"):
        _write(folder, name)
    code = INTERRUPTED.format(
        tests=str(Path(__file__).parent), folder=str(folder), out=str(out),
        script=str(tmp_path / "fake_worker.py"),
    )  # fmt: skip
    process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE)
    row = out / "rows" / "ZAM_a-1.json"
    deadline = time.monotonic() + 30
    while not row.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=10)
    assert [path.name for path in (out / "rows").iterdir()] == [row.name]


def test_find_looks_into_folders_and_passes_over_other_files(tmp_path):
    deep = tmp_path / "deep" / "er"
    deep.mkdir(parents=True)
    _write(deep, "ZAM_deep-1_1_I-1.cr")
    _write(tmp_path, "solution", "CommonRoadSolution")
    _write(tmp_path, "net", "net")
    (tmp_path / "broken.xml").write_text("")
    assert list(find_scenarios([tmp_path])) == ["ZAM_deep-1_1_I-1", "broken"]


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
