"""Motion of a vehicle along a path: piecewise constant acceleration and smooth lateral shifts.

Units: m, m/s, m/s^2, s, rad.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from .paths import Path

TIME_STEP = 0.1  # duration of one scenario step [s]


class Phase(NamedTuple):
    """Time span [s] with constant acceleration [m/s^2]; a standing vehicle never reverses."""

    duration: float
    acceleration: float = 0.0


class Shift(NamedTuple):
    """Smooth lateral move by `distance` [m] (left positive) from `start` [s] for `duration` [s]."""

    start: float
    duration: float
    distance: float


class Pose(NamedTuple):
    """Position [m], orientation [rad], speed [m/s], acceleration [m/s^2], yaw rate [rad/s]."""

    x: float
    y: float
    orientation: float
    velocity: float
    acceleration: float
    yaw_rate: float


@dataclass(frozen=True)
class Motion:
    """Drive along `path` from station `s` [m] with speed `v` [m/s], offset `d` [m] to the left."""

    path: Path
    s: float
    v: float
    phases: tuple[Phase, ...] = ()
    shifts: tuple[Shift, ...] = ()
    d: float = 0.0

    def pose(self, step: int) -> Pose:
        """Pose at the scenario step `step`."""
        time = step * TIME_STEP
        station, speed, acceleration = self._along(time)
        offset, offset_rate = self._across(time)
        curvature = float(self.path.curvature(station))
        forward = speed * (1.0 - curvature * offset)
        slant = math.atan2(offset_rate, forward) if forward > 0.0 else 0.0
        x, y = self.path.point(station, offset)
        return Pose(
            float(x),
            float(y),
            float(self.path.heading(station)) + slant,
            math.hypot(forward, offset_rate),
            acceleration,
            curvature * speed,
        )

    def _along(self, time: float) -> tuple[float, float, float]:
        """Station [m], speed [m/s] and acceleration [m/s^2] at `time` [s]."""
        station, speed, left = self.s, self.v, time
        for duration, acceleration in self.phases:
            span = min(left, duration)
            moving = span if acceleration >= 0.0 else min(span, speed / -acceleration)
            station += speed * moving + 0.5 * acceleration * moving**2
            speed = max(speed + acceleration * moving, 0.0)
            left -= span
            if left <= 0.0 and span < duration:
                return station, speed, acceleration if moving == span else 0.0
        return station + speed * left, speed, 0.0

    def _across(self, time: float) -> tuple[float, float]:
        """Lateral offset [m] and its rate [m/s] at `time` [s] (quintic blends)."""
        offset, rate = self.d, 0.0
        for start, duration, distance in self.shifts:
            u = min(max((time - start) / duration, 0.0), 1.0)
            offset += distance * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
            rate += distance * 30.0 * u**2 * (1.0 - u) ** 2 / duration
        return offset, rate
