"""Ways to the goal that are worth refining: roads, lanes, before or behind whom, when to arrive."""

import numpy as np

from mpcplan.config import Config
from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.road import Road
from mpcplan.seed.lattice import Lattice, lattice
from mpcplan.seed.search import as_seed
from mpcplan.seed.seed import Seed
from mpcplan.seed.ways import find_ways
from mpcplan.trajectory import Array

ALIKE = 6  # decimals of the cost in which the same way on two roads agrees
SAME_TARGET = 1.0  # m, end offsets that differ by less lie in the same lane


def ways_on(
    road: Road, state: Array, acceleration: float, step: int, around: Occupancy, config: Config,
    dt: float,
) -> list[Seed]:  # fmt: skip
    """All ways to the goal on one road: those of the lattice and of the search."""
    grid = lattice(road, state, acceleration, step, around, _wider(config), dt)
    found = [seed for seed in grid.seeds if seed.reaches_goal]
    for path in _distinct_paths(grid):
        ways = find_ways(
            road, grid.paths, grid.blocked, grid.window.ids, path, grid.motion.v, grid.motion.a,
            step, config, dt, config.bound.labels, config.bound.arrivals,
        )  # fmt: skip
        for way in ways:
            made = (way.a, way.v, way.cost, True)
            found.append(as_seed(road, grid.paths, path, grid.motion.a, made, "way", step, dt))
    return found


def cheapest(seeds: list[Seed]) -> list[Seed]:
    """The seeds by cost; of those that agree on several roads, the first."""
    best: dict[tuple[float, int], Seed] = {}
    for seed in sorted(seeds, key=lambda seed: seed.cost):
        best.setdefault((round(seed.cost, ALIKE), len(seed.states)), seed)
    return list(best.values())


def _wider(config: Config) -> Config:
    """The configuration with more lateral moves."""
    moves = {"lengths": config.bound.lengths, "delays": config.bound.delays}
    return config.model_copy(update={"seed": config.seed.model_copy(update=moves)})


def _distinct_paths(grid: Lattice) -> list[int]:
    """One path to every place of the own lane, and all that end elsewhere."""
    target = grid.paths.target
    _, first = np.unique(np.round(target, 1), return_index=True)
    elsewhere = np.flatnonzero(np.abs(target - target[0]) > SAME_TARGET)
    return sorted({*first.tolist(), *elsewhere.tolist()})
