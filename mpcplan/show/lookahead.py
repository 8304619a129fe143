"""The way ahead over time: what the corridor of the plan forbids, and the plan between it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from mpcplan.review.considered import Considered, Ribbon
from mpcplan.show import colours
from mpcplan.show.moment import Moment
from mpcplan.show.moving_strips import prepare
from mpcplan.trajectory import Array

if TYPE_CHECKING:
    from mpcplan.review.replan import Replanned

AHEAD = 5.0  # s
_LEAST, _ABOVE = 10.0, 1.25  # m, and of the longest way that is planned, shown
_BELOW = -0.08  # of the height, below the beginning


class LookAhead:
    """The artists of one strip."""

    def __init__(self, axes: Axes, replanned: Replanned, dt: float) -> None:
        self._dt = dt
        self._of: Considered | None = None
        steps = round(AHEAD / dt)
        ways = [one.ribbon.s[: steps + 1].max() for one in replanned.considered if one.ribbon]
        self._top = max([_ABOVE * float(way) for way in ways] + [_LEAST])
        axes.set_xlim(0, AHEAD)
        axes.set_ylim(_BELOW * self._top, self._top)
        prepare(axes, "way along the path and its corridor [m]", "time since the plan [s]")
        self._forbidden = PolyCollection(
            [], facecolors=f"{colours.CORRIDOR}50", edgecolors=colours.CORRIDOR, linewidths=0.8
        )
        axes.add_collection(self._forbidden, autolim=False)
        self._plan = axes.plot([], [], color=colours.CHOSEN, lw=1.6)[0]
        self._now = axes.plot([], [], color=colours.LIMIT, lw=0.9)[0]
        self._word = axes.text(
            0.5, 0.5, "", transform=axes.transAxes, ha="center", va="center", fontsize=8
        )
        self._all: list[Artist] = [self._forbidden, self._plan, self._now, self._word]
        for artist in self._all:
            artist.set_animated(True)

    def show(self, now: Moment) -> list[Artist]:
        """Moves to a time step; what is to be drawn."""
        known = now.considered if now.plan is not None else None
        if known is not self._of or known is None:
            self._change(known)
            self._of = known
        since = (now.step - known.step) * self._dt if known is not None else np.nan
        self._now.set_data([since, since], [_BELOW * self._top, self._top])
        return self._all

    def _change(self, known: Considered | None) -> None:
        ribbon = known.ribbon if known is not None else None
        if ribbon is None:
            self._forbidden.set_verts([])
            self._plan.set_data([], [])
            self._word.set_text("not known" if known is None else "this plan has no corridor")
            return
        time = np.arange(len(ribbon.s)) * self._dt
        self._forbidden.set_verts(_areas(ribbon, time, _BELOW * self._top, self._top))
        self._plan.set_data(time, ribbon.s)
        self._word.set_text("")


def _areas(ribbon: Ribbon, time: Array, low: float, high: float) -> list[Array]:
    """What lies above the upper and below the lower bound, as polygons within the strip."""
    areas = []
    for bound, beyond in ((ribbon.s_max, high), (ribbon.s_min, low)):
        shown = np.clip(bound, low, high)
        there = np.abs(shown - beyond) > 0
        if there.any():
            edge = np.column_stack([time, shown])
            base = np.column_stack([time[[-1, 0]], [beyond, beyond]])
            areas.append(np.vstack([edge, base]))
    return areas
