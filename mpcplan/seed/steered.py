"""Steered labels: Frenet poses of the single-track model, moved on at given steering rates.

Over the arc length sigma, with the steering rate u = delta':

    s' = cos mu / (1 - kappa_r d),   d' = sin mu,   mu' = tan delta / l - kappa_r s',   delta' = u
"""

from dataclasses import dataclass, fields, replace

import numpy as np

from mpcplan.road.frame import Frame
from mpcplan.seed.clearance import Poses
from mpcplan.seed.paths import FrenetPose
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

STEERING_SHARE = 0.97  # of the largest steering angle
RETURN = 4.0  # m, over which the feedback returns to the reference
MIN_STRETCH = 0.15  # smallest 1 - kappa_r d


@dataclass(frozen=True, eq=False)
class Labels:
    """Ends of paths, all (n,): Frenet pose [m, m, rad] and steering angle [rad], the cost of the
    way there, the steering rate [rad/m] at last, and the index of the label before."""

    s: Array
    d: Array
    mu: Array
    delta: Array
    cost: Array
    rate: Array
    parent: Array

    def pick(self, index: Array) -> "Labels":
        """The labels at an index."""
        return Labels(*(getattr(self, f.name)[index] for f in fields(self)))

    def poses(self, frame: Frame) -> Poses:
        """In the plane."""
        x, y = frame.to_cartesian(self.s, self.d).T
        return x, y, frame.heading(self.s) + self.mu


def start(pose: FrenetPose) -> Labels:
    """The present pose."""
    values = (pose.s, pose.d, pose.mu, pose.delta, 0.0, 0.0, -1)
    return Labels(*(np.array([value]) for value in values))


def advance(frame: Frame, labels: Labels, rate: Array, length: float) -> Labels:
    """Labels after a length [m] at steering rates (n,) [rad/m], by the midpoint rule; same cost."""
    now = (labels.s, labels.d, labels.mu)
    # who has steered further already need not steer back at once
    most = np.maximum(STEERING_SHARE * CAR.delta_max, np.abs(labels.delta))
    after = np.clip(labels.delta + rate * length, -most, most)
    slopes = _slopes(frame, *now, labels.delta)
    s, d, mu = (x + length / 2 * slope for x, slope in zip(now, slopes, strict=True))
    slopes = _slopes(frame, s, d, mu, (labels.delta + after) / 2)
    s, d, mu = (x + length * slope for x, slope in zip(now, slopes, strict=True))
    return replace(labels, s=s, d=d, mu=mu, delta=after, rate=rate)


def _slopes(frame: Frame, s: Array, d: Array, mu: Array, delta: Array) -> Poses:
    """s', d', mu' of the model."""
    kappa = frame.curvature(s)
    along = np.cos(mu) / np.maximum(1.0 - kappa * d, MIN_STRETCH)
    return along, np.sin(mu), np.tan(delta) / CAR.wheelbase - kappa * along


def returning(frame: Frame, labels: Labels, most: float, length: float) -> Array:
    """(n,) steering rates [rad/m], at most ``most``, that lead back to the reference, critically
    damped, when held over a length [m]."""
    kappa = frame.curvature(labels.s)
    aim = kappa / np.maximum(1.0 - kappa * labels.d, MIN_STRETCH)
    aim = aim - labels.d / RETURN**2 - 2 * labels.mu / RETURN
    return np.clip((np.arctan(CAR.wheelbase * aim) - labels.delta) / length, -most, most)
