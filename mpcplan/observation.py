"""What a planner may know: the vehicle's own state and the boxes of the others, now and before.

An :class:`Observation` is all that a planner is given in a cycle. It holds no future of any other
vehicle: in recorded scenarios the recorded trajectories reach only the predictor that is meant to
use them (:mod:`mpcplan.predict.recorded`), at construction.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from mpcplan.trajectory import Array


class Box(IntEnum):
    """Columns of an array of boxes: centre [m], heading [rad], speed [m/s], length, width [m]."""

    X = 0
    Y = 1
    PSI = 2
    V = 3
    LENGTH = 4
    WIDTH = 5


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The others at one time step.

    Attributes:
        step: the time step.
        ids: (n,) obstacle ids.
        boxes: (n, 6) columns :class:`Box`.
        kinds: (n,) what each of them is, in CommonRoad's words ('car', 'bicycle'); empty where
            that is not known.
    """

    step: int
    ids: tuple[int, ...]
    boxes: Array
    kinds: tuple[str, ...] = ()

    def box_of(self, obstacle: int) -> Array | None:
        """(6,) box of an obstacle, or None where it is not there."""
        return self.boxes[self.ids.index(obstacle)] if obstacle in self.ids else None

    def kind_of(self, obstacle: int) -> str:
        """What an obstacle is, 'unknown' where that is not known."""
        known = self.kinds and obstacle in self.ids
        return self.kinds[self.ids.index(obstacle)] if known else "unknown"


@dataclass(frozen=True, eq=False)
class Observation:
    """A planner's input in one cycle.

    Attributes:
        step: present time step.
        state: (5,) own state at the rear axle, columns :class:`mpcplan.trajectory.State`.
        acceleration: own acceleration in the step before [m/s^2].
        others: snapshots of the others, the oldest first, the last one at ``step``.
    """

    step: int
    state: Array
    acceleration: float
    others: tuple[Snapshot, ...]

    @property
    def now(self) -> Snapshot:
        """The others at the present time step."""
        return self.others[-1]


@dataclass(frozen=True, eq=False)
class Forecast:
    """Predicted boxes of the others.

    Attributes:
        first_step: time step of the first prediction.
        ids: (o,) obstacle ids.
        boxes: (o, k, 6) columns :class:`Box`; NaN where an obstacle is not there.
        held: (o,) obstacles that stand where they are for ever, before and after ``boxes`` too;
            None: no one.
        exact: whether this is what will happen, and no guess.
    """

    first_step: int
    ids: tuple[int, ...]
    boxes: Array
    held: Array | None = None
    exact: bool = False

    @property
    def last_step(self) -> int:
        """Time step of the last prediction."""
        return self.first_step + self.boxes.shape[1] - 1

    def at(self, steps: Array) -> Array:
        """(o, n, 6) boxes at time steps (n,); NaN outside the forecast but for held obstacles."""
        return at_steps(self.boxes, self.first_step, self.held, np.asarray(steps, int))


def at_steps(values: Array, first_step: int, held: Array | None, steps: Array) -> Array:
    """(o, n, ...) values at time steps (n,) of an array (o, k, ...) that begins at a time step;
    NaN outside, but for the rows that are held (o,), which keep their first or last value."""
    if not values.shape[1]:
        return np.full((len(values), len(steps), *values.shape[2:]), np.nan)
    index = steps - first_step
    inside = (index >= 0) & (index < values.shape[1])
    known = inside[None, :] if held is None else inside[None, :] | held[:, None]
    taken = values[:, np.clip(index, 0, values.shape[1] - 1)]
    return np.where(known.reshape(*known.shape, *([1] * (values.ndim - 2))), taken, np.nan)


def as_forecast(seen: Sequence[Snapshot]) -> Forecast:
    """What was seen at consecutive time steps, one row of boxes per obstacle."""
    ids = tuple(sorted({number for snapshot in seen for number in snapshot.ids}))
    boxes = np.full((len(ids), len(seen), len(Box)), np.nan)
    row = {number: i for i, number in enumerate(ids)}
    for k, snapshot in enumerate(seen):
        boxes[[row[number] for number in snapshot.ids], k] = snapshot.boxes
    return Forecast(seen[0].step if seen else 0, ids, boxes)


def box_outline(boxes: Array) -> Array:
    """(..., 8, 2) corners and middles of the sides [m] of boxes (..., 6): in a bend a long body
    reaches further between its corners than at them."""
    corners = box_corners(boxes)
    middles = (corners + np.roll(corners, -1, axis=-2)) / 2
    return np.concatenate([corners, middles], axis=-2)


def box_corners(boxes: Array) -> Array:
    """(..., 4, 2) corners [m] of boxes (..., 6)."""
    c, s = np.cos(boxes[..., Box.PSI]), np.sin(boxes[..., Box.PSI])
    half_l = boxes[..., Box.LENGTH, None] / 2 * np.array([-1, 1, 1, -1])
    half_w = boxes[..., Box.WIDTH, None] / 2 * np.array([-1, -1, 1, 1])
    x = boxes[..., Box.X, None] + c[..., None] * half_l - s[..., None] * half_w
    y = boxes[..., Box.Y, None] + s[..., None] * half_l + c[..., None] * half_w
    return np.stack([x, y], axis=-1)
