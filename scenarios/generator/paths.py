"""Plane reference curves made of straights, arcs and clothoids.

All lengths are in metres, angles in radians (counter-clockwise positive), curvatures in 1/m.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

TABLE_STEP = 0.05  # spacing of the internal table [m]
STRAIGHT_VERTEX_STEP = 5.0  # spacing of lanelet vertices on straights [m]
CURVE_VERTEX_STEP = 1.5  # spacing of lanelet vertices in curves [m]
TIGHT_VERTEX_STEP = 1.0  # spacing of lanelet vertices in tight curves [m]
TIGHT_CURVATURE = 1.0 / 25.0  # from here on a curve counts as tight [1/m]
ZERO_CURVATURE = 1e-9  # below this a segment counts as straight [1/m]


class Segment(NamedTuple):
    """Piece of a curve whose curvature changes linearly from `start` to `end` [1/m]."""

    length: float
    start: float = 0.0
    end: float = 0.0


def straight(length: float) -> Segment:
    """Straight segment of the given length [m]."""
    return Segment(length)


def arc(angle: float, radius: float) -> Segment:
    """Arc through `angle` [rad] (left positive, right negative) with `radius` > 0 [m]."""
    curvature = float(np.sign(angle)) / radius
    return Segment(abs(angle) * radius, curvature, curvature)


@dataclass(frozen=True)
class Path:
    """Curve as a table over its arc length `s`; `joints` are the stations between segments."""

    s: np.ndarray
    xy: np.ndarray
    theta: np.ndarray
    kappa: np.ndarray
    joints: np.ndarray

    @property
    def length(self) -> float:
        """Arc length of the whole curve [m]."""
        return float(self.s[-1])

    def heading(self, s: float | np.ndarray) -> float | np.ndarray:
        """Tangent angle at station `s` [rad], continuous along the curve."""
        return np.interp(s, self.s, self.theta)

    def curvature(self, s: float | np.ndarray) -> float | np.ndarray:
        """Curvature at station `s` [1/m]."""
        return np.interp(s, self.s, self.kappa)

    def point(self, s: float | np.ndarray, d: float | np.ndarray = 0.0) -> np.ndarray:
        """Position(s) [m] at station `s` and offset `d` (positive to the left)."""
        theta = self.heading(s)
        x = np.interp(s, self.s, self.xy[:, 0]) - d * np.sin(theta)
        y = np.interp(s, self.s, self.xy[:, 1]) + d * np.cos(theta)
        return np.stack([x, y], axis=-1)

    def offset(self, d: float) -> Path:
        """Parallel curve at the constant distance `d` [m] to the left."""
        turned = self.theta - self.theta[0]
        stations = self.s - d * turned
        return Path(
            stations,
            self.point(self.s, d),
            self.theta,
            self.kappa / (1.0 - d * self.kappa),
            np.interp(self.joints, self.s, stations),
        )

    def reversed(self) -> Path:
        """Same curve driven in the opposite direction."""
        return Path(
            (self.length - self.s)[::-1],
            self.xy[::-1],
            self.theta[::-1] + np.pi,
            -self.kappa[::-1],
            (self.length - self.joints)[::-1],
        )

    def placed(self, s: float, x: float, y: float, heading: float) -> Path:
        """Rigidly moved copy which passes (x, y) [m] with `heading` [rad] at station `s`."""
        turn = heading - float(self.heading(s))
        cos, sin = np.cos(turn), np.sin(turn)
        rotation = np.array([[cos, -sin], [sin, cos]])
        xy = (self.xy - self.point(s)) @ rotation.T + np.array([x, y])
        return Path(self.s, xy, self.theta + turn, self.kappa, self.joints)

    def vertex_stations(self, start: float, end: float) -> np.ndarray:
        """Stations [m] of polyline vertices between `start` and `end`, denser in curves."""
        inner = [j for j in self.joints if start + TABLE_STEP < j < end - TABLE_STEP]
        knots = [start, *inner, end]
        stations = [np.array([start])]
        for a, b in pairwise(knots):
            count = int(np.ceil((b - a) / self._vertex_step(a, b) - ZERO_CURVATURE))
            stations.append(np.linspace(a, b, max(count, 1) + 1)[1:])
        return np.concatenate(stations)

    def _vertex_step(self, a: float, b: float) -> float:
        """Largest vertex spacing [m] for the piece between the stations `a` and `b`."""
        inside = np.abs(self.curvature(np.linspace(a, b, 5)[1:-1]))
        bend = float(inside.max())
        if bend < ZERO_CURVATURE:
            return STRAIGHT_VERTEX_STEP
        return TIGHT_VERTEX_STEP if bend >= TIGHT_CURVATURE else CURVE_VERTEX_STEP


def build_path(*segments: Segment, x: float = 0.0, y: float = 0.0, heading: float = 0.0) -> Path:
    """Join `segments` to a path which starts at (x, y) [m] with `heading` [rad]."""
    stations, thetas, kappas = [np.zeros(1)], [np.array([heading])], [np.array([segments[0].start])]
    joints = [0.0]
    for segment in segments:
        count = max(int(np.ceil(segment.length / TABLE_STEP)), 1)
        local = np.linspace(0.0, segment.length, count + 1)[1:]
        slope = (segment.end - segment.start) / segment.length
        stations.append(joints[-1] + local)
        thetas.append(thetas[-1][-1] + segment.start * local + 0.5 * slope * local**2)
        kappas.append(segment.start + slope * local)
        joints.append(joints[-1] + segment.length)
    s, theta = np.concatenate(stations), np.concatenate(thetas)
    half_turn = 0.5 * np.diff(theta)
    chord = np.diff(s) * np.sinc(half_turn / np.pi)  # exact on arcs
    direction = theta[:-1] + half_turn
    step = np.stack([chord * np.cos(direction), chord * np.sin(direction)], axis=-1)
    xy = np.array([x, y]) + np.vstack([np.zeros((1, 2)), np.cumsum(step, axis=0)])
    return Path(s, xy, theta, np.concatenate(kappas), np.array(joints))
