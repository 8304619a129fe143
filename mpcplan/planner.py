"""The planner: one cycle as a pipeline from an observation to a verified plan.

    1. predict the others        2. project them onto the road        3. find seeds
    4. refine the best of them   5. verify                            6. fall back where needed

Order of fallbacks: the refined seed; the seed itself, driven by feedback; what is left of the last
plan; emergency braking along the lane. Each fall is in the plan's trace.
"""

from collections.abc import Callable
from dataclasses import dataclass

from mpcplan.config import Config
from mpcplan.observation import Forecast, Observation
from mpcplan.plan import Clock, Option, Plan
from mpcplan.predict.occupancy import Occupancy, occupancy
from mpcplan.predict.predictor import make_predictor
from mpcplan.refine.refine import Refined, refine
from mpcplan.road.goal import is_reached
from mpcplan.road.road import Road, build_roads
from mpcplan.seed.candidates import Effort, distinct, find_seeds
from mpcplan.seed.cost import trajectory_cost
from mpcplan.seed.seed import Seed, SeedReport, after, merged, words
from mpcplan.seed.track import frenet_states, track
from mpcplan.task import Task
from mpcplan.trajectory import Trajectory
from mpcplan.verify.guard import Guard

LAST_PLAN = "last plan"  # source of what is left of the plan before
KEPT = "last plan kept"  # source of the last plan as it was
CLEARLY_LONGER = 5  # time steps
REASONS = 3  # told in a fallback
WORTHWHILE = 0.97  # a new seed is refined beside the last plan if its cost is below this share


@dataclass(frozen=True, eq=False)
class _Cycle:
    """What one cycle works with."""

    observation: Observation
    forecast: Forecast
    clock: Clock
    notes: list[str]


class Planner:
    """Plans for one planning problem; built once, then called every cycle."""

    def __init__(self, task: Task, config: Config | None = None) -> None:
        """Builds roads and prediction.

        Raises:
            RoadError: where no route leads to the goal.
            InputError: the configured prediction is not possible.
        """
        config = config or Config()
        known = task.recorded is not None and config.predict.kind in ("auto", "recorded")
        self.config = config if known else _with_reserve(config)
        self.problem, self.dt = task.problem, task.dt
        goal = task.problem.planning_problem
        self.roads = build_roads(task.road_map, goal, self.config.road)
        self._predict = make_predictor(task, self.config.predict)
        self._guard = Guard(self.config, self.dt)
        self._last: Option | None = None
        self._driven: tuple[Trajectory, Forecast] | None = None
        self._occupancies: dict[int, tuple[Forecast, Occupancy]] = {}

    def plan(self, observation: Observation) -> Plan:
        """One planning cycle."""
        clock = Clock()
        with clock("predict"):
            forecast = self._predict(observation)
        cycle = _Cycle(observation, forecast, clock, [])
        options, reports, refusals = self._options(cycle)
        if not options:
            cycle.notes.extend(words(report) for report in reports)
        chosen, fallback = self._choose(cycle, options, refusals)
        self._last = chosen if chosen.seed is not None else None
        self._driven = chosen.trajectory, forecast
        trace = {
            "step": observation.step,
            "source": chosen.source,
            "chosen": chosen.as_dict(),
            "seeds": {r.source: r.as_dict() for r in reports},
            "refusals": "; ".join(words(report) for report in reports),
            "options": [option.as_dict() for option in options],
            "refine": chosen.refined.as_dict() if chosen.refined is not None else None,
            "verify": chosen.finding.as_dict(),
            "fallback": fallback,
            "times_ms": clock.milliseconds(),
        }
        return Plan(chosen.trajectory, chosen.source, chosen.reaches_goal, chosen.finding, trace)

    def still_safe(self, observation: Observation) -> bool:
        """Whether the plan being driven can go on until the next cycle, and be broken off there,
        at a new observation."""
        if self._driven is None:
            return False
        plan, known = self._driven
        forecast = self._predict(observation)
        if forecast is known:  # nothing new has been learnt: it was verified against just this
            return True
        if observation.step >= plan.last_step:
            return True  # nothing is left that could be unsafe; the next cycle is due anyway
        rest, road = plan.since(observation.step), self._current_road
        return self._guard.until_next(rest, road, forecast, observation.step).ok

    # -- seeds ----------------------------------------------------------------------------------

    def _options(self, cycle: _Cycle) -> tuple[list[Option], list[SeedReport], list[Option]]:
        """Verified options (best first), the seed reports, and the options that were refused."""
        options: list[Option] = []
        refused: list[Option] = []
        last = self._continue(cycle)
        if last is not None:
            self._develop(cycle, last, options, refused)
        goes_on = any(option.reaches_goal for option in options)
        seeds, reports = self._seeds(cycle, goes_on)
        if options:
            bar = WORTHWHILE * min(option.cost for option in options)
            seeds = [s for s in seeds if (s.reaches_goal or not goes_on) and s.cost < bar]
        for seed in distinct(seeds, 1 if goes_on else self.config.seed.finalists):
            self._develop(cycle, seed, options, refused)
        options.sort(key=lambda option: (not option.reaches_goal, option.cost))
        return options, reports, refused

    @property
    def _current_road(self) -> Road:
        return self._last.seed.road if self._last and self._last.seed else self.roads[0]

    def _seeds(self, cycle: _Cycle, goes_on: bool) -> tuple[list[Seed], list[SeedReport]]:
        """Seeds of the present road, and of the others where the last plan does not go on."""
        current, found = self._current_road, []
        roads = [current, *(road for road in self.roads if road is not current)]
        reports: list[SeedReport] = []
        for road in roads[: 1 if goes_on else None]:
            effort = Effort.ALWAYS if road is current else Effort.IF_NEEDED
            seen, around = cycle.observation, self._occupancy(cycle, road)
            with cycle.clock("seed"):
                seeds, told = find_seeds(
                    road, seen.state, seen.acceleration, seen.step, around, self.config, self.dt,
                    Effort.NEVER if goes_on else effort,
                )  # fmt: skip
            found += seeds
            reports += told
        found.sort(key=lambda seed: (not seed.reaches_goal, seed.cost))
        return found, merged(reports)

    def _occupancy(self, cycle: _Cycle, road: Road) -> Occupancy:
        """The forecast along a road; kept while the forecast stays the same."""
        known = self._occupancies.get(id(road))
        if known is None or known[0] is not cycle.forecast:
            with cycle.clock("project"):
                known = cycle.forecast, occupancy(cycle.forecast, road.frame)
            self._occupancies[id(road)] = known
        return known[1]

    def _continue(self, cycle: _Cycle) -> Seed | None:
        """What is left of the last plan, as a seed."""
        if self._last is None or self._last.seed is None:
            return None
        last, seed, seen = self._last, self._last.seed, cycle.observation
        if seen.step >= last.trajectory.last_step - 1:
            return None
        rest = last.trajectory.since(seen.step)
        states = frenet_states(seed.road.frame, rest, seen.acceleration)
        return Seed(
            seed.road, seen.step, states, last.cost, last.reaches_goal, LAST_PLAN, seed.label
        )

    # -- refinement and verification --------------------------------------------------------------

    def _develop(
        self, cycle: _Cycle, seed: Seed, options: list[Option], refused: list[Option]
    ) -> None:
        """Refines and verifies a seed, and falls back to the seed itself where that fails."""
        kept = self._unrefined(cycle, seed) if seed.source == LAST_PLAN else None
        ways: list[Callable[[], Option | None]] = []
        if self.config.refine.enabled:
            wider = self.config.refine.retry_margin
            ways.append(lambda: self._refined(cycle, seed, 0.0))
            ways.append(lambda: self._refined(cycle, seed, wider))
        ways.append(lambda: kept or self._unrefined(cycle, seed))
        for way in ways:
            option = way()
            if option is None:
                continue
            if kept is not None and kept.finding.ok and kept.cost <= option.cost:
                option = kept  # what was planned before is still better
            (options if option.finding.ok else refused).append(option)
            if option.finding.ok:
                return

    def _refined(self, cycle: _Cycle, seed: Seed, extra: float) -> Option | None:
        """The refined seed, with margins grown by ``extra`` metres."""
        seen = cycle.observation
        around = self._occupancy(cycle, seed.road)
        with cycle.clock("refine"):
            fresh = seed.source != LAST_PLAN
            refined = refine(
                seed, seen.state, seen.acceleration, around, self.config, self.dt, fresh,
                extra,
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
            onward = track(after(seed, count), trajectory.states[-1], self.dt)
            trajectory = trajectory.then(onward)
        return self._finish(cycle, trajectory, seed, f"{seed.source}, refined", refined)

    def _unrefined(self, cycle: _Cycle, seed: Seed) -> Option:
        """The seed driven by feedback; the last plan as it was."""
        if seed.source == LAST_PLAN and self._last is not None:
            rest = self._last.trajectory.since(cycle.observation.step)
            return self._finish(cycle, rest, seed, KEPT, None)
        with cycle.clock("track"):
            trajectory = track(seed, cycle.observation.state, self.dt)
        source = f"{seed.source}, unrefined" if self.config.refine.enabled else seed.source
        return self._finish(cycle, trajectory, seed, source, None)

    def _finish(
        self, cycle: _Cycle, trajectory: Trajectory, seed: Seed, source: str,
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
            finding = self._guard.verify(trajectory, seed.road, cycle.forecast, now)
        return Option(trajectory, seed, cost, reached is not None, finding, source, refined)

    def _cost(self, cycle: _Cycle, trajectory: Trajectory, road: Road, reaches: bool) -> float:
        """The cost of a trajectory as it would be driven."""
        seen = cycle.observation
        states = frenet_states(road.frame, trajectory, seen.acceleration)
        around = self._occupancy(cycle, road)
        return trajectory_cost(road, states, seen.step, reaches, around, self.config, self.dt)

    def _goal_step(self, trajectory: Trajectory) -> int | None:
        """The first time step at which the goal is reached."""
        goal = self.problem.planning_problem
        for step, state in zip(trajectory.steps.tolist(), trajectory.states, strict=True):
            if is_reached(goal, state, step):
                return step
        return None

    # -- choice and fallbacks ---------------------------------------------------------------------

    def _choose(
        self, cycle: _Cycle, options: list[Option], refused: list[Option]
    ) -> tuple[Option, str | None]:
        """The best option, or the next fallback with what led to it."""
        reasons = [f"{option.source}: {option.finding}" for option in refused] + cycle.notes
        if options:
            best = options[0]
            if best.source == KEPT and reasons:
                return best, _why("the last plan goes on", reasons)
            if best.source.endswith("unrefined"):
                return best, _why("the seed is driven", reasons or ["it could not be improved"])
            return best, None
        return self._fall_back(cycle, refused, reasons)

    def _fall_back(
        self, cycle: _Cycle, refused: list[Option], reasons: list[str]
    ) -> tuple[Option, str]:
        """What is driven where no plan passes: a plan that may be broken off later, or braking."""
        seen, forecast = cycle.observation, cycle.forecast
        if not forecast.exact:
            for option in sorted(refused, key=lambda o: (not o.reaches_goal, o.cost)):
                assert option.seed is not None  # only emergency braking has none
                road = option.seed.road
                if self._guard.until_next(option.trajectory, road, forecast, seen.step).ok:
                    return option, _why("a plan that can still be broken off is driven", reasons)
        road = self._current_road
        trajectory, finding = self._guard.emergency(road, seen.state, seen.step, forecast)
        stop = Option(trajectory, None, float("inf"), False, finding, "emergency braking")
        if not finding.ok and refused:
            # nothing is safe to the end: braking, unless another plan stays safe clearly longer
            last = max(refused, key=lambda o: (o.finding.step or 0, o.reaches_goal))
            if (last.finding.step or 0) >= (finding.step or 0) + CLEARLY_LONGER:
                what = "no plan is safe to its end; the one safe longest is driven"
                return last, _why(what, reasons)
        return stop, _why("emergency braking", reasons)


def _with_reserve(config: Config) -> Config:
    """The configuration for others whose motion is a guess: the last moment may be too late."""
    reserve = max(config.cost.reserve, config.predict.reserve)
    cost = config.cost.model_copy(update={"reserve": reserve})
    return config.model_copy(update={"cost": cost})


def _why(what: str, reasons: list[str]) -> str:
    """A fallback in words, with what led to it."""
    return f"{what}: " + ("; ".join(reasons[:REASONS]) or "no seed was found")
