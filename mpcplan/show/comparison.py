"""Several drives of one scenario in one figure: where, how fast, and what each cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mpcplan.score.tr1 import CHECKER_WEIGHTS, PARTS
from mpcplan.show import colours
from mpcplan.show.gap import gap_ahead
from mpcplan.show.scene import MARGIN, draw_ground
from mpcplan.show.traffic import traffic_of
from mpcplan.trajectory import Input, State
from mpcplan.vehicle import centres

if TYPE_CHECKING:
    from mpcplan.simulate.run import Run

_DPI = 110
_SIZE = (13.0, 8.0)  # inches
_STRIPS = ("speed [m/s]", "acceleration [m/s²]", "steering angle [rad]", "gap ahead [m]")
_COLOURS = (colours.PROBLEMS[0], colours.PROBLEMS[1], colours.PROBLEMS[3], colours.PROBLEMS[2])
_PART_COLOURS = dict(zip(PARTS, ("#0072B2", "#E69F00", "#CC79A7", "#999999"), strict=True))
_LEAST = (1.0, 1.0, 0.05, 10.0)  # ranges of the strips at least, so that noise does not fill one
_SIGNED = (False, True, True, False)  # whether a strip's values may be negative
_LIFTED = 1.25  # of the highest bar, for the labels above


@dataclass(frozen=True, eq=False)
class Compared:
    """One of the drives.

    Attributes:
        name: in the legend.
        run: what was driven.
        parts: unweighted Jlon, SR, D, LC.
    """

    name: str
    run: Run
    parts: Mapping[str, float]


def plot_comparison(compared: Sequence[Compared], path: str | Path | None = None) -> Figure:
    """Draws drives of the same scenario.

    Args:
        compared: the drives; the traffic is that of the first.
        path: file to write; its suffix selects the format. None for no file.

    Returns:
        The figure.
    """
    figure = Figure(figsize=_SIZE, dpi=_DPI)
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        2, 5, height_ratios=[1.1, 1], left=0.06, right=0.98, top=0.93, bottom=0.07, hspace=0.2,
        wspace=0.32,
    )  # fmt: skip
    _draw_paths(figure.add_subplot(grid[0, :]), compared)
    strips = [figure.add_subplot(grid[1, i]) for i in range(len(_STRIPS))]
    for index, one in enumerate(compared):
        _draw_strips(strips, one, _COLOURS[index % len(_COLOURS)])
    for axes, label, least, signed in zip(strips, _STRIPS, _LEAST, _SIGNED, strict=True):
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, -least) if signed else 0.0, max(high, least))
        axes.set_title(label, fontsize=9)
        axes.set_xlabel("time [s]", fontsize=8)
        axes.grid(color="#e4e4e4", lw=0.6)
        axes.tick_params(labelsize=8)
    _draw_costs(figure.add_subplot(grid[1, len(_STRIPS)]), compared)
    figure.suptitle(compared[0].run.loaded.id, x=0.5, y=0.985, fontsize=12)
    if path is not None:
        figure.savefig(path)
    return figure


def _draw_paths(axes: Axes, compared: Sequence[Compared]) -> None:
    """The road, and the way of each centre."""
    run = compared[0].run
    driven = [centres(d.trajectory.states) for one in compared for d in one.run.drives]
    points = np.vstack(driven)
    axes.set_xlim(points[:, 0].min() - MARGIN, points[:, 0].max() + MARGIN)
    axes.set_ylim(points[:, 1].min() - MARGIN, points[:, 1].max() + MARGIN)
    axes.set_aspect("equal")
    draw_ground(axes, run, traffic_of(run))
    for index, one in enumerate(compared):
        for number, drive in enumerate(one.run.drives):
            label = one.name if number == 0 else None
            colour = _COLOURS[index % len(_COLOURS)]
            axes.plot(*centres(drive.trajectory.states).T, color=colour, lw=1.6, label=label)
    axes.legend(loc="upper right", fontsize=9)
    axes.tick_params(labelsize=8)


def _draw_strips(strips: Sequence[Axes], one: Compared, colour: str) -> None:
    traffic = traffic_of(one.run)
    speed, acceleration, angle, gap = strips
    for drive in one.run.drives:
        driven = drive.trajectory
        time = driven.steps * driven.dt
        speed.plot(time, driven.states[:, State.V], color=colour)
        acceleration.stairs(driven.inputs[:, Input.A], time, baseline=None, color=colour)
        angle.plot(time, driven.states[:, State.DELTA], color=colour)
        gap.plot(time, gap_ahead(driven, traffic.during(driven.steps)), color=colour)


def _draw_costs(axes: Axes, compared: Sequence[Compared]) -> None:
    """TR1 of each, stacked by its parts."""
    places = np.arange(len(compared))
    below = np.zeros(len(compared))
    for part in PARTS:
        height = np.array([CHECKER_WEIGHTS[part] * one.parts[part] for one in compared])
        axes.bar(places, height, 0.7, bottom=below, color=_PART_COLOURS[part], label=part)
        below += height
    for place, total in zip(places, below, strict=True):
        axes.annotate(f"{total:.2f}", (place, total), ha="center", va="bottom", fontsize=8)
    axes.set_xticks(places, [one.name for one in compared], fontsize=8)
    axes.set_ylim(0, max(_LIFTED * below.max(), 1e-3))
    axes.set_title("TR1", fontsize=9)
    axes.tick_params(labelsize=8)
    axes.legend(fontsize=7, loc="upper center", ncols=len(PARTS), columnspacing=0.8, handlelength=1)
