"""Where seeds are sought, and what else is tried where none leads to the goal.

In this order, each only while no option reaches the goal:

    1. hope: seeds that count on the others' making way later than plans are verified
    2. a manoeuvre: a path through a narrow place
    3. the last moment: seeds that accelerate harder than others may

and where no option passes verification at all, seeds that are not in haste.
"""

from dataclasses import dataclass, replace

from mpcplan.config import Config
from mpcplan.cycle import Cycle
from mpcplan.develop import Developer
from mpcplan.game.decide import Decision
from mpcplan.guessing import in_the_last_moment
from mpcplan.plan import Option
from mpcplan.road.road import Road
from mpcplan.seed.candidates import Effort, distinct, find_seeds
from mpcplan.seed.manoeuvre import manoeuvre_seeds
from mpcplan.seed.seed import Seed, SeedReport
from mpcplan.trajectory import State
from mpcplan.verify.guard import Guard
from mpcplan.witness import Witness

HOPEFUL = "hopeful"  # before the source of a plan that counts on the others' making way
LAST_MOMENT = "last-moment"  # before the source of a plan that accelerates as hard as no other


class Seeker:
    """Seeks seeds on a road."""

    def __init__(self, config: Config, dt: float, witness: Witness | None = None) -> None:
        self._config, self._dt = config, dt
        self._sampled = witness.sampled if witness is not None else None

    def seek(
        self, cycle: Cycle, road: Road, effort: Effort, config: Config | None = None,
        decision: Decision | None = None,
    ) -> tuple[list[Seed], list[SeedReport]]:  # fmt: skip
        """Seeds of one road, with the planner's configuration or another one."""
        seen, around = cycle.observation, cycle.around(road)
        with cycle.clock("seed"):
            return find_seeds(
                road, seen.state, seen.acceleration, seen.step, around, config or self._config,
                self._dt, effort, decision, self._sampled,
            )  # fmt: skip

    def manoeuvre(self, cycle: Cycle, road: Road) -> tuple[list[Seed], SeedReport]:
        """Seeds along a path made for narrow places."""
        seen, around = cycle.observation, cycle.around(road)
        with cycle.clock("seed"):
            return manoeuvre_seeds(
                road, seen.state, seen.acceleration, seen.step, around, self._config, self._dt
            )


@dataclass(frozen=True, eq=False)
class Resorts:
    """What is tried where no seed leads to the goal; see the module.

    Every method adds to the options those that pass verification, and to the refused ones those
    that do not.

    Attributes:
        config, calm: the planner's configuration, and the same without haste.
        developer, calm_developer: with either of them.
    """

    config: Config
    calm: Config
    seeker: Seeker
    guard: Guard
    developer: Developer
    calm_developer: Developer
    dt: float

    def hope(self, cycle: Cycle, road: Road, options: list[Option], refused: list[Option]) -> None:
        """Plans to the goal that count on the others' making way later than is verified.

        A guess that far ahead is no reason to give up the goal: who waits far from a crossing
        until the whole way is predicted to be free may wait for ever.
        """
        levels = () if cycle.forecast.exact else self.config.predict.hope
        for later in levels:
            hopeful = replace(cycle, certain=self.guard.certain + round(later / self.dt))
            seeds, _ = self.seeker.seek(hopeful, road, Effort.PLAIN)
            self._develop(hopeful, seeds, HOPEFUL, options, refused)
            if any(option.reaches_goal for option in options):
                return

    def manoeuvre(
        self, cycle: Cycle, road: Road, options: list[Option], refused: list[Option]
    ) -> list[SeedReport]:
        """A plan to the goal along a path made for narrow places; the report, if it is sought.

        It asks for low speed and much steering: it is for when nothing else leads on.
        """
        speed, config = float(cycle.observation.state[State.V]), self.config.seed
        if not config.manoeuvre or speed > config.manoeuvre_speed:
            return []
        seeds, report = self.seeker.manoeuvre(cycle, road)
        for seed in seeds:
            if seed.reaches_goal:
                self.developer.develop(cycle, seed, options, refused)
        return [report]

    def last_moment(
        self, cycle: Cycle, road: Road, options: list[Option], refused: list[Option]
    ) -> None:
        """Plans to the goal that accelerate harder than others may.

        Were every plan allowed to, it would pay to wait until nothing else leads to the goal.
        """
        hard = in_the_last_moment(self.config)
        if hard is self.config:
            return
        seeds, _ = self.seeker.seek(cycle, road, Effort.ALWAYS, hard)
        self._develop(cycle, seeds, LAST_MOMENT, options, refused)

    def take_time(
        self, cycle: Cycle, road: Road, options: list[Option], refused: list[Option]
    ) -> None:
        """Plans that are not in haste."""
        if self.calm is self.config:
            return
        seeds, _ = self.seeker.seek(cycle, road, Effort.ALWAYS, self.calm)
        for seed in distinct(seeds, self.config.seed.finalists):
            self.calm_developer.develop(cycle, seed, options, refused)

    def _develop(
        self, cycle: Cycle, seeds: list[Seed], told: str, options: list[Option],
        refused: list[Option],
    ) -> None:  # fmt: skip
        """Develops the best seeds that reach the goal, told by a word before their source."""
        reaching = [seed for seed in seeds if seed.reaches_goal]
        for seed in distinct(reaching, self.config.seed.finalists):
            named = replace(seed, source=f"{told} {seed.source}")
            self.developer.develop(cycle, named, options, refused)
