"""How far off the predictions were, measured on the traffic that a benchmark has simulated.

Every interactive run leaves its traffic beside its solution (``<id>.simulated.cr.xml``). Each
prediction is made again at many of its time steps, from what could be seen then, and compared with
what the others did afterwards. Runs that the planner lost count as well, as far as they went.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mpcplan.bench.store import csv_text
from mpcplan.bench.table import align
from mpcplan.config import PredictConfig
from mpcplan.errors import InputError
from mpcplan.predict.error import ErrorRow, ErrorSummary, displacement_errors, summary
from mpcplan.predict.predictor import make_predictor
from mpcplan.scenario import LoadedScenario, load
from mpcplan.score.solution_file import read_solution
from mpcplan.simulate.recorded import RecordedTraffic
from mpcplan.task import task_of
from mpcplan.trajectory import Array, State, Trajectory
from mpcplan.vehicle import FORD_ESCORT as CAR

KINDS = ("constant_input", "lane_follow")
SIMULATED = ".simulated.cr.xml"
HEADER = (
    "prediction", "obstacle", "seconds", "number", "mean", "median", "p95", "spread_p50",
    "spread_p90",
)  # fmt: skip


@dataclass(frozen=True)
class ForecastErrors:
    """The errors of one prediction over many runs."""

    kind: str
    rows: tuple[ErrorSummary, ...]


def forecast_errors(folder: str | Path, kinds: Sequence[str] = KINDS) -> list[ForecastErrors]:
    """The displacement errors of predictions on a benchmark's simulated traffic.

    Args:
        folder: results of ``bench``.
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
        # the task as it was when the traffic reacted: without its trajectories
        task = replace(task_of(loaded, loaded.problems[0]), recorded=None)
        traffic, ego = RecordedTraffic(loaded.scenario), _driven(path, loaded)
        seen = [traffic.at(step) for step in ego.steps.tolist()]
        for kind in kinds:
            # followers are left out of forecasts because they react to the ego: here they count
            config = PredictConfig(kind=kind, leave_out_followers=False, lateness=0.0)
            rows[kind] += displacement_errors(make_predictor(task, config), seen, ego, loaded.dt)
    return [ForecastErrors(kind, tuple(summary(found))) for kind, found in rows.items()]


def _driven(path: Path, loaded: LoadedScenario) -> Trajectory:
    """What the ego vehicle drove: the solution beside the traffic."""
    name = path.name.removesuffix(SIMULATED)
    solutions = sorted(path.parent.glob(f"solution_*:{name}:*.xml"))
    if not solutions:
        raise InputError(f"{path}: no solution of {name} beside it")
    part = read_solution(solutions[0]).planning_problem_solutions[0]
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
    return align([HEADER, *(_cells(found.kind, row) for found in errors for row in found.rows)])


def as_csv(errors: Sequence[ForecastErrors]) -> str:
    """The errors as CSV, distances in m, spreads as parts of the predicted way."""
    cells = (_cells(found.kind, row) for found in errors for row in found.rows)
    return csv_text((dict(zip(HEADER, line, strict=True)) for line in cells), HEADER)


def _cells(kind: str, row: ErrorSummary) -> list[str]:
    numbers = [f"{value:.2f}" for value in (row.mean, row.median, row.p95)]
    spread = ["" if np.isnan(x) else f"{x:.3f}" for x in (row.spread50, row.spread90)]
    return [kind, row.kind, f"{row.seconds:g}", str(row.number), *numbers, *spread]
