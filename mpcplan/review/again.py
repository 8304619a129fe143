"""The run of a trace and a solution, as the closed loop once answered it."""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from mpcplan.config import Config
from mpcplan.errors import ConfigError, InputError
from mpcplan.plan import Plan
from mpcplan.review.files import RunFiles
from mpcplan.scenario import LoadedScenario, Problem
from mpcplan.score.solution_file import read_solution
from mpcplan.simulate.recorded import RecordedTraffic
from mpcplan.simulate.run import Cycle, Drive, Run
from mpcplan.trajectory import Input, State, Trajectory
from mpcplan.vehicle import FORD_ESCORT
from mpcplan.verify.drivability import PASSED


def run_again(files: RunFiles) -> Run:
    """What was driven. The plans are as long as they were driven: more is not in the files.

    Raises:
        InputError: the solution is broken, or of another run.
        ConfigError: the trace's configuration is none of this version.
    """
    loaded, trace = files.loaded, files.trace
    driven = _trajectories(files.solution, loaded) if files.solution is not None else {}
    problems = {problem.id: problem for problem in loaded.problems}
    drives = []
    for told in trace["drives"]:
        problem = problems.get(told.get("problem"))
        if problem is None:
            raise InputError(
                f"{loaded.path} has no planning problem {told.get('problem')}, which the trace of "
                f"{trace.get('scenario')} tells of"
            )
        drives.append(_drive(told, problem, driven.get(problem.id), files))
    return Run(loaded, config_of(trace), tuple(drives))


def config_of(trace: Mapping[str, Any]) -> Config:
    """The configuration of a run.

    Raises:
        ConfigError: it is none of this version.
    """
    try:
        return Config.model_validate(trace.get("config", {}))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ConfigError(
            f"the configuration in the trace of {trace.get('scenario')} is of another version: "
            f"{where}: {first['msg']}; solve the scenario again"
        ) from error


def _trajectories(solution: Path, loaded: LoadedScenario) -> dict[int, Trajectory]:
    """What was driven by planning problem, at the rear axle in local coordinates."""
    found = {}
    for part in read_solution(solution).planning_problem_solutions:
        states = part.trajectory.state_list
        x = np.zeros((len(states), len(State)))
        x[:, State.PSI] = [s.orientation for s in states]
        x[:, State.DELTA] = [s.steering_angle for s in states]
        x[:, State.V] = [s.velocity for s in states]
        heading = np.column_stack([np.cos(x[:, State.PSI]), np.sin(x[:, State.PSI])])
        centre = np.array([s.position for s in states]) - loaded.origin
        x[:, [State.X, State.Y]] = centre - FORD_ESCORT.rear_to_centre * heading
        inputs = np.zeros((len(states) - 1, len(Input)))
        inputs[:, Input.A] = np.diff(x[:, State.V]) / loaded.dt
        inputs[:, Input.V_DELTA] = np.diff(x[:, State.DELTA]) / loaded.dt
        first = int(states[0].time_step)
        found[part.planning_problem_id] = Trajectory(first, x, inputs, loaded.dt)
    return found


def _drive(
    told: dict[str, Any], problem: Problem, driven: Trajectory | None, files: RunFiles
) -> Drive:
    """One drive; of one that did not begin the start alone."""
    cycles = told["cycles"]
    if driven is None or not cycles:
        if cycles:
            raise InputError(
                f"there is no solution of problem {problem.id} beside the trace of "
                f"{files.trace.get('scenario')}: what was driven is not known"
            )
        start, nothing = problem.start[None].copy(), np.empty((0, len(Input)))
        driven = Trajectory(problem.first_step, start, nothing, files.loaded.dt)
    elif not driven.first_step <= cycles[-1]["step"] <= driven.last_step:
        raise InputError(
            f"{files.solution} is not of the run that the trace tells of: it ends at step "
            f"{driven.last_step}, and the last planning cycle is of step {cycles[-1]['step']}"
        )
    traffic = RecordedTraffic(files.loaded.scenario)
    return Drive(
        problem.id, driven, told.get("reached_step"), str(told.get("cause", "")),
        _cycles(cycles, driven), bool(told.get("collided", False)),
        tuple(traffic.at(int(step)) for step in driven.steps),
    )  # fmt: skip


def _cycles(told: list[dict[str, Any]], driven: Trajectory) -> tuple[Cycle, ...]:
    """The planning cycles, each with the part of its plan that was driven."""
    ends = [*(cycle["step"] for cycle in told), driven.last_step][1:]
    return tuple(
        Cycle(
            cycle["step"],
            Plan(
                driven.since(cycle["step"]).until(max(end, cycle["step"])), cycle["source"],
                bool(cycle["chosen"]["reaches_goal"]), PASSED, cycle,
            ),
            cycle["times_ms"]["total"] / 1e3,
        )
        for cycle, end in zip(told, ends, strict=True)
    )  # fmt: skip


def cycle_at(cycles: tuple[Cycle, ...], step: int) -> Cycle:
    """The cycle whose plan was driven at a time step that was driven."""
    for cycle, following in pairwise(cycles):
        if step < following.step:
            return cycle
    return cycles[-1]
