"""The Dask engine: attempts as tasks of a Dask cluster (optional dependency ``distributed``).

A task takes the scenario's files with it and brings rows, solutions, traces and logs back, so the
cluster's machines need this package but no common file system. The task starts the scenario's child
process, with its limits, on the machine that it is given to.
"""

import logging
import socket
import uuid
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from contextlib import suppress
from typing import Any

from mpcplan import __version__
from mpcplan.bench.attempt import Attempt, Outcome, failed, run_attempt, ship
from mpcplan.bench.process import Processes
from mpcplan.errors import InputError, MpcplanError

CONNECT_S = 10.0
"""How long the scheduler is looked for [s]."""

_here: dict[str, Processes] = {}
"""In a process of the cluster: its child processes, by the run that they belong to."""


def run_here(run: str, attempt: Attempt) -> Outcome:
    """Run an attempt on the machine of this call (a task of the cluster)."""
    return run_attempt(attempt, _here.setdefault(run, Processes()))


def stop_here(run: str) -> None:
    """End a run's child processes on this machine, and start no more."""
    _here.setdefault(run, Processes()).stop()


def version_here() -> str:
    """This package's version on the machine of this call."""
    return __version__


class DaskEngine:
    """Attempts on a Dask cluster."""

    def __init__(self, address: str, jobs: int | None = None) -> None:
        """Connect to a scheduler.

        Args:
            address: 'tcp://host:port'.
            jobs: attempts at a time; None: as many as the cluster has threads.

        Raises:
            InputError: the package is not installed, the scheduler does not answer or has no
                workers, or those do not have this package.
        """
        self._client = _connect(address)
        self._address, self._run = address, uuid.uuid4().hex
        self._pool = self._client.get_executor(pure=False, retries=0)
        threads = sum(self._client.nthreads().values())
        if not threads:
            raise InputError(f"the Dask scheduler at {address} has no workers: start some first")
        self._check_workers()
        self._slots = jobs or threads
        self._stopped = False

    def _check_workers(self) -> None:
        """Raises InputError where a worker cannot import this package, or has another version."""
        try:
            versions = set(self._client.run(version_here).values())
        except Exception as error:  # whatever unpickling or importing raises there
            versions = {f"none ({error})"}
        if versions != {__version__}:
            raise InputError(
                f"the Dask workers of {self._address} have mpcplan {', '.join(sorted(versions))}: "
                f"install version {__version__} in their environment"
            )

    @property
    def slots(self) -> int:
        """How many attempts run at a time."""
        return self._slots

    def submit(self, attempt: Attempt) -> "Future[Outcome]":
        """Send an attempt to the cluster."""
        result: Future[Outcome] = Future()
        try:
            task = self._pool.submit(run_here, self._run, ship(attempt))
        except OSError as error:
            result.set_result(failed(attempt, f"its files cannot be read: {error.strerror}"))
            return result
        task.add_done_callback(self._translate(attempt, result))
        return result

    def _translate(
        self, attempt: Attempt, result: "Future[Outcome]"
    ) -> Callable[["Future[Any]"], None]:
        """What the cluster says of a task, in our words."""

        def done(task: "Future[Any]") -> None:
            error = CancelledError() if task.cancelled() else task.exception()
            if error is None:
                result.set_result(task.result())
            elif self._stopped or isinstance(error, InterruptedError):
                result.cancel()
                result.set_running_or_notify_cancel()  # wakes those that wait for it
            elif type(error).__name__ == "KilledWorker":
                result.set_result(failed(attempt, "the Dask workers that ran it died"))
            else:
                what = f"{type(error).__name__} {error}".strip()
                result.set_exception(
                    MpcplanError(
                        f"the Dask cluster at {self._address} failed ({what}); what is finished is "
                        "kept: start the same command again"
                    )
                )

        return done

    def stop(self) -> None:
        """End all that run on the cluster."""
        if not self._stopped:
            self._stopped = True
            with suppress(Exception):  # a cluster that is gone has nothing to stop
                self._client.run(stop_here, self._run, on_error="ignore")

    def close(self) -> None:
        """Stop and disconnect; the cluster goes on."""
        self.stop()
        self._client.close()


def _connect(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError(
            "the engine 'dask' needs the package distributed: pip install 'mpcplan[dask]'"
        ) from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # our messages say it
    try:
        _knock(address)
        return Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"no Dask scheduler answers at {address}: {' '.join(str(error).split())[:200]}"
        ) from error


def _knock(address: str) -> None:
    """Raises OSError or ValueError where nobody listens at an address with host and port.

    A client that finds nobody leaves its threads behind in this process; so ask before.
    """
    from distributed.comm.addressing import parse_address, parse_host_port

    protocol, location = parse_address(address)
    if protocol in ("tcp", "tls"):
        host, port = parse_host_port(location)
        socket.create_connection((host, port), CONNECT_S).close()
