"""All seeds of one road: the lattice's best, and where asked for those of the speed search."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from enum import Enum

import numpy as np

from mpcplan.config import Config, SeedConfig
from mpcplan.game.decide import Decision
from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.road import Road
from mpcplan.seed.blocked import Blocked, with_margins
from mpcplan.seed.foreign import foreign_seeds
from mpcplan.seed.lattice import Lattice, differ, lattice
from mpcplan.seed.level_k import level_k_seed
from mpcplan.seed.paths import Paths
from mpcplan.seed.rules import seed_cost
from mpcplan.seed.search import ACTUATOR_SHARE, as_seed, search
from mpcplan.seed.seed import Seed, SeedReport
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

SEARCHED_PATHS = 3
COMFORTABLE = 3.0  # m/s^2, braking before what a path demands
ROUNDING = 0.05  # m, on top of verification's margin: the search looks at samples of the path


class Effort(Enum):
    """When the speed search runs beside the lattice."""

    NEVER = "never"
    IF_NEEDED = "if needed"  # where no candidate of the lattice reaches the goal
    ALWAYS = "always"
    PLAIN = "plain"  # always, but not with the narrowest margins where it fails


def find_seeds(
    road: Road, state: Array, acceleration: float, step: int, occupancy: Occupancy,
    config: Config, dt: float, effort: Effort, decision: Decision | None = None,
    sampled: Callable[[Road, Lattice], None] | None = None,
) -> tuple[list[Seed], list[SeedReport]]:  # fmt: skip
    """Seeds along one road, the cheapest first, with the reports of their sources.

    Args:
        effort: when the speed search runs beside the lattice.
        decision: of the level-k game on this road, which becomes a seed too.
        sampled: is shown the lattice.
    """
    if effort is Effort.NEVER:  # there is a plan already, with its lane changes when they are due
        config = config.model_copy(update={"seed": config.seed.model_copy(update={"delays": ()})})
    grid = lattice(road, state, acceleration, step, occupancy, config, dt)
    if sampled is not None:
        sampled(road, grid)
    seeds, reports = list(grid.seeds), [grid.report]
    reached = any(seed.reaches_goal for seed in seeds)
    always = effort in (Effort.ALWAYS, Effort.PLAIN)
    if config.seed.search and (always or (effort is Effort.IF_NEEDED and not reached)):
        for found, report in _searches(road, grid, step, config, dt, effort, reached):
            seeds += found
            reports.append(report)
    for spec in config.seed.sources:
        found, report = foreign_seeds(spec, road, state, acceleration, step, occupancy, config, dt)
        seeds += found
        reports.append(report)
    if decision is not None:
        found, report = level_k_seed(
            road, grid.paths, grid.blocked, grid.window, grid.motion, decision, step, config, dt
        )
        seeds += _with_rules(found, grid, config, dt)
        reports.append(report)
    seeds.sort(key=lambda seed: (not seed.reaches_goal, seed.cost))
    return seeds, reports


def _searches(
    road: Road, grid: Lattice, step: int, config: Config, dt: float, effort: Effort, reached: bool
) -> Iterator[tuple[list[Seed], SeedReport]]:
    """What the speed search finds: along plain paths, and as long as nothing reaches the goal with
    narrower margins, and along paths that lead around slow obstacles."""
    plain, passing = _paths_to_search(grid.paths, grid.motion.v, config.seed)

    def searched(paths: list[int], blocked: Blocked, source: str) -> tuple[list[Seed], SeedReport]:
        nonlocal reached
        found, report = _searched(road, grid, blocked, paths, source, step, config, dt)
        reached = reached or any(seed.reaches_goal for seed in found)
        return found, report

    yield searched(plain, grid.blocked, "search")
    if not reached and effort is not Effort.PLAIN:
        near = with_margins(grid.blocked, grid.window, grid.paths, tight(config))
        yield searched(plain, near, "tight search")
    if not reached and passing:
        yield searched(passing, grid.blocked, "search around")


def tight(config: Config) -> SeedConfig:
    """The seeds' margins reduced to what verification asks for."""
    margin = config.verify.margin + ROUNDING
    return config.seed.model_copy(
        update={
            "margin_lon": min(margin, config.seed.margin_lon),
            "margin_lat": min(margin, config.seed.margin_lat),
        }
    )


def _searched(
    road: Road, grid: Lattice, blocked: Blocked, wanted: list[int], source: str, step: int,
    config: Config, dt: float,
) -> tuple[list[Seed], SeedReport]:  # fmt: skip
    """Seeds of the speed search along a few paths."""
    seeds = []
    for path in wanted:
        v, a = grid.motion.v, grid.motion.a
        found = search(road, grid.paths, blocked, path, v, a, step, config, dt)
        if found is not None:
            seeds.append(as_seed(road, grid.paths, path, a, found, source, step, dt))
    reaching = sum(seed.reaches_goal for seed in seeds)
    report = SeedReport(source, len(wanted), len(seeds), reaching)
    return _with_rules(seeds, grid, config, dt), report


def _with_rules(seeds: list[Seed], grid: Lattice, config: Config, dt: float) -> list[Seed]:
    """The seeds with what they cost for breaking the rules."""
    return [
        replace(seed, cost=seed.cost + seed_cost(seed, grid.window, config, dt)) for seed in seeds
    ]


def _paths_to_search(paths: Paths, v: float, config: SeedConfig) -> tuple[list[int], list[int]]:
    """The paths along which speeds are searched, and those that lead around slow obstacles.

    For the first targets one path each: the first that can be driven from the present speed
    [m/s] on, braking comfortably where it must, else the gentlest; if asked for, the first too."""
    sigma = paths.spacing * np.arange(paths.s.shape[1])
    slowed = np.sqrt(np.maximum(v**2 - 2 * COMFORTABLE * sigma, 0.0))
    bend = np.abs(paths.kappa) * slowed**2 / (ACTUATOR_SHARE * CAR.a_max)
    steering = np.abs(paths.delta_slope) * slowed / (CAR.v_delta_max + config.steering_slack)
    demand = np.maximum(bend, steering).max(axis=1)
    plain = np.flatnonzero(~paths.passing)
    targets, first = np.unique(np.round(paths.target[plain], 1), return_index=True)
    wanted = []
    for target in targets[np.argsort(first)][:SEARCHED_PATHS]:
        there = plain[np.round(paths.target[plain], 1) == target]
        drivable = there[demand[there] <= 1.0]
        chosen = drivable[0] if len(drivable) else there[demand[there].argmin()]
        also = there[:1] if config.shortest else there[:0]
        wanted += [int(path) for path in np.unique([*also, chosen])]
    road = paths.road_excess.max(axis=1) <= config.road_slack
    passing = np.flatnonzero(paths.passing & (demand <= 1.0) & road)
    return wanted, passing.tolist()


def distinct(seeds: list[Seed], count: int) -> list[Seed]:
    """The first ``count`` seeds that differ from each other by metres, or lie on other roads."""
    chosen: list[Seed] = []
    for seed in seeds:
        if len(chosen) == count:
            break
        if all(
            seed.road is not other.road or differ(seed.states, other.states) for other in chosen
        ):
            chosen.append(seed)
    return chosen
