"""Two results tables of `bench` in one figure: costs, their parts, planning times."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from mpcplan.bench.comparison import Result, read_results
from mpcplan.errors import InputError
from mpcplan.score.tr1 import PARTS
from mpcplan.show import colours
from mpcplan.trajectory import Array

PERCENTILES = ("plan_p50_ms", "plan_p95_ms")
Pair = tuple[Result, Result]
_DPI = 110
_SIZE = (11.0, 8.5)  # inches
_LEAST = 1e-3  # of TR1 on logarithmic axes: a drive may cost nothing
_WIDER = 1.3  # the logarithmic axes reach this factor beyond what they show
_LIFTED = 1.2  # of the highest bar, for the labels above
_LABELLED = (1.0, 2.0, 5.0)  # times powers of ten
_STYLES = ("-", ":")  # of the 50th and of the 95th percentile


def pairs_of(a: str | Path, b: str | Path) -> list[Pair]:
    """The scenarios that both solved with a cost, in the order of their names.

    Args:
        a: results.csv of one planner, or its folder.
        b: another one.

    Raises:
        InputError: a table cannot be read, holds several planners, or they have no such scenario.
    """
    first, second = _only(a), _only(b)
    pairs = [
        (first[name], second[name])
        for name in sorted(set(first) & set(second))
        if _has_cost(first[name]) and _has_cost(second[name])
    ]
    if not pairs:
        raise InputError(f"{a} and {b} have no scenario in common that both solved with a cost")
    return pairs


def _only(path: str | Path) -> dict[str, Result]:
    tables = read_results(path)
    if len(tables) > 1:
        raise InputError(f"{path} holds several planners: {', '.join(tables)}")
    return next(iter(tables.values()))


def _has_cost(result: Result) -> bool:
    return result.solved and result.tr1 is not None


def costs(pairs: Sequence[Pair]) -> Array:
    """(n, 2) TR1 of both in every pair."""
    return np.array([[one.tr1 for one in pair] for pair in pairs], dtype=float)


def mean_parts(pairs: Sequence[Pair]) -> Array:
    """(2, 4) means of the weighted parts of TR1, in the order of their names."""
    parts = [[[one.parts.get(part, np.nan) for part in PARTS] for one in pair] for pair in pairs]
    mean: Array = np.mean(parts, axis=0)
    return mean


def plot_results(pairs: Sequence[Pair], names: tuple[str, str]) -> Figure:
    """Draws TR1 of each scenario, the ratio's distribution, the parts' means, planning times.

    Args:
        pairs: what :func:`pairs_of` tells.
        names: of the two, in the legends.

    Returns:
        The figure.
    """
    figure = Figure(figsize=_SIZE, dpi=_DPI)
    FigureCanvasAgg(figure)
    (scatter, ratio), (parts, times) = figure.subplots(2, 2)
    _draw_costs(scatter, costs(pairs), names)
    _draw_ratio(ratio, costs(pairs), names)
    _draw_parts(parts, mean_parts(pairs), names)
    _draw_times(times, pairs, names)
    figure.suptitle(f"{len(pairs)} scenarios that both solved")
    figure.tight_layout()
    return figure


def _draw_costs(axes: Axes, both: Array, names: tuple[str, str]) -> None:
    shown = np.maximum(both, _LEAST)
    ends = shown.min() / _WIDER, shown.max() * _WIDER
    axes.plot(ends, ends, ls="--", color=colours.LIMIT, label="equal")
    axes.plot(shown[:, 0], shown[:, 1], "o", ms=5, color=colours.of_variant(1), label="a scenario")
    axes.set(xscale="log", yscale="log", xlim=ends, ylim=ends)
    axes.set(xlabel=f"TR1, {names[0]}", ylabel=f"TR1, {names[1]}")
    axes.set_title(f"below the line {names[1]} is cheaper", loc="left", fontsize=11)
    _finish(axes)
    _label_logarithms(axes.xaxis, axes.yaxis)


def _draw_ratio(axes: Axes, both: Array, names: tuple[str, str]) -> None:
    """The share of the scenarios whose ratio of costs is at most so much."""
    first, second = np.maximum(both, _LEAST).T
    axes.ecdf(second / first, color=colours.of_variant(1), label="scenarios")
    axes.axvline(1.0, ls="--", color=colours.LIMIT, label="equal")
    axes.set_xscale("log")
    axes.set(xlabel=f"TR1 of {names[1]} / TR1 of {names[0]}", ylabel="share of the scenarios")
    axes.set_title("distribution of the ratio", loc="left", fontsize=11)
    _finish(axes)
    _label_logarithms(axes.xaxis)


def _draw_parts(axes: Axes, means: Array, names: tuple[str, str]) -> None:
    below = np.zeros(len(names))
    for index, part in enumerate(PARTS):
        heights = np.nan_to_num(means[:, index])
        axes.bar(names, heights, 0.6, bottom=below, color=colours.COSTS[index], label=part)
        below += heights
    known: Array = np.isfinite(means.sum(axis=1))
    for place, total in enumerate(below):
        told = f"{total:.3f}" if known[place] else "parts unknown"
        axes.annotate(told, (place, total), ha="center", va="bottom", fontsize=9)
    axes.set_ylim(0, max(_LIFTED * below.max(), _LEAST))
    axes.set_ylabel("mean of TR1")
    axes.set_title("weighted parts", loc="left", fontsize=11)
    _finish(axes, ncols=len(PARTS))


def _draw_times(axes: Axes, pairs: Sequence[Pair], names: tuple[str, str]) -> None:
    """The share of the scenarios whose planning times' percentile is at most so much."""
    for index, name in enumerate(names):
        for percentile, style in zip(PERCENTILES, _STYLES, strict=True):
            known = [pair[index].times.get(percentile) for pair in pairs]
            values = np.array([value for value in known if value is not None])
            if len(values):
                label = f"{name}, {percentile.split('_')[1]}"
                axes.ecdf(values, color=colours.of_variant(index), ls=style, label=label)
    axes.set_xscale("log")
    axes.set(xlabel="planning time per cycle [ms]", ylabel="share of the scenarios")
    axes.set_title("planning times", loc="left", fontsize=11)
    _finish(axes)
    _label_logarithms(axes.xaxis)
    if axes.lines:  # beside the title: the curves leave no corner free
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, fontsize=8, frameon=False)


def _finish(axes: Axes, ncols: int = 1) -> None:
    axes.grid(color=colours.GRID, lw=0.6)
    axes.set_axisbelow(True)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8, ncols=ncols)


def _label_logarithms(*scales: Axis) -> None:
    """Plain numbers, few enough that they do not overlap, also where there is no power of ten."""
    for scale in scales:
        scale.set_major_locator(LogLocator(subs=_LABELLED))
        scale.set_major_formatter(StrMethodFormatter("{x:g}"))
        scale.set_minor_formatter(NullFormatter())
