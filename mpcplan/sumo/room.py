"""Whether there is room for a vehicle that appears: nobody in its place or about to run into it."""

import numpy as np

from mpcplan.observation import Box, box_corners
from mpcplan.trajectory import Array

AHEAD = 1.5  # s, for which nobody may touch at constant speeds
_EVERY = 0.1  # s
_MARGIN = 0.5  # m, distance kept


def has_room(box: Array, others: Array) -> bool:
    """Whether a box (6,) can appear among others (n, 6) a step before: no overlap now or within
    :data:`AHEAD`, everybody going straight on at constant speed."""
    if not len(others):
        return True
    times = np.arange(0.0, AHEAD + _EVERY / 2, _EVERY)
    return not bool(np.any(_overlap(_moved(box[None], times), _moved(others, times))))


def _moved(boxes: Array, times: Array) -> Array:
    """(n, k, 6) boxes (n, 6) at k times."""
    moved = np.repeat(boxes[:, None], len(times), axis=1)
    way = boxes[:, None, Box.V] * times
    moved[..., Box.X] += way * np.cos(boxes[:, None, Box.PSI])
    moved[..., Box.Y] += way * np.sin(boxes[:, None, Box.PSI])
    return moved


def _overlap(one: Array, others: Array) -> Array:
    """(n, k) whether boxes (1, k, 6) and (n, k, 6) are nearer than the margin (axis test)."""
    grown = one.copy()
    grown[..., [Box.LENGTH, Box.WIDTH]] += 2 * _MARGIN
    apart = np.zeros(others.shape[:2], bool)
    a, b = box_corners(grown), box_corners(others)
    for psi in (grown[..., Box.PSI], others[..., Box.PSI]):
        for axis in (psi, psi + np.pi / 2):
            direction = np.stack([np.cos(axis), np.sin(axis)], axis=-1)[..., None, :]
            pa, pb = (a * direction).sum(-1), (b * direction).sum(-1)
            apart |= (pa.max(-1) < pb.min(-1)) | (pb.max(-1) < pa.min(-1))
    return ~apart
