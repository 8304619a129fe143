"""Where the computation time goes: the stages of the planning cycles, as the trace tells them.

Wall-clock times of the machine on which the run was made; they differ from run to run.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mpcplan.bench.table import align
from mpcplan.show import colours
from mpcplan.trajectory import Array

if TYPE_CHECKING:
    from mpcplan.simulate.run import Run

PERCENTILES = (50, 95)
TOTAL = "total"
_DPI = 110
_WIDTH = 10.0  # inches
_PER_STAGE = 0.55  # inches of height,
_AROUND = 1.4  # and these for title and axis
_GROUP = 0.8  # of the distance between two stages, for the bars of one


def stage_times(runs: Sequence[Run]) -> dict[str, Array]:
    """Times [ms] by stage, each (n,) over the n cycles of all runs in which the stage worked.

    In the order in which a cycle works; the last one, :data:`TOTAL`, has all cycles.
    """
    found: defaultdict[str, list[float]] = defaultdict(list)
    for run in runs:
        for drive in run.drives:
            for cycle in drive.cycles:
                for stage, spent in cycle.plan.trace["times_ms"].items():
                    found[stage].append(spent)
    total = found.pop(TOTAL, [])
    return {stage: np.array(spent) for stage, spent in {**found, TOTAL: total}.items()}


def percentiles(times: Mapping[str, Array]) -> dict[str, tuple[float, float]]:
    """The 50th and the 95th percentile [ms] of every stage that has a time."""
    low, high = PERCENTILES
    return {
        stage: (float(np.percentile(spent, low)), float(np.percentile(spent, high)))
        for stage, spent in times.items()
        if len(spent)
    }


def times_table(variants: Mapping[str, Mapping[str, Array]]) -> str:
    """Percentiles of every variant's stages as text."""
    lines: list[tuple[str, ...]] = [("stage", "drive", "cycles", "p50 [ms]", "p95 [ms]")]
    for stage in _stages(variants):
        for name, times in variants.items():
            found = percentiles(times).get(stage)
            if found is not None:
                cells = (f"{value:.1f}" for value in found)
                lines.append((stage, name, str(len(times[stage])), *cells))
    return align(lines)


def plot_times(variants: Mapping[str, Mapping[str, Array]]) -> Figure:
    """Draws p50 as bars and p95 as whiskers, per stage and variant, on a logarithmic axis.

    Args:
        variants: by name, what :func:`stage_times` tells.

    Returns:
        The figure.
    """
    stages = _stages(variants)
    figure = Figure(figsize=(_WIDTH, _AROUND + _PER_STAGE * len(stages)), dpi=_DPI)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    high = _GROUP / max(len(variants), 1)
    for index, (name, times) in enumerate(variants.items()):
        found = percentiles(times)
        own = [stage for stage in stages if stage in found]
        p50, p95 = np.array([found[stage] for stage in own]).reshape(-1, 2).T
        shift = (index - (len(variants) - 1) / 2) * high
        places = np.array([stages.index(stage) for stage in own]) + shift
        axes.barh(
            places, p50, high, color=colours.of_variant(index), label=f"{name}: p50, whisker p95",
            xerr=np.stack([np.zeros_like(p50), p95 - p50]), ecolor=colours.PLAN, capsize=3,
        )  # fmt: skip
    axes.set_xscale("log")
    axes.set_yticks(range(len(stages)), stages)
    axes.invert_yaxis()
    axes.set_xlabel("time per planning cycle in which the stage worked [ms]")
    axes.set_title("Computation times, measured on this machine", fontsize=11)
    axes.grid(axis="x", color=colours.GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.legend(fontsize=9, loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False)
    figure.tight_layout()
    return figure


def _stages(variants: Mapping[str, Mapping[str, Array]]) -> list[str]:
    """The stages of all variants, :data:`TOTAL` last."""
    known = dict.fromkeys(
        stage for times in variants.values() for stage in times if len(times[stage])
    )
    return [stage for stage in known if stage != TOTAL] + [TOTAL] * (TOTAL in known)
