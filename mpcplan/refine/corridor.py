"""The corridor of a seed: bounds on s and d that fix which side of every obstacle it passes.

For every time step and obstacle the seed tells on which axis the two are apart: behind or ahead
(then s is bounded) or beside (then d is). The refinement may move freely inside these bounds, so
it keeps the seed's homotopy. The evaluated cost's leader is fixed in the same way.
"""

from dataclasses import dataclass

import numpy as np

from mpcplan.config import Config
from mpcplan.predict.occupancy import Occupancy
from mpcplan.seed.paths import BODY_POINTS
from mpcplan.seed.seed import Seed, Stage
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

LON_SCALE = 4.0  # m, a longitudinal gap of this weighs as much as
LAT_SCALE = 1.0  # m, a lateral one of this when the axis is chosen
FAR = 1e3  # m, no bound


@dataclass(frozen=True, eq=False)
class Corridor:
    """Bounds for the rear axle's s and the body's d at steps k = 0..N.

    Attributes:
        s_min, s_max: (N + 1,) bounds of s [m].
        d_min, d_max: (N + 1,) bounds from obstacles beside, for every point of the body's axis [m].
        lead: (N + 1,) arc length of the centre of the obstacle that TR1 counts as ahead, else inf.
    """

    s_min: Array
    s_max: Array
    d_min: Array
    d_max: Array
    lead: Array


def build_corridor(seed: Seed, occupancy: Occupancy, config: Config) -> Corridor:
    """The corridor of a seed among predicted obstacles."""
    n = len(seed.states)
    window = occupancy.window(seed.first_step, n)
    near = np.flatnonzero(np.isfinite(window.s).any(axis=1))
    s, d, mu = (seed.states[:, c] for c in (Stage.S, Stage.D, Stage.MU))
    ahead, behind, left, right = _gaps(s, d, mu, window, near)
    lon, lat = np.fmax(ahead, behind), np.fmax(left, right)
    by_lon = lon / LON_SCALE >= lat / LAT_SCALE
    margin = config.seed.margin_lon / 2
    bounds = _bounds(window, near, by_lon, ahead >= behind, left >= right, margin, config)
    s_min, s_max, d_min, d_max = bounds
    road_end = seed.road.limits.end - CAR.front
    s_max = np.minimum(s_max, road_end)
    return Corridor(s_min, s_max, d_min, d_max, _lead(seed, window, near, config))


def _gaps(
    s: Array, d: Array, mu: Array, window: Occupancy, rows: Array
) -> tuple[Array, Array, Array, Array]:
    """(m, n) gaps [m] to the obstacle ahead, behind, to the left, to the right (NaN: not there)."""
    ends = np.stack([d + point * np.sin(mu) for point in (-CAR.rear, CAR.front)])
    half = CAR.width / 2
    ahead = window.s_low[rows] - (s + CAR.front)
    behind = (s - CAR.rear) - window.s_high[rows]
    left = window.d_low[rows] - (ends.max(axis=0) + half)
    right = (ends.min(axis=0) - half) - window.d_high[rows]
    return ahead, behind, left, right


def _bounds(
    window: Occupancy, rows: Array, by_lon: Array, is_ahead: Array, is_left: Array, margin: float,
    config: Config,
) -> tuple[Array, Array, Array, Array]:  # fmt: skip
    """Bounds of s and d over the steps from the chosen axes."""
    lat = config.seed.margin_lat + CAR.width / 2

    def least(values: Array, chosen: Array) -> Array:
        return np.where(chosen & np.isfinite(values), values, FAR).min(axis=0, initial=FAR)

    there = np.isfinite(window.s_low[rows])
    s_max = least(window.s_low[rows] - CAR.front - margin, there & by_lon & is_ahead)
    s_min = -least(-(window.s_high[rows] + CAR.rear + margin), there & by_lon & ~is_ahead)
    d_max = least(window.d_low[rows] - lat, there & ~by_lon & is_left)
    d_min = -least(-(window.d_high[rows] + lat), there & ~by_lon & ~is_left)
    return s_min, s_max, d_min, d_max


def _lead(seed: Seed, window: Occupancy, rows: Array, config: Config) -> Array:
    """(n,) arc length of the nearest centre ahead that counts for TR1, from the seed's place."""
    s, d, mu = (seed.states[:, c] for c in (Stage.S, Stage.D, Stage.MU))
    centre_s = s + CAR.rear_to_centre * np.cos(mu)
    centre_d = d + CAR.rear_to_centre * np.sin(mu)
    with np.errstate(invalid="ignore"):
        counts = np.abs(window.d[rows] - centre_d) < config.cost.distance_lateral
        counts &= window.s[rows] > centre_s
    return np.where(counts, window.s[rows], np.inf).min(axis=0, initial=np.inf)


def lateral_bounds(
    seed: Seed, corridor: Corridor, s: Array, mu: Array
) -> tuple[Array, Array]:
    """(n, 3) bounds of d at the body's points from road and obstacles, at the present s and mu."""
    road, limits = seed.road, seed.road.limits
    half = CAR.width / 2
    low, high = [], []
    for ahead in BODY_POINTS:
        at = s + ahead * np.cos(mu)
        left = np.interp(at, road.frame.s, limits.left) - half
        right = np.interp(at, road.frame.s, limits.right) + half
        low.append(np.maximum(right, corridor.d_min))
        high.append(np.minimum(left, corridor.d_max))
    return np.stack(low, axis=1), np.stack(high, axis=1)
