"""From arc lengths on ways back to boxes: the middles of both bumpers lie on the way.

What a box is off its way at present fades: the offset to the side slowly, since drivers keep it,
the heading and what is left along the way quickly.
"""

import numpy as np

from mpcplan.observation import Box
from mpcplan.predict.hypotheses import Hypotheses
from mpcplan.predict.paths import Paths
from mpcplan.predict.scene import Scene
from mpcplan.trajectory import Array

TURNING = 0.5  # s, time constant by which headings come to those of the ways
DIFFERENT = 1.0  # m, by which another hypothesis must differ to matter


def outlines(
    scene: Scene, found: Hypotheses, paths: Paths, s: Array, v: Array, dt: float,
    offset_fade: float, spread: float,
) -> Array:  # fmt: skip
    """(h, k + 1, 6) boxes of hypotheses; the first of each is the present box.

    Args:
        scene: the vehicles.
        found: the hypotheses.
        paths: the ways.
        s: (k + 1, h) arc lengths of the fronts [m].
        v: (k + 1, h) speeds [m/s].
        dt: time step [s].
        offset_fade: time constant by which offsets to the side fade [s].
        spread: part of the way driven by which boxes grow at either end.
    """
    now = scene.boxes[found.vehicle]
    length, path = now[:, Box.LENGTH, None], found.path[:, None]
    front, rear = paths.at(path, s.T), paths.at(path, s.T - length)
    axis = front - rear
    psi = np.arctan2(axis[..., 1], axis[..., 0])
    along = np.stack([np.cos(psi), np.sin(psi)], axis=-1)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    t = dt * np.arange(len(s))
    quick = np.exp(-t / TURNING)
    off = now[:, [Box.X, Box.Y]] - (front[:, 0] + rear[:, 0]) / 2
    lag = (off * along[:, 0]).sum(axis=1)[:, None] * quick
    aside = (off * across[:, 0]).sum(axis=1)
    drift = (scene.motion.velocity[found.vehicle] * across[:, 0]).sum(axis=1)
    aside = _aside(aside, drift, t) * np.exp(-t / offset_fade)
    turn = np.remainder(now[:, Box.PSI] - psi[:, 0] + np.pi, 2 * np.pi) - np.pi
    boxes = np.empty((*psi.shape, len(Box)))
    centre = (front + rear) / 2 + aside[..., None] * across + lag[..., None] * along
    boxes[..., [Box.X, Box.Y]] = centre
    boxes[..., Box.PSI] = psi + turn[:, None] * quick
    boxes[..., Box.V] = v.T
    boxes[..., Box.LENGTH] = length + 2 * spread * (s - s[0]).T
    boxes[..., Box.WIDTH] = now[:, Box.WIDTH, None]
    boxes[:, 0] = now
    return boxes


def _aside(offset: Array, drift: Array, t: Array) -> Array:
    """(h, k + 1) offsets [m] to the left of the way: who drifts [m/s] towards it goes on until it
    is on it."""
    side = np.sign(offset)
    towards = np.maximum(-side * drift, 0.0)
    left = np.maximum(np.abs(offset)[:, None] - towards[:, None] * t, 0.0)
    found: Array = side[:, None] * left
    return found


def others_that_matter(
    found: Hypotheses, first: Array, boxes: Array, least: float, count: int
) -> Array:
    """Rows of hypotheses beside the most likely ones that are likely and different enough.

    Args:
        found: the hypotheses.
        first: (n,) row of each vehicle's most likely one.
        boxes: (h, k + 1, 6) of the hypotheses.
        least: weight that they must have.
        count: time steps within which they must differ.
    """
    other = found.weight >= least
    other &= first[found.vehicle] != np.arange(len(other))
    rows = np.flatnonzero(other)
    gap = boxes[rows, :count] - boxes[first[found.vehicle[rows]], :count]
    apart = np.hypot(gap[..., Box.X], gap[..., Box.Y])
    kept: Array = rows[(apart > DIFFERENT).any(axis=1)]
    return kept
