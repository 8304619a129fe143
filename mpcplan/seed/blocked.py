"""Where a path is blocked: (time step, sigma) grids of the obstacles for every candidate path.

blocked[p, k, n]: the body, with its rear axle at sample n of path p at time step k, comes within
the margins of an obstacle's predicted rectangle (in the Frenet frame; in the plane where the path
bends or the rectangle is turned).
lead[p, k, n]: distance from the body's centre to the nearest obstacle ahead that TR1 counts: its
centre lies within 2.8 m laterally and ahead (infinity where there is none).
"""

from dataclasses import dataclass, replace

import numpy as np

from mpcplan.config import CostConfig, SeedConfig
from mpcplan.predict.occupancy import Occupancy
from mpcplan.seed.crossing import last_crossing
from mpcplan.seed.paths import Paths
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

BENT = 0.02  # m, of swing: in bends bodies are compared in the plane
ALIGNED = 0.15  # |sin 2 turn| below which a rectangle's extents in s and d describe it well
PRESENT_GAP_SHARE = 0.1  # m, a gap that is short already may shrink by this much
LEAD_REACH = 100.0  # m, the evaluator's box around the vehicle


@dataclass(frozen=True, eq=False)
class Blocked:
    """Grids over (path, time step, sample of sigma); see the module.

    ``owner`` holds the row of the obstacle that blocks (-1: none), ``clear`` (p,) the arc lengths
    [m] at which each path has all crossings behind (-inf: none is ahead).
    """

    owner: Array
    lead: Array
    clear: Array


def block(occupancy: Occupancy, paths: Paths, config: SeedConfig, cost: CostConfig) -> Blocked:
    """Both grids for an occupancy whose columns are the time steps of the profiles."""
    lead = np.stack([_lead(occupancy, paths, path, cost) for path in range(len(paths.s))])
    first, s = occupancy.first_step, float(paths.s[0, 0])
    clear = np.full(len(paths.s), -np.inf)
    if cost.haste:
        ways = zip(paths.s, paths.d, strict=True)
        clear = np.array([last_crossing(occupancy, first, s, way) for way in ways])
    return Blocked(_owners(occupancy, paths, config), lead, clear)


def with_margins(
    blocked: Blocked, occupancy: Occupancy, paths: Paths, config: SeedConfig
) -> Blocked:
    """The same grids for other margins; distances to who is ahead do not depend on them."""
    return replace(blocked, owner=_owners(occupancy, paths, config))


def _owners(occupancy: Occupancy, paths: Paths, config: SeedConfig) -> Array:
    """(p, k, n) rows of the obstacles that block, -1 where nobody does."""
    p, n = paths.s.shape
    owner = np.full((p, occupancy.s.shape[1], n), -1, dtype=np.int32)
    rows, steps = _relevant(occupancy, paths)
    margins = _margins(occupancy, paths, config)
    for path in range(p):
        _mark(owner[path], occupancy, rows, steps, margins, paths, path, config)
    return owner


def _relevant(occupancy: Occupancy, paths: Paths) -> tuple[Array, Array]:
    """Rows and columns of the occupancy that come near any path."""
    low, high = paths.d.min() - CAR.length, paths.d.max() + CAR.length
    s_low, s_high = float(paths.s.min()) - CAR.length, float(paths.s.max()) + 2 * CAR.length
    with np.errstate(invalid="ignore"):
        near = (occupancy.d_low < high) & (occupancy.d_high > low)
        near &= (occupancy.s_low < s_high) & (occupancy.s_high > s_low)
    rows, steps = np.nonzero(near)
    return rows, steps


def _mark(
    owner: Array,
    occupancy: Occupancy,
    rows: Array,
    steps: Array,
    margins: Array,
    paths: Paths,
    path: int,
    config: SeedConfig,
) -> None:
    """Enters obstacles (rows at steps) into the grid (k, n) of one path."""
    s, d, mu, swing = paths.s[path], paths.d[path], paths.mu[path], paths.swing[path]
    front, rear = d + CAR.front * np.sin(mu), d - CAR.rear * np.sin(mu)
    half = CAR.width / 2 + config.margin_lat
    d_max = np.maximum(np.maximum(front, front - swing), rear) + half
    d_min = np.minimum(np.minimum(front, front - swing), rear) - half
    beside = occupancy.d_low[rows, steps] < d_max.max()
    beside &= occupancy.d_high[rows, steps] > d_min.min()
    rows, steps = rows[beside], steps[beside]
    lon = margins[rows]
    stretch = paths.stretch[path]  # the body covers more s on the inside of a bend
    low = occupancy.s_low[rows, steps] - CAR.front / stretch - lon
    high = occupancy.s_high[rows, steps] + CAR.rear / stretch + lon
    first, last = np.searchsorted(s, low), np.searchsorted(s, high)
    if not len(rows) or not (width := int((last - first).max())):
        return
    at = first[:, None] + np.arange(width)
    inside = at < np.minimum(last, len(s))[:, None]
    at = np.minimum(at, len(s) - 1)
    hit = inside & (d_max[at] > occupancy.d_low[rows, steps, None])
    hit &= d_min[at] < occupancy.d_high[rows, steps, None]
    pair, column = np.nonzero(hit)
    owner_of = rows[pair]
    # of turned rectangles, and in bends, the extents in s and d overlap long before the bodies do
    where = at[pair, column]
    turned = (np.abs(np.sin(2 * occupancy.turn[rows, steps])) > ALIGNED)[pair]
    turned = np.flatnonzero(turned | (np.abs(swing[where]) > BENT))
    at_turned = where[turned]
    pose = paths.x[path, at_turned], paths.y[path, at_turned], paths.psi[path, at_turned]
    free = ~_touch(
        pose, occupancy, rows[pair[turned]], steps[pair[turned]], lon[pair[turned]],
        config.margin_lat,
    )  # fmt: skip
    hit_by = np.ones(len(pair), bool)
    hit_by[turned[free]] = False
    pair, column = pair[hit_by], column[hit_by]
    owner[steps[pair], at[pair, column]] = owner_of[hit_by]


def _touch(
    pose: tuple[Array, Array, Array], occupancy: Occupancy, rows: Array, steps: Array,
    lon: Array, lat: float,
) -> Array:  # fmt: skip
    """Whether bodies with their rear axles at poses overlap rectangles: separating axes."""
    x, y, psi = pose
    turn = occupancy.psi[rows, steps]
    dx = occupancy.x[rows, steps] - x - CAR.rear_to_centre * np.cos(psi)
    dy = occupancy.y[rows, steps] - y - CAR.rear_to_centre * np.sin(psi)
    ego = (CAR.length / 2 + lon, CAR.width / 2 + lat)
    other = (occupancy.length[rows, steps] / 2, occupancy.width[rows, steps] / 2)
    return touching(dx, dy, (psi, turn), ego, other)


def touching(
    dx: Array, dy: Array, headings: tuple[Array, Array],
    ego: tuple[Array | float, Array | float], other: tuple[Array, Array],
) -> Array:  # fmt: skip
    """(n,) whether rectangles overlap, by separating axes.

    Args:
        dx, dy: from the centres of the first to those of the second [m].
        headings: of both [rad].
        ego: half length and half width of the first [m].
        other: of the second.
    """
    psi, turn = headings
    apart = np.zeros(len(psi), bool)
    for axis in (psi, psi + np.pi / 2, turn, turn + np.pi / 2):
        gap = np.abs(dx * np.cos(axis) + dy * np.sin(axis))
        reach = ego[0] * np.abs(np.cos(psi - axis)) + ego[1] * np.abs(np.sin(psi - axis))
        reach += other[0] * np.abs(np.cos(turn - axis)) + other[1] * np.abs(np.sin(turn - axis))
        apart |= gap > reach
    return ~apart


def _margins(occupancy: Occupancy, paths: Paths, config: SeedConfig) -> Array:
    """(o,) longitudinal margin [m]: the configured one, or what the present gap leaves of it."""
    s, d = paths.s[0, 0], paths.d[0, 0]
    with np.errstate(invalid="ignore"):
        gap = np.maximum(
            occupancy.s_low[:, 0] - s - CAR.front, s - CAR.rear - occupancy.s_high[:, 0]
        )
        beside = np.maximum(occupancy.d_low[:, 0] - d, d - occupancy.d_high[:, 0]) < CAR.width
    near = np.clip(gap - PRESENT_GAP_SHARE, 0.0, config.margin_lon)
    return np.where(np.isfinite(gap) & beside, near, config.margin_lon)


def _lead(occupancy: Occupancy, paths: Paths, path: int, cost: CostConfig) -> Array:
    """(k, n) distance [m] from the body's centre to the nearest counted obstacle ahead."""
    centre = paths.s[path] + CAR.rear_to_centre * np.cos(paths.mu[path])
    offset = paths.d[path] + CAR.rear_to_centre * np.sin(paths.mu[path])
    lead = np.full((occupancy.s.shape[1], len(centre)), np.inf)
    side = cost.distance_lateral
    with np.errstate(invalid="ignore"):
        near = (occupancy.d < offset.max() + side) & (occupancy.d > offset.min() - side)
        near &= (occupancy.s > centre[0]) & (occupancy.s < centre[-1] + LEAD_REACH)
    for row in np.flatnonzero(near.any(axis=1)):
        steps = np.flatnonzero(near[row])
        gap = occupancy.s[row, steps, None] - centre
        counts = (gap > 0) & (gap < LEAD_REACH)
        counts &= np.abs(occupancy.d[row, steps, None] - offset) < side
        lead[steps] = np.minimum(lead[steps], np.where(counts, gap, np.inf))
    return lead
