"""All ways of driving along one path among the others: before or behind each, early or late.

The labels of :mod:`mpcplan.seed.search` are told apart by whom they are ahead of: an obstacle that
blocks the samples [low, high] of a path at a time step has the label either behind (below low) or
ahead (above high), and which of both stays the same as long as it is there. So the cheapest label
in the goal for every combination is the cheapest way of its homotopy class.

Source: labels augmented by their topology as in Bhattacharya, Likhachev, Kumar: Topological
constraints in search-based robot path planning, Autonomous Robots 33 (2012), here with the sides of
obstacles in (sigma, t).
"""

from dataclasses import dataclass

import numpy as np

from mpcplan.config import Config
from mpcplan.road.road import Road
from mpcplan.seed.blocked import Blocked
from mpcplan.seed.goal_fit import pose_fits
from mpcplan.seed.paths import Paths
from mpcplan.seed.search import (
    Labels,
    Tables,
    grow_layers,
    in_goal,
    layer_bounds,
    play_back,
    start_label,
    tables_of,
)
from mpcplan.trajectory import Array

MOST_OBSTACLES = 16  # told apart on one path, those that block most of it first


@dataclass(frozen=True, eq=False)
class Way:
    """One way along a path.

    Attributes:
        a: (k,) accelerations [m/s^2].
        v: (k + 1,) speeds [m/s].
        cost: as the search counts it.
        ahead: ids of those that are left behind of those that come in the way.
        arrival: time steps from now to the goal.
    """

    a: Array
    v: Array
    cost: float
    ahead: tuple[int, ...]
    arrival: int


def find_ways(
    road: Road, paths: Paths, blocked: Blocked, ids: tuple[int, ...], path: int, v: float, a: float,
    step: int, config: Config, dt: float, labels: int, arrivals: int,
) -> list[Way]:  # fmt: skip
    """The cheapest way to the goal for every homotopy class and part of the goal's time.

    Args:
        road, paths, blocked: what is driven on, see :mod:`mpcplan.seed.search`.
        ids: of the obstacles that own the blocked cells.
        path: which of the paths.
        v, a: speed and acceleration at the start.
        step: present time step.
        config: the configuration.
        dt: time step [s].
        labels: kept per layer.
        arrivals: parts into which the goal's time is divided.
    """
    rows, passed = _passed(blocked, path)
    tables = tables_of(road, paths, blocked, path, step, config, passed)
    fits = [pose_fits(goal, road, paths)[path] for goal in road.goals]
    bounds = layer_bounds(road, step, blocked.owner.shape[1] - 1, config.seed.search_steps)
    layers = [start_label(v, a)]
    begin = max(min(goal.first for goal in road.goals) - step, 1)
    part = max((bounds[-1] + 1 - begin) / arrivals, 1.0)
    best: dict[tuple[int, int], tuple[float, int, int]] = {}
    for last in grow_layers(layers, tables, bounds, labels, config, dt):
        for ahead, label in _cheapest(road, fits, layers[-1], tables, step + last):
            key, cost = (ahead, int((last - begin) / part)), float(layers[-1].cost[label])
            if key not in best or cost < best[key][0]:
                best[key] = (cost, len(layers) - 1, label)
    found = []
    for (ahead, _), (cost, layer, label) in best.items():
        speeds = play_back(layers, bounds, layer, label, dt)
        left = tuple(ids[row] for bit, row in enumerate(rows) if ahead >> bit & 1)
        found.append(Way(*speeds, cost, left, bounds[layer]))
    return sorted(found, key=lambda way: way.cost)


def _passed(blocked: Blocked, path: int) -> tuple[list[int], Array]:
    """Rows of the obstacles told apart, and the last sample (m, k) that each blocks, -1: none."""
    owner = blocked.owner[path]
    rows, counts = np.unique(owner[owner >= 0], return_counts=True)
    rows = rows[np.argsort(-counts, kind="stable")][:MOST_OBSTACLES].tolist()
    passed = np.full((len(rows), len(owner)), -1)
    for bit, row in enumerate(rows):
        mine = owner == row
        there = mine.any(axis=1)
        passed[bit, there] = owner.shape[1] - 1 - np.argmax(mine[there, ::-1], axis=1)
    return rows, passed


def _cheapest(
    road: Road, fits: list[Array], labels: Labels, tables: Tables, step: int
) -> list[tuple[int, int]]:
    """The cheapest label in the goal for each combination: the combination, the label."""
    inside = np.flatnonzero(in_goal(road, fits, labels, tables, step))
    order = inside[np.argsort(labels.cost[inside], kind="stable")]
    kinds, first = np.unique(labels.ahead[order], return_index=True)
    return list(zip(kinds.tolist(), order[first].tolist(), strict=True))
