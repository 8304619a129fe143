"""The closed loop: observe, plan, execute until the next cycle, stop at the goal.

A new plan is made every replanning interval, and at once when what is left of the present plan is
no longer safe. A drive ends at the first step at which the goal is reached, or when the last time
step of the goal has passed.
"""

import time
from collections.abc import Callable
from typing import Protocol

import numpy as np

from mpcplan.config import Config
from mpcplan.errors import MpcplanError
from mpcplan.observation import Observation, Snapshot
from mpcplan.plan import Plan
from mpcplan.planner import Planner
from mpcplan.road.goal import is_reached, last_goal_step
from mpcplan.scenario import LoadedScenario, Problem
from mpcplan.simulate.open import open_traffic
from mpcplan.simulate.run import Cycle, Drive, Run
from mpcplan.simulate.traffic import Traffic
from mpcplan.task import Task, task_of
from mpcplan.trajectory import Input, Trajectory
from mpcplan.verify.drivability import separation

Progress = Callable[[int, int], None]
HISTORY = 10  # past snapshots that an observation holds


class Driver(Protocol):
    """What the loop asks: a plan every cycle, and in between whether it still holds."""

    def plan(self, observation: Observation) -> Plan:
        """A plan from the observation's time step on."""
        ...

    def still_safe(self, observation: Observation) -> bool:
        """Whether what is left of the last plan may go on."""
        ...


MakeDriver = Callable[[Task, Config], Driver]


def drive(
    loaded: LoadedScenario,
    config: Config | None = None,
    progress: Progress | None = None,
    planner: MakeDriver = Planner,
) -> Run:
    """Drives every planning problem of a scenario in closed loop.

    Args:
        loaded: the scenario.
        config: the configuration; None: the defaults.
        progress: called with (time step, last time step) after every cycle.
        planner: makes what plans.
    """
    config = config or Config()
    drives = [_drive(loaded, problem, config, progress, planner) for problem in loaded.problems]
    return Run(loaded, config, tuple(drives))


def _drive(
    loaded: LoadedScenario,
    problem: Problem,
    config: Config,
    progress: Progress | None,
    planner: MakeDriver,
) -> Drive:
    start = Trajectory(
        problem.first_step, problem.start[None, :].copy(), np.empty((0, len(Input))), loaded.dt
    )
    try:
        driver = planner(task_of(loaded, problem), config)
        traffic = open_traffic(loaded, problem)
    except MpcplanError as error:
        return Drive(problem.id, start, None, str(error), (), False)
    try:
        return _Loop(problem, driver, traffic, config, loaded.dt).run(start, progress)
    finally:
        traffic.close()


class _Loop:
    """One drive in the making."""

    def __init__(
        self, problem: Problem, driver: Driver, traffic: Traffic, config: Config, dt: float
    ) -> None:
        self._problem, self._driver, self._traffic = problem, driver, traffic
        self._every = max(round(config.drive.replan / dt), 1)
        last = last_goal_step(problem.planning_problem)
        self._end = min(last, problem.first_step + config.drive.steps_max)
        self._step_seconds: list[float] = []

    def run(self, driven: Trajectory, progress: Progress | None) -> Drive:
        """Drives until the goal, the end of time, a collision or a failure."""
        cycles: list[Cycle] = []
        while True:
            reached = self._reached(driven)
            if reached is not None:
                return self._ended(driven.until(reached), cycles, reached)
            if driven.last_step >= self._end or self._hit(driven):
                return self._ended(driven, cycles, None)
            try:
                cycles.append(self._cycle(driven))
                driven = self._execute(driven, cycles[-1])
            except MpcplanError as error:
                return self._ended(driven, cycles, None, str(error))
            if progress is not None:
                progress(driven.last_step, self._end)

    def _cycle(self, driven: Trajectory) -> Cycle:
        """One planning cycle at the end of what was driven."""
        seen = self._observe(driven)
        start = time.perf_counter()
        plan = self._driver.plan(seen)
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
        every = min(self._every, cycle.plan.hold or self._every)
        last = first + min(every, len(plan.inputs), self._end - first)
        for step in range(first + 1, last + 1):
            driven = driven.then(plan.since(step - 1).until(step))
            self._advance(driven)
            if step < last and not self._driver.still_safe(self._observe(driven)):
                break
        return driven

    def _advance(self, driven: Trajectory) -> None:
        """The others' next time step, beside the ego's."""
        start = time.perf_counter()
        self._traffic.advance(driven.last_step, driven.states[-1])
        self._step_seconds.append(time.perf_counter() - start)

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

    def _ended(
        self, driven: Trajectory, cycles: list[Cycle], reached: int | None, failure: str = ""
    ) -> Drive:
        hit = reached is None and self._hit(driven)
        cause = "" if reached is not None else failure or self._cause(driven, cycles, hit)
        others: tuple[Snapshot, ...] = tuple(
            self._traffic.at(step) for step in range(driven.first_step, driven.last_step + 1)
        )
        return Drive(
            self._problem.id, driven, reached, cause, tuple(cycles), hit,
            others, self._traffic.notes, np.array(self._step_seconds),
        )  # fmt: skip

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
