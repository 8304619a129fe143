"""Forecasts along a reference path: which (s, d) every obstacle occupies at every time step."""

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from mpcplan.observation import Box, Forecast, at_steps, box_outline
from mpcplan.road.frame import Frame
from mpcplan.trajectory import Array

NEAR = 80.0  # m, boxes further from every sample of the path are left out


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
    held: Array | None = None

    def window(self, first: int, count: int) -> "Occupancy":
        """The time steps [first, first + count); NaN where nothing is predicted."""
        steps = np.arange(first, first + count)
        cut: dict[str, Any] = {
            name: at_steps(getattr(self, name), self.first_step, self.held, steps)
            for name in VALUES
        }
        return replace(self, first_step=first, **cut)


VALUES = tuple(f.name for f in fields(Occupancy) if f.name not in ("first_step", "ids", "held"))


def occupancy(forecast: Forecast, frame: Frame) -> Occupancy:
    """Projects a forecast onto a reference path."""
    boxes = forecast.boxes
    shape = boxes.shape[:2]
    arrays = [np.full(shape, np.nan) for _ in VALUES]
    there = np.isfinite(boxes[..., Box.X])
    if there.any():
        low, high = frame.points.min(0) - NEAR, frame.points.max(0) + NEAR
        inside = np.zeros(shape, bool)
        centre = boxes[there][:, [Box.X, Box.Y]]
        inside[there] = ((centre > low) & (centre < high)).all(1)
        for array, values in zip(arrays, _project(boxes[inside], frame), strict=True):
            array[inside] = values
    named = dict(zip(VALUES, arrays, strict=True))
    return Occupancy(forecast.first_step, forecast.ids, **named, held=forecast.held)


def _project(boxes: Array, frame: Frame) -> tuple[Array, ...]:
    """Centres, extents and speeds along the path of (n, 6) boxes."""
    centre = boxes[:, [Box.X, Box.Y]]
    s, d = frame.to_frenet(centre)
    outline = box_outline(boxes)
    near = np.repeat(s[:, None], outline.shape[1], axis=1)
    corner_s, corner_d = frame.to_frenet(outline, near)
    turn = boxes[:, Box.PSI] - frame.heading(s)
    along = boxes[:, Box.V] * np.cos(turn)
    return (
        s, d, corner_s.min(1), corner_s.max(1), corner_d.min(1), corner_d.max(1), along, turn,
        boxes[:, Box.LENGTH], boxes[:, Box.WIDTH],
    )  # fmt: skip
