"""The clairvoyant optimum of one planning problem.

    min TR1  over all trajectories of the KS model that reach the goal, the others' motion known.

It is sought by enumeration: on every road every lateral target, before or behind every vehicle in
the way, early or late in the goal's time (:mod:`mpcplan.bound.enumerate`). The cheapest of these
ways are refined over the whole horizon; for the best ones the corridor is then made anew around the
result and the problem solved by IPOPT, an interior-point method with exact second derivatives,
until they settle. What passes verification and costs least is the bound. It is a local optimum in
each homotopy class and the best of those enumerated, not a proof.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from mpcplan.bound.enumerate import cheapest, ways_on
from mpcplan.config import Config
from mpcplan.cycle import Cycle
from mpcplan.develop import Developer
from mpcplan.errors import BoundError
from mpcplan.observation import Observation
from mpcplan.plan import Clock, Option
from mpcplan.road.road import Road, build_roads
from mpcplan.seed.seed import Seed
from mpcplan.seed.track import frenet_states
from mpcplan.task import Task
from mpcplan.trajectory import Trajectory
from mpcplan.verify.guard import Guard

DRIVEN, SETTLED = "as driven", "settled"
STANDSTILL = 0.0  # m/s^2, acceleration before the start


@dataclass(frozen=True, eq=False)
class Optimum:
    """The best trajectory found, and what was looked at.

    Attributes:
        trajectory: from the start to the goal.
        cost: as the planner counts it.
        source: how it came about.
        label: what it does.
        found: ways that were enumerated; refined: those that were refined; verified: of these
            those that passed.
        before: the best cost before the corridors were made anew and IPOPT took over.
    """

    trajectory: Trajectory
    cost: float
    source: str
    label: str
    found: int
    refined: int
    verified: int
    before: float


class Clairvoyant:
    """Looks for the optimum of one problem with recorded traffic."""

    def __init__(self, task: Task, config: Config, last_step: int | None = None) -> None:
        """Builds the roads.

        Args:
            task: with the recorded traffic.
            config: the planner's.
            last_step: the latest time step at which the goal may be reached; None: the goal's own.

        Raises:
            RoadError: where no route leads to the goal.
        """
        assert task.recorded is not None  # nobody can be clairvoyant of what is not there
        self._task, self._config = task, config
        goal = task.problem.planning_problem
        roads = build_roads(task.road_map, goal, config.road)
        self._roads = roads if last_step is None else _until(roads, last_step)
        guard = Guard(config, task.dt)
        self._converged = Developer(goal, guard, _converging(config), task.dt)
        self._whole = Developer(goal, guard, _converging(config, "ipopt"), task.dt)
        seen = Observation(task.problem.first_step, task.problem.start, STANDSTILL, ())
        self._cycle = Cycle(seen, task.recorded, Clock(), [], {})

    def optimum(self, driven: Trajectory | None = None) -> Optimum:
        """The optimum; ``driven`` is one more way to begin from.

        Raises:
            BoundError: no way to the goal passed verification.
        """
        ways = cheapest(self._ways())
        seeds = ways[: self._config.bound.refined]
        if driven is not None:
            seeds += self._seeds_of(driven, DRIVEN)
        refused: list[Option] = []
        options = self._develop(self._converged, seeds, refused)
        verified = len(options)
        if not options:
            reasons = "; ".join(f"{o.source}: {o.finding}" for o in refused[:3])
            raise BoundError(
                f"no clairvoyant way to the goal: {len(ways)} found, {len(seeds)} refined"
                + (f"; {reasons}" if reasons else "")
            )
        best = sorted(options, key=lambda o: o.cost)[: self._config.bound.polished]
        chosen = min([self._settle(option) for option in best], key=lambda o: o.cost)
        assert chosen.seed is not None
        return Optimum(
            chosen.trajectory, chosen.cost, chosen.source, chosen.seed.label, len(ways),
            len(seeds), verified, best[0].cost,
        )  # fmt: skip

    def _ways(self) -> list[Seed]:
        seen = self._cycle.observation
        found: list[Seed] = []
        for road in self._roads:
            around = self._cycle.around(road)
            found += ways_on(
                road, seen.state, seen.acceleration, seen.step, around, self._config, self._task.dt
            )
        return found

    def _seeds_of(self, driven: Trajectory, source: str) -> list[Seed]:
        """A trajectory as a seed on every road."""
        return [self._seed_on(road, driven, source, source) for road in self._roads]

    def _seed_on(self, road: Road, trajectory: Trajectory, source: str, label: str) -> Seed:
        states = frenet_states(road.frame, trajectory, self._cycle.observation.acceleration)
        return Seed(road, trajectory.first_step, states, 0.0, True, source, label)

    def _again(self, option: Option, source: str) -> Seed:
        """An option's trajectory as a seed."""
        assert option.seed is not None
        return self._seed_on(option.seed.road, option.trajectory, source, option.seed.label)

    def _settle(self, option: Option) -> Option:
        """The option solved by IPOPT in corridors made around it, until it gains no more."""
        for _ in range(self._config.bound.rounds):
            again = self._develop(self._whole, [self._again(option, SETTLED)], [])
            if not again or again[0].cost > (1 - self._config.bound.gain) * option.cost:
                break
            option = again[0]
        return option

    def _develop(
        self, developer: Developer, seeds: Sequence[Seed], refused: list[Option]
    ) -> list[Option]:
        """What reaches the goal and passes verification."""
        options: list[Option] = []
        for seed in seeds:
            developer.develop(self._cycle, seed, options, refused)
        return [option for option in options if option.reaches_goal]


def _until(roads: Sequence[Road], last_step: int) -> tuple[Road, ...]:
    """The roads with goals that end at a time step at the latest."""
    return tuple(
        replace(
            road,
            goals=tuple(
                replace(goal, last=min(goal.last, last_step))
                for goal in road.goals
                if goal.first <= last_step
            ),
        )
        for road in roads
        if any(goal.first <= last_step for goal in road.goals)
    )


def _converging(config: Config, backend: str = "piqp") -> Config:
    """The configuration with the refinement to the goal, and to convergence."""
    bound = config.bound
    changes = {
        "horizon": "goal",
        "fresh_backend": backend,
        "fresh_iterations": bound.iterations,
        "gain": bound.gain / 100,
        "tolerance": min(config.refine.tolerance, 1e-4),
    }
    return config.model_copy(update={"refine": config.refine.model_copy(update=changes)})
