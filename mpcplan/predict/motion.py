"""How the others have moved lately, and where they come when they go on like that."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mpcplan.observation import Box, Snapshot
from mpcplan.trajectory import Array

FADE = 1.0  # s, time constant by which acceleration and yaw rate fade
CREEPING = 0.1  # m/s, at less than this headings do not change


@dataclass(frozen=True, eq=False)
class Motion:
    """Rates of change of boxes, least squares over the latest snapshots; 0 for newcomers.

    Attributes:
        acceleration: (n,) [m/s^2].
        yaw_rate: (n,) [rad/s].
        velocity: (n, 2) of the centre [m/s].
    """

    acceleration: Array
    yaw_rate: Array
    velocity: Array


def motion(others: Sequence[Snapshot], count: int, dt: float) -> Motion:
    """The motion of those in the last of the snapshots, over at most the ``count`` latest."""
    now, latest = others[-1], others[-count:]
    row = {number: i for i, number in enumerate(now.ids)}
    values = np.full((len(latest), len(now.ids), len(Box)), np.nan)
    for k, snapshot in enumerate(latest):
        if snapshot.ids == now.ids:
            values[k] = snapshot.boxes
        else:
            there = [(i, j) for i, number in enumerate(snapshot.ids)
                     if (j := row.get(number)) is not None]  # fmt: skip
            for i, j in there:
                values[k, j] = snapshot.boxes[i]
    # a turn across pi is no jump
    values[..., Box.PSI] = now.boxes[:, Box.PSI] + _within_pi(
        values[..., Box.PSI] - now.boxes[:, Box.PSI]
    )
    seen = np.isfinite(values[..., Box.X])
    known = seen.sum(axis=0)
    t = dt * np.arange(len(latest))[:, None]
    offset = np.where(seen, t - np.where(seen, t, 0.0).sum(axis=0) / np.maximum(known, 1), 0.0)
    spread = (offset**2).sum(axis=0)
    spread = np.where(spread > 0, spread, np.inf)
    slopes = (offset[..., None] * np.nan_to_num(values)).sum(axis=0) / spread[:, None]
    return Motion(slopes[:, Box.V], slopes[:, Box.PSI], slopes[:, [Box.X, Box.Y]])


def straight_on(boxes: Array, motion: Motion, steps: int, dt: float) -> Array:
    """(n, steps + 1, 6) boxes of who goes on with fading acceleration and yaw rate."""
    t = dt * np.arange(steps + 1)
    faded = FADE * (1 - np.exp(-t / FADE))
    found = np.repeat(boxes[:, None], steps + 1, axis=1)
    v = boxes[:, Box.V, None]
    speed = np.maximum(np.abs(v) + np.sign(v) * motion.acceleration[:, None] * faded, 0.0)
    turned = np.where(np.abs(v) > CREEPING, motion.yaw_rate[:, None] * faded, 0.0)
    found[..., Box.V] = np.where(v < 0, -speed, speed)
    found[..., Box.PSI] += turned
    for column, part in ((Box.X, np.cos), (Box.Y, np.sin)):
        rate = found[..., Box.V] * part(found[..., Box.PSI])
        found[:, 1:, column] += np.cumsum((rate[:, 1:] + rate[:, :-1]) * (dt / 2), axis=1)
    return found


def _within_pi(angle: Array) -> Array:
    """Angles [rad] within (-pi, pi]."""
    wrapped: Array = np.pi - (np.pi - angle) % (2 * np.pi)
    return wrapped
