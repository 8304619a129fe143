"""What moves on the road: the vehicle, the others with what is predicted of them, the plans.

Level of detail: who comes near the plan is drawn in full, with heading, predicted path, predicted
boxes and further guesses; the others are simple boxes. Labels only where asked for, and for those
who are feared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from mpcplan.observation import Box, box_corners
from mpcplan.show import colours
from mpcplan.show.moment import Moment
from mpcplan.show.moving_plans import MovingPlans
from mpcplan.simulate.run import Drive
from mpcplan.trajectory import Array
from mpcplan.vehicle import centres, rectangles

EDGE = "#7a5200"  # of the others' boxes
PREDICTED = 4.0  # s, of the predictions that are drawn
_PIECES = 0.2  # s, of a predicted path
_NOTHING: Array = np.empty((0, 4, 2))


@dataclass(frozen=True)
class Label:
    """An id on the road, at a point [m]."""

    text: str
    at: tuple[float, float]
    alarming: bool


class MovingRoad:
    """The artists of one pair of axes."""

    def __init__(self, axes: Axes, drive: Drive, labels: bool) -> None:
        self._axes, self._drive, self._all_labels = axes, drive, labels
        blue, orange = colours.of_problem(0), colours.TRAFFIC
        self._plans = MovingPlans(axes)
        self._far = _boxes(axes, facecolors=f"{orange}70", edgecolors="none", zorder=4)
        self._paths = _lines(axes, colors=orange, linewidths=1.0, zorder=4)
        self._guesses = _lines(axes, colors=orange, linewidths=1.0, linestyles="--", zorder=4)
        self._later = _boxes(axes, facecolors="none", edgecolors=orange, linewidths=0.8, zorder=4)
        self._full = _boxes(axes, facecolors=orange, edgecolors=EDGE, linewidths=0.9, zorder=6)
        self._noses = _lines(axes, colors=EDGE, linewidths=1.2, zorder=6)
        self._feared = _boxes(
            axes, facecolors="none", edgecolors=colours.ALARM, linewidths=2.0, zorder=7
        )
        self._driven = axes.plot([], [], color=blue, lw=2.0, zorder=5)[0]
        self._ego = _boxes(axes, facecolors=blue, edgecolors="black", linewidths=0.9, zorder=8)
        self._ego_nose = _lines(axes, colors="white", linewidths=1.4, zorder=8)
        self._crash = axes.plot(
            [], [], "X", color=colours.ALARM, ms=14, mec="white", ls="", zorder=9
        )[0]

    def show(self, now: Moment) -> list[Artist]:
        """Moves everything to a time step, whose surroundings the axes show already; what is to
        be drawn, in this order."""
        self._plans.show(now)
        inside = self._inside(now.boxes)
        full = now.full & inside
        corners = box_corners(now.boxes) if len(now.boxes) else _NOTHING
        self._far.set_verts([*corners[inside & ~full]])
        self._full.set_verts([*corners[full]])
        self._noses.set_segments(_noses(corners[full]))
        self._predict(now, {i for i, one in zip(now.ids, full, strict=True) if one})
        feared = {who for _, who in now.feared}
        these = np.array([i in feared for i in now.ids], dtype=bool)
        self._feared.set_verts([*corners[these], *(met for _, met in _met(now))])
        self._driven.set_data(*centres(now.driven.states).T)
        body = rectangles(now.driven.states[-1:])
        self._ego.set_verts([*body])
        self._ego_nose.set_segments(_noses(body))
        last = now.step == self._drive.trajectory.last_step
        hit = centres(now.driven.states[-1:]) if last and self._drive.collided else np.empty((0, 2))
        self._crash.set_data(*hit.T)
        return [
            *self._plans.below(), self._far, self._guesses, self._paths, self._later, self._driven,
            *self._plans.above(), self._full, self._noses, self._feared, self._ego, self._ego_nose,
            self._crash,
        ]  # fmt: skip

    def labels(self, now: Moment) -> list[Label]:
        """Whose id is written, and where."""
        inside, feared = self._inside(now.boxes), {who for _, who in now.feared}
        met = [
            Label(f"{step * now.driven.dt:.1f} s", tuple(corners.mean(axis=0)), True)
            for step, corners in _met(now)
        ]
        return met + [
            Label(str(i), (float(box[Box.X]), float(box[Box.Y])), i in feared)
            for i, box, there in zip(now.ids, now.boxes, inside, strict=True)
            if there and (self._all_labels or i in feared)
        ]

    def _inside(self, boxes: Array) -> Array:
        """(n,) whether boxes are in the view, or nearly."""
        if not len(boxes):
            return np.zeros(0, dtype=bool)
        (x0, x1), (y0, y1) = self._axes.get_xlim(), self._axes.get_ylim()
        x, y, spare = boxes[:, Box.X], boxes[:, Box.Y], boxes[:, Box.LENGTH]
        return (x > x0 - spare) & (x < x1 + spare) & (y > y0 - spare) & (y < y1 + spare)

    def _predict(self, now: Moment, whom: set[int]) -> None:
        """Paths of the most likely predictions with a box every second, and further guesses."""
        paths, guesses, later = list[Array](), list[Array](), list[Array]()
        known = now.considered
        if known is not None:
            dt = now.driven.dt
            seen: set[int] = set()
            steps = now.step + np.arange(round(PREDICTED / dt) + 1)
            boxes = known.forecast.at(steps)
            for i, row in zip(known.forecast.ids, boxes, strict=True):
                there = row[~np.isnan(row[:, Box.X])]
                if i not in whom or not len(there):
                    continue
                line = there[:: max(round(_PIECES / dt), 1), [Box.X, Box.Y]]
                (guesses if i in seen else paths).append(line)
                if i not in seen and np.ptp(line, axis=0).max() > 0:
                    later += [*box_corners(there[round(1 / dt) :: round(1 / dt)])]
                seen.add(i)
        self._paths.set_segments(paths)
        self._guesses.set_segments(guesses)
        self._later.set_verts(later)


def _met(now: Moment) -> list[tuple[int, Array]]:
    """When those who are feared would be met, and (4, 2) their predicted boxes then."""
    known, found = now.considered, []
    for step, who in now.feared:
        if known is not None and step >= now.step and who in known.forecast.ids:
            box = known.forecast.at(np.array([step]))[known.forecast.ids.index(who), 0]
            found += [] if np.isnan(box).any() else [(step, box_corners(box))]
    return found


def _noses(corners: Array) -> list[Array]:
    """A short line from the centre to the front of each body (n, 4, 2)."""
    if not len(corners):
        return []
    front = corners[:, [1, 2]].mean(axis=1)
    return list(np.stack([corners.mean(axis=1), front], axis=1))


def _boxes(axes: Axes, **style: Any) -> PolyCollection:
    collection = PolyCollection([], **style)
    axes.add_collection(collection, autolim=False)
    return collection


def _lines(axes: Axes, **style: Any) -> LineCollection:
    lines: Sequence[Array] = []
    collection = LineCollection(lines, **style)
    axes.add_collection(collection, autolim=False)
    return collection
