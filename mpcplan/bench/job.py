"""What one worker process is to do, and its command line."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

WORKER = (sys.executable, "-m", "mpcplan.bench.worker")
"""How the command of the package's own worker begins."""
OWN_PLANNER = "mpcplan"
"""The planner of this package, in place of 'package.module:Class'."""


@dataclass(frozen=True)
class Limits:
    """Limits of one worker: time [s] and address space [MB]."""

    timeout_s: float = 600.0
    memory_mb: float = 4000.0


@dataclass(frozen=True)
class Job:
    """One scenario to be run by a worker process.

    Attributes:
        name: file name without extension.
        scenario: the file, or an interactive scenario's folder.
        out: where the worker writes solution, trace and simulated traffic.
        row: where the worker writes its row.
        config: configuration file that holds every parameter.
        planner: 'package.module:Class', or :data:`OWN_PLANNER`.
        bound: whether the clairvoyant optimum is sought too.
    """

    name: str
    scenario: Path
    out: Path
    row: Path
    config: Path
    planner: str = OWN_PLANNER
    bound: bool = False


Command = Callable[[Job], list[str]]


def worker_command(job: Job) -> list[str]:
    """The command that plans, drives and judges one scenario."""
    return [
        *WORKER,
        *(str(job.scenario), str(job.out), str(job.row)),
        *("--config", str(job.config), "--planner", job.planner, "--end-with-parent"),
        *(("--bound",) if job.bound else ()),
    ]
