"""Lateral candidates: paths d(s) from the present pose to offsets of the own and other lanes.

d(s) is a quintic over arc length (Werling et al. 2012, low-speed mode at all speeds: the path does
not depend on the speed, so it can be driven at any speed, standing starts included), then constant.
With mu the angle to the reference and kappa_r the reference's curvature (Werling 2010, appendix):

    tan mu = d' / (1 - kappa_r d)
    kappa  = [(d'' + (kappa_r' d + kappa_r d') tan mu) cos^2 mu / (1 - kappa_r d) + kappa_r]
             cos mu / (1 - kappa_r d)
    delta  = atan(l kappa)

All arrays are sampled uniformly over the arc length sigma of the candidate path itself.
"""

from dataclasses import dataclass

import numpy as np

from mpcplan.config import SeedConfig
from mpcplan.road.road import Road
from mpcplan.seed.polynomials import evaluate, quintic
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

MIN_STRETCH = 0.2  # smallest 1 - kappa_r d of a path
BODY_POINTS = (-CAR.rear, CAR.rear_to_centre, CAR.front)  # m ahead of the rear axle


@dataclass(frozen=True)
class FrenetPose:
    """Pose and steering at the rear axle in a Frenet frame: m, m, rad, rad."""

    s: float
    d: float
    mu: float
    delta: float


@dataclass(frozen=True, eq=False)
class Paths:
    """Candidate paths, all arrays (p, n) over sigma = 0, spacing, 2 spacing, ...

    Attributes:
        spacing: step of sigma [m].
        s, d, mu: Frenet coordinates of the rear axle [m, m, rad].
        kappa: curvature [1/m]; delta: steering angle [rad]; delta_slope: d delta/d sigma [rad/m].
        road_excess: how far the body sticks out of the drivable area up to here [m], at least 0.
        target: (p,) end offset [m].
    """

    spacing: float
    s: Array
    d: Array
    mu: Array
    kappa: Array
    delta: Array
    delta_slope: Array
    road_excess: Array
    target: Array


def frenet_pose(road: Road, state: Array) -> FrenetPose:
    """The rear-axle state (columns x, y, delta, v, psi) in the road's frame."""
    x, y, delta, _, psi = (float(value) for value in state)
    s, d = (float(value) for value in road.frame.to_frenet(np.array([x, y])))
    mu = (psi - float(road.frame.heading(np.array(s))) + np.pi) % (2 * np.pi) - np.pi
    return FrenetPose(s, d, mu, delta)


def sample_paths(road: Road, pose: FrenetPose, reach: float, config: SeedConfig) -> Paths:
    """All candidate paths from a pose over ``reach`` metres."""
    target, length = _targets(road, pose, config)
    spacing = road.frame.spacing
    ds = np.arange(0.0, reach + spacing, spacing)
    d, d1, d2 = _offsets(road, pose, target, length, ds)
    return _geometry(road, pose, ds, d, d1, d2, target)


def _targets(road: Road, pose: FrenetPose, config: SeedConfig) -> tuple[Array, Array]:
    """End offsets and lengths of the lateral moves, the plain lane keeping first."""
    pairs = [(offset, length) for length in config.lengths for offset in config.offsets]
    pairs.sort(key=lambda pair: (abs(pair[0]), pair[1]))
    limits, s = road.limits, road.frame.s
    for length in config.lengths:
        at = int(np.clip(np.searchsorted(s, pose.s + length), 0, len(s) - 1))
        for lane in (limits.lane_left[at], limits.lane_right[at]):
            if np.isfinite(lane):
                pairs.append((float(lane), length))
    for goal in road.goals:
        if goal.d is not None and not goal.d[0] <= 0.0 <= goal.d[1]:
            middle = (goal.d[0] + goal.d[1]) / 2
            pairs += [(middle, length) for length in config.lengths]
    target, length = np.array(pairs).T
    return target, length


def _offsets(
    road: Road, pose: FrenetPose, target: Array, length: Array, ds: Array
) -> tuple[Array, Array, Array]:
    """d, d', d'' over ds, each (p, n)."""
    kappa = float(road.frame.curvature(np.array(pose.s)))
    slope = float(road.frame.curvature_slope(np.array(pose.s)))
    stretch = max(1.0 - kappa * pose.d, MIN_STRETCH)
    mu = float(np.clip(pose.mu, -1.2, 1.2))
    d1 = stretch * np.tan(mu)
    own = np.tan(pose.delta) / CAR.wheelbase
    d2 = -(slope * pose.d + kappa * d1) * np.tan(mu)
    d2 += stretch / np.cos(mu) ** 2 * (own * stretch / np.cos(mu) - kappa)
    zero = np.zeros_like(target)
    c = quintic(zero + pose.d, zero + d1, zero + d2, target, zero, zero, length)
    moved = np.minimum(ds, length[:, None])
    d, first, second = evaluate(c, moved)
    there = ds >= length[:, None]
    return d, np.where(there, 0.0, first), np.where(there, 0.0, second)


def _geometry(
    road: Road, pose: FrenetPose, ds: Array, d: Array, d1: Array, d2: Array, target: Array
) -> Paths:
    """Heading, curvature and steering of d(s), resampled over the path's own arc length."""
    s = pose.s + ds
    kappa_r, slope_r = road.frame.curvature(s), road.frame.curvature_slope(s)
    stretch = np.maximum(1.0 - kappa_r * d, MIN_STRETCH)
    mu = np.arctan2(d1, stretch)
    bend = (d2 + (slope_r * d + kappa_r * d1) * np.tan(mu)) * np.cos(mu) ** 2 / stretch
    kappa = (bend + kappa_r) * np.cos(mu) / stretch
    speed = stretch / np.cos(mu)  # d sigma / d s
    sigma = np.zeros_like(d)
    sigma[:, 1:] = np.cumsum((speed[:, 1:] + speed[:, :-1]) / 2 * np.diff(ds), axis=1)
    even = np.stack([np.interp(ds, row, s) for row in sigma])
    resampled = [
        np.stack([np.interp(at, s, row) for at, row in zip(even, values, strict=True)])
        for values in (d, mu, kappa)
    ]
    d, mu, kappa = resampled
    delta = np.arctan(CAR.wheelbase * kappa)
    spacing = float(ds[1] - ds[0])
    delta_slope = np.gradient(delta, spacing, axis=1)
    excess = np.maximum.accumulate(_road_excess(road, even, d, mu), axis=1)
    return Paths(spacing, even, d, mu, kappa, delta, delta_slope, excess, target)


def _road_excess(road: Road, s: Array, d: Array, mu: Array) -> Array:
    """How far [m] the body's sides lie outside the drivable area, 0 where they are inside."""
    half = CAR.width / 2 * np.cos(mu)
    excess = np.zeros_like(d)
    kappa = road.frame.curvature(s)
    for ahead in BODY_POINTS:
        at = s + ahead * np.cos(mu)
        side = d + ahead * np.sin(mu) - kappa * (ahead * np.cos(mu)) ** 2 / 2
        left = np.interp(at, road.frame.s, road.limits.left)
        right = np.interp(at, road.frame.s, road.limits.right)
        excess = np.maximum(excess, np.maximum(side + half - left, right - side + half))
    return np.maximum(excess, 0.0)
