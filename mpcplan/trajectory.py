"""Trajectories of the kinematic single-track model, the currency between all stages.

A trajectory holds the states x_k = [x, y, delta, v, psi] at the *rear axle* in local coordinates
(columns named by :class:`State`) and the inputs u_k = [a, v_delta] (columns named by
:class:`Input`) that are constant over [k, k+1) dt.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]  # of float64; indices and masks are named as such


class State(IntEnum):
    """Columns of a state array: m, m, rad, m/s, rad."""

    X = 0
    Y = 1
    DELTA = 2
    V = 3
    PSI = 4


class Input(IntEnum):
    """Columns of an input array: m/s^2, rad/s."""

    A = 0
    V_DELTA = 1


@dataclass(frozen=True)
class Trajectory:
    """States and inputs of the KS model from time step ``first_step`` on.

    Attributes:
        first_step: time step of the first state.
        states: (n + 1, 5) array, columns :class:`State`.
        inputs: (n, 2) array, columns :class:`Input`.
        dt: time step [s].
    """

    first_step: int
    states: Array
    inputs: Array
    dt: float

    def __post_init__(self) -> None:
        if self.states.ndim != 2 or self.states.shape[1] != len(State):
            raise ValueError(f"states must be (n + 1, {len(State)}), got {self.states.shape}")
        if self.inputs.shape != (len(self.states) - 1, len(Input)):
            raise ValueError(
                f"inputs must be ({len(self.states) - 1}, {len(Input)}), got {self.inputs.shape}"
            )

    def __len__(self) -> int:
        """Number of states."""
        return len(self.states)

    @property
    def last_step(self) -> int:
        """Time step of the last state."""
        return self.first_step + len(self.inputs)

    @property
    def steps(self) -> NDArray[np.int64]:
        """(n + 1,) time steps of the states."""
        return np.arange(self.first_step, self.last_step + 1)

    def state_at(self, step: int) -> Array:
        """(5,) state at a time step; raises IndexError outside the trajectory."""
        if not self.first_step <= step <= self.last_step:
            raise IndexError(f"step {step} outside [{self.first_step}, {self.last_step}]")
        return self.states[step - self.first_step]

    def since(self, step: int) -> "Trajectory":
        """The part from ``step`` on; raises IndexError outside the trajectory."""
        self.state_at(step)
        i = step - self.first_step
        return Trajectory(step, self.states[i:], self.inputs[i:], self.dt)

    def until(self, step: int) -> "Trajectory":
        """The part up to and with ``step``; raises IndexError outside the trajectory."""
        self.state_at(step)
        i = step - self.first_step
        return Trajectory(self.first_step, self.states[: i + 1], self.inputs[:i], self.dt)

    def then(self, other: "Trajectory") -> "Trajectory":
        """This trajectory continued by another that starts at its last step."""
        if other.first_step != self.last_step:
            raise ValueError(f"continues at {other.first_step}, expected {self.last_step}")
        states = np.vstack([self.states, other.states[1:]])
        return Trajectory(self.first_step, states, np.vstack([self.inputs, other.inputs]), self.dt)
