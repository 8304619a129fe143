"""How fast and how well solvers solve the same problems.

Every solver starts from the same seed without a warm start. A problem is solved once to build what
belongs to its size, and then again for the time. The cost is that of the refinement's own problem
(objective and slack penalties), so that solvers with their own formulation are judged alike; it is
compared with IPOPT's, where that found an optimum.
"""

import gc
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mpcplan.config import WHOLE, Backend, Config, RefineConfig
from mpcplan.refine.problem import Problem
from mpcplan.refine.sqp import SqpResult, solve
from mpcplan.solvers.record import Recorded

REFERENCE: Backend = "ipopt"
GIVE_UP = 20.0  # s, a solver that takes longer for one problem is not asked again
_NOTHING = 1e-3  # cost beside which differences do not matter
SAME = 0.01  # a cost that is higher by this share is not as good as IPOPT's


@dataclass(frozen=True)
class Trial:
    """One problem by one solver: time [s], cost and residuals; ``ok``: it called it solved."""

    ok: bool
    seconds: float
    iterations: int
    cost: float
    stationarity: float
    defect: float


@dataclass(frozen=True, eq=False)
class Column:
    """All trials of one solver, None from where it was given up."""

    backend: str
    trials: tuple[Trial | None, ...]


def try_solvers(
    problems: Sequence[Recorded], backends: Sequence[Backend], config: Config,
    tell: Callable[[str, int], None] | None = None,
) -> list[Column]:  # fmt: skip
    """Solves all problems by all solvers.

    Args:
        problems: of a run.
        backends: the solvers' names, see ``refine.backend``.
        config: iterations and tolerances.
        tell: called with a solver and the number of problems done.

    Raises:
        InputError: a solver is not installed.
    """
    columns = []
    for backend in backends:
        trials: list[Trial | None] = []
        slow = False
        for recorded in problems:
            trials.append(None if slow else _trial(recorded.problem, backend, config))
            last = trials[-1]
            slow = slow or (last is not None and last.seconds > GIVE_UP)
            if tell is not None:
                tell(backend, len(trials))
        columns.append(Column(backend, tuple(trials)))
    return columns


def _trial(problem: Problem, backend: Backend, config: Config) -> Trial:
    asked = config.refine.model_copy(update={"fresh_backend": backend})
    result, seconds = _timed(problem, asked)
    if seconds <= GIVE_UP:
        result, seconds = _timed(problem, asked)
    return _judged(result, seconds, backend)


def _timed(problem: Problem, config: RefineConfig) -> tuple[SqpResult, float]:
    """A result and its time [s], without garbage collection of what the drives left behind, as
    timeit does."""
    collected = gc.isenabled()
    gc.disable()
    try:
        begin = time.perf_counter()
        result = solve(problem, config)
        return result, time.perf_counter() - begin
    finally:
        if collected:
            gc.enable()


def _judged(result: SqpResult, seconds: float, backend: Backend) -> Trial:
    iterations = result.qp_iterations if backend in WHOLE else result.iterations
    return Trial(
        not result.failed and result.status != "no descent", seconds, iterations,
        result.cost_after, result.kkt.stationarity, result.kkt.defect,
    )  # fmt: skip


HEAD = (
    *("solver", "solved", "iterations", "p50 [ms]", "p95", "max", "IPOPT's time /"),
    *("stationarity", "cost / IPOPT's: median", "p95", f"within {SAME:.0%}"),
)


def lines(columns: Sequence[Column]) -> list[tuple[str, ...]]:
    """The table's lines, one per solver."""
    reference = next((c for c in columns if c.backend == REFERENCE), None)
    return [HEAD, *(_line(column, reference) for column in columns)]


def _line(column: Column, reference: Column | None) -> tuple[str, ...]:
    trials = [trial for trial in column.trials if trial is not None]
    times = [1e3 * trial.seconds for trial in trials]
    p50, p95, top = (f"{value:.1f}" for value in np.percentile(times, (50, 95, 100)))
    solved = [trial for trial in trials if trial.ok]
    residual = [t.stationarity for t in solved if np.isfinite(t.stationarity)]
    return (
        column.backend,
        f"{len(solved)} of {len(column.trials)}",
        f"{statistics.fmean(t.iterations for t in trials):.1f}",
        *(p50, p95, top),
        *_beside(column, reference, residual),
    )


def _beside(column: Column, reference: Column | None, residual: list[float]) -> tuple[str, ...]:
    """Figures that compare with the reference, '-' where there is none."""
    stationarity = f"{statistics.median(residual):.1e}" if residual else "-"
    if reference is None:
        return "-", stationarity, "-", "-", "-"
    pairs = [
        (mine, theirs)
        for mine, theirs in zip(column.trials, reference.trials, strict=True)
        if mine is not None and theirs is not None and theirs.ok
    ]
    if not pairs:
        return "-", stationarity, "-", "-", "-"
    faster = statistics.median(theirs.seconds / mine.seconds for mine, theirs in pairs)
    excess = [_ratio(mine.cost, theirs.cost) for mine, theirs in pairs if mine.ok]
    if not excess:
        return f"{faster:.1f}", stationarity, "-", "-", "-"
    near = sum(ratio <= 1 + SAME for ratio in excess)
    middle, high = np.percentile(excess, (50, 95))
    share = f"{near} of {len(pairs)}"
    return f"{faster:.1f}", stationarity, f"{middle:.4f}", f"{high:.3f}", share


def _ratio(cost: float, reference: float) -> float:
    """The ratio of two costs; both next to nothing count as equal."""
    return (cost + _NOTHING) / (reference + _NOTHING)
