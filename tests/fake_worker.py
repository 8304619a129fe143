"""A worker of the benchmark that does what its scenario's name says, in no time.

Usage: python fake_worker.py NAME OUT ROW NOTES; every start is noted in the folder NOTES.
"""

import json
import os
import signal
import sys
import tempfile
import time
from pathlib import Path

from mpcplan.bench.job import Job
from mpcplan.bench.store import CUT, UNJUDGED, empty_row
from mpcplan.bench.worker import end_with_parent

HANG_S = 600.0


def command(notes: Path):
    """What bench and compete take as ``command``."""

    def make(job: Job) -> list[str]:
        out = [job.name, str(job.out), str(job.row)]
        return [sys.executable, str(Path(__file__).resolve()), *out, str(notes)]

    return make


def started(notes: Path) -> list[str]:
    """Names of the scenarios in the order in which their workers were started."""
    path = notes / "started.txt"
    return path.read_text().split() if path.exists() else []


def pids(notes: Path) -> list[int]:
    return [int(pid) for pid in (notes / "pids.txt").read_text().split()]


def alive(pid: int) -> bool:
    """Whether a process runs (a zombie does not)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def until(condition, seconds: float = 30.0) -> None:
    """Wait for something that another process does."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it did not come"
        time.sleep(0.02)


def solution_name(name: str) -> str:
    return f"solution_KS1:TR1:{name}:2020a.xml"


def main() -> None:
    name, out, row, notes = sys.argv[1], *(Path(arg) for arg in sys.argv[2:5])
    before = started(notes).count(name)
    for file, text in (("started.txt", name), ("pids.txt", os.getpid())):
        with (notes / file).open("a") as stream:
            stream.write(f"{text}\n")
    Path(tempfile.mkdtemp(prefix="mpcplan-fake-"), "left").write_text("behind")
    end_with_parent()
    solved = empty_row(name, "solved") | {"valid": True, "TR1": 1.5, "cycles": 3}

    def write(cells: dict) -> None:
        row.write_text(json.dumps(cells))

    def solve() -> None:
        path = out / "solutions" / solution_name(name)
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"<CommonRoadSolution attempt='{before + 1}'/>" + 500 * "\n")

    def say_where(number: int, _: object) -> None:
        write(empty_row(name, CUT, "in the drive, at step 5 of at most 40"))
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)

    if "segfault" in name:
        print("about to die", flush=True)
        os.kill(os.getpid(), signal.SIGSEGV)
    if "exit" in name:
        sys.exit(7)
    if "killed" in name:
        os.kill(os.getpid(), signal.SIGKILL)
    if "full" in name:
        raise OSError(28, "No space left on device")
    if "memory" in name:
        bytearray(10**10)
    if "polite" in name:
        signal.signal(signal.SIGTERM, say_where)
    if "stubborn" in name:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if "candidate" in name and not ("later" in name and before):
        solve()
        write(solved | {"status": UNJUDGED, "valid": False, "cause": "not judged"})
    if "hang" in name or ("later" in name and not before):
        time.sleep(HANG_S)
    if "slow" in name:
        time.sleep(1.0)
    solve()
    if "invalid" in name:
        write(solved | {"status": "invalid", "valid": False, "cause": "no_collision: of a test"})
    else:
        write(solved)


if __name__ == "__main__":
    main()
