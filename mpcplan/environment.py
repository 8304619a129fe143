"""The environment variables of our own child processes."""

import os
from pathlib import Path

_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def child_environment() -> dict[str, str]:
    """This process's environment with this package importable, no window system, and one thread
    per process: the processes are the parallelism."""
    root = str(Path(__file__).resolve().parents[1])
    fixed = {"PYTHONPATH": before("PYTHONPATH", root), "MPLBACKEND": "Agg"}
    return {**os.environ, **fixed, **dict.fromkeys(_ONE_THREAD, "1")}


def before(name: str, path: str) -> str:
    """A variable of search paths with one put before the others."""
    return os.pathsep.join(filter(None, [path, os.environ.get(name, "")]))
