"""Traffic without a simulator for the tests of the closed loop, the replay and the judge."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from mpcplan.observation import Box, Snapshot
from mpcplan.scenario import LoadedScenario
from mpcplan.sumo.folder import SumoFolder
from mpcplan.trajectory import Array


@dataclass
class FakeTraffic:
    """One car that drives on at a speed of its own; every call is kept."""

    box: Array
    first_step: int = 0
    notes: tuple[str, ...] = ("fake traffic",)
    seen: list[Snapshot] = field(default_factory=list)
    egos: list[Array] = field(default_factory=list)
    closed: bool = False

    def __post_init__(self) -> None:
        self.seen = [Snapshot(self.first_step, (5001,), self.box[None].copy(), ("truck",))]

    def at(self, step: int) -> Snapshot:
        return self.seen[step - self.first_step]

    def advance(self, step: int, state: Array) -> None:
        assert step == self.seen[-1].step + 1, "one step at a time"
        assert not self.closed
        box = self.seen[-1].boxes[0].copy()
        heading = np.array([np.cos(box[Box.PSI]), np.sin(box[Box.PSI])])
        box[[Box.X, Box.Y]] += 0.1 * box[Box.V] * heading
        self.egos.append(state.copy())
        self.seen.append(Snapshot(step, (5001,), box[None], ("truck",)))

    def close(self) -> None:
        self.closed = True


def interactive(loaded: LoadedScenario) -> LoadedScenario:
    """The scenario as if it came in a folder."""
    path = Path(loaded.path)
    folder = SumoFolder(
        path=path.parent, name=loaded.id, scenario=path, net=path, routes=(), additional=(),
        options={}, settings=None, presimulated=False,
    )  # fmt: skip
    return replace(loaded, folder=folder)
