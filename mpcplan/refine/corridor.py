"""The corridor of a seed: bounds on s and d that fix which side of every obstacle it passes.

For every time step and obstacle the seed tells on which axis the two are apart: behind or ahead
(then s is bounded) or beside (then d is). The refinement may move freely inside these bounds, so
it keeps the seed's homotopy. The evaluated cost's leader is fixed in the same way.
"""

from dataclasses import dataclass, fields, replace

import numpy as np

from mpcplan.config import Config
from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.strips import TURN_MAX
from mpcplan.rules.predicates import safe_distance
from mpcplan.seed.crossing import last_crossing
from mpcplan.seed.rules import planned_reaction
from mpcplan.seed.seed import Seed, Stage
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

LON_SCALE = 4.0  # m, a longitudinal gap of this weighs as much as
LAT_SCALE = 1.0  # m, a lateral one of this when the axis is chosen
SPARE = 0.03  # m, kept on top of verification's margin, or left of the seed's own gap
YIELDED = 1.0  # m, that the refinement may fall behind a seed which is in haste
IN_LANE = 2.0  # m, aside: who is ahead within this is in the same lane
FAR = 1e3  # m, no bound


@dataclass(frozen=True, eq=False)
class Corridor:
    """Bounds for the rear axle's s and the body's d at steps k = 0..N.

    Attributes:
        s_min, s_max: (N + 1,) bounds of s [m].
        d_min, d_max: (N + 1,) bounds from obstacles beside, for every point of the body's axis [m].
        lead: (N + 1,) arc length of the centre of the obstacle that TR1 counts as ahead, else inf.
        slant: (N + 1, 3) columns (n_s, n_d, bound): n_s s_c + n_d d_c <= bound for the body's
            centre, against the obstacle that only its own axes part from the body, else
            (0, 0, FAR).
    """

    s_min: Array
    s_max: Array
    d_min: Array
    d_max: Array
    lead: Array
    slant: Array

    def steps(self, first: int, end: int) -> "Corridor":
        """The part over steps first..end - 1."""
        return Corridor(*(getattr(self, f.name)[first:end] for f in fields(self)))


def build_corridor(
    seed: Seed, occupancy: Occupancy, config: Config, aside: float | None = None
) -> Corridor:
    """The corridor of a seed among predicted obstacles.

    Who is ahead is counted ``aside`` metres further to the side than TR1 does, for the refinement
    may still move sideways; None: as much as is configured first.
    """
    n = len(seed.states)
    window = occupancy.window(seed.first_step, n)
    near = np.flatnonzero(np.isfinite(window.s).any(axis=1))
    s, d, mu = (seed.states[:, c] for c in (Stage.S, Stage.D, Stage.MU))
    ahead, behind, left, right = _gaps(s, d, mu, window, near)
    lon, lat = np.fmax(ahead, behind), np.fmax(left, right)
    by_lon = lon / LON_SCALE >= lat / LAT_SCALE
    slant, by_slant = _slants(s, d, mu, window, near, np.fmax(lon, lat), config)
    least = config.verify.margin + SPARE
    lon_margin = np.clip(lon - SPARE, least, _wanted(seed, window, near, ahead, config))
    lat_margin = np.clip(lat - SPARE, least, config.seed.pass_gap)
    chosen = ~by_slant & np.isfinite(window.s_low[near])
    half = CAR.width / 2

    def nearest(values: Array, these: Array) -> Array:
        return np.where(these, values, FAR).min(axis=0, initial=FAR)

    in_front, to_left = ahead >= behind, left >= right
    s_max = nearest(window.s_low[near] - CAR.front - lon_margin, chosen & by_lon & in_front)
    s_min = -nearest(-(window.s_high[near] + CAR.rear + lon_margin), chosen & by_lon & ~in_front)
    d_max = nearest(window.d_low[near] - half - lat_margin, chosen & ~by_lon & to_left)
    d_min = -nearest(-(window.d_high[near] + half + lat_margin), chosen & ~by_lon & ~to_left)
    s_max = np.minimum(s_max, seed.road.limits.end - CAR.front)
    if config.cost.haste:  # when to pass a crossing is the seed's decision
        clear = last_crossing(occupancy, seed.first_step, float(s[0]), (s, d))
        timed = np.where(s < clear, np.minimum(s, s_max) - YIELDED, -FAR)
        s_min = np.maximum(s_min, timed)
    lead = _lead(seed, window, near, config, config.refine.asides[0] if aside is None else aside)
    return Corridor(s_min, s_max, d_min, d_max, lead, slant)


def _wanted(seed: Seed, window: Occupancy, rows: Array, ahead: Array, config: Config) -> Array:
    """(m, n) gaps [m] to keep ahead and behind where the seed has as much: the seeds' margin, and
    where rules cost something the safe distance (R_G1) to who drives ahead in the same lane."""
    wanted = np.full(ahead.shape, config.seed.margin_lon)
    if not config.cost.safe_distance:
        return wanted
    v, v_o = seed.states[:, Stage.V], np.maximum(np.nan_to_num(window.v[rows]), 0.0)
    braking = config.rules.braking_ego, config.rules.braking_others
    safe = safe_distance(v, v_o, *braking, planned_reaction(config))
    with np.errstate(invalid="ignore"):
        leads = (ahead > 0) & (np.cos(window.turn[rows]) > np.cos(TURN_MAX))
        leads &= np.abs(window.d[rows] - seed.states[:, Stage.D]) < IN_LANE
    return np.where(leads, np.maximum(wanted, safe + SPARE), wanted)


def different_asides(seed: Seed, occupancy: Occupancy, config: Config) -> list[float]:
    """Of the configured distances aside those that count others as ahead than the ones before."""
    window = occupancy.window(seed.first_step, len(seed.states))
    near = np.flatnonzero(np.isfinite(window.s).any(axis=1))
    found: list[tuple[float, Array]] = []
    for aside in config.refine.asides:
        lead = _lead(seed, window, near, config, aside)
        if not any(np.array_equal(lead, other) for _, other in found):
            found.append((aside, lead))
    return [aside for aside, _ in found]


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


def _slants(
    s: Array, d: Array, mu: Array, window: Occupancy, rows: Array, gap: Array, config: Config
) -> tuple[Array, Array]:
    """Half-planes along the obstacles' own axes where neither s nor d parts them from the body.

    Returns the tightest per step, (n, 3), and (m, n) which obstacles they serve.
    """
    s_c, d_c = s + CAR.rear_to_centre * np.cos(mu), d + CAR.rear_to_centre * np.sin(mu)
    with np.errstate(invalid="ignore"):
        tight = np.isfinite(gap) & (gap < config.verify.margin + SPARE)
    slant = np.tile([0.0, 0.0, FAR], (len(s), 1))
    serves = np.zeros(gap.shape, bool)
    for m, k in zip(*np.nonzero(tight), strict=True):
        row, turn = rows[m], window.turn[rows[m], k]
        best = None
        for axis, extent in (
            (turn, window.length[row, k]),
            (turn + np.pi / 2, window.width[row, k]),
        ):
            ds, dd = window.s[row, k] - s_c[k], window.d[row, k] - d_c[k]
            side = 1.0 if ds * np.cos(axis) + dd * np.sin(axis) >= 0 else -1.0
            n_s, n_d = side * np.cos(axis), side * np.sin(axis)
            reach = extent / 2 + CAR.length / 2 * abs(np.cos(mu[k] - axis))
            reach += CAR.width / 2 * abs(np.sin(mu[k] - axis))
            space = n_s * ds + n_d * dd - reach
            if best is None or space > best[0]:
                at = n_s * window.s[row, k] + n_d * window.d[row, k] - reach
                best = (space, n_s, n_d, at)
        assert best is not None
        if best[0] > gap[m, k]:
            serves[m, k] = True
            if best[0] < _slack(slant[k], s_c[k], d_c[k]):
                margin = np.clip(best[0] - SPARE, config.verify.margin, config.seed.margin_lat)
                slant[k] = best[1], best[2], best[3] - margin
    return slant, serves


def _slack(slant: Array, s_c: float, d_c: float) -> float:
    """Room that a half-plane leaves to a centre [m]."""
    return float(slant[2] - slant[0] * s_c - slant[1] * d_c)


def _lead(seed: Seed, window: Occupancy, rows: Array, config: Config, aside: float) -> Array:
    """(n,) arc length of the nearest centre ahead that counts for TR1, from the seed's place."""
    s, d, mu = (seed.states[:, c] for c in (Stage.S, Stage.D, Stage.MU))
    centre_s = s + CAR.rear_to_centre * np.cos(mu)
    centre_d = d + CAR.rear_to_centre * np.sin(mu)
    with np.errstate(invalid="ignore"):
        counts = np.abs(window.d[rows] - centre_d) < config.cost.distance_lateral + aside
        counts &= window.s[rows] > centre_s
    return np.where(counts, window.s[rows], np.inf).min(axis=0, initial=np.inf)


def narrowed(corridor: Corridor, extra: float) -> Corridor:
    """The corridor with every obstacle's bound moved inwards by ``extra`` metres."""
    slant = corridor.slant.copy()
    slant[:, 2] -= extra
    return replace(
        corridor,
        s_min=corridor.s_min + extra, s_max=corridor.s_max - extra,
        d_min=corridor.d_min + extra, d_max=corridor.d_max - extra, slant=slant,
    )  # fmt: skip
