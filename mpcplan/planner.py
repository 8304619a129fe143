"""The planner: one cycle as a pipeline from an observation to a verified plan.

    1. predict the others        2. project them onto the road        3. find seeds
    4. refine the best of them   5. verify                            6. fall back where needed

Order of fallbacks: the refined seed; the seed itself, driven by feedback; what is left of the last
plan; where the others' motion is a guess, a refused plan that can still be broken off later, or
that trusts who follows; emergency braking along the lane. Each fall is in the plan's trace.
"""

from dataclasses import replace
from functools import partial

from mpcplan.config import Config
from mpcplan.cycle import Cycle
from mpcplan.develop import KEPT, LAST_PLAN, Developer
from mpcplan.observation import Forecast, Observation
from mpcplan.plan import Clock, Option, Plan
from mpcplan.predict.occupancy import Occupancy
from mpcplan.predict.predictor import make_predictor
from mpcplan.refine.refine import Watch
from mpcplan.road.road import Road, build_roads, with_strips
from mpcplan.seed.candidates import Effort, distinct, find_seeds
from mpcplan.seed.seed import Seed, SeedReport, merged, words
from mpcplan.seed.track import frenet_states
from mpcplan.task import Task
from mpcplan.trajectory import Trajectory
from mpcplan.verify.guard import Guard

HOPEFUL = "hopeful"  # before the source of a plan that counts on the others' making way
CLEARLY_LONGER = 5  # time steps
RISEN = 2.0  # of cost, since the plan was decided on
REASONS = 3  # told in a fallback
WORTHWHILE = 0.97  # a new seed is refined beside the last plan if its cost is below this share


class Planner:
    """Plans for one planning problem; built once, then called every cycle."""

    def __init__(
        self, task: Task, config: Config | None = None, watch: Watch | None = None
    ) -> None:
        """Builds roads and prediction.

        Args:
            task: what is to be planned.
            config: the configuration; None: the defaults.
            watch: is shown every problem of the refinement.

        Raises:
            RoadError: where no route leads to the goal.
            InputError: the configured prediction is not possible.
        """
        config = config or Config()
        known = task.recorded is not None and config.predict.kind in ("auto", "recorded")
        self.config = config if known else _for_guesses(config)
        self._calm = _without_haste(self.config)
        self.problem, self.dt = task.problem, task.dt
        goal = task.problem.planning_problem
        self.roads = build_roads(task.road_map, goal, self.config.road)
        if self.config.cost.safe_distance > 0 or self.config.cost.traffic_flow > 0:
            roads = (with_strips(road, task.road_map, self.config) for road in self.roads)
            self.roads = tuple(roads)
        self._predict = make_predictor(task, self.config.predict)
        self._guard = Guard(self.config, self.dt)
        self._developer = Developer(goal, self._guard, self.config, self.dt, watch)
        self._calm_developer = Developer(goal, self._guard, self._calm, self.dt, watch)
        self._last: Option | None = None
        self._decided = float("inf")  # what the last plan was expected to cost
        self._driven: tuple[Trajectory, Forecast] | None = None
        self._occupancies: dict[int, tuple[Forecast, Occupancy]] = {}

    def plan(self, observation: Observation) -> Plan:
        """One planning cycle."""
        clock = Clock()
        with clock("predict"):
            forecast = self._predict(observation)
        cycle = Cycle(observation, forecast, clock, [], self._occupancies)
        options, reports, refusals = self._options(cycle)
        if not options:
            cycle.notes.extend(words(report) for report in reports)
        chosen, fallback = self._choose(cycle, options, refusals)
        if self._last is None or chosen.seed is None or not chosen.source.startswith(LAST_PLAN):
            self._decided = chosen.cost
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

    def _options(self, cycle: Cycle) -> tuple[list[Option], list[SeedReport], list[Option]]:
        """Verified options (best first), the seed reports, and the options that were refused."""
        options: list[Option] = []
        refused: list[Option] = []
        last = self._continue(cycle)
        if last is not None:
            seed, rest, settled = last
            self._developer.develop(cycle, seed, options, refused, rest, settled)
        goes_on = any(option.reaches_goal for option in options)
        if cycle.forecast.exact and any(o.reaches_goal and o.settled for o in options):
            return options, [], refused  # nothing new can be learnt, and nothing more be gained
        worse = goes_on and self._has_become_worse(cycle, options)
        seeds, reports = self._seeds(cycle, goes_on, worse)
        if options:
            bar = WORTHWHILE * min(option.cost for option in options)
            seeds = [s for s in seeds if (s.reaches_goal or not goes_on) and s.cost < bar]
        if not goes_on and not any(seed.reaches_goal for seed in seeds):
            self._hope(cycle, options, refused)
        if goes_on or not any(option.reaches_goal for option in options):
            for seed in distinct(seeds, 1 if goes_on else self.config.seed.finalists):
                self._developer.develop(cycle, seed, options, refused)
        if not options and self._calm is not self.config:
            self._take_time(cycle, options, refused)
        options.sort(key=lambda option: (not option.reaches_goal, option.cost))
        return options, reports, refused

    def _take_time(self, cycle: Cycle, options: list[Option], refused: list[Option]) -> None:
        """Adds plans that are not in haste, where none passes that is."""
        seeds, _ = self._seeds_of(cycle, self._current_road, Effort.ALWAYS, self._calm)
        for seed in distinct(seeds, self.config.seed.finalists):
            self._calm_developer.develop(cycle, seed, options, refused)

    def _hope(self, cycle: Cycle, options: list[Option], refused: list[Option]) -> None:
        """Adds plans to the goal that count on the others' making way later than is verified.

        A guess that far ahead is no reason to give up the goal: who waits far from a crossing
        until the whole way is predicted to be free may wait for ever.
        """
        levels = () if cycle.forecast.exact else self.config.predict.hope
        for later in levels:
            hopeful = replace(cycle, certain=self._guard.certain + round(later / self.dt))
            seeds, _ = self._seeds_of(hopeful, self._current_road, Effort.PLAIN)
            reaching = [seed for seed in seeds if seed.reaches_goal]
            for seed in distinct(reaching, self.config.seed.finalists):
                told = replace(seed, source=f"{HOPEFUL} {seed.source}")
                self._developer.develop(hopeful, told, options, refused)
            if any(option.reaches_goal for option in options):
                return

    @property
    def _current_road(self) -> Road:
        return self._last.seed.road if self._last and self._last.seed else self.roads[0]

    def _has_become_worse(self, cycle: Cycle, options: list[Option]) -> bool:
        """Whether a plan that was decided on turns out much dearer than it was, since the others
        do not drive as they were guessed to: then it is time to look at all the ways again."""
        now = min(option.cost for option in options)
        if cycle.forecast.exact or now <= self._decided + RISEN:
            self._decided = min(self._decided, now)
            return False
        self._decided = now
        return True

    def _seeds(
        self, cycle: Cycle, goes_on: bool, worse: bool = False
    ) -> tuple[list[Seed], list[SeedReport]]:
        """Seeds of the present road, and of the others where the last plan does not go on."""
        current, found = self._current_road, []
        roads = [current, *(road for road in self.roads if road is not current)]
        reports: list[SeedReport] = []
        for road in roads[: 1 if goes_on else None]:
            effort = Effort.ALWAYS if road is current else Effort.IF_NEEDED
            if goes_on:
                effort = Effort.PLAIN if worse else Effort.NEVER
            seeds, told = self._seeds_of(cycle, road, effort)
            found += seeds
            reports += told
        found.sort(key=lambda seed: (not seed.reaches_goal, seed.cost))
        return found, merged(reports)

    def _seeds_of(
        self, cycle: Cycle, road: Road, effort: Effort, config: Config | None = None
    ) -> tuple[list[Seed], list[SeedReport]]:
        """Seeds of one road, with the planner's configuration or another one."""
        seen, around = cycle.observation, cycle.around(road)
        with cycle.clock("seed"):
            return find_seeds(
                road, seen.state, seen.acceleration, seen.step, around, config or self.config,
                self.dt, effort,
            )  # fmt: skip

    def _continue(self, cycle: Cycle) -> tuple[Seed, Trajectory, bool] | None:
        """What is left of the last plan, as a seed and as it was, and whether it has settled."""
        if self._last is None or self._last.seed is None:
            return None
        last, seed, seen = self._last, self._last.seed, cycle.observation
        if seen.step >= last.trajectory.last_step:
            return None
        rest = last.trajectory.since(seen.step)
        states = frenet_states(seed.road.frame, rest, seen.acceleration)
        again = Seed(
            seed.road, seen.step, states, last.cost, last.reaches_goal, LAST_PLAN, seed.label
        )
        return again, rest, last.settled or not last.reaches_goal

    # -- choice and fallbacks ---------------------------------------------------------------------

    def _choose(
        self, cycle: Cycle, options: list[Option], refused: list[Option]
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
        self, cycle: Cycle, refused: list[Option], reasons: list[str]
    ) -> tuple[Option, str]:
        """What is driven where no plan passes: one that may be broken off later, one that trusts
        who follows, or braking."""
        seen, forecast, guard = cycle.observation, cycle.forecast, self._guard
        if not forecast.exact:
            best = sorted(refused, key=lambda o: (not o.reaches_goal, o.cost))
            for what, passes in (
                ("a plan that can still be broken off is driven", guard.until_next),
                ("a plan that trusts who follows is driven", partial(guard.verify, trusting=True)),
            ):
                for option in best:
                    assert option.seed is not None  # only emergency braking has none
                    if passes(option.trajectory, option.seed.road, forecast, seen.step).ok:
                        return option, _why(what, reasons)
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


def _for_guesses(config: Config) -> Config:
    """The configuration for others whose motion is a guess: the last moment may be too late, and
    what counts on their motion far ahead (later lane changes, further routes, the jerk at the
    drive's end) is not worth it."""
    reserve = max(config.cost.reserve, config.predict.reserve)
    haste = max(config.cost.haste, config.predict.haste)
    cost = config.cost.model_copy(update={"reserve": reserve, "haste": haste, "edges": False})
    variants = min(config.road.variants, config.predict.variants)
    changes = {
        "cost": cost,
        "road": config.road.model_copy(update={"variants": variants}),
        "seed": config.seed.model_copy(update={"delays": (), "shortest": False}),
    }
    return config.model_copy(update=changes)


def _without_haste(config: Config) -> Config:
    """The same configuration without haste; itself where there is none."""
    if not config.cost.haste:
        return config
    return config.model_copy(update={"cost": config.cost.model_copy(update={"haste": 0.0})})


def _why(what: str, reasons: list[str]) -> str:
    """A fallback in words, with what led to it."""
    return f"{what}: " + ("; ".join(reasons[:REASONS]) or "no seed was found")
