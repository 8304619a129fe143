"""Sources of seeds that are not ours: found by name, and what they propose checked and judged.

A source is a class 'package.module:Class' in `seed.sources`. It is built as ``Class(config, dt)``
and called in every cycle in which seeds are sought; it proposes Frenet states and says what they
do. What they cost, and whether they reach the goal, is for the planner to say, and verification
decides as about all other seeds.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from mpcplan.config import Config
from mpcplan.errors import PlannerError
from mpcplan.plug.named import Part, asked, class_named
from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.road import Road
from mpcplan.seed.cost import trajectory_cost
from mpcplan.seed.goal_fit import speed_fits
from mpcplan.seed.seed import Seed, SeedReport, Stage
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

SOURCE = Part("seed.sources", "__call__", "road, state, acceleration, step, occupancy")
LEAST = 3  # states of a proposal
FIRST = 0.05  # m, rad or m/s, by which its first state may differ from the present one


@dataclass(frozen=True, eq=False)
class Proposal:
    """What a source proposes.

    Attributes:
        states: (k + 1, 6) from the present time step on, columns :class:`Stage`.
        label: what it does, in words.
    """

    states: Array
    label: str


class SeedSource(Protocol):
    """A source of seeds."""

    def __call__(
        self, road: Road, state: Array, acceleration: float, step: int, occupancy: Occupancy
    ) -> Iterable[Proposal]:
        """Proposals along a road, from a rear-axle state (5,) and the acceleration [m/s^2] of the
        step before; ``occupancy``: the others along the road."""
        ...


def foreign_seeds(
    spec: str, road: Road, state: Array, acceleration: float, step: int, occupancy: Occupancy,
    config: Config, dt: float,
) -> tuple[list[Seed], SeedReport]:  # fmt: skip
    """Seeds of one source, with its report.

    Raises:
        InputError: the name leads to no usable class.
        PlannerError: it failed, or proposed what is no seed.
    """
    made = class_named(spec, SOURCE)

    def propose() -> list[Proposal]:
        source = _made(made, config, dt)
        return list(source(road, state.copy(), acceleration, step, occupancy))

    proposed = asked(SOURCE, spec, made, f"step {step}", propose)
    present = _present(road, state)
    for proposal in proposed:
        wrong = _wrong(proposal, present)
        if wrong:
            raise PlannerError(f"{SOURCE.name} {spec!r}, step {step}: {wrong}")
    seeds = [_judged(made.__name__, p, road, step, occupancy, config, dt) for p in proposed]
    reaching = sum(seed.reaches_goal for seed in seeds)
    return seeds, SeedReport(made.__name__, len(proposed), len(seeds), reaching)


@lru_cache(maxsize=16)
def _source(made: Any, settings: str, dt: float) -> SeedSource:
    source: SeedSource = made(Config.model_validate_json(settings), dt)
    return source


def _made(made: type[Any], config: Config, dt: float) -> SeedSource:
    """The source for a configuration; built once."""
    hashable: Any = made
    return _source(hashable, config.model_dump_json(), dt)


def _present(road: Road, state: Array) -> Array:
    """(3,) s [m], d [m] and v [m/s] of a rear-axle state."""
    s, d = road.frame.to_frenet(state[None, :2])
    return np.array([s[0], d[0], state[3]])


def _wrong(proposal: Any, present: Array) -> str:
    """What is wrong with a proposal, '' where nothing is."""
    if not isinstance(proposal, Proposal):
        return f"it proposed a {type(proposal).__name__}, expected a Proposal"
    states = np.asarray(proposal.states)
    if states.ndim != 2 or states.shape[1] != len(Stage) or len(states) < LEAST:
        return f"states are {states.shape}, expected (at least {LEAST}, {len(Stage)})"
    if not np.isfinite(states).all():
        return "states hold numbers that are not finite"
    off = np.abs(states[0, [Stage.S, Stage.D, Stage.V]] - present)
    if off.max() > FIRST:
        name = ("s", "d", "v")[int(off.argmax())]
        return f"the first state's {name} is {off.max():.3g} off the present one"
    return ""


def _judged(
    name: str, proposal: Proposal, road: Road, step: int, occupancy: Occupancy, config: Config,
    dt: float,
) -> Seed:  # fmt: skip
    """A proposal as a seed: up to where it meets a goal, with its cost."""
    states = np.array(proposal.states, float)[: road.last_step - step + 1]
    met = np.flatnonzero(_meets_goal(road, states, step))
    if len(met):
        states = states[: max(int(met[0]), 1) + 1]
    cost = trajectory_cost(road, states, step, bool(len(met)), occupancy, config, dt)
    return Seed(road, step, states, cost, bool(len(met)), name, proposal.label)


def _meets_goal(road: Road, states: Array, step: int) -> Array:
    """(k + 1,) whether states meet a goal window."""
    s = states[:, Stage.S] + CAR.rear_to_centre * np.cos(states[:, Stage.MU])
    d = states[:, Stage.D] + CAR.rear_to_centre * np.sin(states[:, Stage.MU])
    steps, psi = step + np.arange(len(states)), road.frame.heading(states[:, Stage.S])
    meets = np.zeros(len(states), bool)
    for goal in road.goals:
        fits = (steps >= goal.first) & (steps <= goal.last) & speed_fits(goal, states[:, Stage.V])
        if goal.s is not None and goal.d is not None:
            fits &= goal.holds(s, d)
        if goal.psi is not None:
            middle, half = (goal.psi[0] + goal.psi[1]) / 2, (goal.psi[1] - goal.psi[0]) / 2
            turned = psi + states[:, Stage.MU] - middle
            fits &= np.abs((turned + np.pi) % (2 * np.pi) - np.pi) <= half
        meets |= fits
    return meets
