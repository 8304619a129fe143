"""Forecasts along a reference path: which (s, d) every obstacle occupies at every time step."""

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from mpcplan.observation import Box, Forecast, at_steps, box_outline
from mpcplan.road.frame import Frame
from mpcplan.trajectory import Array

NEAR = 80.0  # m, boxes further from every sample of the path are left out,
ASIDE = 12.0  # m, and so are those further aside of it
STRAIGHT = 1e-4  # 1/m, along a path that is less curved all points of a body project alike (1 mm)


@dataclass(frozen=True, eq=False)
class Occupancy:
    """Frenet extents of the obstacles (all (o, k), NaN where not there).

    Attributes:
        first_step: time step of the first column.
        ids: obstacle ids.
        s, d: centre [m].
        s_low, s_high, d_low, d_high: extents of the outline [m].
        v: speed along the path [m/s].
        turn: heading relative to the path [rad].
        length, width: of the rectangle [m].
        x, y, psi: centre [m] and heading [rad] in the plane.
        held: (o,) obstacles that keep their place before and after what is predicted.
    """

    first_step: int
    ids: tuple[int, ...]
    s: Array
    d: Array
    s_low: Array
    s_high: Array
    d_low: Array
    d_high: Array
    v: Array
    turn: Array
    length: Array
    width: Array
    x: Array
    y: Array
    psi: Array
    held: Array | None = None

    def window(self, first: int, count: int) -> "Occupancy":
        """The time steps [first, first + count); NaN where nothing is predicted."""
        steps = np.arange(first, first + count)
        cut: dict[str, Any] = {
            name: at_steps(getattr(self, name), self.first_step, self.held, steps)
            for name in VALUES
        }
        return replace(self, first_step=first, **cut)

    def until(self, last: int) -> "Occupancy":
        """Nobody after a time step, but for those that are held."""
        kept = np.zeros(len(self.ids), bool) if self.held is None else self.held
        cut: dict[str, Any] = {}
        for name in VALUES:
            values = getattr(self, name).copy()
            values[~kept, max(last + 1 - self.first_step, 0) :] = np.nan
            cut[name] = values
        return replace(self, **cut)


VALUES = tuple(f.name for f in fields(Occupancy) if f.name not in ("first_step", "ids", "held"))


def occupancy(forecast: Forecast, frame: Frame) -> Occupancy:
    """Projects a forecast onto a reference path; boxes that stay far aside of it are left out."""
    boxes = forecast.boxes
    near = _near(boxes, frame)
    s, d = np.full((2, *boxes.shape[:2]), np.nan)
    s[near], d[near] = frame.to_frenet(boxes[near][:, [Box.X, Box.Y]])
    with np.errstate(invalid="ignore"):
        near &= np.abs(d) - boxes[..., Box.LENGTH] / 2 < ASIDE
    arrays = [np.full(boxes.shape[:2], np.nan) for _ in VALUES]
    for array, values in zip(arrays, _project(boxes[near], s[near], d[near], frame), strict=True):
        array[near] = values
    named = dict(zip(VALUES, arrays, strict=True))
    return Occupancy(forecast.first_step, forecast.ids, **named, held=forecast.held)


def _near(boxes: Array, frame: Frame) -> Array:
    """(o, k) boxes within the path's surroundings; False where there is none."""
    low, high = frame.points.min(0) - NEAR, frame.points.max(0) + NEAR
    centre = boxes[..., [Box.X, Box.Y]]
    with np.errstate(invalid="ignore"):
        inside: Array = ((centre > low) & (centre < high)).all(-1)
    return inside


def _project(boxes: Array, s: Array, d: Array, frame: Frame) -> tuple[Array, ...]:
    """Extents and speeds along the path of (n, 6) boxes with their centres at (s, d)."""
    turn = boxes[:, Box.PSI] - frame.heading(s)
    c, sn = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    half_l, half_w = boxes[:, Box.LENGTH] / 2, boxes[:, Box.WIDTH] / 2
    reach_s, reach_d = half_l * c + half_w * sn, half_l * sn + half_w * c
    extents = np.stack([s - reach_s, s + reach_s, d - reach_d, d + reach_d])
    bent = np.abs(frame.curvature(s)) > STRAIGHT
    for shift in (-reach_s, reach_s):
        bent |= np.abs(frame.curvature(s + shift)) > STRAIGHT
    extents[:, bent] = _outline_extents(boxes[bent], s[bent], frame)
    along = boxes[:, Box.V] * np.cos(turn)
    kept = (boxes[:, c] for c in (Box.LENGTH, Box.WIDTH, Box.X, Box.Y, Box.PSI))
    return (s, d, *extents, along, turn, *kept)


def _outline_extents(boxes: Array, s: Array, frame: Frame) -> Array:
    """(4, n) least and largest s and d of the outlines of (n, 6) boxes with centres at s."""
    outline = box_outline(boxes)
    near = np.repeat(s[:, None], outline.shape[1], axis=1)
    corner_s, corner_d = frame.to_frenet(outline, near)
    return np.stack([corner_s.min(1), corner_s.max(1), corner_d.min(1), corner_d.max(1)])
