"""What a run leaves behind: driven trajectories, the trace of every cycle, the solution file."""

import os
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from commonroad.common.solution import (
    CommonRoadSolutionWriter,
    CostFunction,
    PlanningProblemSolution,
    Solution,
    VehicleModel,
    VehicleType,
)
from commonroad.scenario.state import KSState
from commonroad.scenario.trajectory import Trajectory as CrTrajectory

from mpcplan.config import Config
from mpcplan.observation import Snapshot
from mpcplan.plan import Plan
from mpcplan.scenario import LoadedScenario
from mpcplan.trajectory import Array, State, Trajectory
from mpcplan.vehicle import centres

SOLUTION_DATE = datetime(2020, 1, 1)  # fixed: the same run gives the same bytes


@dataclass(frozen=True, eq=False)
class Cycle:
    """One planning cycle: when, what was planned, and how long that took [s]."""

    step: int
    plan: Plan
    seconds: float


@dataclass(frozen=True, eq=False)
class Drive:
    """One planning problem as it was driven.

    Attributes:
        problem_id: the planning problem.
        trajectory: what was driven, at the rear axle, in local coordinates.
        reached_step: time step at which the goal was reached, or None.
        cause: why not, '' where it was.
        cycles: the planning cycles.
        collided: whether the body hit an obstacle.
        others: the others at every time step of the trajectory.
        notes: what to know about this traffic.
        step_seconds: times of the traffic's steps [s].
    """

    problem_id: int
    trajectory: Trajectory
    reached_step: int | None
    cause: str
    cycles: tuple[Cycle, ...]
    collided: bool
    others: tuple[Snapshot, ...] = ()
    notes: tuple[str, ...] = ()
    step_seconds: Array = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True, eq=False)
class Run:
    """All planning problems of a scenario as they were driven."""

    loaded: LoadedScenario
    config: Config
    drives: tuple[Drive, ...]

    @property
    def solved(self) -> bool:
        """Whether every problem's goal was reached."""
        return all(drive.reached_step is not None for drive in self.drives)

    @property
    def driven(self) -> bool:
        """Whether anything was driven, so that there is something to judge."""
        return any(len(drive.trajectory.inputs) for drive in self.drives)

    @property
    def cause(self) -> str:
        """Why it was not solved, '' where it was."""
        causes = [
            f"problem {drive.problem_id}: {drive.cause}" if len(self.drives) > 1 else drive.cause
            for drive in self.drives
            if drive.cause
        ]
        return "; ".join(causes)

    @cached_property
    def planning_ms(self) -> Array:
        """Times of all planning cycles [ms]."""
        return np.array([1e3 * c.seconds for drive in self.drives for c in drive.cycles])

    @cached_property
    def step_ms(self) -> Array:
        """Times of all steps of the traffic [ms]."""
        return np.concatenate([np.empty(0), *(1e3 * drive.step_seconds for drive in self.drives)])

    @property
    def notes(self) -> tuple[str, ...]:
        """What to know about the scenario and its traffic."""
        return (*self.loaded.notes, *(note for drive in self.drives for note in drive.notes))

    def solution(self) -> Solution:
        """The run as a KS1:TR1 solution in the file's coordinates (positions: centres)."""
        parts = [self._problem_solution(drive) for drive in self.drives]
        return Solution(self.loaded.scenario.scenario_id, parts, date=SOLUTION_DATE)

    def _problem_solution(self, drive: Drive) -> PlanningProblemSolution:
        positions = centres(drive.trajectory.states) + self.loaded.origin
        states = [
            KSState(
                time_step=int(step),
                position=position,
                steering_angle=float(state[State.DELTA]),
                velocity=float(state[State.V]),
                orientation=float(state[State.PSI]),  # continuous from the problem's own
            )
            for step, position, state in zip(
                drive.trajectory.steps, positions, drive.trajectory.states, strict=True
            )
        ]
        return PlanningProblemSolution(
            planning_problem_id=drive.problem_id,
            vehicle_model=VehicleModel.KS,
            vehicle_type=VehicleType.FORD_ESCORT,
            cost_function=CostFunction.TR1,
            trajectory=CrTrajectory(int(drive.trajectory.first_step), states),
        )

    def write_solution(self, folder: str | Path) -> Path:
        """Writes 'solution_KS1:TR1:<id>:2020a.xml' into a folder, whole or not at all."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        solution = self.solution()
        path = folder / f"solution_{solution.benchmark_id}.xml"
        partial = folder / f".{path.name}.partial"
        partial.write_text(CommonRoadSolutionWriter(solution).dump(), encoding="utf-8")
        os.replace(partial, path)
        return path

    def trace(self) -> dict[str, Any]:
        """Everything about the run that explains it, JSON-able."""
        return {
            "scenario": self.loaded.id,
            "file": str(self.loaded.path.resolve()),
            "notes": list(self.notes),
            "config": self.config.model_dump(mode="json"),
            "drives": [_drive_trace(drive) for drive in self.drives],
        }


def _drive_trace(drive: Drive) -> dict[str, Any]:
    return {
        "problem": drive.problem_id,
        "reached_step": drive.reached_step,
        "collided": drive.collided,
        "cause": drive.cause,
        "cycles": [cycle.plan.trace for cycle in drive.cycles],
    }
