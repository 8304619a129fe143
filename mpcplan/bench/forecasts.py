"""How far off the predictions were, measured on the traffic that a benchmark has simulated.

Every interactive run leaves its traffic beside its solution (``<id>.simulated.cr.xml``). Each
prediction is made again at many of its time steps, from what could be seen then, and compared with
what the others did afterwards. Runs that the planner lost count as well, as far as they went.
"""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from commonroad.common.solution import CommonRoadSolutionReader

from mpcplan.config import PredictConfig
from mpcplan.errors import InputError
from mpcplan.observation import Box, Snapshot
from mpcplan.predict.error import ErrorRow, ErrorSummary, displacement_errors, summary
from mpcplan.predict.predictor import make_predictor
from mpcplan.predict.recorded import kinds_of
from mpcplan.scenario import LoadedScenario, load
from mpcplan.task import Task, road_map, task_of
from mpcplan.trajectory import Array, State, Trajectory
from mpcplan.vehicle import FORD_ESCORT as CAR

KINDS = ("constant_input", "lane_follow")
SIMULATED = ".simulated.cr.xml"
HEADER = ("prediction", "obstacle", "seconds", "number", "mean", "median", "p95")


@dataclass(frozen=True)
class ForecastErrors:
    """The errors of one prediction over many runs."""

    kind: str
    rows: tuple[ErrorSummary, ...]


def forecast_errors(folder: str | Path, kinds: Sequence[str] = KINDS) -> list[ForecastErrors]:
    """The displacement errors of predictions on a benchmark's simulated traffic.

    Args:
        folder: results of ``bench`` or ``compete``.
        kinds: values of ``predict.kind``.

    Raises:
        InputError: the folder holds no simulated traffic, or a file of it cannot be read.
    """
    runs = sorted(Path(folder).rglob(f"*{SIMULATED}"))
    if not runs:
        raise InputError(
            f"{folder}: no simulated traffic (*{SIMULATED}); give the folder of results of a bench "
            "over interactive scenarios"
        )
    rows: dict[str, list[ErrorRow]] = {kind: [] for kind in kinds}
    for path in runs:
        loaded = load(path)
        task, ego = _task(loaded), _driven(path, loaded)
        seen = snapshots(loaded, ego.last_step)
        for kind in kinds:
            # followers are left out of forecasts because they react to the ego: here they count
            config = PredictConfig(kind=kind, leave_out_followers=False, lateness=0.0)
            rows[kind] += displacement_errors(make_predictor(task, config), seen, ego, loaded.dt)
    return [ForecastErrors(kind, tuple(summary(found))) for kind, found in rows.items()]


def _task(loaded: LoadedScenario) -> Task:
    """The task as it was when the traffic reacted: without its trajectories."""
    task = task_of(loaded, loaded.problems[0])
    return Task(road_map(loaded.scenario), task.problem, task.vehicle, task.dt, None)


def snapshots(loaded: LoadedScenario, last: int) -> list[Snapshot]:
    """What was seen at every time step from a problem's first one to ``last``."""
    task, kinds = task_of(loaded, loaded.problems[0]), kinds_of(loaded.scenario)
    assert task.recorded is not None  # a file with trajectories
    steps = np.arange(loaded.problems[0].first_step, last + 1)
    boxes = task.recorded.at(steps)
    found = []
    for k, step in enumerate(steps.tolist()):
        there = np.flatnonzero(np.isfinite(boxes[:, k, Box.X]))
        ids = tuple(task.recorded.ids[row] for row in there)
        found.append(Snapshot(step, ids, boxes[there, k], tuple(kinds[i] for i in ids)))
    return found


def _driven(path: Path, loaded: LoadedScenario) -> Trajectory:
    """What the ego vehicle drove: the solution beside the traffic."""
    name = path.name.removesuffix(SIMULATED)
    solutions = sorted(path.parent.glob(f"solution_*:{name}:*.xml"))
    if not solutions:
        raise InputError(f"{path}: no solution of {name} beside it")
    try:
        part = CommonRoadSolutionReader.open(str(solutions[0])).planning_problem_solutions[0]
    except Exception as error:  # the reader raises whatever the broken place makes it raise
        raise InputError(f"{solutions[0]} is not a readable solution: {error}") from error
    states = part.trajectory.state_list
    table = np.array([[*s.position, s.steering_angle, s.velocity, s.orientation] for s in states])
    return _rear_axle(table, loaded, int(states[0].time_step))


def _rear_axle(table: Array, loaded: LoadedScenario, first_step: int) -> Trajectory:
    """The trajectory of centres in the file's coordinates, (n, 5) columns :class:`State`."""
    states, psi = table.copy(), table[:, State.PSI]
    ahead = CAR.rear_to_centre * np.column_stack([np.cos(psi), np.sin(psi)])
    states[:, [State.X, State.Y]] -= ahead + loaded.origin
    inputs = np.diff(states[:, [State.V, State.DELTA]], axis=0) / loaded.dt
    return Trajectory(first_step, states, inputs, loaded.dt)


def as_table(errors: Sequence[ForecastErrors]) -> str:
    """The errors as aligned text."""
    lines = [list(HEADER), *(_cells(found.kind, row) for found in errors for row in found.rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(HEADER))]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if i < 2 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    )


def as_csv(errors: Sequence[ForecastErrors]) -> str:
    """The errors as CSV, distances in m."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADER)
    writer.writerows(_cells(found.kind, row) for found in errors for row in found.rows)
    return text.getvalue()


def _cells(kind: str, row: ErrorSummary) -> list[str]:
    numbers = (f"{value:.2f}" for value in (row.mean, row.median, row.p95))
    return [kind, row.kind, f"{row.seconds:g}", str(row.number), *numbers]
