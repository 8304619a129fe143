"""The level-k decision as a seed: its actions along a path, then the best way on to the goal.

The game's actions are held for `game.step` each and turn at once; the seed follows that of the
candidate paths which ends at the offset that the actions lead to, with their accelerations, and
from there on the speed search goes on. Who yields to the ego vehicle by the decision is not in its
way: whether a plan that counts on that is safe is for verification to say.
"""

from dataclasses import replace

import numpy as np

from mpcplan.config import Config
from mpcplan.game.decide import Decision, Order
from mpcplan.game.way import Place
from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.road import Road
from mpcplan.seed.blocked import Blocked
from mpcplan.seed.paths import Paths
from mpcplan.seed.profiles import Motion
from mpcplan.seed.search import as_seed, search
from mpcplan.seed.seed import Seed, SeedReport
from mpcplan.trajectory import Array

LEVEL_K = "level-k"


def level_k_seed(
    road: Road, paths: Paths, blocked: Blocked, window: Occupancy, motion: Motion,
    decision: Decision, step: int, config: Config, dt: float,
) -> tuple[list[Seed], SeedReport]:  # fmt: skip
    """The seed of a decision, none where others are in the way of its actions.

    Args:
        road: the road on which the game was played.
        paths: candidate paths from the present pose.
        blocked: where others are in their way.
        window: the others from now on, with the rows of ``blocked``.
        motion: present speed and acceleration.
        decision: of the game.
        step: present time step.
        config: the configuration.
        dt: time step [s].
    """
    offset = float(decision.path[-1, Place.D])
    plain = np.flatnonzero(~paths.passing)
    path = int(plain[np.abs(paths.target[plain] - offset).argmin()])
    free = without_yielding(blocked, window, decision)
    held = accelerations(decision, dt)
    found = search(road, paths, free, path, motion.v, motion.a, step, config, dt, held)
    seeds = []
    if found is not None:
        seeds.append(as_seed(road, paths, path, motion.a, found, LEVEL_K, step, dt))
    reaching = sum(seed.reaches_goal for seed in seeds)
    return seeds, SeedReport(LEVEL_K, 1, len(seeds), reaching)


def accelerations(decision: Decision, dt: float) -> Array:
    """(k,) accelerations [m/s^2] at time steps while the actions last."""
    steps = round(float(decision.times[-1]) / dt)
    speeds = np.interp(dt * np.arange(steps + 1), decision.times, decision.path[:, Place.V])
    held: Array = np.diff(speeds) / dt
    return held


def without_yielding(blocked: Blocked, window: Occupancy, decision: Decision) -> Blocked:
    """The grids without those who go second by the decision."""
    second = [i for i, order in decision.orders.items() if order is Order.GO]
    rows = np.flatnonzero(np.isin(window.ids, second))
    owner = np.where(np.isin(blocked.owner, rows), -1, blocked.owner)
    return replace(blocked, owner=owner)
