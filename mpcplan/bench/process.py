"""One scenario's worker process: started, limited, timed, and its end put into words."""

import os
import re
import resource
import signal
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from mpcplan.bench.child import Child, Nursery, Program
from mpcplan.bench.job import WORKER

GRACE_S = 2.0
"""Time [s] between the request to end (SIGTERM) and the end by force (SIGKILL)."""

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
        self._idle: list[Nursery] = []
        self._loading: list[Nursery] = []
        self._lock = threading.Lock()
        self._stopped = False

    def run(
        self, command: Sequence[str], scratch: Path, log: Path, timeout_s: float, memory_mb: float
    ) -> End:
        """Run a command to its end, its output in a log file.

        At the time limit the process gets SIGTERM, so that it can say how far it came, and with its
        children SIGKILL ``GRACE_S`` later. Its standard input is a pipe from this process: a worker
        that sees the pipe's end knows that nobody is left to limit it. The package's own workers
        come from a nursery, which loads once what they all need; other commands are started as
        programs.

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
        if tuple(command[: len(WORKER)]) != WORKER:
            return self._run(lambda: Program(command, scratch, log), timeout_s, memory_mb)
        nursery, arguments = self._nursery(), command[len(WORKER) :]
        try:
            return self._run(lambda: nursery.start(arguments, scratch, log), timeout_s, memory_mb)
        finally:
            self._give_back(nursery)

    def _run(self, start: Callable[[], Child], timeout_s: float, memory_mb: float) -> End:
        began = time.monotonic()
        with self._lock:
            self._refuse_when_stopped()
            child = start()
            self._running.add(child.pid)
        _limit_memory(child.pid, memory_mb)
        expired = threading.Event()

        def expire() -> None:
            expired.set()
            self._end([child.pid])

        timer = threading.Timer(timeout_s, expire)
        timer.daemon = True
        timer.start()
        child.wait()
        with self._lock:
            self._running.discard(child.pid)
            kill_group(child.pid)  # children that outlived it
            code, peak_mb = child.reap()
        timer.cancel()
        return End(code, expired.is_set(), self._stopped, time.monotonic() - began, peak_mb)

    def _refuse_when_stopped(self) -> None:
        if self._stopped:
            raise InterruptedError("stopped before the start")

    def _nursery(self) -> Nursery:
        """A nursery that is free: one that is left, or a new one."""
        with self._lock:
            self._refuse_when_stopped()
            while self._idle:
                nursery = self._idle.pop()
                if nursery.alive:
                    return nursery
                nursery.close()
            nursery = Nursery()
            self._loading.append(nursery)
        nursery.ready()
        with self._lock:
            self._loading.remove(nursery)
        return nursery

    def _give_back(self, nursery: Nursery) -> None:
        """Keep a nursery for the next worker, if it is still good and there may be one."""
        with self._lock:
            if nursery.alive and not self._stopped:
                self._idle.append(nursery)
            else:
                nursery.close()

    def stop(self) -> None:
        """End all that run, with ``GRACE_S`` to say a last word, and start no more."""
        with self._lock:
            self._stopped = True
            pids = list(self._running)
            for nursery in (*self._idle, *self._loading):
                nursery.close()
            self._idle.clear()
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
