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

from mpcplan.score.tr1 import CHECKER_WEIGHTS, PARTS, tr1
from mpcplan.show import colours
from mpcplan.show.quantities import (
    ACCELERATION,
    GAP,
    SPEED,
    STEERING_ANGLE,
    Quantity,
    draw,
    prepare,
)
from mpcplan.show.scene import MARGIN, draw_ground
from mpcplan.show.traffic import traffic_of
from mpcplan.vehicle import centres

if TYPE_CHECKING:
    from mpcplan.simulate.run import Run

_DPI = 110
_WIDTH = 13.0  # inches
_HEIGHTS = (4.4, 3.6)  # inches, of the road and of each row of strips
_IN_ONE_ROW = 5  # panels at most below the road in one row,
_PER_ROW = 3  # more of them stand in rows of so many
_USUAL = (SPEED, ACCELERATION, STEERING_ANGLE, GAP)
_PART_COLOURS = dict(zip(PARTS, colours.COSTS, strict=True))
_LIFTED = 1.25  # of the highest bar, for the labels above


@dataclass(frozen=True, eq=False)
class Compared:
    """One of the drives.

    Attributes:
        name: in the legend.
        run: what was driven.
        parts: unweighted Jlon, SR, D, LC; NaN where there is no cost.
    """

    name: str
    run: Run
    parts: Mapping[str, float]


def plot_comparison(
    compared: Sequence[Compared],
    path: str | Path | None = None,
    quantities: Sequence[Quantity] = _USUAL,
) -> Figure:
    """Draws drives of the same scenario.

    Args:
        compared: the drives; the traffic is that of the first.
        path: file to write; its suffix selects the format. None for no file.
        quantities: of the strips over time.

    Returns:
        The figure.
    """
    panels = len(quantities) + 1
    columns = panels if panels <= _IN_ONE_ROW else _PER_ROW
    rows = -(-panels // columns)
    figure = Figure(figsize=(_WIDTH, _HEIGHTS[0] + rows * _HEIGHTS[1]), dpi=_DPI)
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        1 + rows, columns, height_ratios=[1.1, *rows * [1]], left=0.06, right=0.98, top=0.93,
        bottom=0.07 if rows == 1 else 0.05, hspace=0.2 if rows == 1 else 0.3,
        wspace=0.32 if rows == 1 else 0.2,
    )  # fmt: skip
    _draw_paths(figure.add_subplot(grid[0, :]), compared)
    cells = [grid[1 + i // columns, i % columns] for i in range(panels)]
    strips: list[Axes] = []
    for cell in cells[:-1]:
        strips.append(figure.add_subplot(cell, sharex=strips[0] if strips else None))
    for index, one in enumerate(compared):
        _draw_strips(strips, quantities, one, colours.of_variant(index))
    for axes, quantity in zip(strips, quantities, strict=True):
        prepare(axes, quantity)
    _draw_costs(figure.add_subplot(cells[-1]), compared)
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
            colour = colours.of_variant(index)
            axes.plot(*centres(drive.trajectory.states).T, color=colour, lw=1.6, label=label)
    axes.set_xlabel("x [m]", fontsize=8)
    axes.set_ylabel("y [m]", fontsize=8)
    axes.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(compared), frameon=False, fontsize=9
    )
    axes.tick_params(labelsize=8)


def _draw_strips(
    strips: Sequence[Axes], quantities: Sequence[Quantity], one: Compared, colour: str
) -> None:
    traffic = traffic_of(one.run)
    for drive in one.run.drives:
        driven = drive.trajectory
        boxes = traffic.during(driven.steps)
        for axes, quantity in zip(strips, quantities, strict=True):
            draw(axes, quantity, driven, boxes, colour)


def _draw_costs(axes: Axes, compared: Sequence[Compared]) -> None:
    """TR1 of each, stacked by its parts; no bar for a drive without a cost."""
    places = np.arange(len(compared))
    below = np.zeros(len(compared))
    for part in PARTS:
        height = np.array([CHECKER_WEIGHTS[part] * one.parts[part] for one in compared])
        height = np.nan_to_num(height)
        axes.bar(places, height, 0.7, bottom=below, color=_PART_COLOURS[part], label=part)
        below += height
    for place, total, one in zip(places, below, compared, strict=True):
        told = f"{total:.2f}" if np.isfinite(tr1(one.parts)) else "no cost"
        axes.annotate(told, (place, total), ha="center", va="bottom", fontsize=8)
    axes.set_xticks(places, [one.name for one in compared], fontsize=8)
    axes.set_ylim(0, max(_LIFTED * below.max(), 1e-3))
    axes.set_title("TR1", fontsize=9)
    axes.tick_params(labelsize=8)
    axes.legend(fontsize=7, loc="upper center", ncols=len(PARTS), columnspacing=0.8, handlelength=1)
