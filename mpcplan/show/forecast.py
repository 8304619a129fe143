"""The forecast of one planning cycle: boxes over time with their spread, and what then happened.

A predicted box grows along its way by a share of the way driven (`predict.spread_along`), and other
ways of at least `predict.alternative` weight are predicted beside the most likely one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from mpcplan.observation import Box, box_corners
from mpcplan.show import colours
from mpcplan.show.cycles import LookedInto, Moment
from mpcplan.show.scene import draw_map
from mpcplan.show.traffic import traffic_of
from mpcplan.trajectory import Array
from mpcplan.vehicle import centres

_DPI = 110
_SIZE = (13.0, 6.2)  # inches
_EVERY = 1.0  # s, between drawn boxes
_AROUND = 10.0  # m, shown around what is predicted
_MOST = 5.0  # s, of prediction that is drawn
_AMBER, _OPAQUE = to_rgb(colours.TRAFFIC), 0.6  # of boxes at once, fading with time
_STYLES = ("-", "--", "-.", ":")


@dataclass(frozen=True, eq=False)
class Foreseen:
    """One row of a forecast against what then happened, over the same time steps (all (k,)).

    Attributes:
        obstacle: its id.
        main: whether it is the most likely motion.
        time: since the cycle [s].
        spread: by which the box has grown ahead and behind [m].
        off: distance of the predicted centre from the true one [m]; NaN where it was not there.
    """

    obstacle: int
    main: bool
    time: Array
    spread: Array
    off: Array


def foreseen(looked: LookedInto, moment: Moment, seconds: float = _MOST) -> list[Foreseen]:
    """The forecast's rows that move, against the traffic of the run."""
    run, forecast = looked.run, moment.forecast
    last = min(
        moment.step + round(seconds / run.loaded.dt), forecast.last_step,
        run.drives[0].trajectory.last_step,
    )  # fmt: skip
    steps = np.arange(moment.step, last + 1)
    traffic = traffic_of(run)
    true, row = traffic.during(steps), {number: i for i, number in enumerate(traffic.ids)}
    found, seen = [], set[int]()
    for number, boxes in zip(forecast.ids, forecast.at(steps), strict=True):
        main = number not in seen
        seen.add(number)
        if not np.nanmax(np.abs(boxes[:, Box.V]), initial=0.0) > 0.0:
            continue
        gap = boxes[:, : Box.PSI] - true[row[number]][:, : Box.PSI]
        found.append(
            Foreseen(
                number, main, run.loaded.dt * (steps - moment.step),
                (boxes[:, Box.LENGTH] - boxes[0, Box.LENGTH]) / 2, np.hypot(*gap.T),
            )
        )  # fmt: skip
    return found


def plot_forecast(looked: LookedInto, moment: Moment) -> Figure:
    """Draws predicted boxes every second on the map, and how far off they were.

    Args:
        looked: the run, for the map and for what then happened.
        moment: one of its cycles.

    Returns:
        The figure.
    """
    figure = Figure(figsize=_SIZE, dpi=_DPI)
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        1, 2, width_ratios=[1.5, 1], left=0.06, right=0.97, top=0.88, bottom=0.1, wspace=0.14
    )
    _draw_boxes(figure.add_subplot(grid[0]), looked, moment)
    _draw_errors(figure.add_subplot(grid[1]), foreseen(looked, moment))
    kind = moment.config.predict.kind
    figure.suptitle(f"forecast of time step {moment.step}: predict.kind = {kind}")
    return figure


def _draw_boxes(axes: Axes, looked: LookedInto, moment: Moment) -> None:
    """Predicted boxes, coloured by time; other hypotheses dashed."""
    dt, forecast = looked.run.loaded.dt, moment.forecast
    every = round(_EVERY / dt)
    last = min(moment.step + round(_MOST / dt), forecast.last_step)
    steps = np.arange(moment.step, last + 1, every)
    boxes = forecast.at(steps)
    ego = centres(moment.plan.trajectory.until(min(last, moment.plan.trajectory.last_step)).states)
    points = np.vstack([boxes[..., [Box.X, Box.Y]].reshape(-1, 2), ego])
    low, high = np.nanmin(points, axis=0) - _AROUND, np.nanmax(points, axis=0) + _AROUND
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    draw_map(axes, looked.run)
    seen = set[int]()
    for number, row in zip(forecast.ids, boxes, strict=True):
        main = number not in seen
        seen.add(number)
        _draw_row(axes, number, row, steps - moment.step, dt, main)
    axes.plot(*ego.T, color=colours.PLAN, lw=1.4, zorder=5, label="the ego vehicle's plan")
    for style, label in (("-", "most likely way"), ("--", "another way")):
        axes.plot([], [], color=colours.ALARM, ls=style, label=label)
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.set_title("boxes every second", loc="left", fontsize=10)
    axes.legend(fontsize=8, loc="lower right", bbox_to_anchor=(1, 1), ncols=3, frameon=False)


def _draw_row(axes: Axes, number: int, row: Array, steps: Array, dt: float, main: bool) -> None:
    there = np.isfinite(row[:, Box.X])
    if not there.any():
        return
    soon = np.exp(-steps[there] * dt / _MOST)
    faces: Any = [(*_AMBER, _OPAQUE * a) for a in soon] if main else "none"
    axes.add_collection(
        PolyCollection(
            list(box_corners(row[there])), facecolors=faces, edgecolors=colours.ALARM,
            linestyles="-" if main else "--", lw=0.8, zorder=4,
        )
    )  # fmt: skip
    axes.add_collection(
        LineCollection([row[there][:, [Box.X, Box.Y]]], colors=colours.ALARM, lw=0.8,
                       linestyles="-" if main else "--", zorder=4)
    )  # fmt: skip
    if main:
        x, y = row[there][0, [Box.X, Box.Y]]
        axes.annotate(
            str(number), (float(x), float(y)), textcoords="offset points", xytext=(0, 8),
            fontsize=8, ha="center", zorder=6,
        )  # fmt: skip


def _draw_errors(axes: Axes, rows: list[Foreseen]) -> None:
    """Error and spread over time, by obstacle; of the most likely motion."""
    main = [row for row in rows if row.main]
    for index, row in enumerate(main):
        colour, style = colours.of_problem(index), _STYLES[index % len(_STYLES)]
        axes.plot(row.time, row.off, color=colour, ls=style, label=f"{row.obstacle}: error")
        axes.fill_between(
            row.time, 0.0, row.spread, color=colour, alpha=0.15, lw=0,
            label=f"{row.obstacle}: spread",
        )  # fmt: skip
    axes.set(xlabel="time since the cycle [s]", ylabel="distance [m]")
    axes.set_ylim(bottom=0.0)
    axes.set_title("predicted centre to true centre, and the spread", loc="left", fontsize=10)
    axes.grid(color=colours.GRID, lw=0.6)
    axes.set_axisbelow(True)
    if main:
        axes.legend(fontsize=8, ncols=2, loc="upper left")
