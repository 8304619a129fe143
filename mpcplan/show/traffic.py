"""The traffic during a run, recorded or simulated, as boxes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mpcplan.observation import as_forecast
from mpcplan.predict.recorded import record, static_ids
from mpcplan.trajectory import Array

if TYPE_CHECKING:
    from mpcplan.simulate.run import Run


@dataclass(frozen=True, eq=False)
class Traffic:
    """The others from the first problem's start to the end of the last drive.

    Attributes:
        first_step: time step of the first boxes.
        ids: (o,) of the obstacles.
        boxes: (o, n, 6) columns :class:`mpcplan.observation.Box`; NaN where an obstacle is absent.
        still: (o,) whether an obstacle never moves.
    """

    first_step: int
    ids: tuple[int, ...]
    boxes: Array
    still: np.ndarray

    def during(self, steps: np.ndarray) -> Array:
        """(o, len(steps), 6) boxes at time steps within the run."""
        return self.boxes[:, steps - self.first_step]


def traffic_of(run: Run) -> Traffic:
    """The traffic that a run met."""
    first = min(problem.first_step for problem in run.loaded.problems)
    last = max((drive.trajectory.last_step for drive in run.drives), default=first)
    standing = static_ids(run.loaded.scenario)
    if run.loaded.interactive:
        forecast = as_forecast([seen for drive in run.drives for seen in drive.others])
        return Traffic(
            first,
            forecast.ids,
            forecast.at(np.arange(first, last + 1)),
            np.array([number in standing for number in forecast.ids], dtype=bool),
        )
    forecast = record(run.loaded.scenario)
    boxes = forecast.at(np.arange(first, last + 1))
    still = np.array([number in standing for number in forecast.ids], dtype=bool)
    # a drive may outlast the record, in which obstacles that never move have no end
    boxes[still] = forecast.at(np.array([0]))[still]
    return Traffic(first, forecast.ids, boxes, still)
