"""The others in the closed loop: played back, or moved by SUMO."""

from typing import Protocol

from mpcplan.observation import Snapshot
from mpcplan.trajectory import Array


class Traffic(Protocol):
    """The others, one time step at a time; the loop calls it, planners never see it."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the result should know about this traffic, one sentence each."""
        ...

    def at(self, step: int) -> Snapshot:
        """The others at a time step that has been simulated."""
        ...

    def advance(self, step: int, state: Array) -> None:
        """Moves the others to a time step, the next one, at which the ego is in ``state``.

        Args:
            step: one more than the last time step simulated.
            state: (5,) of the ego at that step (rear axle, local coordinates).
        """
        ...

    def close(self) -> None:
        """Ends the simulation."""
        ...
