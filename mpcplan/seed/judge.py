"""Judges all candidates of the lattice at once: when they arrive, what refuses them, their cost.

Arrays run over (path p, profile i, looked-at time step m); see :mod:`mpcplan.seed.lattice`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mpcplan.config import Config
from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.road import Road
from mpcplan.seed.blocked import Blocked
from mpcplan.seed.goal_fit import miss_distance, pose_fits, speed_fits
from mpcplan.seed.paths import Paths
from mpcplan.seed.profiles import Profiles
from mpcplan.seed.seed import Rejection, SeedReport
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import acceleration_limit

TOLERANCE = 1e-6
STEERING_SHARE = 0.95  # of the steering rate that seeds may use
ACCELERATION_SHARE = 0.97  # of the acceleration that seeds may use
DENSE_STEPS = 50  # horizons up to this many steps are looked at at every step


@dataclass(frozen=True, eq=False)
class Table:
    """When candidates (path p, profile i) are looked at, and how far they go.

    Attributes:
        ks: (m,) time steps from now; dt: (m,) time since the one before [s].
        index: (i, m) samples of the path; k_end: (p, i) last index into ks; reached: (p, i) whether
            a goal is met there; alive: (p, i, m) whether a time step counts.
    """

    ks: Array
    dt: Array
    index: Array
    k_end: Array
    reached: Array
    alive: Array


def make_table(road: Road, paths: Paths, profiles: Profiles, step: int, dt: float) -> Table:
    """Indices into the path tables, and when each candidate first meets a goal."""
    n, last = paths.s.shape[1], profiles.sigma.shape[1] - 1
    ks = _looked_at(road, last, step)
    index = np.clip(np.rint(profiles.sigma[:, ks] / paths.spacing).astype(np.int32), 0, n - 1)
    reached = np.zeros((len(paths.s), *index.shape), bool)
    for goal in road.goals:
        in_time = (ks + step >= goal.first) & (ks + step <= goal.last)
        in_time = in_time & speed_fits(goal, profiles.v[:, ks])
        reached |= in_time[None] & pose_fits(goal, road, paths)[:, index]
    hit: Array = np.any(reached, axis=2)
    k_end = np.where(hit, reached.argmax(axis=2), len(ks) - 1)
    alive = np.arange(len(ks)) <= k_end[:, :, None]
    return Table(ks, np.diff(ks, prepend=0) * dt, index, k_end, hit, alive)


def _looked_at(road: Road, last: int, step: int) -> Array:
    """Time steps at which candidates are looked at: all of a short horizon, every other of a long
    one (a body is longer than the way between two of them), and all in the goal windows."""
    if last <= DENSE_STEPS:
        return np.arange(last + 1)
    wanted = {0, last, *range(last, 0, -2)}
    for goal in road.goals:
        if goal.last - goal.first <= 2 * DENSE_STEPS:
            wanted |= {k - step for k in (goal.first, goal.last) if 0 < k - step <= last}
    return np.array(sorted(wanted))


def profile_violations(profiles: Profiles) -> dict[str, tuple[Array, str]]:
    """(i,) violations that do not depend on the path."""
    top = ACCELERATION_SHARE * acceleration_limit(profiles.v)
    return {
        "reversing": ((-profiles.v).max(axis=1) - 0.01, "m/s"),
        "acceleration": ((profiles.a - top).max(axis=1), "m/s^2"),
        "braking": ((-profiles.a).max(axis=1) - ACCELERATION_SHARE * CAR.a_max, "m/s^2"),
    }


def violations_of(
    paths: Paths, profiles: Profiles, blocked: Blocked, table: Table, config: Config
) -> dict[str, tuple[Array, str]]:
    """(p, i) violation of every constraint (at most 0: kept) with its unit."""
    v, a, index, alive = profiles.v[:, table.ks], profiles.a[:, table.ks], table.index, table.alive
    end = np.take_along_axis(np.broadcast_to(index, alive.shape), table.k_end[..., None], 2)[..., 0]
    path = np.arange(len(paths.s))[:, None]
    lateral = v**2 * np.abs(paths.kappa)[:, index]
    steering = np.abs(paths.delta_slope)[:, index] * v
    delta_worst = np.maximum.accumulate(np.abs(paths.delta), axis=1)

    def over_time(values: Array) -> Array:
        return np.where(alive, values, -np.inf).max(axis=2, initial=-np.inf)

    hit = (blocked.owner[path[..., None], table.ks, index] >= 0) & alive
    return {
        "friction circle": (over_time(np.hypot(a, lateral) - CAR.a_max), "m/s^2"),
        "lateral acceleration": (over_time(lateral - _lateral_limit(paths, v, config)), "m/s^2"),
        "steering rate": (over_time(steering - STEERING_SHARE * CAR.v_delta_max), "rad/s"),
        "steering angle": (delta_worst[path, end] - CAR.delta_max, "rad"),
        "road": (_new_excess(paths)[path, end], "m"),
        "collision": (hit[..., 1:] @ table.dt[1:], "s"),
    }


def _lateral_limit(paths: Paths, v: Array, config: Config) -> float:
    """The configured lateral acceleration, or what the present state has where that is more."""
    present = float(v[:1, 0].max(initial=0.0) ** 2 * np.abs(paths.kappa[:, 0]).max())
    return max(config.road.lateral_acceleration, min(present, 0.95 * CAR.a_max))


def _new_excess(paths: Paths) -> Array:
    """Excess over the drivable area beyond what the present pose has already [m]."""
    return paths.road_excess - paths.road_excess[:, :1] - 1e-3 * (paths.road_excess[:, :1] > 0)


def candidate_cost(
    road: Road, paths: Paths, profiles: Profiles, blocked: Blocked, table: Table, step: int,
    dt: float, config: Config,
) -> Array:  # fmt: skip
    """(p, i) estimate of TR1 with the penalties for a missed goal, for speeding and lateness."""
    cost, index, path = config.cost, table.index, np.arange(len(paths.s))[:, None, None]
    v = profiles.v[:, table.ks]
    jerk = np.diff(profiles.a, axis=1, prepend=profiles.a[:, :1]) / dt
    jerked = cost.jerk * dt * np.cumsum(jerk**2, axis=1)[:, table.ks]
    lead = blocked.lead[path, table.ks, index]
    closeness = np.exp(-cost.distance_decay * (lead - cost.distance_offset))
    centre = paths.d + CAR.rear_to_centre * np.sin(paths.mu)
    offset = road.limits.lane_offset(road.frame, paths.s, centre)
    limit = np.interp(paths.s, road.frame.s, road.limits.posted)[:, index]
    speeding = np.maximum(v - np.maximum(limit, 0.1), 0.0) ** 2
    rate = cost.steering_rate * (paths.delta_slope**2)[:, index] * v**2
    rate = rate + cost.distance * closeness + config.refine.speeding * speeding
    rate = rate + cost.lane * (offset**2)[:, index]
    due = road.due(step, profiles.v.shape[1] - 1, cost.reserve)[table.ks]
    if np.isfinite(due).any():
        rate = rate + cost.late * np.maximum(due - paths.s[:, index], 0.0) ** 2
    rate = rate + cost.haste * (paths.s[:, index] < blocked.clear[:, None, None])
    total = np.where(table.alive, rate, 0.0) @ table.dt
    total = total + jerked[np.arange(len(v)), table.k_end]
    return total + np.where(table.reached, 0.0, _missed(road, paths, profiles, table, config))


def _missed(road: Road, paths: Paths, profiles: Profiles, table: Table, config: Config) -> Array:
    """(p, i) penalty by how far the last state is from the nearest goal window."""
    end = table.index[:, -1]
    centre_s = (paths.s + CAR.rear_to_centre)[:, end]
    best = miss_distance(road, centre_s, paths.d[:, end], profiles.v[None, :, -1])
    return config.seed.goal_missed + config.seed.goal_distance * best


def report_of(
    broken: dict[str, tuple[Array, str]], violations: dict[str, tuple[Array, str]], accepted: Array,
    table: Table, blocked: Blocked, window: Occupancy, step: int,
) -> SeedReport:  # fmt: skip
    """Counts per constraint (a candidate counts at each that it breaks)."""
    paths, rejected = len(accepted), {}
    for name, (violation, unit) in [*broken.items(), *violations.items()]:
        bad = violation > TOLERANCE
        if not bad.any():
            continue
        count = int(bad.sum()) * (paths if name in broken else 1)
        obstacle = at = None
        if name == "collision":
            where = np.unravel_index(np.argmin(np.where(bad, violation, np.inf)), bad.shape)
            obstacle, at = _first_hit([int(value) for value in where], table, blocked, window, step)
        smallest = round(float(violation[bad].min()), 4)
        rejected[name] = Rejection(count, smallest, unit, obstacle, at)
    candidates = paths * len(next(iter(broken.values()))[0])
    passing = int((accepted & table.reached).sum())
    return SeedReport("lattice", candidates, int(accepted.sum()), passing, rejected)


def _first_hit(
    where: Sequence[int], table: Table, blocked: Blocked, window: Occupancy, step: int
) -> tuple[int | None, int | None]:
    """Obstacle and time step of a candidate's first collision."""
    p, i = where
    owner = np.where(table.alive[p, i], blocked.owner[p, table.ks, table.index[i]], -1)
    hits = np.flatnonzero(owner[1:] >= 0) + 1
    if not len(hits):
        return None, None
    return window.ids[owner[hits[0]]], int(step + table.ks[hits[0]])
