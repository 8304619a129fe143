"""A drive whose planning cycles can be looked into: what each cycle saw, predicted and solved.

A run keeps the plans and their traces. The figures of one cycle need more: the forecast, the game
with its players, and the problems of the refinement. They are kept here by a planner that plans as
the usual one does and notes what passes by.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mpcplan.config import Config
from mpcplan.cycle import Cycle
from mpcplan.errors import InputError
from mpcplan.game.match import Played
from mpcplan.observation import Forecast, Observation
from mpcplan.plan import Plan
from mpcplan.planner import Planner
from mpcplan.refine.problem import Problem
from mpcplan.road.road import Road
from mpcplan.scenario import load
from mpcplan.simulate.loop import drive
from mpcplan.simulate.run import Run
from mpcplan.solvers.record import GOES_ON, TO_GOAL, Recorded
from mpcplan.task import Task


@dataclass(frozen=True, eq=False)
class Moment:
    """One planning cycle with what it worked with.

    Attributes:
        observation: what was seen.
        forecast: of the others.
        road: on which the cycle began.
        onward: the plan's road.
        played: the level-k game; None: it is off, or the others' motion is known.
        problems: of the refinement, in the order in which they came up.
        plan: what came of it.
        config: the planner's configuration, which differs from the run's where motion is a guess.
    """

    observation: Observation
    forecast: Forecast
    road: Road
    onward: Road
    played: Played | None
    problems: tuple[Recorded, ...]
    plan: Plan
    config: Config

    @property
    def step(self) -> int:
        """The time step at which the cycle planned."""
        return self.observation.step


@dataclass(frozen=True, eq=False)
class LookedInto:
    """A run of one planning problem and its cycles."""

    run: Run
    moments: tuple[Moment, ...]

    @property
    def problems(self) -> list[Recorded]:
        """All problems of the refinement."""
        return [problem for moment in self.moments for problem in moment.problems]

    def at(self, step: int) -> Moment:
        """The cycle whose plan was driven at a time step.

        Raises:
            InputError: no cycle planned this step.
        """
        begun = [moment for moment in self.moments if moment.step <= step]
        last = self.run.drives[0].trajectory.last_step
        if not begun or step > last:
            first = self.moments[0].step if self.moments else "none"
            raise InputError(
                f"{self.run.loaded.id}: no planning cycle at step {step}; it was driven from step "
                f"{first} to {last}"
            )
        return begun[-1]


class _Noting(Planner):
    """Plans as usual and notes every cycle."""

    def __init__(self, task: Task, config: Config, note: Callable[[Moment], None]) -> None:
        super().__init__(task, config, self._watched)
        self._note, self._problems = note, list[Recorded]()
        self._forecast: Forecast | None = None
        self._game: Played | None = None

    def _watched(self, problem: Problem, fresh: bool) -> None:
        kind = TO_GOAL if fresh else GOES_ON
        self._problems.append(Recorded(str(self.problem.id), kind, problem))

    def _play(self, cycle: Cycle) -> Played | None:
        self._forecast, self._game = cycle.forecast, super()._play(cycle)
        return self._game

    def plan(self, observation: Observation) -> Plan:
        """One planning cycle, noted."""
        self._problems, road = [], self._current_road
        plan = super().plan(observation)
        assert self._forecast is not None  # every cycle comes by
        problems = tuple(self._problems)
        self._note(
            Moment(
                observation, self._forecast, road, self._current_road, self._game, problems, plan,
                self.config,
            )
        )  # fmt: skip
        return plan


def look_into(path: str | Path, config: Config) -> LookedInto:
    """Drives a scenario and keeps its planning cycles.

    Args:
        path: the scenario, of one planning problem.
        config: with which it is driven.

    Raises:
        InputError: the scenario cannot be read, or has several planning problems.
    """
    loaded, moments = load(path), list[Moment]()
    if len(loaded.problems) > 1:
        raise InputError(f"{path}: it has several planning problems; give a scenario of one")

    def planner(task: Task, config: Config) -> Planner:
        return _Noting(task, config, moments.append)

    run = drive(loaded, config, planner=planner)
    return LookedInto(run, tuple(moments))
