"""Speed and gap ahead over the whole drive, with the present and what the plan expects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from mpcplan.show import colours
from mpcplan.show.gap import REACH, gap_ahead
from mpcplan.show.moment import Moment
from mpcplan.show.strips import mark_goal_times
from mpcplan.show.traffic import traffic_of
from mpcplan.trajectory import Array, State

if TYPE_CHECKING:
    from mpcplan.simulate.run import Run

_WHOLE = "#c9d7e3"  # what will be driven
_ABOVE = 1.12  # of the highest value
_LEAST_SPEED, _LEAST_GAP = 5.0, 10.0  # m/s and m, the scales reach so far at least


class MovingStrips:
    """The artists of both strips."""

    def __init__(self, axes: Sequence[Axes], run: Run, index: int) -> None:
        drive = run.drives[index]
        driven = drive.trajectory
        self._time = driven.steps * driven.dt
        self._values: list[Array] = [
            driven.states[:, State.V],
            gap_ahead(driven, traffic_of(run).during(driven.steps)),
        ]
        least, names = (_LEAST_SPEED, _LEAST_GAP), ("speed [m/s]", "gap ahead [m]")
        colour = colours.of_problem(0)
        self._so_far, self._now, self._marks = list[Line2D](), list[Line2D](), list[Line2D]()
        mark_goal_times(axes, run)
        for one, values, name, low in zip(axes, self._values, names, least, strict=True):
            one.plot(self._time, values, color=_WHOLE, lw=1.2)
            one.set_xlim(self._time[0], max(self._time[-1], self._time[0] + 1.0))
            one.set_ylim(0, max(_ABOVE * np.nanmax(np.append(values, 0.0)), low))
            prepare(one, name, "time [s]")
            self._so_far += one.plot([], [], color=colour, lw=1.8)
            self._now += one.plot([], [], color=colours.LIMIT, lw=0.9)
            self._marks += one.plot([], [], "o", color=colour, ms=4)
        if np.isnan(self._values[1]).all():
            axes[1].text(
                0.5, 0.5, f"nobody ahead within {REACH:.0f} m", transform=axes[1].transAxes,
                ha="center", fontsize=8,
            )  # fmt: skip
        self._planned = axes[0].plot([], [], color=colours.CHOSEN, lw=1.1, ls="--")[0]
        self._goes_on = axes[0].get_xlim()[1]
        self._all = [*self._now, self._planned, *self._so_far, *self._marks]
        for artist in self._all:
            artist.set_animated(True)

    def show(self, now: Moment) -> list[Artist]:
        """Moves to a time step; what is to be drawn."""
        k = len(now.driven)
        for values, so_far, line, mark, top in zip(
            self._values, self._so_far, self._now, self._marks, self._tops(), strict=True
        ):
            so_far.set_data(self._time[:k], values[:k])
            line.set_data([self._time[k - 1]] * 2, [0, top])
            mark.set_data(self._time[k - 1 : k], values[k - 1 : k])
        plan = now.plan
        time = plan.steps * plan.dt if plan is not None else np.empty(0)
        self._planned.set_data(time, plan.states[:, State.V] if plan is not None else [])
        return list(self._all)

    def _tops(self) -> list[float]:
        return [float(line.axes.get_ylim()[1]) for line in self._now if line.axes is not None]


def prepare(axes: Axes, name: str, below: str) -> None:
    """Names a strip in its corner, where it needs no room."""
    axes.set_title(name, fontsize=9, loc="left", pad=3)
    axes.set_xlabel(below, fontsize=8, labelpad=1)
    axes.grid(color=colours.GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8, pad=2)
