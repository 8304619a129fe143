"""From a seed to an option: refined or driven by feedback, ended, judged and verified."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from commonroad.planning.planning_problem import PlanningProblem

from mpcplan.config import Config
from mpcplan.cycle import Cycle
from mpcplan.plan import Option
from mpcplan.refine.corridor import different_asides
from mpcplan.refine.refine import Refined, Watch, refine
from mpcplan.road.goal import is_reached
from mpcplan.road.road import Road
from mpcplan.seed.cost import trajectory_cost
from mpcplan.seed.seed import Seed, after
from mpcplan.seed.track import frenet_states, track
from mpcplan.trajectory import Trajectory
from mpcplan.verify.guard import Guard

LAST_PLAN = "last plan"  # source of what is left of the plan before
KEPT = "last plan kept"  # source of the last plan as it was


class Developer:
    """Makes options of seeds; see the module."""

    def __init__(
        self, goal: PlanningProblem, guard: Guard, config: Config, dt: float,
        watch: Watch | None = None,
    ) -> None:  # fmt: skip
        self._goal, self._guard, self._config, self._dt = goal, guard, config, dt
        self._watch = watch

    def develop(
        self, cycle: Cycle, seed: Seed, options: list[Option], refused: list[Option],
        last: Trajectory | None = None, settled: bool = True,
    ) -> None:  # fmt: skip
        """Refines and verifies a seed, and falls back to the seed itself where that fails.

        Args:
            cycle: the present one.
            seed: to be developed.
            options: gains the option that passes verification.
            refused: gains those that do not.
            last: what is left of the last plan, where the seed is that.
            settled: whether that is known to gain no more the whole way to the goal.
        """
        cycle = self._answered(cycle, seed, last)
        whole = last is None or not settled
        kept = self._finish(cycle, last, seed, KEPT, None) if last is not None else None
        ways: list[Callable[[], Option | None]] = []
        if self._config.refine.enabled:
            ways.append(lambda: self._best_refined(cycle, seed, whole))
            ways += [
                partial(self._refined, cycle, seed, wider, whole)
                for wider in self._config.refine.retry_margins
            ]
        ways.append(lambda: kept or self._unrefined(cycle, seed))
        for way in ways:
            option = way()
            if option is None and cycle.forecast.exact and kept is not None and kept.finding.ok:
                option = kept  # nothing was gained, and wider margins gain less
            if option is None:
                continue
            if cycle.forecast.exact:  # what is guessed far ahead is not worth it
                option = replace(option, settled=self._settled(option, kept, settled))
            if kept is not None and kept.finding.ok and kept.cost <= option.cost:
                option = kept  # what was planned before is still better
            (options if option.finding.ok else refused).append(option)
            if option.finding.ok:
                return

    def _answered(self, cycle: Cycle, seed: Seed, last: Trajectory | None) -> Cycle:
        """The cycle as it is if a seed is driven, or what is left of the last plan."""
        if not self._config.verify.held or cycle.forecast.exact:
            return cycle
        plan = last if last is not None else track(seed, cycle.observation.state, self._dt)
        forecast = self._guard.answer(cycle.forecast, plan)
        if forecast is cycle.forecast:
            return cycle
        return replace(cycle, forecast=forecast, projected={}, made=cycle.forecast)

    def _settled(self, option: Option, kept: Option | None, settled: bool) -> bool:
        """Whether the whole way to the goal need not be refined again in the next cycle."""
        if kept is None:  # a fresh seed: its corridor is made anew at least once
            return option.refined is None or self._config.refine.settle >= 1
        return settled or kept.cost - option.cost <= self._config.refine.settle * kept.cost

    def _best_refined(self, cycle: Cycle, seed: Seed, whole: bool) -> Option | None:
        """The refined seed; where all is known and it is refined the whole way, the best of those
        that count different vehicles as ahead."""
        if not (cycle.forecast.exact and whole):
            return self._refined(cycle, seed, 0.0, whole)
        asides = different_asides(seed, cycle.around(seed.road), self._config)
        tried = [self._refined(cycle, seed, 0.0, whole, aside) for aside in asides]
        found = [option for option in tried if option is not None]
        return min(
            found, key=lambda o: (not o.finding.ok, not o.reaches_goal, o.cost), default=None
        )

    def _refined(
        self, cycle: Cycle, seed: Seed, extra: float, whole: bool, aside: float | None = None
    ) -> Option | None:
        """The refined seed, with margins grown by ``extra`` metres."""
        seen = cycle.observation
        around = cycle.around(seed.road)
        with cycle.clock("refine"):
            refined = refine(
                seed, seen.state, seen.acceleration, around, self._config, self._dt, whole, extra,
                self._watch, aside,
            )  # fmt: skip
        if refined is None:
            return None
        if refined.result.failed and refined.result.gained <= 0.0:
            cycle.notes.append(f"{seed.source}: {refined.result.status}")
            return None
        if refined.result.gained <= 0.0 and extra == 0.0:
            return None
        trajectory, count = refined.trajectory, len(refined.trajectory.inputs)
        if count < len(seed.states) - 1:  # the problem ends before the seed: the seed goes on
            onward = track(after(seed, count), trajectory.states[-1], self._dt)
            trajectory = trajectory.then(onward)
        return self._finish(cycle, trajectory, seed, f"{seed.source}, refined", refined)

    def _unrefined(self, cycle: Cycle, seed: Seed) -> Option:
        """The seed driven by feedback."""
        with cycle.clock("track"):
            trajectory = track(seed, cycle.observation.state, self._dt)
        source = f"{seed.source}, unrefined" if self._config.refine.enabled else seed.source
        return self._finish(cycle, trajectory, seed, source, None)

    def _finish(
        self, cycle: Cycle, trajectory: Trajectory, seed: Seed, source: str,
        refined: Refined | None,
    ) -> Option:  # fmt: skip
        """The trajectory ended at the goal, or with a fail-safe tail; judged and verified."""
        with cycle.clock("verify"):
            reached = self._goal_step(trajectory) if seed.reaches_goal else None
            if reached is not None:
                trajectory = trajectory.until(reached)
            cost = self._cost(cycle, trajectory, seed.road, reached is not None)
            if reached is None:
                trajectory = trajectory.then(self._guard.tail(seed.road, trajectory))
            now = cycle.observation.step
            finding = self._guard.verify(trajectory, seed.road, cycle.made or cycle.forecast, now)
        return Option(trajectory, seed, cost, reached is not None, finding, source, refined)

    def _cost(self, cycle: Cycle, trajectory: Trajectory, road: Road, reaches: bool) -> float:
        """The cost of a trajectory as it would be driven."""
        seen = cycle.observation
        states = frenet_states(road.frame, trajectory, seen.acceleration)
        around = cycle.around(road)
        return trajectory_cost(
            road, states, seen.step, reaches, around, self._config, self._dt, cycle.forecast.exact
        )

    def _goal_step(self, trajectory: Trajectory) -> int | None:
        """The first time step at which the goal is reached."""
        for step, state in zip(trajectory.steps.tolist(), trajectory.states, strict=True):
            if is_reached(self._goal, state, step):
                return step
        return None
