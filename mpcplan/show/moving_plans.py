"""The plans of a cycle on the road: candidates, corridor, options, and the plan itself."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from mpcplan.review.considered import Considered
from mpcplan.show import colours
from mpcplan.show.moment import Moment
from mpcplan.vehicle import centres

_FRESH, _FADED = 0.8, 0.3  # opacity of what the present cycle considered, and an older one
_CORRIDOR = f"{colours.CORRIDOR}30"


class MovingPlans:
    """The artists of one pair of axes."""

    def __init__(self, axes: Axes) -> None:
        def lines(colour: str, width: float, style: str, zorder: float) -> LineCollection:
            found = LineCollection(
                [], colors=colour, linewidths=width, linestyles=style, zorder=zorder
            )
            axes.add_collection(found, autolim=False)
            return found

        self._refused = lines(colours.REFUSED, 0.6, "-", 3)
        self._collided = lines(colours.ALARM, 0.5, "--", 3)
        self._accepted = lines(colours.ACCEPTED, 0.8, "-", 3)
        self._ends = axes.plot([], [], ".", color=colours.ACCEPTED, ms=5, zorder=3)[0]
        self._ribbon = PolyCollection(
            [], facecolors=_CORRIDOR, edgecolors=colours.CORRIDOR, linewidths=0.9, zorder=2.5
        )
        axes.add_collection(self._ribbon, autolim=False)
        self._options = lines(colours.CHOSEN, 1.0, ":", 5)
        self._turned_down = lines(colours.ALARM, 1.2, ":", 5)
        self._plan = axes.plot([], [], color=colours.CHOSEN, lw=1.6, zorder=5)[0]
        self._seconds = axes.plot([], [], "o", color=colours.CHOSEN, ms=3.2, zorder=5)[0]
        self._of: Considered | None = None

    def below(self) -> list[Artist]:
        """What lies below the others."""
        return [self._ribbon, self._refused, self._collided, self._accepted, self._ends]

    def above(self) -> list[Artist]:
        """What lies above them."""
        return [self._turned_down, self._options, self._plan, self._seconds]

    def show(self, now: Moment) -> None:
        """Shows the cycle whose plan is driven; what it did not choose fades after its step."""
        known = now.considered if now.plan is not None else None
        if known is not self._of:
            self._change(known)
            self._of = known
        for artist in (self._refused, self._collided, self._accepted, self._ends):
            artist.set_alpha(_FRESH if now.fresh else _FADED)
        points, second = np.empty((0, 2)), 1
        if now.plan is not None:
            points, second = centres(now.plan.states), max(round(1 / now.plan.dt), 1)
        self._plan.set_data(*points.T)
        self._seconds.set_data(*points[second::second].T)

    def _change(self, known: Considered | None) -> None:
        candidates = known.candidates if known is not None else None
        accepted = [*candidates.accepted] if candidates is not None else []
        self._accepted.set_segments(accepted)
        self._refused.set_segments([*candidates.refused] if candidates is not None else [])
        self._collided.set_segments([*candidates.collided] if candidates is not None else [])
        ends = np.array([line[-1] for line in accepted]).reshape(-1, 2)
        self._ends.set_data(*ends.T)
        ribbon = known.ribbon if known is not None else None
        area = [] if ribbon is None else [np.vstack([ribbon.left, ribbon.right[::-1]])]
        self._ribbon.set_verts(area)
        self._options.set_segments(known.options if known is not None else [])
        self._turned_down.set_segments(known.turned_down if known is not None else [])
