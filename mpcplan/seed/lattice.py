"""The sampled lattice: every path with every speed profile, judged at once as arrays.

Candidates (p, i) over time steps k = 0..K are looked up in tables over the path's arc length:
curvature and steering, drivable area, obstacles. Each constraint refuses candidates with counts and
the smallest violation; the cost is TR1 up to the first step at which a goal window is met,

    dt sum_k 0.01 j_k^2 + 22 (delta'(sigma) v)_k^2 + 8 exp(-0.2 gap_k) + w_LC d_k^2,

plus a penalty where no goal is met. All arrays, no loop over candidates.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mpcplan.config import Config
from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.road import Road
from mpcplan.seed.blocked import Blocked, block
from mpcplan.seed.goal_fit import miss_distance, pose_fits, speed_fits
from mpcplan.seed.paths import FrenetPose, Paths, frenet_pose, sample_paths
from mpcplan.seed.profiles import Arrival, Motion, Profiles, sample_profiles
from mpcplan.seed.seed import Rejection, Seed, SeedReport, Stage
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import acceleration_limit

TOLERANCE = 1e-6
STEERING_SHARE = 0.95  # of the steering rate that seeds may use
ACCELERATION_SHARE = 0.97  # of the acceleration that seeds may use
TRIED_PER_FINALIST = 15  # best candidates looked at for each finalist
DENSE_STEPS = 50  # horizons up to this many steps are looked at at every step
DISTINCT = 4.0  # m, finalists differ by this much somewhere
SPEEDING = 0.5  # 1/(m^2/s^3), weight of the squared excess over the speed limit
LEADER_TIMES = (2.0, 4.0)  # s, at which leaders are followed


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


@dataclass(frozen=True, eq=False)
class Lattice:
    """The best candidates (best first), the report of the others, and the tables behind them."""

    seeds: list[Seed]
    report: SeedReport
    paths: Paths
    window: Occupancy
    blocked: Blocked
    pose: FrenetPose
    motion: Motion


def lattice(
    road: Road,
    state: Array,
    acceleration: float,
    step: int,
    occupancy: Occupancy,
    config: Config,
    dt: float,
) -> Lattice:
    """The best candidates of the lattice, best first, and the report of the others.

    Args:
        road: the road.
        state: (5,) rear-axle state.
        acceleration: acceleration of the step before [m/s^2].
        step: present time step.
        occupancy: obstacles along the road.
        config: the whole configuration.
        dt: time step [s].
    """  # fmt: skip
    count = max(road.last_step - step, 1)
    t = dt * np.arange(count + 1)
    pose = frenet_pose(road, state)
    motion = Motion(max(float(state[State.V]), 0.0), acceleration)
    window = occupancy.window(step, count + 1)
    reach = _reach(road, pose, motion, t[-1])
    paths = sample_paths(road, pose, reach, window, config.seed)
    profiles = _profiles(road, pose, motion, paths, window, t, step, config)
    broken = _profile_violations(profiles)
    fit = np.flatnonzero(np.all([v <= TOLERANCE for v, _ in broken.values()], axis=0))
    profiles = Profiles(profiles.sigma[fit], profiles.v[fit], profiles.a[fit])
    blocked = block(window, paths, config.seed, config.cost)
    table = _table(road, paths, profiles, step, dt)
    violations = _violations(paths, profiles, blocked, table, config)
    cost = _cost(road, paths, profiles, blocked, table, dt, config)
    slack = _slacks(config)
    accepted = np.all(
        [v <= slack.get(n, 0.0) + TOLERANCE for n, (v, _) in violations.items()], axis=0
    )
    for name in slack:
        cost = cost + config.seed.slack_cost * np.maximum(violations[name][0], 0.0)
    report = _report(broken, violations, accepted, table, blocked, window, step)
    seeds = _finalists(road, paths, profiles, table, cost, accepted, step, config)
    return Lattice(seeds, report, paths, window, blocked, pose, motion)


def _slacks(config: Config) -> dict[str, float]:
    """Excess by constraint that seeds may have, since the refinement repairs it."""
    if not config.refine.enabled:
        return {}
    return {"road": config.seed.road_slack, "steering rate": config.seed.steering_slack}


def _reach(road: Road, pose: FrenetPose, motion: Motion, duration: float) -> float:
    """Length of path that candidates can use [m]."""
    top = motion.v + ACCELERATION_SHARE * 8.0
    return float(np.clip(top * duration, 20.0, max(road.frame.length - pose.s - CAR.front, 20.0)))


def _profiles(
    road: Road, pose: FrenetPose, motion: Motion, paths: Paths, window: Occupancy, t: Array,
    step: int, config: Config,
) -> Profiles:  # fmt: skip
    """Speed profiles towards the road's goals and behind its leaders."""
    dt = float(t[1] - t[0])
    along = paths.s[0]  # the plain lane keeping: sigma and s nearly agree on it
    arrivals = []
    for goal in road.goals:
        if goal.s is None or goal.last <= step:
            continue
        low, high = np.interp(
            np.array(goal.s) - CAR.rear_to_centre, along, paths.spacing * np.arange(len(along))
        )
        v = goal.v or (0.0, config.road.speed_max)
        for at in sorted({max(goal.first, step + 1), goal.last}):
            if at == goal.last or goal.last - at > 5:
                arrivals.append(Arrival((at - step) * dt, (float(low), float(high)), v))
    leaders = _leaders(window, paths, t)
    limit = max(float(road.limits.speed[np.searchsorted(road.frame.s, pose.s) :][:200].max()), 3.0)
    profiles = sample_profiles(motion, arrivals, leaders, t, limit, config.seed)
    speeds = np.where(np.abs(profiles.v) < 1e-9, 0.0, profiles.v)
    return Profiles(np.maximum(profiles.sigma, 0.0), speeds, profiles.a)


def _leaders(window: Occupancy, paths: Paths, t: Array) -> Array:
    """(m, 3) time, sigma of the rear axle that touches the leader, and the leader's speed."""
    rows = []
    s, d = paths.s[0], paths.d[0]
    for time in LEADER_TIMES:
        k = int(np.argmin(np.abs(t - time)))
        with np.errstate(invalid="ignore"):
            offset = np.abs(window.d[:, k] - np.interp(np.nan_to_num(window.s[:, k]), s, d))
            ahead = (window.s[:, k] > s[0]) & (window.s[:, k] < s[-1]) & (offset < CAR.width)
        if k and ahead.any():
            row = np.flatnonzero(ahead)[np.argmin(window.s[ahead, k])]
            touch = np.interp(
                window.s_low[row, k] - CAR.front, s, paths.spacing * np.arange(len(s))
            )
            rows.append((t[k], touch, max(window.v[row, k], 0.0)))
    return np.array(rows).reshape(-1, 3)


def _table(road: Road, paths: Paths, profiles: Profiles, step: int, dt: float) -> Table:
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


def _profile_violations(profiles: Profiles) -> dict[str, tuple[Array, str]]:
    """(i,) violations that do not depend on the path."""
    top = ACCELERATION_SHARE * acceleration_limit(profiles.v)
    return {
        "reversing": ((-profiles.v).max(axis=1) - 0.01, "m/s"),
        "acceleration": ((profiles.a - top).max(axis=1), "m/s^2"),
        "braking": ((-profiles.a).max(axis=1) - ACCELERATION_SHARE * CAR.a_max, "m/s^2"),
    }


def _violations(
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


def _cost(
    road: Road, paths: Paths, profiles: Profiles, blocked: Blocked, table: Table, dt: float,
    config: Config,
) -> Array:  # fmt: skip
    """(p, i) estimate of TR1 with the penalties for a missed goal and for speeding."""
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
    rate = rate + cost.distance * closeness + SPEEDING * speeding
    rate = rate + cost.lane * (offset**2)[:, index]
    total = np.where(table.alive, rate, 0.0) @ table.dt
    total = total + jerked[np.arange(len(v)), table.k_end]
    return total + np.where(table.reached, 0.0, _missed(road, paths, profiles, table, config))


def _missed(road: Road, paths: Paths, profiles: Profiles, table: Table, config: Config) -> Array:
    """(p, i) penalty by how far the last state is from the nearest goal window."""
    end = table.index[:, -1]
    centre_s = (paths.s + CAR.rear_to_centre)[:, end]
    best = miss_distance(road, centre_s, paths.d[:, end], profiles.v[None, :, -1])
    return config.seed.goal_missed + config.seed.goal_distance * best


def _report(
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


def _finalists(
    road: Road, paths: Paths, profiles: Profiles, table: Table, cost: Array, accepted: Array,
    step: int, config: Config,
) -> list[Seed]:  # fmt: skip
    """The best accepted candidates that differ from each other."""
    order = np.argsort(np.where(accepted, cost, np.inf), axis=None, kind="stable")
    seeds: list[Seed] = []
    for flat in order[: TRIED_PER_FINALIST * config.seed.finalists]:
        p, i = (int(v) for v in np.unravel_index(flat, cost.shape))
        if not accepted[p, i] or len(seeds) == config.seed.finalists:
            break
        seed = _seed(road, paths, profiles, table, p, i, float(cost[p, i]), step)
        if all(differ(seed.states, other.states) for other in seeds):
            seeds.append(seed)
    return seeds


def differ(a: Array, b: Array) -> bool:
    """Whether two Frenet trajectories are metres apart somewhere."""
    n = min(len(a), len(b))
    gap = np.abs(a[:n, [Stage.S, Stage.D]] - b[:n, [Stage.S, Stage.D]])
    return bool(gap[:, 0].max() > DISTINCT or gap[:, 1].max() > CAR.width / 2)


def _seed(
    road: Road, paths: Paths, profiles: Profiles, table: Table, p: int, i: int, cost: float,
    step: int,
) -> Seed:  # fmt: skip
    """Candidate (p, i) as a Frenet trajectory up to its goal or the last time step."""
    end = int(table.ks[table.k_end[p, i]])
    sigma = profiles.sigma[i, : end + 1]
    grid = paths.spacing * np.arange(paths.s.shape[1])
    columns = [np.interp(sigma, grid, values[p]) for values in (paths.s, paths.d, paths.mu)]
    v, a = profiles.v[i, : end + 1], profiles.a[i, : end + 1]
    delta = np.interp(sigma, grid, paths.delta[p])
    states = np.column_stack([*columns, np.maximum(v, 0.0), delta, a])
    label = f"to d = {paths.target[p]:.2f} m, {v[-1]:.1f} m/s at the end"
    return Seed(road, step, states, cost, bool(table.reached[p, i]), "lattice", label)
