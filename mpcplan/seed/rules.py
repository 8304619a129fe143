"""What candidates cost for breaking the rules:

    dt sum_k  w_R1 max(0, -rho_1,k) + w_R4 max(0, -rho_4,k)

with rho_1 the robustness of R_G1 [m] towards whoever is predicted to drive ahead and rho_4 that of
R_G4 [m/s] (:mod:`mpcplan.rules`). Nothing is computed where both weights are 0: the road has no
strips then. A cut-in is known from the forecast on, so that who cut in before now has no grace.

The sum ends after ``cost.rules_horizon``: where the others' motion is a guess, distances to where
they may be in ten seconds would cost more than a missed goal, and who stops keeps them best. There
who drives ahead may also brake right after a plan was made, and it is seen in the next cycle only:
plans keep the distance with a reaction that is longer by ``cost.rules_delay``.
"""

import numpy as np

from mpcplan.config import Config
from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.road import Road
from mpcplan.rules.predicates import Bodies, ego_bodies, other_bodies
from mpcplan.rules.robustness import robustness
from mpcplan.seed.judge import Table
from mpcplan.seed.paths import Paths
from mpcplan.seed.profiles import Profiles
from mpcplan.seed.seed import Seed, Stage
from mpcplan.trajectory import Array

CHUNK = 64  # candidates judged at once, which limits the memory


def states_cost(
    road: Road, states: Array, first_step: int, around: Occupancy, config: Config, dt: float
) -> float:
    """Cost of (k + 1, 6) Frenet states (columns :class:`Stage`) from a time step on."""
    if road.strips is None:
        return 0.0
    columns = (Stage.S, Stage.D, Stage.MU, Stage.V)
    count = _asked(len(states), config, dt)
    ego = ego_bodies(*(states[None, :count, column] for column in columns))
    window = around.window(first_step, count)
    return dt * float(_rates(road, ego, window, config, dt)[0, 1:].sum())


def seed_cost(seed: Seed, around: Occupancy, config: Config, dt: float) -> float:
    """Cost of a seed."""
    return states_cost(seed.road, seed.states, seed.first_step, around, config, dt)


def candidates_cost(
    road: Road, paths: Paths, profiles: Profiles, table: Table, accepted: Array, window: Occupancy,
    config: Config, dt: float,
) -> Array:  # fmt: skip
    """(p, i) cost of the accepted candidates of the lattice up to their end; 0 for all others."""
    cost = np.zeros(accepted.shape)
    if road.strips is None:
        return cost
    count = _asked(profiles.sigma.shape[1], config, dt)
    window = window.window(window.first_step, count)
    at = np.rint(profiles.sigma[:, :count] / paths.spacing).astype(np.int64)
    at = np.clip(at, 0, paths.s.shape[1] - 1)
    steps = np.arange(1, at.shape[1])
    rows = np.argwhere(accepted)
    for chunk in np.split(rows, range(CHUNK, len(rows), CHUNK)):
        p, i = chunk.T
        s, d, mu = (values[p[:, None], at[i]] for values in (paths.s, paths.d, paths.mu))
        rates = _rates(road, ego_bodies(s, d, mu, profiles.v[i, :count]), window, config, dt)[:, 1:]
        alive = steps <= table.ks[table.k_end[p, i]][:, None]
        cost[p, i] = dt * np.where(alive, rates, 0.0).sum(axis=1)
    return cost


def planned_reaction(config: Config) -> float:
    """Time [s] delta after which the ego vehicle brakes in the safe distance that plans keep."""
    return config.rules.reaction + config.cost.rules_delay


def _asked(count: int, config: Config, dt: float) -> int:
    """Of ``count`` states from the present one on, how many the rules are asked of."""
    return min(count, round(config.cost.rules_horizon / dt) + 1)


def _rates(road: Road, ego: Bodies, window: Occupancy, config: Config, dt: float) -> Array:
    """(n, k) cost rate of bodies at the time steps of a window."""
    assert road.strips is not None
    held = window.held
    parked = np.zeros(len(window.ids), bool) if held is None else held
    others = other_bodies(window)
    weights, reaction = config.cost, planned_reaction(config)
    rules = config.rules.model_copy(update={"reaction": reaction})
    distance, flow = robustness(road.strips, ego, others, parked, rules, dt)
    rates: Array = weights.safe_distance * np.maximum(-distance, 0.0)
    return rates + weights.traffic_flow * np.maximum(-flow, 0.0)
