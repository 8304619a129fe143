"""The sampled lattice: every path with every speed profile, judged at once as arrays.

Candidates (p, i) over time steps k = 0..K are looked up in tables over the path's arc length:
curvature and steering, drivable area, obstacles. Each constraint refuses candidates with counts and
the smallest violation; the cost is TR1 up to the first step at which a goal window is met,

    dt sum_k 0.01 j_k^2 + 22 (delta'(sigma) v)_k^2 + 8 exp(-0.2 gap_k) + w_LC d_k^2,

plus a penalty where no goal is met, and what broken rules cost (:mod:`mpcplan.seed.rules`).
All arrays, no loop over candidates.
"""

from dataclasses import dataclass

import numpy as np

from mpcplan.config import Config
from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.road import Road
from mpcplan.seed.blocked import Blocked, block
from mpcplan.seed.judge import (
    ACCELERATION_SHARE,
    TOLERANCE,
    Table,
    candidate_cost,
    make_table,
    profile_violations,
    report_of,
    violations_of,
)
from mpcplan.seed.paths import FrenetPose, Paths, frenet_pose, sample_paths
from mpcplan.seed.profiles import Arrival, Motion, Profiles, sample_profiles
from mpcplan.seed.rules import candidates_cost
from mpcplan.seed.seed import Seed, SeedReport, Stage
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import FORD_ESCORT as CAR

TRIED_PER_FINALIST = 15  # best candidates looked at for each finalist
DISTINCT = 4.0  # m, finalists differ by this much somewhere
LEADER_TIMES = (2.0, 4.0)  # s, at which leaders are followed


@dataclass(frozen=True, eq=False)
class Judged:
    """All candidates (path p, profile i), and what was said of them.

    Attributes:
        paths, profiles: of which they are made; profiles that no path can be driven with are left
            out.
        table: when they are looked at, and how far they go.
        violations: (p, i) of every constraint with its unit, at most 0 where it is kept.
        accepted: (p, i) who keeps all of them.
        cost: (p, i) of TR1 with penalties.
        report: in numbers, with the profiles that are left out.
        window: the others from now on.
        blocked: where they are in the way.
        pose, motion: the present ones.
    """

    paths: Paths
    profiles: Profiles
    table: Table
    violations: dict[str, tuple[Array, str]]
    accepted: Array
    cost: Array
    report: SeedReport
    window: Occupancy
    blocked: Blocked
    pose: FrenetPose
    motion: Motion


@dataclass(frozen=True, eq=False)
class Lattice(Judged):
    """All candidates, judged, and the best of them as seeds (best first)."""

    seeds: list[Seed]


def lattice(
    road: Road, state: Array, acceleration: float, step: int, occupancy: Occupancy,
    config: Config, dt: float,
) -> Lattice:  # fmt: skip
    """The best candidates of the lattice, best first, and the report of the others; see
    :func:`judge_all`."""
    found = judge_all(road, state, acceleration, step, occupancy, config, dt)
    seeds = _finalists(
        road, found.paths, found.profiles, found.table, found.cost, found.accepted, step, config
    )
    return Lattice(**vars(found), seeds=seeds)


def judge_all(
    road: Road, state: Array, acceleration: float, step: int, occupancy: Occupancy,
    config: Config, dt: float,
) -> Judged:  # fmt: skip
    """All candidates of the lattice, judged.

    Args:
        road: the road.
        state: (5,) rear-axle state.
        acceleration: acceleration of the step before [m/s^2].
        step: present time step.
        occupancy: obstacles along the road.
        config: the whole configuration.
        dt: time step [s].
    """
    count = max(road.last_step - step, 1)
    t = dt * np.arange(count + 1)
    pose = frenet_pose(road, state)
    motion = Motion(max(float(state[State.V]), 0.0), acceleration)
    window = occupancy.window(step, count + 1)
    reach = reach_of(road, pose, motion, t[-1])
    paths = sample_paths(road, pose, reach, window, config.seed)
    profiles = _profiles(road, pose, motion, paths, window, t, step, config)
    broken = profile_violations(profiles)
    fit = np.flatnonzero(np.all([v <= TOLERANCE for v, _ in broken.values()], axis=0))
    profiles = Profiles(profiles.sigma[fit], profiles.v[fit], profiles.a[fit])
    blocked = block(window, paths, config.seed, config.cost)
    table = make_table(road, paths, profiles, step, dt)
    violations = violations_of(paths, profiles, blocked, table, config)
    cost = candidate_cost(road, paths, profiles, blocked, table, step, dt, config)
    slack = _slacks(config)
    accepted = np.all(
        [v <= slack.get(n, 0.0) + TOLERANCE for n, (v, _) in violations.items()], axis=0
    )
    cost = cost + candidates_cost(road, paths, profiles, table, accepted, window, config, dt)
    for name in slack:
        cost = cost + config.seed.slack_cost * np.maximum(violations[name][0], 0.0)
    report = report_of(broken, violations, accepted, table, blocked, window, step)
    return Judged(
        paths, profiles, table, violations, accepted, cost, report, window, blocked, pose, motion
    )


def _slacks(config: Config) -> dict[str, float]:
    """Excess by constraint that seeds may have, since the refinement repairs it."""
    if not config.refine.enabled:
        return {}
    return {"road": config.seed.road_slack, "steering rate": config.seed.steering_slack}


def reach_of(road: Road, pose: FrenetPose, motion: Motion, duration: float) -> float:
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
