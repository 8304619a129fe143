"""Manoeuvres at low speed: paths of the single-track model through narrow places.

A polynomial d(s) is too coarse where the vehicle must turn close to who stands in its way, or
around a corner that is tighter than its lane. Here paths are built of short pieces along which the
steering angle changes at a constant rate, delta' = u over the arc length sigma, u in {-r, 0, r}:

    s' = cos mu / (1 - kappa_r d),   d' = sin mu,   mu' = tan delta / l - kappa_r s'

Solved forward by dynamic programming over labels (s, d, mu, delta): of all labels of equal arc
length that share a cell the cheapest stays, at most a given number. From where the best one ends,
feedback leads back to the reference. Where others stand, and the road, are checked exactly; the
speed search along the path looks after who moves. Source: hybrid A* (Dolgov et al. 2010), with arc
length as the only order, so that a layer is one array.
"""

from dataclasses import dataclass, fields

import numpy as np

from mpcplan.config import Config
from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.frame import Frame
from mpcplan.road.road import Road
from mpcplan.seed.clearance import Boxes, on_road, standing, touches
from mpcplan.seed.paths import FrenetPose, Paths
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

SPEED = 2.0  # m/s, at which manoeuvres are driven about, which weighs ways against each other
PIECE = 1.0  # m, of one steering rate
CELL = (1.0, 0.4, 0.15, 0.2)  # m, m, rad, rad: labels this close in s, d, mu, delta share a cell
FASTER = 3.0  # times the usual steering rate, for what is tighter: slower
PROGRESS = 5.0  # 1/s, cost of time
END_OFFSET, END_TURN = 2.0, 10.0  # 1/m^2, 1/rad^2: cost of leaving the reference where it ends
ASTRAY = 2.0  # m, from the reference: a path that ends further off leads elsewhere
TURN_MAX = 1.4  # rad, to the reference
STEERING_SHARE = 0.97  # of the largest steering angle that manoeuvres use
RETURN = 4.0  # m, over which the feedback returns to the reference
SPARE = 0.05  # m, kept to the road's edge: the model follows the path nearly
MIN_STRETCH = 0.15  # smallest 1 - kappa_r d


@dataclass(frozen=True, eq=False)
class Labels:
    """Ends of pieces, all (n,): Frenet pose and steering, the cost of the way there, the steering
    rate [rad/m] of its last piece and the index of the label before."""

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


def manoeuvres(
    road: Road, pose: FrenetPose, reach: float, window: Occupancy, config: Config
) -> Paths | None:
    """Paths clear of where the others stand, and if there is one of wherever they will be.

    Args:
        road: the road.
        pose: present pose.
        reach: length of the paths [m].
        window: the others from now on.
        config: the configuration.

    Returns:
        The paths that differ; None where there is none.
    """
    free = _Free(road, pose, window, config.seed.manoeuvre_gap)
    rates = _best_rates(road, pose, free, config)
    if rates is None:
        return None
    return _as_paths(road, pose, [rates], reach, config.seed.manoeuvre_rate)


class _Free:
    """Which poses are free; what is too close already at first does not count."""

    def __init__(self, road: Road, pose: FrenetPose, window: Occupancy, gap: float) -> None:
        self._road = road
        here = Labels(*(np.array([v]) for v in (pose.s, pose.d, pose.mu, pose.delta, 0, 0, -1)))
        plane = self._plane(here)
        boxes = standing(window).grown(gap)
        apart = [not touches(*plane, _one(boxes, i))[0] for i in range(len(boxes.x))]
        self._boxes = _one(boxes, np.flatnonzero(apart))
        self._spare = SPARE if on_road(*plane, road.area, SPARE)[0] else 0.0

    def of_boxes(self, labels: Labels) -> Array:
        """(n,) whether no box is touched."""
        return ~touches(*self._plane(labels), self._boxes)

    def of_road(self, labels: Labels) -> Array:
        """(n,) whether the body is on the road."""
        return on_road(*self._plane(labels), self._road.area, self._spare)

    def _plane(self, labels: Labels) -> tuple[Array, Array, Array]:
        return plane_poses(self._road.frame, labels.s, labels.d, labels.mu)


def _one(boxes: Boxes, index: Array | int) -> Boxes:
    at = np.atleast_1d(index)
    return Boxes(*(getattr(boxes, f.name)[at] for f in fields(boxes)))


def plane_poses(frame: Frame, s: Array, d: Array, mu: Array) -> tuple[Array, Array, Array]:
    """x, y [m] and heading [rad] at Frenet poses."""
    plane = frame.to_cartesian(s, d)
    return plane[..., 0], plane[..., 1], frame.heading(s) + mu


def advance(frame: Frame, labels: Labels, rate: Array, ds: float) -> Labels:
    """Labels after ``ds`` [m] at steering rates [rad/m], by the midpoint rule; costs unchanged."""

    def slopes(s: Array, d: Array, mu: Array, delta: Array) -> tuple[Array, Array, Array]:
        kappa = frame.curvature(s)
        along = np.cos(mu) / np.maximum(1.0 - kappa * d, MIN_STRETCH)
        return along, np.sin(mu), np.tan(delta) / CAR.wheelbase - kappa * along

    limit = STEERING_SHARE * CAR.delta_max
    s, d, mu, delta = labels.s, labels.d, labels.mu, labels.delta
    most = np.maximum(limit, np.abs(delta))
    after = np.clip(delta + rate * ds, -most, most)
    half = [x + ds / 2 * dx for x, dx in zip((s, d, mu), slopes(s, d, mu, delta), strict=True)]
    middle = slopes(*half, (delta + after) / 2)
    s, d, mu = (x + ds * dx for x, dx in zip((s, d, mu), middle, strict=True))
    return Labels(s, d, mu, after, labels.cost, rate, labels.parent)


def _best_rates(road: Road, pose: FrenetPose, free: _Free, config: Config) -> Array | None:
    """(m,) steering rates [rad/m] of the pieces of the best path; None where there is none."""
    start = (pose.s, pose.d, pose.mu, pose.delta, 0.0, 0.0, -1)
    layers = [Labels(*(np.array([value]) for value in start))]
    far = min((goal.s[0] for goal in road.goals if goal.s is not None), default=np.inf)
    for _ in range(round(config.seed.manoeuvre_length / PIECE)):
        if layers[-1].s.max() > far:
            break
        grown = _grow(road, layers[-1], free, config)
        if grown is None:
            return None
        layers.append(grown)
    last = layers[-1]
    at = int(np.argmin(last.cost + END_OFFSET * last.d**2 + END_TURN * last.mu**2))
    if abs(last.d[at]) > ASTRAY:
        return None
    rates = []
    for labels in layers[:0:-1]:
        rates.append(float(labels.rate[at]))
        at = int(labels.parent[at])
    return np.array(rates[::-1])


def _grow(road: Road, labels: Labels, free: _Free, config: Config) -> Labels | None:
    """The successors of a layer that are free, the cheapest of every cell; None: there is none."""
    usual, spacing = config.seed.manoeuvre_rate, road.frame.spacing
    rates = usual * np.array([-FASTER, -1.0, 0.0, 1.0, FASTER])
    parent = np.repeat(np.arange(len(labels.s)), len(rates))
    rate = np.tile(rates, len(labels.s))
    grown = labels.pick(parent)
    grown = Labels(grown.s, grown.d, grown.mu, grown.delta, grown.cost, rate, parent)
    steps = max(round(PIECE / spacing), 1)
    for _ in range(steps):
        grown = advance(road.frame, grown, grown.rate, PIECE / steps)
        low, high = road.frame.domain(grown.s)
        inside = (np.abs(grown.mu) < TURN_MAX) & (grown.d > low) & (grown.d < high)
        grown = grown.pick(np.flatnonzero(inside))
        grown = grown.pick(np.flatnonzero(free.of_boxes(grown)))
    if not len(grown.s):
        return None
    speed = np.minimum(SPEED, CAR.v_delta_max / np.maximum(np.abs(grown.rate), usual))
    rated = config.cost.steering_rate * (grown.rate * speed) ** 2 + config.cost.lane * grown.d**2
    cost = grown.cost + (rated + PROGRESS) * PIECE / speed
    cost = cost - PROGRESS * (grown.s - labels.s[grown.parent]) / SPEED
    grown = Labels(grown.s, grown.d, grown.mu, grown.delta, cost, grown.rate, grown.parent)
    kept = _cheapest(grown, config.seed.manoeuvre_labels)
    kept = kept.pick(np.flatnonzero(free.of_road(kept)))
    return kept if len(kept.s) else None


def _cheapest(labels: Labels, most: int) -> Labels:
    """The cheapest label of every cell, and of these the cheapest ``most``."""
    values = (labels.s, labels.d, labels.mu, labels.delta)
    cells = [np.rint(value / size) for value, size in zip(values, CELL, strict=True)]
    order = np.lexsort((labels.cost, *cells))
    keys = np.stack(cells)[:, order]
    first = np.concatenate([[True], (np.diff(keys, axis=1) != 0).any(axis=0)])
    kept = order[first]
    return labels.pick(kept[np.argsort(labels.cost[kept], kind="stable")[:most]])


def _as_paths(
    road: Road, pose: FrenetPose, found: list[Array], reach: float, most: float
) -> Paths:
    """Paths of steering rates, led on along the reference."""
    spacing = road.frame.spacing
    count = round(reach / spacing) + 1
    steps = max(round(PIECE / spacing), 1)
    rows = len(found)
    given = np.full((rows, count), np.nan)
    for row, rates in zip(given, found, strict=True):
        each = np.repeat(rates, steps)[: count - 1]
        row[: len(each)] = each
    start = (pose.s, pose.d, pose.mu, pose.delta, 0.0, 0.0, -1)
    at = Labels(*(np.full(rows, value, float) for value in start))
    samples = [at]
    for k in range(count - 1):
        back = _feedback_rate(road.frame, at, most, spacing)
        rate = np.where(np.isfinite(given[:, k]), given[:, k], back)
        at = advance(road.frame, at, rate, spacing)
        samples.append(at)
    s, d, mu, delta = (
        np.stack([getattr(label, name) for label in samples], axis=1)
        for name in ("s", "d", "mu", "delta")
    )
    return _with_geometry(road, s, d, mu, delta)


def _feedback_rate(frame: Frame, at: Labels, most: float, ds: float) -> Array:
    """Steering rates [rad/m] that return to the reference, critically damped."""
    kappa = frame.curvature(at.s)
    aim = kappa / np.maximum(1.0 - kappa * at.d, MIN_STRETCH)
    aim = aim - at.d / RETURN**2 - 2 * at.mu / RETURN
    return np.clip((np.arctan(CAR.wheelbase * aim) - at.delta) / ds, -most, most)


def _with_geometry(road: Road, s: Array, d: Array, mu: Array, delta: Array) -> Paths:
    """Sampled Frenet poses (p, n) as paths; off the road they may not be driven."""
    frame, spacing = road.frame, road.frame.spacing
    x, y, psi = plane_poses(frame, s, d, mu)
    flat = (x.ravel(), y.ravel(), psi.ravel())
    inside = on_road(*flat, road.area, 0.0).reshape(s.shape)
    excess = np.maximum.accumulate(np.where(inside, 0.0, CAR.length), axis=1)
    kappa_r = frame.curvature(s)
    swing = kappa_r * (CAR.front * np.cos(mu)) ** 2 / 2
    stretch = np.minimum((1.0 - kappa_r * d).min(axis=1), 1.0)
    return Paths(
        spacing, s, d, mu, x, y, psi, swing, np.tan(delta) / CAR.wheelbase, delta,
        np.gradient(delta, spacing, axis=1), excess, d[:, -1],
        np.maximum(stretch, MIN_STRETCH), np.ones(len(s), bool),
    )  # fmt: skip
