"""The planner: one cycle as a pipeline from an observation to a verified plan.

    1. predict the others        2. build the roads anew (if asked for, where the lane is another)
    3. play the level-k game (if asked for)        4. find seeds        5. refine the best of them
    6. verify                    7. fall back where needed

Order of fallbacks: the refined seed; the seed itself, driven by feedback; what is left of the last
plan; where the others' motion is a guess, a refused plan that can still be broken off later, or
that trusts who follows; emergency braking along the lane. Each fall is in the plan's trace.
"""

from mpcplan.choice import choose
from mpcplan.config import Config
from mpcplan.cycle import Cycle
from mpcplan.develop import LAST_PLAN, Developer
from mpcplan.game.match import Match, Played
from mpcplan.guessing import for_guesses, without_haste
from mpcplan.observation import Forecast, Observation
from mpcplan.plan import Clock, Option, Plan
from mpcplan.predict.occupancy import Occupancy
from mpcplan.predict.predictor import make_predictor
from mpcplan.reassociate import Reassociation, planned_roads
from mpcplan.refine.refine import Watch
from mpcplan.risk import risks
from mpcplan.road.association import Judgement
from mpcplan.road.road import Road
from mpcplan.seed.candidates import Effort, distinct
from mpcplan.seed.level_k import LEVEL_K
from mpcplan.seed.seed import Seed, SeedReport, merged, words
from mpcplan.seed.track import frenet_states
from mpcplan.seeking import Resorts, Seeker
from mpcplan.task import Task
from mpcplan.trajectory import Trajectory
from mpcplan.verify.guard import Guard
from mpcplan.witness import Witness

RISEN = 2.0  # of cost, since the plan was decided on
WORTHWHILE = 0.97  # a new seed is refined beside the last plan if its cost is below this share


class Planner:
    """Plans for one planning problem; built once, then called every cycle."""

    def __init__(
        self, task: Task, config: Config | None = None, watch: Watch | None = None,
        witness: Witness | None = None,
    ) -> None:  # fmt: skip
        """Builds roads and prediction.

        Args:
            task: what is to be planned.
            config: the configuration; None: the defaults.
            watch: is shown every problem of the refinement.
            witness: is shown what every cycle considers.

        Raises:
            RoadError: where no route leads to the goal.
            InputError: the configured prediction is not possible.
        """
        config = config or Config()
        known = task.recorded is not None and config.predict.kind in ("auto", "recorded")
        self.config = config if known else for_guesses(config)
        self.problem, self.dt = task.problem, task.dt
        goal = task.problem.planning_problem
        self.roads = planned_roads(task.road_map, goal, self.config)
        anew = self.config.association.enabled
        self._anew = Reassociation(task.road_map, goal, self.config) if anew else None
        self._predict = make_predictor(task, self.config.predict)
        self._guard = Guard(self.config, self.dt)
        self._developer = Developer(goal, self._guard, self.config, self.dt, watch)
        calm = without_haste(self.config)
        self._seeker = Seeker(self.config, self.dt, witness)
        self._resorts = Resorts(
            self.config, calm, self._seeker, self._guard, self._developer,
            Developer(goal, self._guard, calm, self.dt, watch), self.dt,
        )  # fmt: skip
        plays = self.config.game.enabled and not known
        network = task.road_map.lanelet_network
        self._witness = witness
        self._match = Match(network, self.config, self.dt) if plays else None
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
        association = self._reassociate(cycle)
        played = self._play(cycle)
        options, reports, refusals = self._options(cycle, played)
        if not options:
            cycle.notes.extend(words(report) for report in reports)
        road = self._current_road
        chosen, fallback = choose(cycle, self._guard, road, options, refusals)
        if self._last is None or chosen.seed is None or not chosen.source.startswith(LAST_PLAN):
            self._decided = chosen.cost
        self._last = chosen if chosen.seed is not None else None
        self._driven = chosen.trajectory, forecast
        if self._witness is not None:
            self._witness.chose(cycle, chosen, options, refusals)
        risks_now = self._risks(cycle)
        trace = {
            "step": observation.step,
            "source": chosen.source,
            "chosen": chosen.as_dict(),
            "association": association.as_dict() if association is not None else None,
            "game": played.as_dict() if played is not None else None,
            "seeds": {r.source: r.as_dict() for r in reports},
            "refusals": "; ".join(words(report) for report in reports),
            "options": [option.as_dict() for option in options],
            "refine": chosen.refined.as_dict() if chosen.refined is not None else None,
            "verify": chosen.finding.as_dict(),
            "fallback": fallback,
            "risks": list(risks_now),
            "times_ms": clock.milliseconds(),
        }
        hold = round(self.config.risk.replan / self.dt) if risks_now else None
        return Plan(
            chosen.trajectory, chosen.source, chosen.reaches_goal, chosen.finding, trace, hold
        )

    def _reassociate(self, cycle: Cycle) -> Judgement | None:
        """The roads built anew where the ego vehicle has come into another lane, if asked for."""
        if self._anew is None:
            return None
        found = self._anew.look(cycle, self._current_road, self._last)
        if found.roads is not None:
            self.roads, self._last = found.roads, found.last
            self._occupancies.clear()  # known by the roads' identity, which may come again
        return found.told

    def _risks(self, cycle: Cycle) -> tuple[str, ...]:
        """Why the next plan is due sooner than usual; nothing where it is not."""
        if self.config.risk.replan >= self.config.drive.replan:
            return ()
        road = self._current_road
        return risks(road, cycle.observation, cycle.around(road), self.config.risk)

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

    def _play(self, cycle: Cycle) -> Played | None:
        """The level-k game on the present road, where it is asked for."""
        if self._match is None:
            return None
        with cycle.clock("game"):
            return self._match.play(cycle.observation, self._current_road)

    def _options(
        self, cycle: Cycle, played: Played | None
    ) -> tuple[list[Option], list[SeedReport], list[Option]]:
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
        seeds, reports = self._seeds(cycle, goes_on, worse, played)
        if options:
            bar = WORTHWHILE * min(option.cost for option in options)
            seeds = [s for s in seeds if (s.reaches_goal or not goes_on) and s.cost < bar]
        road = self._current_road
        if not goes_on and not any(seed.reaches_goal for seed in seeds):
            self._resorts.hope(cycle, road, options, refused)
        if goes_on or not any(option.reaches_goal for option in options):
            finalists = distinct(seeds, 1 if goes_on else self.config.seed.finalists)
            decided = [seed for seed in seeds if seed.source == LEVEL_K and seed not in finalists]
            for seed in finalists + decided:
                self._developer.develop(cycle, seed, options, refused)
        if not any(option.reaches_goal for option in options):
            reports += self._resorts.manoeuvre(cycle, road, options, refused)
        if not any(option.reaches_goal for option in options):
            self._resorts.last_moment(cycle, road, options, refused)
        if not options:
            self._resorts.take_time(cycle, road, options, refused)
        options.sort(key=lambda option: (not option.reaches_goal, option.cost))
        return options, reports, refused

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
        self, cycle: Cycle, goes_on: bool, worse: bool, played: Played | None
    ) -> tuple[list[Seed], list[SeedReport]]:
        """Seeds of the present road, and of the others where the last plan does not go on."""
        current, found = self._current_road, []
        roads = [current, *(road for road in self.roads if road is not current)]
        reports: list[SeedReport] = []
        for road in roads[: 1 if goes_on else None]:
            effort = Effort.ALWAYS if road is current else Effort.IF_NEEDED
            if goes_on:
                effort = Effort.PLAIN if worse else Effort.NEVER
            decision = played.decision if played is not None and road is current else None
            seeds, told = self._seeker.seek(cycle, road, effort, decision=decision)
            found += seeds
            reports += told
        found.sort(key=lambda seed: (not seed.reaches_goal, seed.cost))
        return found, merged(reports)

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
