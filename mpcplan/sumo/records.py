"""What a scenario records of each obstacle, in the coordinates that SUMO shares with the file."""

from dataclasses import dataclass

import numpy as np

from mpcplan.observation import Box
from mpcplan.predict.recorded import kinds_of, record
from mpcplan.scenario import LoadedScenario
from mpcplan.trajectory import Array


@dataclass(frozen=True, eq=False)
class Record:
    """One obstacle.

    Attributes:
        id: CommonRoad's id.
        kind: what it is, in CommonRoad's words.
        first_step: time step of the first box.
        boxes: (n, 6) at consecutive time steps, file coordinates, columns :class:`Box`.
        stands: whether it stands where it is for ever.
    """

    id: int
    kind: str
    first_step: int
    boxes: Array
    stands: bool

    @property
    def last_step(self) -> int:
        """Time step of the last box."""
        return self.first_step + len(self.boxes) - 1

    def at(self, step: int) -> Array | None:
        """(6,) box at a time step, None where it is not there."""
        i = 0 if self.stands else step - self.first_step
        return self.boxes[i] if 0 <= i < len(self.boxes) else None


def records(loaded: LoadedScenario, first_step: int) -> list[Record]:
    """What is recorded from a time step on, by id; obstacles that are gone by then are left out."""
    forecast, kinds = record(loaded.scenario), kinds_of(loaded.scenario)
    held = np.zeros(len(forecast.ids), bool) if forecast.held is None else forecast.held
    found = []
    for row, obstacle in sorted(enumerate(forecast.ids), key=lambda item: item[1]):
        stands = bool(held[row])
        boxes = forecast.boxes[row] if stands else forecast.boxes[row, first_step:]
        there = np.flatnonzero(np.isfinite(boxes[:, Box.X]))
        if not len(there):
            continue
        known = _without_gaps(boxes[there[0] :])[: 1 if stands else None].copy()
        known[:, [Box.X, Box.Y]] += loaded.origin
        begin = first_step if stands else first_step + int(there[0])
        found.append(Record(obstacle, kinds[obstacle], begin, known, stands))
    return found


def _without_gaps(boxes: Array) -> Array:
    """The boxes up to the first time step that is not recorded."""
    missing = np.flatnonzero(~np.isfinite(boxes[:, Box.X]))
    return boxes[: missing[0]] if len(missing) else boxes
