"""A Dask cluster of processes of its own, as a user starts one; ended with all its children."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import fake_worker

from mpcplan.bench.engine import open_engine
from mpcplan.errors import InputError

ROOT = Path(__file__).parents[1]
START_S = 60.0


class Cluster:
    """A scheduler and workers on this machine."""

    def __init__(self, folder: Path, workers: int) -> None:
        self._known = folder / "scheduler.json"
        self._log = (folder / "dask.log").open("wb")
        self._processes = [
            self._start("dask_scheduler", "--port", "0"),
            self._start("dask_worker", "--nworkers", str(workers), "--nthreads", "1"),
        ]
        self.address = ""
        fake_worker.until(lambda: self._slots() == workers, START_S)

    def _start(self, name: str, *options: str) -> subprocess.Popen:
        path = os.pathsep.join(map(str, (ROOT, ROOT / "tests")))
        return subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.{name}", "--host", "127.0.0.1",
             "--no-dashboard", "--scheduler-file", self._known, *options],
            env={**os.environ, "PYTHONPATH": path}, start_new_session=True,
            stdin=subprocess.DEVNULL, stdout=self._log, stderr=self._log,
        )  # fmt: skip

    def _slots(self) -> int:
        """How many attempts run at a time there; 0 while there are no workers."""
        with suppress(OSError, ValueError, InputError):
            self.address = json.loads(self._known.read_text())["address"]
            engine = open_engine("dask", self.address)
            engine.close()
            return engine.slots
        return 0

    def end(self) -> None:
        for process in self._processes:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        self._log.close()


@contextmanager
def running_cluster(folder: Path, workers: int) -> Iterator[Cluster]:
    cluster = Cluster(folder, workers)
    try:
        yield cluster
    finally:
        cluster.end()
