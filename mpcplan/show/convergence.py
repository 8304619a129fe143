"""How the SQP converges: cost and KKT residuals after every iteration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from mpcplan.config import RefineConfig
from mpcplan.refine.problem import Problem
from mpcplan.refine.sqp import Kkt, SqpResult, solve
from mpcplan.show import colours
from mpcplan.trajectory import Array

RESIDUALS = ("stationarity", "defect", "bounds", "complementarity")
FLOOR = 1e-12  # smaller values are drawn here: a logarithmic axis has no zero
_DPI = 110
_SIZE = (11.0, 4.2)  # inches
_MARKERS = ("o", "s", "^", "D")  # beside the colours, one per residual


@dataclass(frozen=True, eq=False)
class Convergence:
    """The iterates of one problem's solution.

    Attributes:
        cost: (K + 1,) objective with slack penalties, of the seed and after iterations 1..K.
        kkt: (K,) residuals after iterations 1..K.
        result: the last one.
    """

    cost: Array
    kkt: tuple[Kkt, ...]
    result: SqpResult

    def residuals(self, name: str) -> Array:
        """(K,) the residual of a name in :data:`RESIDUALS`."""
        return np.array([getattr(kkt, name) for kkt in self.kkt])


def converge(problem: Problem, config: RefineConfig, fresh: bool) -> Convergence:
    """Solves a problem again and again, with one iteration more each time.

    The solution is deterministic: stopped after k iterations, it is at the k-th iterate of the
    whole solution. So nothing need be recorded while it is planned.

    Args:
        problem: the problem.
        config: with which it was solved.
        fresh: whether it is a fresh seed's.
    """
    last = solve(problem, config, fresh)
    limit = "fresh_iterations" if fresh else "iterations"
    shorter = (config.model_copy(update={limit: k}) for k in range(1, last.iterations))
    results = [*(solve(problem, few, fresh) for few in shorter), last]
    cost = np.array([last.cost_before, *(result.cost_after for result in results)])
    return Convergence(cost, tuple(result.kkt for result in results), last)


def plot_convergence(found: Convergence) -> Figure:
    """Draws the cost and the four KKT residuals over the iterations.

    Args:
        found: what :func:`converge` tells.

    Returns:
        The figure.
    """
    figure = Figure(figsize=_SIZE, dpi=_DPI)
    FigureCanvasAgg(figure)
    cost, residuals = figure.subplots(1, 2)
    iterations = np.arange(len(found.cost))
    cost.plot(iterations, np.maximum(found.cost, FLOOR), "o-", color=colours.of_variant(1))
    cost.set_yscale("log")  # what a seed breaks is dear: it can cost a multiple of the result
    cost.set_ylabel("objective + slack penalties [as TR1]")
    cost.set_title("cost (0: the seed)", loc="left", fontsize=11)
    for index, name in enumerate(RESIDUALS):
        values = found.residuals(name)
        shown = np.maximum(values, FLOOR)
        residuals.plot(
            iterations[1:], shown, marker=_MARKERS[index], color=colours.of_variant(index),
            label=name if (values > FLOOR).any() else f"{name} (0 everywhere)",
        )  # fmt: skip
    residuals.set_yscale("log")
    residuals.set_ylabel("largest entry [SI units]")
    residuals.set_title("KKT residuals", loc="left", fontsize=11)
    residuals.legend(fontsize=9)
    for axes in (cost, residuals):
        _finish(axes)
    figure.suptitle(f"SQP: {found.result.status} after {found.result.iterations} iterations")
    figure.tight_layout()
    return figure


def _finish(axes: Axes) -> None:
    axes.set_xlabel("SQP iteration k")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(color=colours.GRID, lw=0.6)
