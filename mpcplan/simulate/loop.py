"""The closed loop: observe, plan, execute until the next cycle, stop at the goal.

A new plan is made every replanning interval, and at once when what is left of the present plan is
no longer safe. A drive ends at the first step at which the goal is reached, or when the last time
step of the goal has passed.
"""

import time
from collections.abc import Callable

import numpy as np

from mpcplan.config import Config
from mpcplan.errors import RoadError
from mpcplan.observation import Observation
from mpcplan.planner import Planner
from mpcplan.road.goal import is_reached
from mpcplan.scenario import LoadedScenario, Problem
from mpcplan.simulate.recorded import RecordedTraffic
from mpcplan.simulate.run import Cycle, Drive, Run
from mpcplan.trajectory import Input, Trajectory
from mpcplan.verify.drivability import separation

Progress = Callable[[int, int], None]
HISTORY = 10  # past snapshots that an observation holds


def drive(
    loaded: LoadedScenario, config: Config | None = None, progress: Progress | None = None
) -> Run:
    """Drives every planning problem of a scenario in closed loop.

    Args:
        loaded: the scenario.
        config: the configuration; None: the defaults.
        progress: called with (time step, last time step) after every cycle.
    """
    config = config or Config()
    drives = [_drive(loaded, problem, config, progress) for problem in loaded.problems]
    return Run(loaded, config, tuple(drives))


def _drive(
    loaded: LoadedScenario, problem: Problem, config: Config, progress: Progress | None
) -> Drive:
    start = Trajectory(
        problem.first_step, problem.start[None, :].copy(), np.empty((0, len(Input))), loaded.dt
    )
    try:
        planner = Planner(loaded, problem, config)
    except RoadError as error:
        return Drive(problem.id, start, None, str(error), (), False)
    return _Loop(loaded, problem, planner, config).run(start, progress)


class _Loop:
    """One drive in the making."""

    def __init__(
        self, loaded: LoadedScenario, problem: Problem, planner: Planner, config: Config
    ) -> None:
        self._traffic = RecordedTraffic(loaded.scenario)
        self._problem, self._planner, self._config = problem, planner, config
        self._every = max(round(config.drive.replan / loaded.dt), 1)
        last = max(road.last_step for road in planner.roads)
        self._end = min(last, problem.first_step + config.drive.steps_max)

    def run(self, driven: Trajectory, progress: Progress | None) -> Drive:
        """Drives until the goal, the end of time or a collision."""
        cycles: list[Cycle] = []
        while True:
            reached = self._reached(driven)
            if reached is not None:
                return self._ended(driven.until(reached), cycles, reached)
            if driven.last_step >= self._end or self._hit(driven):
                return self._ended(driven, cycles, None)
            cycles.append(self._cycle(driven))
            driven = self._execute(driven, cycles[-1])
            if progress is not None:
                progress(driven.last_step, self._end)

    def _cycle(self, driven: Trajectory) -> Cycle:
        """One planning cycle at the end of what was driven."""
        seen = self._observe(driven)
        start = time.perf_counter()
        plan = self._planner.plan(seen)
        return Cycle(driven.last_step, plan, time.perf_counter() - start)

    def _observe(self, driven: Trajectory) -> Observation:
        """What the planner may know at the end of what was driven."""
        before = float(driven.inputs[-1, Input.A]) if len(driven.inputs) else 0.0
        first = max(driven.first_step, driven.last_step - HISTORY)
        others = tuple(self._traffic.at(step) for step in range(first, driven.last_step + 1))
        return Observation(driven.last_step, driven.states[-1], before, others)

    def _execute(self, driven: Trajectory, cycle: Cycle) -> Trajectory:
        """The plan's first steps added to what was driven, up to the first surprise."""
        plan = cycle.plan.trajectory
        if len(plan.inputs) == 0:  # at rest with nothing planned: wait a step
            plan = Trajectory(
                plan.first_step, np.repeat(plan.states, 2, axis=0), np.zeros((1, 2)), plan.dt
            )
        first = driven.last_step
        last = first + min(self._every, len(plan.inputs), self._end - first)
        for step in range(first + 1, last + 1):
            driven = driven.then(plan.since(step - 1).until(step))
            if step < last and not self._planner.still_safe(self._observe(driven)):
                break
        return driven

    def _reached(self, driven: Trajectory) -> int | None:
        """The first of the last executed steps that lies in the goal."""
        since = max(driven.first_step, driven.last_step - self._every)
        for step in range(since, driven.last_step + 1):
            if is_reached(self._problem.planning_problem, driven.state_at(step), step):
                return step
        return None

    def _hit(self, driven: Trajectory) -> bool:
        """Whether the body overlaps anybody in the last executed steps."""
        since = max(driven.first_step, driven.last_step - self._every)
        for step in range(since, driven.last_step + 1):
            boxes = self._traffic.at(step).boxes
            if len(boxes) and separation(driven.state_at(step)[None], boxes[:, None]).min() < 0:
                return True
        return False

    def _ended(self, driven: Trajectory, cycles: list[Cycle], reached: int | None) -> Drive:
        hit = reached is None and self._hit(driven)
        cause = "" if reached is not None else self._cause(driven, cycles, hit)
        return Drive(self._problem.id, driven, reached, cause, tuple(cycles), hit)

    def _cause(self, driven: Trajectory, cycles: list[Cycle], hit: bool) -> str:
        """Why the goal was not reached, in a sentence."""
        what = "collided" if hit else "the goal was not reached"
        cause = f"{what} at step {driven.last_step}"
        falls = [(c.step, c.plan.trace["fallback"]) for c in cycles if c.plan.trace["fallback"]]
        if falls:
            cause += f"; first fallback at step {falls[0][0]}: {falls[0][1]}"
        elif cycles and not cycles[-1].plan.reaches_goal:
            cause += f"; no plan reached the goal: {cycles[0].plan.trace['refusals']}"
        return cause
