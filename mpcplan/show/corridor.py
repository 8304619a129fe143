"""The corridor of one plan: what its problem allows along the path over time, and across it.

    s_min - sigma_s <= s_k <= s_max + sigma_s                 rear axle
    d_min - sigma_d <= d_i(s_k, d_k, mu_k) <= d_max + sigma_d    four points i of the body's axis

The bounds are those of the corridor (:mod:`mpcplan.refine.corridor`) and of the road's edges as the
problem reads them off (:mod:`mpcplan.refine.reading`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mpcplan.refine.corridor import FAR
from mpcplan.refine.problem import Problem
from mpcplan.refine.reading import Iterate
from mpcplan.seed.seed import Stage
from mpcplan.show import colours
from mpcplan.trajectory import Array

FRONT = -1  # of the body's points: the middle of the front bumper
_DPI = 110
_SIZE = (11.0, 8.5)  # inches
_MARGIN_S, _MARGIN_D = 0.15, 0.6  # of the range of s, and m, shown around plan and bounds
_MOST_D = 5.0  # m, bounds further aside of the plans are not shown
_FORBIDDEN: dict[str, Any] = {"color": colours.TRAFFIC, "alpha": 0.3, "lw": 0}
_SEED: dict[str, Any] = {"color": colours.of_variant(0), "ls": "--", "label": "seed"}
_REFINED: dict[str, Any] = {"color": colours.of_variant(1), "label": "refined"}


@dataclass(frozen=True, eq=False)
class Bounds:
    """A plan in its corridor, at the steps 1..N.

    Attributes:
        time: (N,) since the scenario's beginning [s].
        s, s_min, s_max: (N,) arc length of the rear axle and its bounds [m]; infinite for none.
        at: (N, 4) arc lengths of the body's points, rear to front [m].
        d, d_min, d_max: (N, 4) their offsets and the bounds of these [m].
    """

    time: Array
    s: Array
    s_min: Array
    s_max: Array
    at: Array
    d: Array
    d_min: Array
    d_max: Array


def bounds_of(problem: Problem, z: Iterate) -> Bounds:
    """The bounds along an iterate of a problem."""
    x, along = z.x[1:], problem.corridor.steps(1, problem.n + 1)
    at, offset, turn = problem.read.project_body(x)
    (low, _), (high, _) = problem.read.sides(at, offset, turn)
    time = (problem.seed.first_step + np.arange(1, problem.n + 1)) * problem.dt
    return Bounds(
        time, x[:, Stage.S], np.where(along.s_min > -FAR / 2, along.s_min, -np.inf),
        np.where(along.s_max < FAR / 2, along.s_max, np.inf), at, offset, low, high,
    )  # fmt: skip


def plot_corridor(problem: Problem, z: Iterate) -> Figure:
    """Draws the seed and the refined plan of a problem in the corridor.

    Above, s over time with what the corridor forbids; below, d over s of the middle of the front
    bumper, with the road's edges.

    Args:
        problem: of the plan.
        z: its solution.

    Returns:
        The figure.
    """
    seed, refined = bounds_of(problem, problem.initial()), bounds_of(problem, z)
    figure = Figure(figsize=_SIZE, dpi=_DPI)
    FigureCanvasAgg(figure)
    along, across = figure.subplots(2, 1)
    _draw_along(along, seed, refined)
    _draw_across(across, problem, seed, refined)
    for axes in (along, across):
        axes.grid(color=colours.GRID, lw=0.6)
        axes.set_axisbelow(True)
        axes.legend(fontsize=9, loc="lower right", bbox_to_anchor=(1, 1), ncols=5, frameon=False)
    figure.suptitle(f"plan of time step {problem.seed.first_step}, refined over {problem.n} steps")
    figure.tight_layout()
    return figure


def _draw_along(axes: Axes, seed: Bounds, refined: Bounds) -> None:
    """s over time, as far as the plans reach."""
    both = np.concatenate([seed.s, refined.s])
    margin = _MARGIN_S * max(float(np.ptp(both)), 1.0)
    low, high = both.min() - margin, both.max() + margin
    axes.fill_between(
        refined.time, np.minimum(refined.s_max, high), high, label="forbidden", **_FORBIDDEN
    )
    axes.fill_between(refined.time, low, np.maximum(refined.s_min, low), **_FORBIDDEN)
    axes.plot(seed.time, seed.s, **_SEED)
    axes.plot(refined.time, refined.s, **_REFINED)
    axes.set(ylim=(low, high), xlabel="time t [s]", ylabel="rear axle's s [m]")
    axes.set_title("along the path", loc="left", fontsize=11)


def _draw_across(axes: Axes, problem: Problem, seed: Bounds, refined: Bounds) -> None:
    """d over s of the front's middle, with the road's edges beyond the bounds of that point."""
    at, frame, limits = refined.at[:, FRONT], problem.seed.road.frame, problem.seed.road.limits
    low, high = refined.d_min[:, FRONT], refined.d_max[:, FRONT]
    seen = slice(np.searchsorted(frame.s, at[0]), np.searchsorted(frame.s, at[-1], "right"))
    right, left = limits.right[seen], limits.left[seen]
    plans = np.concatenate([seed.d[:, FRONT], refined.d[:, FRONT]])
    bottom = max(right.min(initial=low.min()) - _MARGIN_D, plans.min() - _MOST_D)
    top = min(left.max(initial=high.max()) + _MARGIN_D, plans.max() + _MOST_D)
    axes.fill_between(at, np.minimum(high, top), top, label="forbidden", **_FORBIDDEN)
    axes.fill_between(at, bottom, np.maximum(low, bottom), **_FORBIDDEN)
    for edge, label in ((right, "road's edges"), (left, None)):
        axes.plot(frame.s[seen], edge, color=colours.PLAN, lw=1.0, label=label)
    axes.plot(seed.at[:, FRONT], seed.d[:, FRONT], **_SEED)
    axes.plot(at, refined.d[:, FRONT], **_REFINED)
    axes.set(ylim=(bottom, top), xlabel="s [m]", ylabel="front's d [m]")
    axes.set_title("across the path", loc="left", fontsize=11)
