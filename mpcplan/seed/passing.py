"""Lateral moves around who is slow, or is going to stand in the way.

A move leads from the present offset to one beside the obstacle, and back behind it. Who will come
to rest on the path, before it crosses or turns off, is passed where it will stand.
"""

import numpy as np

from mpcplan.config import SeedConfig
from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.road import Road
from mpcplan.vehicle import FORD_ESCORT as CAR

STANDING = 0.5  # m/s, who is slower stands,
WHILE = 15  # time steps, and is in the way if it does so for at least as long
PASSING_SPEED = 8.0  # m/s, at which slow obstacles are passed when their way is foreseen
SHORTEST = 8.0  # m, of a move out
BEFORE = 2.0  # m, before the obstacle the move out has ended,
BEYOND = 4.0  # m, beyond it and the own length the move back begins,
BACK_MORE = 5.0  # m, and takes so much longer than the shortest move to another lane

Move = tuple[float, float, float, float, float]
"""Offset beside [m], length of the move there, offset at last, where the move back begins, its
length."""


def around_slow(road: Road, s: float, window: Occupancy, config: SeedConfig) -> list[Move]:
    """Moves out and back around the nearest obstacles on the path that are slow or will stand.

    Args:
        road: the road.
        s: present arc length of the rear axle [m].
        window: the obstacles from now on.
        config: of the seeds.
    """
    rows: list[Move] = []
    half = CAR.width / 2 + config.pass_gap
    for row, k in _passed(s, window, half, config):
        ahead = float(window.s_low[row, k] - s - CAR.front)
        v = max(float(window.v[row, k]), 0.0)
        foreseen = ahead + v * ahead / PASSING_SPEED - BEFORE
        out = float(np.clip(foreseen, SHORTEST, config.lengths[-1]))
        extent = float(window.s_high[row, k] - window.s_low[row, k])
        beyond = ahead + extent + CAR.length + BEYOND
        back = beyond + v * beyond / PASSING_SPEED
        sides = (window.d_high[row, k] + half, window.d_low[row, k] - half)
        lane = road.limits.lane_left, road.limits.lane_right
        at = int(np.clip(np.searchsorted(road.frame.s, s + ahead), 0, len(road.frame.s) - 1))
        for offset in (*sides, lane[0][at], lane[1][at]):
            if np.isfinite(offset):
                length = config.lengths[0] + BACK_MORE
                rows.append((float(offset), out, 0.0, max(back, out), length))
    return rows


def _passed(s: float, window: Occupancy, half: float, config: SeedConfig) -> list[tuple[int, int]]:
    """The rows of the nearest obstacles that are in the way, and the columns of the window at which
    they are: now, or when they have come to stand."""
    with np.errstate(invalid="ignore"):
        on_path = (window.d_low < half) & (window.d_high > -half)
        on_path &= window.s_low > s + CAR.front
        slow = on_path[:, 0] & (np.abs(window.v[:, 0]) < config.pass_speed)
        still = on_path & (np.abs(window.v) < STANDING)
    stays = still[:, : max(still.shape[1] - WHILE, 0)] & still[:, WHILE:]
    found = []
    for row in np.flatnonzero(slow | stays.any(axis=1)).tolist():
        k = 0 if slow[row] else int(stays[row].argmax())
        found.append((float(window.s[row, k]), row, k))
    return [(row, k) for _, row, k in sorted(found)[: config.passed]]
