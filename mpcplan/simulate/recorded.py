"""Recorded traffic as the world that a planner observes, one time step at a time."""

import numpy as np
from commonroad.scenario.scenario import Scenario

from mpcplan.observation import Box, Forecast, Snapshot
from mpcplan.predict.recorded import kinds_of, record
from mpcplan.trajectory import Array


class RecordedTraffic:
    """Plays recorded trajectories; nobody reacts to the ego vehicle."""

    notes: tuple[str, ...] = ()

    def __init__(self, scenario: Scenario) -> None:
        self._record: Forecast = record(scenario)
        self._kinds = kinds_of(scenario)

    def at(self, step: int) -> Snapshot:
        """The others at a time step."""
        boxes = self._record.at(np.array([step]))[:, 0]
        there = np.isfinite(boxes[:, Box.X])
        ids = tuple(i for i, present in zip(self._record.ids, there, strict=True) if present)
        return Snapshot(step, ids, boxes[there], tuple(self._kinds[i] for i in ids))

    def advance(self, step: int, state: Array) -> None:
        """The record goes on by itself."""

    def close(self) -> None:
        """Nothing to end."""
