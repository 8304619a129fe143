"""All seeds of one road: the lattice's best, and where asked for those of the speed search."""

import numpy as np

from mpcplan.config import Config
from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.road import Road
from mpcplan.seed.lattice import Lattice, lattice
from mpcplan.seed.search import as_seed, search
from mpcplan.seed.seed import Seed, SeedReport
from mpcplan.trajectory import Array

SEARCHED_PATHS = 3


def find_seeds(
    road: Road, state: Array, acceleration: float, step: int, occupancy: Occupancy,
    config: Config, dt: float, thorough: bool,
) -> tuple[list[Seed], list[SeedReport]]:  # fmt: skip
    """Seeds along one road, the cheapest first, with the reports of their sources.

    Args:
        thorough: run the speed search even where the lattice reaches the goal.
    """
    grid = lattice(road, state, acceleration, step, occupancy, config, dt)
    seeds, reports = list(grid.seeds), [grid.report]
    reached = any(seed.reaches_goal for seed in seeds)
    if config.seed.search and (thorough or not reached):
        found, report = _searched(road, grid, step, config, dt)
        seeds, reports = seeds + found, [*reports, report]
    seeds.sort(key=lambda seed: (not seed.reaches_goal, seed.cost))
    return seeds, reports


def _searched(
    road: Road, grid: Lattice, step: int, config: Config, dt: float
) -> tuple[list[Seed], SeedReport]:
    """Seeds of the speed search along a few paths with distinct targets."""
    _, first = np.unique(np.round(grid.paths.target, 1), return_index=True)
    wanted = sorted(int(i) for i in first)[:SEARCHED_PATHS]
    seeds = []
    for path in wanted:
        v, a = grid.motion.v, grid.motion.a
        found = search(road, grid.paths, grid.blocked, path, v, a, step, config, dt)
        if found is not None:
            seeds.append(as_seed(road, grid.paths, path, a, found, step, dt))
    reaching = sum(seed.reaches_goal for seed in seeds)
    return seeds, SeedReport("search", len(wanted), len(seeds), reaching)
