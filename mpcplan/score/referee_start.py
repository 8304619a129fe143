"""How the referee's child process is started: as a program, or as a fork of this process.

A fork saves the seconds that loading the checker takes, in a process that has loaded it already. It
is for processes with one job (the benchmark's workers): it copies all they hold, and is no safer
than that in a program with busy threads.
"""

import faulthandler
import multiprocessing
import os
import runpy
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from mpcplan.environment import child_environment

CHILD = "mpcplan.score.referee_child"

Start = Callable[[Sequence[str], Path, float], int | None]
"""Runs the child to its end, given its arguments, the file for its output, and its time limit [s].
Returns its exit code, or minus the signal's number; None when it was killed at the limit."""


def as_program(arguments: Sequence[str], log: Path, timeout_s: float) -> int | None:
    """The child as a program; see :data:`Start`."""
    with log.open("wb") as noise:
        try:
            return subprocess.run(
                [sys.executable, "-m", CHILD, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=noise,
                stderr=noise,
                env=child_environment(),
                timeout=timeout_s,
                check=False,
            ).returncode
        except subprocess.TimeoutExpired:
            return None


def as_fork(arguments: Sequence[str], log: Path, timeout_s: float) -> int | None:
    """The child as a fork of this process; see :data:`Start`."""
    process = multiprocessing.get_context("fork").Process(target=_become, args=(arguments, log))
    process.start()
    process.join(timeout_s)
    if process.is_alive():
        process.kill()
        process.join()
        return None
    return process.exitcode


def _become(arguments: Sequence[str], log: Path) -> None:
    """In the fork: the child's module from its first line, as a program would run it."""
    faulthandler.disable()  # a crash here is told by the parent
    noise = os.open(log, os.O_WRONLY | os.O_CREAT, 0o666)
    for stream in (1, 2):
        os.dup2(noise, stream)
    sys.stdout = sys.stderr = os.fdopen(noise, "w", buffering=1)
    sys.argv = [CHILD, *arguments]
    runpy.run_module(CHILD, run_name="__main__")
