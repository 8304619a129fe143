"""Child processes that run one worker each: started as a program, or by a nursery.

Both are the first of a group of processes, so that their children die with them, and both have a
pipe from this process as standard input: who sees its end knows that nobody is left to limit it.
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

from mpcplan.environment import child_environment

_NURSERY = (sys.executable, "-m", "mpcplan.bench.nursery")


class Child(Protocol):
    """A running process."""

    @property
    def pid(self) -> int:
        """Its id, which is also its group's; nobody else's until :meth:`reap`."""
        ...

    def wait(self) -> None:
        """Returns when it has ended."""
        ...

    def reap(self) -> tuple[int, float]:
        """Exit code (or minus the signal's number) and largest memory [MB], once it has ended."""
        ...


class Program:
    """A child started as a program."""

    def __init__(self, command: Sequence[str], scratch: Path, log: Path) -> None:
        """Starts it, with a folder for temporary files and a file for its output.

        Raises:
            OSError: it cannot be started.
        """
        with log.open("wb") as output:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=output,
                stderr=output,
                env={**child_environment(), "TMPDIR": str(scratch)},
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """See :class:`Child`."""
        return self._process.pid

    def wait(self) -> None:
        """See :class:`Child`."""
        os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOWAIT)  # it keeps its id for now

    def reap(self) -> tuple[int, float]:
        """See :class:`Child`."""
        _, status, usage = os.wait4(self.pid, 0)
        self._process.returncode = os.waitstatus_to_exitcode(status)
        if self._process.stdin is not None:
            self._process.stdin.close()
        return self._process.returncode, usage.ru_maxrss / 1024


class Nursery:
    """A process that has loaded all that workers need, and forks one child after another.

    Loading takes several seconds, as long as many a scenario. See :mod:`mpcplan.bench.nursery`.
    """

    def __init__(self) -> None:
        """Starts it; raises OSError where that is not possible."""
        self._process = subprocess.Popen(
            _NURSERY,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=child_environment(),
            start_new_session=True,
        )

    @property
    def alive(self) -> bool:
        """Whether it can still start a child."""
        return self._process.poll() is None

    def ready(self) -> None:
        """Returns when it has loaded everything, or has died."""
        self._hear()

    def start(self, arguments: Sequence[str], scratch: Path, log: Path) -> "Forked":
        """A child with a worker's arguments.

        Raises:
            OSError: there is no room for another process, or the nursery has died.
        """
        log.touch()
        self._say({"arguments": list(arguments), "scratch": str(scratch), "log": str(log)})
        answer = self._hear()
        if "pid" not in answer:
            raise OSError(answer.get("error", "the process that starts the workers has died"))
        return Forked(self, int(answer["pid"]))

    def wait(self) -> None:
        """Returns when its child has ended, or it has died itself."""
        self._hear()

    def reap(self) -> tuple[int, float]:
        """The end of its child; as if killed where the nursery has died itself."""
        self._say({})
        answer = self._hear()
        return int(answer.get("code", -signal.SIGKILL)), float(answer.get("peak_mb", 0.0))

    def close(self) -> None:
        """Ends it; once is enough, twice does no harm."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(BrokenPipeError):
                    pipe.close()

    def _say(self, message: dict[str, Any]) -> None:
        assert self._process.stdin is not None
        with suppress(BrokenPipeError, ValueError):  # dead or closed: the answer is then missing
            self._process.stdin.write(json.dumps(message).encode() + b"\n")
            self._process.stdin.flush()

    def _hear(self) -> dict[str, Any]:
        """Its next answer; nothing, and its end, when it does not answer any more."""
        assert self._process.stdout is not None
        try:
            line = self._process.stdout.readline()
        except ValueError:  # closed
            line = b""
        if line:
            answer: dict[str, Any] = json.loads(line)
            return answer
        self.close()
        return {}


class Forked:
    """The present child of a nursery."""

    def __init__(self, nursery: Nursery, pid: int) -> None:
        self._nursery, self._pid = nursery, pid

    @property
    def pid(self) -> int:
        """See :class:`Child`."""
        return self._pid

    def wait(self) -> None:
        """See :class:`Child`."""
        self._nursery.wait()

    def reap(self) -> tuple[int, float]:
        """See :class:`Child`."""
        return self._nursery.reap()
