"""The command line as the user calls it: output, exit codes, no noise."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import straight_road as road

from mpcplan import cli
from mpcplan.cli import arguments
from mpcplan.console import quiet

ROOT = Path(__file__).resolve().parents[1]
EASY = ROOT / "scenarios" / "ZAM_FreeRoad-1_1_T-1.xml"
COMMAND = [sys.executable, "-m", "mpcplan"]


def _call(*args: object, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [*COMMAND, *map(str, args)], capture_output=True, text=True, cwd=cwd, timeout=300,
        env={**os.environ, "PYTHONPATH": path}, check=False,
    )  # fmt: skip


def _one_error_line(done: subprocess.CompletedProcess[str]) -> str:
    assert done.stdout == ""
    assert done.stderr.startswith("error: ") and done.stderr.count("\n") == 1
    return done.stderr


def test_help_is_quick_and_names_all_commands():
    start = time.monotonic()
    done = _call("--help")
    assert done.returncode == 0 and time.monotonic() - start < 2.0
    for name in ("solve", "evaluate", "bench", "compare", "config"):
        assert name in done.stdout
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "mpcplan", "--help"],
        capture_output=True, text=True, cwd=ROOT, check=True,
    )  # fmt: skip
    assert not [m for m in ("numpy", "casadi", "commonroad", "pydantic") if m in done.stderr]


@pytest.mark.parametrize("args", [[], ["fly"], ["solve"], ["bench", "x"], ["bench", "--jobs", "a"]])
def test_wrong_usage_is_exit_code_2(args):
    done = _call(*args)
    assert done.returncode == 2 and "usage:" in done.stderr and "Traceback" not in done.stderr


@pytest.mark.parametrize("command", ["solve", "evaluate", "bench"])
def test_missing_file_is_bad_input(command, tmp_path):
    extra = {"solve": [], "evaluate": ["s.xml"], "bench": ["--out", tmp_path / "out"]}[command]
    done = _call(command, tmp_path / "none.xml", *extra)
    assert done.returncode == 2
    assert "none.xml" in _one_error_line(done)


@pytest.mark.parametrize("command", ["solve", "evaluate"])
def test_broken_scenario_is_bad_input(command, tmp_path):
    broken = tmp_path / "broken.xml"
    broken.write_text("<commonRoad")
    done = _call(command, broken, *([broken] if command == "evaluate" else ()), cwd=tmp_path)
    assert done.returncode == 2
    assert "broken.xml" in _one_error_line(done)


@pytest.mark.parametrize("command", [["config"], ["solve", EASY], ["bench", EASY, "--out", "x"]])
def test_wrong_parameter_is_bad_input(command, tmp_path):
    done = _call(*command, "--set", "no.such=1", cwd=tmp_path)
    assert done.returncode == 2
    assert "no" in _one_error_line(done)


def test_config_prints_what_is_in_effect(tmp_path):
    done = _call("config", "--set", "cost.jerk=0.25")
    assert done.returncode == 0 and "jerk: 0.25" in done.stdout and done.stderr == ""
    file = tmp_path / "mine.yaml"
    file.write_text(done.stdout)
    assert _call("config", "--config", file).stdout == done.stdout


def test_evaluate_valid_and_not_valid(tmp_path):
    scenario = road.write_scenario(tmp_path)
    solution = road.write_solution(tmp_path, road.straight())
    done = _call("evaluate", scenario, solution)
    assert done.returncode == 0 and done.stderr == ""
    assert done.stdout.startswith(f"{road.ID}: valid\nTR1 ")

    solution = road.write_solution(tmp_path, road.straight(steps=10))
    done = _call("evaluate", scenario, solution)
    assert done.returncode == 1 and done.stderr == ""
    assert "failed    goal: problem 100" in done.stdout


def test_evaluate_as_json(tmp_path):
    scenario = road.write_scenario(tmp_path)
    done = _call("evaluate", scenario, road.write_solution(tmp_path, road.straight()), "--json")
    verdict = json.loads(done.stdout)
    assert verdict["valid"] is True and set(verdict["parts"]) == {"Jlon", "SR", "D", "LC"}


def test_compare(tmp_path):
    table = tmp_path / "results.csv"
    table.write_text("scenario,valid,TR1\nX_A-1,True,1.5\n")
    done = _call("compare", table, tmp_path)
    assert done.returncode == 0 and "both solved 1" in done.stdout
    assert _call("compare", table, tmp_path, "--planner", "z").returncode == 2


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (KeyboardInterrupt(), 130, ""),
        (ZeroDivisionError("of ours"), 3, "unexpected ZeroDivisionError: of ours"),
    ],
)
def test_other_ends(monkeypatch, capsys, error, code, words):
    def fail(args):
        raise error

    monkeypatch.setattr(arguments, "compare", fail)
    assert cli.main(["compare", "a", "b"]) == code
    shown = capsys.readouterr()
    assert shown.out == "" and words in shown.err
    if code == cli.INTERNAL:
        report = Path(shown.err.split("traceback in ")[1].rstrip(")\n"))
        assert "ZeroDivisionError" in report.read_text()
        report.unlink()
    else:
        assert shown.err == ""


def test_a_closed_pipe_is_no_error(tmp_path):
    table = tmp_path / "results.csv"
    rows = "".join(f"X_A{i:03}-1,True,1.5\n" for i in range(5000))
    table.write_text("scenario,valid,TR1\n" + rows)
    text = " ".join([*COMMAND, "compare", str(table), str(table), "| head -1"])
    done = subprocess.run(text, shell=True, capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stderr == "" and done.stdout.startswith("A = ")


def test_quiet_keeps_the_libraries_words_from_the_user(capfd):
    with quiet() as terminal:
        os.write(1, b"noise")
        print("more noise", file=sys.stderr)
        terminal.write("ours\n")
    print("afterwards")
    assert capfd.readouterr() == ("afterwards\n", "ours\n")


@pytest.mark.slow
def test_solve_writes_its_files_and_says_what_came_out(tmp_path):
    done = _call("solve", EASY, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    name = EASY.stem
    assert done.stdout.startswith(f"{name}: solved, valid\n")
    for words in ("reached at step", "under the checker's weights", "p95", "files"):
        assert words in done.stdout
    folder = tmp_path / "out" / name
    assert {p.name for p in folder.iterdir()} == {
        "trace.json", f"{name}.png", f"solution_KS1:TR1:{name}:2020a.xml",
    }  # fmt: skip
    json.loads((folder / "trace.json").read_text())


@pytest.mark.slow
def test_solve_out_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    done = _call("solve", EASY, "--out", tmp_path / "file" / "x")
    assert done.returncode == 2
    assert "cannot make the folder" in _one_error_line(done)


@pytest.mark.slow
def test_bench_prints_the_table(tmp_path):
    done = _call("bench", EASY, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "cluster" in done.stdout and "ZAM_FreeRoad" in done.stdout
    assert (tmp_path / "out" / "results.csv").exists()
    assert list((tmp_path / "out" / "solutions").iterdir())
    assert list((tmp_path / "out" / "traces").iterdir())


@pytest.mark.slow
def test_interrupt_is_quiet(tmp_path):
    process = subprocess.Popen(
        [*COMMAND, "solve", str(EASY), "--out", str(tmp_path)], cwd=ROOT,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        # a shell's background jobs, and the tests in one, ignore interrupts and hand that on
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 130 and out == b"" and err == b""
