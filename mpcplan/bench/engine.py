"""Engines: where attempts run. All offer the same few methods over concurrent.futures.

Whatever the engine, each scenario runs in a child process of its own with limits of time and memory
(:mod:`mpcplan.bench.attempt`); an engine only says where that child process is started.
"""

from collections.abc import Callable, Generator, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Protocol

from mpcplan.bench.attempt import Attempt, Outcome, run_attempt
from mpcplan.bench.process import GRACE_S, Processes
from mpcplan.errors import InputError

ENGINES = ("local", "dask")
_POLL_S = 0.2  # how often a request to stop, or Ctrl-C, is looked for while all workers are busy
_LAST_WAIT_S = GRACE_S + 8.0  # for the outcomes of what was stopped


class Engine(Protocol):
    """Runs attempts."""

    @property
    def slots(self) -> int:
        """How many attempts run at a time."""
        ...

    def submit(self, attempt: Attempt) -> "Future[Outcome]":
        """Start an attempt, or queue it when all slots are taken."""
        ...

    def stop(self) -> None:
        """End all that run: their futures end soon, with :attr:`Outcome.stopped` or cancelled."""
        ...

    def close(self) -> None:
        """Stop, and give back what the engine holds."""
        ...


class LocalEngine:
    """Child processes of this process."""

    def __init__(self, jobs: int = 1) -> None:
        """Room for ``jobs`` attempts at a time."""
        self._slots = jobs
        self._pool = ThreadPoolExecutor(jobs)
        self._processes = Processes()

    @property
    def slots(self) -> int:
        """How many attempts run at a time."""
        return self._slots

    def submit(self, attempt: Attempt) -> "Future[Outcome]":
        """Start an attempt, or queue it when all slots are taken."""
        return self._pool.submit(run_attempt, attempt, self._processes)

    def stop(self) -> None:
        """End all that run."""
        self._processes.stop()
        self._pool.shutdown(wait=False, cancel_futures=True)

    def close(self) -> None:
        """Stop, and wait for the end of all processes."""
        self.stop()
        self._pool.shutdown(wait=True)


def open_engine(name: str = "local", address: str | None = None, jobs: int | None = None) -> Engine:
    """The engine of a name.

    Args:
        name: one of :data:`ENGINES`.
        address: of the cluster's scheduler, 'tcp://host:8786'; for dask only.
        jobs: attempts at a time; None: 1 locally, all threads of a cluster.

    Raises:
        InputError: the arguments do not fit, the engine is not installed, or cannot be reached.
    """
    if jobs is not None and jobs < 1:
        raise InputError(f"the number of jobs must be positive, it is {jobs}")
    if (name == "dask") != (address is not None):
        raise InputError("--engine dask and --address tcp://HOST:PORT belong together")
    if name == "local":
        return LocalEngine(jobs or 1)
    if name == "dask" and address is not None:
        from mpcplan.bench.dask_engine import DaskEngine

        return DaskEngine(address, jobs)
    raise InputError(f"no engine {name!r}; there are: {', '.join(ENGINES)}")


def run_all(
    engine: Engine,
    next_attempt: Callable[[], Attempt | None],
    stop: Callable[[], bool] = lambda: False,
) -> Generator[Outcome, None, None]:
    """Keeps an engine busy and yields outcomes as they come.

    Attempts are asked for when there is room for them, so that each can be chosen late. After
    ``stop`` says so, no more are started and those that run are stopped; their outcomes still come.
    The engine is stopped in any case at the end, also when the caller leaves early by an exception.

    Args:
        engine: runs the attempts.
        next_attempt: the next one, None when there is none at present; asked again after outcomes.
        stop: looked at several times a second.
    """
    pending: set[Future[Outcome]] = set()
    try:
        while not stop():
            while len(pending) < engine.slots and (attempt := next_attempt()) is not None:
                pending.add(engine.submit(attempt))
            if not pending:
                return
            done, pending = wait(pending, timeout=_POLL_S, return_when=FIRST_COMPLETED)
            yield from _results(done)
        engine.stop()
        done, _ = wait(pending, timeout=_LAST_WAIT_S)
        yield from _results(done)
    finally:
        engine.stop()


def _results(futures: "set[Future[Outcome]]") -> Iterator[Outcome]:
    """Outcomes of finished futures; of those that were stopped in the queue there are none."""
    for future in futures:
        if not future.cancelled() and not isinstance(future.exception(), InterruptedError):
            yield future.result()
