"""One scenario's worker process: started, limited, timed, and its end put into words."""

import os
import re
import resource
import signal
import subprocess
import threading
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_MEMORY = re.compile(
    r"MemoryError|bad_alloc|Cannot allocate memory|out of memory|failed to map segment", re.I
)


@dataclass(frozen=True)
class End:
    """How a process ended.

    Attributes:
        code: exit code, or minus the signal's number.
        timed_out: it was stopped at its time limit.
        wall_s: run time [s].
        peak_mb: largest resident memory of it and its children [MB].
    """

    code: int
    timed_out: bool
    wall_s: float
    peak_mb: float


class Processes:
    """Starts processes and can stop all that still run (from another thread)."""

    def __init__(self) -> None:
        """Nothing runs yet."""
        self._groups: set[int] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def run(self, command: Sequence[str], log: Path, timeout_s: float, memory_mb: float) -> End:
        """Run a command to its end, its output in a log file.

        Args:
            command: program and arguments.
            log: file for stdout and stderr.
            timeout_s: after this time the process and its children are killed [s].
            memory_mb: limit of the address space [MB].
        """
        start = time.monotonic()
        process = self._start(command, log)
        _limit_memory(process.pid, memory_mb)
        expired = threading.Event()

        def expire() -> None:
            expired.set()
            kill_group(process.pid)

        timer = threading.Timer(timeout_s, expire)
        timer.start()
        _, status, usage = os.wait4(process.pid, 0)
        timer.cancel()
        kill_group(process.pid)  # children that outlived it
        with self._lock:
            self._groups.discard(process.pid)
        process.returncode = os.waitstatus_to_exitcode(status)
        wall_s = time.monotonic() - start
        return End(process.returncode, expired.is_set(), wall_s, usage.ru_maxrss / 1024)

    def _start(self, command: Sequence[str], log: Path) -> subprocess.Popen[bytes]:
        """Start a process in a group of its own, so that its children die with it."""
        with log.open("wb") as output, self._lock:
            if self._stopped:
                raise InterruptedError("stopped before the start")
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                env=worker_environment(),
                start_new_session=True,
            )
            self._groups.add(process.pid)
        return process

    @property
    def stopped(self) -> bool:
        """Whether :meth:`stop` has been called."""
        return self._stopped

    def stop(self) -> None:
        """Kill all that run and start no more."""
        with self._lock:
            self._stopped = True
            for group in self._groups:
                kill_group(group)


def worker_environment() -> dict[str, str]:
    """One thread per process (the processes are the parallelism), this package importable."""
    root = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH", "")]))
    fixed = {"PYTHONPATH": path, "MPLBACKEND": "Agg", **dict.fromkeys(_ONE_THREAD, "1")}
    return {**os.environ, **fixed}


def _limit_memory(pid: int, memory_mb: float) -> None:
    """Limit the address space of a process; set from outside, as code between fork and exec is
    not safe in a program with threads. Systems without prlimit run without the limit."""
    limit = int(memory_mb * 2**20)
    if hasattr(resource, "prlimit"):
        with suppress(ProcessLookupError):  # it has already ended
            resource.prlimit(pid, resource.RLIMIT_AS, (limit, limit))


def kill_group(pid: int) -> None:
    """Kill a process with all its children; no complaint when there are none."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, signal.SIGKILL)


def judge_end(end: End, log: Path, timeout_s: float, memory_mb: float) -> tuple[str, str]:
    """Status and cause of a process that left no row."""
    if end.timed_out:
        return "timeout", f"not finished within {timeout_s:g} s"
    lines = log_lines(log)
    if any(_MEMORY.search(line) for line in lines[-40:]):
        return "memory", f"needs more than {memory_mb:g} MB of memory"
    if end.code == -signal.SIGKILL:
        return "memory", "killed by the system (signal 9), most likely for lack of memory"
    how = f"exit code {end.code}"
    if end.code < 0:
        how = f"signal {-end.code}, {signal.Signals(-end.code).name}"
    return "crash", f"the process crashed ({how})" + (f": {lines[-1][:200]}" if lines else "")


def log_lines(log: Path) -> list[str]:
    """The log's lines without blank ones and the extension modules' leak reports at exit."""
    text = log.read_text(encoding="utf-8", errors="replace") if log.exists() else ""
    return _telling(text.splitlines())


def _telling(lines: Iterable[str]) -> list[str]:
    stripped = (line.strip() for line in lines)
    return [s for s in stripped if s and not s.startswith(("nanobind", "- leaked", "See https"))]
