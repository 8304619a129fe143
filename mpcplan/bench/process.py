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

GRACE_S = 2.0
"""Time [s] between the request to end (SIGTERM) and the end by force (SIGKILL)."""

_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_MEMORY = re.compile(
    r"MemoryError|bad_alloc|Cannot allocate memory|out of memory|failed to map segment", re.I
)
_NO_ROOM = re.compile(r"No space left on device|Disk quota exceeded")
_FROM_OUTSIDE = (-signal.SIGTERM, -signal.SIGINT, -signal.SIGHUP)


@dataclass(frozen=True)
class End:
    """How a process ended.

    Attributes:
        code: exit code, or minus the signal's number.
        timed_out: it was ended at its time limit.
        stopped: it was ended by :meth:`Processes.stop`.
        wall_s: run time [s].
        peak_mb: largest resident memory of it and its children [MB].
    """

    code: int
    timed_out: bool
    stopped: bool
    wall_s: float
    peak_mb: float


class Processes:
    """Starts processes and can stop all that still run (from another thread)."""

    def __init__(self) -> None:
        """Nothing runs yet."""
        self._running: set[int] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def run(
        self, command: Sequence[str], scratch: Path, log: Path, timeout_s: float, memory_mb: float
    ) -> End:
        """Run a command to its end, its output in a log file.

        At the time limit the process gets SIGTERM, so that it can say how far it came, and with its
        children SIGKILL ``GRACE_S`` later. Its standard input is a pipe from this process: a worker
        that reads the pipe's end knows that nobody is left to limit it.

        Args:
            command: program and arguments.
            scratch: folder for the temporary files of the process and its children, which cannot
                remove them when they are killed.
            log: file for stdout and stderr.
            timeout_s: time limit [s].
            memory_mb: limit of the address space [MB].

        Raises:
            InterruptedError: :meth:`stop` has been called before the start.
            OSError: the process cannot be started.
        """
        start = time.monotonic()
        process = self._start(command, scratch, log)
        _limit_memory(process.pid, memory_mb)
        expired = threading.Event()

        def expire() -> None:
            expired.set()
            self._end([process.pid])

        timer = threading.Timer(timeout_s, expire)
        timer.daemon = True
        timer.start()
        code, peak_mb = self._wait(process)
        timer.cancel()
        return End(code, expired.is_set(), self._stopped, time.monotonic() - start, peak_mb)

    def _start(self, command: Sequence[str], scratch: Path, log: Path) -> subprocess.Popen[bytes]:
        """Start a process in a group of its own, so that its children die with it."""
        with log.open("wb") as output, self._lock:
            if self._stopped:
                raise InterruptedError("stopped before the start")
            process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=output,
                stderr=output,
                env={**worker_environment(), "TMPDIR": str(scratch)},
                start_new_session=True,
            )
            self._running.add(process.pid)
        return process

    def _wait(self, process: subprocess.Popen[bytes]) -> tuple[int, float]:
        """Exit code and largest memory [MB] of a process, once it and its children are gone."""
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)  # it keeps its id for now
        with self._lock:
            self._running.discard(process.pid)
            kill_group(process.pid)  # children that outlived it
            _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.stdin is not None:
            process.stdin.close()
        return process.returncode, usage.ru_maxrss / 1024

    def stop(self) -> None:
        """End all that run, with ``GRACE_S`` to say a last word, and start no more."""
        with self._lock:
            self._stopped = True
            pids = list(self._running)
        self._end(pids)

    def _end(self, pids: Sequence[int]) -> None:
        """Ask processes to end, and force those that do not."""
        self._signal(pids, signal.SIGTERM)
        force = threading.Timer(GRACE_S, lambda: self._signal(pids, signal.SIGKILL))
        force.daemon = True
        force.start()

    def _signal(self, pids: Iterable[int], number: signal.Signals) -> None:
        """A request goes to the process alone (its children serve it), force to its whole group."""
        with self._lock:  # one that has been waited for is not among them: its id may be another's
            for pid in self._running.intersection(pids):
                if number == signal.SIGKILL:
                    kill_group(pid)
                else:
                    with suppress(ProcessLookupError):
                        os.kill(pid, number)


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
        return "aborted", "killed by the system (signal 9), most likely for lack of memory"
    if end.code in _FROM_OUTSIDE:
        return "aborted", f"ended from outside (signal {-end.code})"
    if any(_NO_ROOM.search(line) for line in lines[-40:]):
        return "aborted", "no space left for the files of the run"
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
