"""Speed search: the best sequence of accelerations along one path, to the goal.

State (sigma, v) along a fixed path, actions a from a small set held for m time steps; minimise

    sum dt (w_D exp(-0.2 gap) + w_SR (delta' v)^2 + w_LC d^2 + w_T late^2)
        + w_J (a - a_before)^2 / (m dt)

subject to v >= 0, the actuator limits and the blocked (time step, sigma) cells. Solved forward by
dynamic programming over labels: of all labels that share a cell of (sigma, v) the cheapest stays,
at most a given number per layer. It finds gaps (before one vehicle, behind the next) that a grid
of polynomials misses. Source: hybrid A* (Dolgov et al. 2010) with time as the only order.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from enum import IntEnum
from itertools import pairwise

import numpy as np

from mpcplan.config import Config
from mpcplan.road.road import Road
from mpcplan.seed.blocked import Blocked
from mpcplan.seed.goal_fit import miss_distance, pose_fits, speed_fits
from mpcplan.seed.paths import Paths
from mpcplan.seed.seed import Seed
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import acceleration_limit

CELL_SIGMA = 0.75  # m, labels this close
CELL_V = 0.5  # m/s, and this close in speed share a cell
LONG_STEPS = 50  # horizons beyond this have cells
LONG_CELLS = 1.5  # times as large
ACTUATOR_SHARE = 0.95  # of the limits that the search uses
AHEAD_CELLS = 10_000_000  # more than there are cells of (sigma, v)
LEAST_LIMIT = 0.1  # m/s, of a speed limit
ROLLING = 1e-6  # m/s, slower is standing


@dataclass(frozen=True, eq=False)
class Labels:
    """Labels of one layer, all (n,): sigma [m], v [m/s], last a [m/s^2], cost, parent's index, and
    as bits which obstacles they are ahead of (see :class:`Tables`)."""

    sigma: Array
    v: Array
    a: Array
    cost: Array
    parent: Array
    ahead: Array

    def pick(self, index: Array) -> "Labels":
        """The labels at an index."""
        return Labels(*(getattr(self, f.name)[index] for f in fields(self)))


class Along(IntEnum):
    """Rows of what does not change with time along a path, see :attr:`Tables.along`."""

    STEERING = 0  # cost rate of the steering by v^2
    SWIFT = 1  # |delta'| [rad/m]
    KAPPA = 2  # |curvature| [1/m]
    SPEED = 3  # posted and curve limit [m/s]


@dataclass(frozen=True, eq=False)
class Tables:
    """Lookups over the samples of one path (n,) and the time steps (k)."""

    spacing: float
    blocked: Array  # (k, n)
    rate: Array  # (k, n) cost rate of closeness, lane offset, and of being short of what is due
    along: Array  # (4, n), rows Along
    passed: Array  # (m, k) last sample blocked by each obstacle that is told apart, -1: none

    def at(self, sigma: Array) -> Array:
        """Indices of the samples nearest to sigma >= 0."""
        index = (sigma * (1.0 / self.spacing) + 0.5).astype(np.int64)
        return np.minimum(index, self.along.shape[1] - 1)


def search(
    road: Road, paths: Paths, blocked: Blocked, path: int, v: float, a: float, step: int,
    config: Config, dt: float, held: Array | None = None,
) -> tuple[Array, Array, float, bool] | None:  # fmt: skip
    """The best speed profile along one path.

    Args:
        road: the road.
        paths: candidate paths.
        blocked: where others are in their way.
        path: index of the path.
        v: present speed [m/s].
        a: acceleration in the step before [m/s^2].
        step: present time step.
        config: the configuration.
        dt: time step [s].
        held: (k,) accelerations [m/s^2] with which the profile begins, None: free from now on.

    Returns:
        Accelerations (k,), speeds (k + 1,), cost and whether it ends in a goal window; None where
        every profile is blocked within the first layer.
    """
    tables = tables_of(road, paths, blocked, path, step, config)
    fits = [pose_fits(goal, road, paths)[path] for goal in road.goals]
    bounds = layer_bounds(road, step, blocked.owner.shape[1] - 1, config.seed.search_steps)
    layers, best, most = [start_label(v, a)], None, config.seed.search_labels
    for last in grow_layers(layers, tables, bounds, most, config, dt, held):
        hit = _goal_label(road, fits, layers[-1], tables, step + last)
        if hit is not None and (best is None or layers[-1].cost[hit] < best[0]):
            best = (float(layers[-1].cost[hit]), len(layers) - 1, hit)
        if best is not None and best[0] <= layers[-1].cost.min():
            break
    if len(layers) == 1:
        return None
    if best is None:
        best = _nearest_miss(road, paths, path, layers, tables, config)
        return *play_back(layers, bounds, *best[1:], dt), best[0], False
    return *play_back(layers, bounds, *best[1:], dt), best[0], True


def start_label(v: float, a: float) -> Labels:
    """The present state as a layer."""
    return Labels(*(np.array([x]) for x in (0.0, max(v, 0.0), a, 0.0, -1, 0)))


def grow_layers(
    layers: list[Labels], tables: Tables, bounds: list[int], most: int, config: Config, dt: float,
    held: Array | None = None,
) -> Iterator[int]:  # fmt: skip
    """Adds layer after layer, until all is blocked; yields the time step (from now) of each.

    ``held``: (k,) accelerations [m/s^2] at first, of which each layer takes the mean.
    """
    coarse = LONG_CELLS if bounds[-1] > LONG_STEPS else 1.0
    free, given = np.array(config.seed.search_actions), 0 if held is None else len(held)
    for first, last in pairwise(bounds):
        actions = free if held is None or first >= given else held[first:last].mean(keepdims=True)
        grown = _grow(layers[-1], tables, first, last, actions, config, dt)
        if grown is None:
            return
        layers.append(_prune(grown, most, coarse))
        yield last


def tables_of(
    road: Road, paths: Paths, blocked: Blocked, path: int, step: int, config: Config,
    passed: Array | None = None,
) -> Tables:  # fmt: skip
    """The lookups of one path; ``passed``: see :class:`Tables`."""
    cost = config.cost
    due = road.due(step, blocked.owner.shape[1] - 1, cost.reserve)
    off_road = paths.road_excess[path] - paths.road_excess[path, 0] > config.seed.road_slack
    closeness = np.exp(-cost.distance_decay * (blocked.lead[path] - cost.distance_offset))
    offset = cost.lane * road.limits.lane_offset(road.frame, paths.s[path], paths.d[path]) ** 2
    late = cost.late * np.maximum(due[:, None] - paths.s[path], 0.0) ** 2
    late += cost.haste * (paths.s[path] < blocked.clear[path])
    slope = np.abs(paths.delta_slope[path])
    speed = np.interp(paths.s[path], road.frame.s, road.limits.speed)
    return Tables(
        paths.spacing,
        (blocked.owner[path] >= 0) | off_road[None],
        cost.distance * closeness + offset + late,
        np.stack([
            cost.steering_rate * slope**2, slope, np.abs(paths.kappa[path]),
            np.maximum(speed, LEAST_LIMIT),
        ]),
        np.empty((0, len(blocked.owner[path])), int) if passed is None else passed,
    )  # fmt: skip


def layer_bounds(road: Road, step: int, last: int, moves: int) -> list[int]:
    """Time steps (from now) at which layers end; goal windows' ends are among them."""
    marks = {k - step for goal in road.goals for k in (goal.first, goal.last)}
    bounds = [0]
    while bounds[-1] < last:
        following = min([m for m in marks if m > bounds[-1]], default=last)
        bounds.append(min(bounds[-1] + moves, following, last))
    return bounds


def _grow(
    labels: Labels, tables: Tables, first: int, last: int, actions: Array, config: Config, dt: float
) -> Labels | None:
    """All successors of a layer that are not blocked, None where there are none."""
    parent = np.repeat(np.arange(len(labels.v)), len(actions))
    a = np.tile(actions, len(labels.v))
    sigma, v, cost = labels.sigma[parent], labels.v[parent], labels.cost[parent]
    ahead = labels.ahead[parent]
    duration = (last - first) * dt
    cost = cost + config.cost.jerk * (a - labels.a[parent]) ** 2 / duration
    allowed = a <= ACTUATOR_SHARE * acceleration_limit(np.maximum(v, v + a * duration))
    lateral = np.sqrt(np.maximum((ACTUATOR_SHARE * CAR.a_max) ** 2 - a**2, 0.0))
    for k in range(first + 1, last + 1):
        after = np.maximum(v + a * dt, 0.0)
        sigma, v = sigma + (v + after) * (dt / 2), after
        at, square = tables.at(sigma), v * v
        for bit in np.flatnonzero(tables.passed[:, k] >= 0).tolist():
            beyond = (at > tables.passed[bit, k]).astype(np.int64) << bit
            ahead = ahead & ~(1 << bit) | beyond
        along = tables.along.take(at, axis=1)
        excess = np.maximum(v - along[Along.SPEED], 0.0)
        slow = np.maximum(along[Along.SWIFT] * v - CAR.v_delta_max, 0.0)
        allowed &= ~tables.blocked[k].take(at)
        allowed &= square * along[Along.KAPPA] <= lateral
        allowed &= slow <= config.seed.steering_slack
        rate = tables.rate[k].take(at) + along[Along.STEERING] * square
        rate += config.refine.speeding * (excess * excess) + config.seed.slack_cost * slow
        cost += dt * rate
    if not allowed.any():
        return None
    return Labels(sigma, v, a, cost, parent, ahead).pick(np.flatnonzero(allowed))


def _prune(labels: Labels, most: int, coarse: float) -> Labels:
    """The cheapest label of every cell of (sigma, v) and of those ahead of the same obstacles, and
    of these the cheapest ``most``."""
    cell = np.rint(labels.sigma / (CELL_SIGMA * coarse)).astype(np.int64) * 1000
    cell += np.rint(labels.v / (CELL_V * coarse)).astype(np.int64)
    cell += labels.ahead * AHEAD_CELLS
    order = np.lexsort((labels.cost, cell))
    first = np.concatenate([[True], np.diff(cell[order]) != 0])
    kept = order[first]
    if len(kept) > most:
        kept = kept[np.argsort(labels.cost[kept], kind="stable")[:most]]
    return labels.pick(kept)


def _goal_label(
    road: Road, fits: list[Array], labels: Labels, tables: Tables, step: int
) -> int | None:
    """The cheapest label of a layer that lies in a goal window."""
    inside = in_goal(road, fits, labels, tables, step)
    if not inside.any():
        return None
    return int(np.argmin(np.where(inside, labels.cost, np.inf)))


def in_goal(road: Road, fits: list[Array], labels: Labels, tables: Tables, step: int) -> Array:
    """(n,) which labels of a layer lie in a goal window at a time step."""
    inside = np.zeros(len(labels.v), bool)
    for goal, fit in zip(road.goals, fits, strict=True):
        if goal.first <= step <= goal.last:
            inside |= fit[tables.at(labels.sigma)] & speed_fits(goal, labels.v)
    return inside


def _nearest_miss(
    road: Road, paths: Paths, path: int, layers: list[Labels], tables: Tables, config: Config
) -> tuple[float, int, int]:
    """Cost with penalty, layer and label that come nearest to the goal at the last layer."""
    labels = layers[-1]
    at = tables.at(labels.sigma)
    centre = paths.s[path, at] + CAR.rear_to_centre
    miss = miss_distance(road, centre, paths.d[path, at], labels.v)
    cost = labels.cost + config.seed.goal_missed + config.seed.goal_distance * miss
    best = int(np.argmin(cost))
    return float(cost[best]), len(layers) - 1, best


def play_back(
    layers: list[Labels], bounds: list[int], layer: int, label: int, dt: float
) -> tuple[Array, Array]:
    """Accelerations per time step and speeds of the way to a label."""
    chain: list[tuple[int, float]] = []
    while layer > 0:
        labels = layers[layer]
        chain.append((bounds[layer] - bounds[layer - 1], float(labels.a[label])))
        label, layer = int(labels.parent[label]), layer - 1
    v = [float(layers[0].v[0])]
    for count, a in reversed(chain):
        for _ in range(count):
            v.append(max(v[-1] + a * dt, 0.0))
    speeds = np.array(v)
    return np.diff(speeds) / dt, np.where(speeds < ROLLING, 0.0, speeds)


def as_seed(
    road: Road, paths: Paths, path: int, a0: float, found: tuple[Array, Array, float, bool],
    source: str, step: int, dt: float,
) -> Seed:  # fmt: skip
    """A found speed profile as a Frenet trajectory."""
    a, v, cost, reaches = found
    sigma = np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2 * dt)])
    grid = paths.spacing * np.arange(paths.s.shape[1])
    tables = (paths.s, paths.d, paths.mu)
    columns = [np.interp(sigma, grid, table[path]) for table in tables]
    delta = np.interp(sigma, grid, paths.delta[path])
    states = np.column_stack([*columns, v, delta, np.concatenate([[a0], a])])
    label = f"to d = {paths.target[path]:.2f} m, {v[-1]:.1f} m/s at the end"
    return Seed(road, step, states, cost, reaches, source, label)
