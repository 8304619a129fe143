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
from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.road import Road
from mpcplan.seed.passing import around_slow
from mpcplan.seed.polynomials import evaluate, quintic
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

MIN_STRETCH = 0.2  # smallest 1 - kappa_r d of a path
ELSEWHERE = 1.0  # m, beside the present offset: a move to there leads to another lane
BODY_POINTS = tuple(float(x) for x in np.linspace(-CAR.rear, CAR.front, 4))  # m ahead of the axle


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
        s, d, mu: Frenet coordinates of the rear axle [m, m, rad]; x, y, psi: in the plane.
        swing: by how much [m] the reference turns aside from the body's front, to the left.
        kappa: curvature [1/m]; delta: steering angle [rad]; delta_slope: d delta/d sigma [rad/m].
        road_excess: how far the body sticks out of the drivable area up to here [m], at least 0.
        target: (p,) end offset [m].
        stretch: (p,) least 1 - kappa_r d along each path, at most 1.
        passing: (p,) whether it leads around a slow obstacle and back.
    """

    spacing: float
    s: Array
    d: Array
    mu: Array
    x: Array
    y: Array
    psi: Array
    swing: Array
    kappa: Array
    delta: Array
    delta_slope: Array
    road_excess: Array
    target: Array
    stretch: Array
    passing: Array


def frenet_pose(road: Road, state: Array) -> FrenetPose:
    """The rear-axle state (columns x, y, delta, v, psi) in the road's frame."""
    x, y, delta, _, psi = (float(value) for value in state)
    s, d = (float(value) for value in road.frame.to_frenet(np.array([x, y])))
    mu = (psi - float(road.frame.heading(np.array(s))) + np.pi) % (2 * np.pi) - np.pi
    return FrenetPose(s, d, mu, delta)


@dataclass(frozen=True, eq=False)
class _Moves:
    """Lateral moves, all (p,): to ``first`` over ``length``, and back to ``second`` from ``back``
    on over ``back_length`` (back = inf: never); ``passing``: around a slow obstacle."""

    first: Array
    length: Array
    second: Array
    back: Array
    back_length: Array
    passing: Array


def sample_paths(
    road: Road, pose: FrenetPose, reach: float, window: Occupancy, config: SeedConfig
) -> Paths:
    """All candidate paths from a pose over ``reach`` metres.

    ``window`` are the obstacles from now on: paths around slow ones lead out and back.
    """
    moves = _moves(road, pose, window, config)
    spacing = road.frame.spacing
    ds = np.arange(0.0, reach + spacing, spacing)
    d, d1, d2 = _offsets(road, pose, moves, ds)
    return _geometry(road, pose, ds, d, d1, d2, moves)


def _moves(road: Road, pose: FrenetPose, window: Occupancy, config: SeedConfig) -> _Moves:
    """All lateral moves, the plain lane keeping first."""
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
    rows = [(offset, length, 0.0, np.inf, 1.0) for offset, length in pairs]
    middles = {0.0} | {offset for offset, _ in pairs} - set(config.offsets)
    rows += [
        (pose.d, config.lengths[0], offset, max(delay, config.lengths[0]), length)
        for offset in sorted(middles)
        if abs(offset - pose.d) > ELSEWHERE
        for delay in config.delays
        for length in config.lengths
    ]
    around = around_slow(road, pose.s, window, config)
    passing = np.arange(len(rows) + len(around)) >= len(rows)
    first, length, second, back, back_length = np.array(rows + around).T
    return _Moves(first, length, second, back, back_length, passing)


def _offsets(road: Road, pose: FrenetPose, moves: _Moves, ds: Array) -> tuple[Array, Array, Array]:
    """d, d', d'' over ds, each (p, n)."""
    kappa = float(road.frame.curvature(np.array(pose.s)))
    slope = float(road.frame.curvature_slope(np.array(pose.s)))
    stretch = max(1.0 - kappa * pose.d, MIN_STRETCH)
    mu = float(np.clip(pose.mu, -1.2, 1.2))
    d1 = stretch * np.tan(mu)
    own = np.tan(pose.delta) / CAR.wheelbase
    d2 = -(slope * pose.d + kappa * d1) * np.tan(mu)
    d2 += stretch / np.cos(mu) ** 2 * (own * stretch / np.cos(mu) - kappa)
    zero = np.zeros_like(moves.first)
    out = quintic(zero + pose.d, zero + d1, zero + d2, moves.first, zero, zero, moves.length)
    back = quintic(moves.first, zero, zero, moves.second, zero, zero, moves.back_length)
    length, begin = moves.length[:, None], moves.back[:, None]
    early = evaluate(out, np.minimum(ds, length))
    since = np.clip(np.where(np.isfinite(begin), ds - begin, 0.0), 0.0, moves.back_length[:, None])
    late = evaluate(back, since)
    d, first, second = (np.where(ds < begin, e, w) for e, w in zip(early, late, strict=True))
    still = ((ds >= length) & (ds < begin)) | (ds >= begin + moves.back_length[:, None])
    return d, np.where(still, 0.0, first), np.where(still, 0.0, second)


def _geometry(
    road: Road, pose: FrenetPose, ds: Array, d: Array, d1: Array, d2: Array, moves: _Moves
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
    least = np.minimum(stretch.min(axis=1), 1.0)
    delta_slope = np.gradient(delta, spacing, axis=1)
    excess = np.maximum.accumulate(_road_excess(road, even, d, mu), axis=1)
    target = np.where(np.isfinite(moves.back), moves.second, moves.first)
    plane = road.frame.to_cartesian(even.ravel(), d.ravel()).reshape(*even.shape, 2)
    psi = road.frame.heading(even) + mu
    swing = road.frame.curvature(even) * (CAR.front * np.cos(mu)) ** 2 / 2
    return Paths(
        spacing, even, d, mu, plane[..., 0], plane[..., 1], psi, swing, kappa, delta, delta_slope,
        excess, target, least, moves.passing,
    )  # fmt: skip


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
