"""Which samples of the candidate paths lie in a goal window, and how far a state misses it."""

import numpy as np

from mpcplan.road.goal import GoalWindow
from mpcplan.road.road import Road
from mpcplan.seed.paths import Paths
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

WORST_MISS = 60.0  # m, distance to the goal beyond which candidates are not told apart


def pose_fits(goal: GoalWindow, road: Road, paths: Paths) -> Array:
    """(p, n) whether position and heading at the samples meet the window."""
    fits = np.ones(paths.s.shape, bool)
    if goal.s is not None and goal.d is not None:
        centre_s = paths.s + CAR.rear_to_centre * np.cos(paths.mu)
        centre_d = paths.d + CAR.rear_to_centre * np.sin(paths.mu)
        fits &= goal.holds(centre_s, centre_d)
    if goal.psi is not None:
        heading = road.frame.heading(paths.s) + paths.mu
        middle, half = (goal.psi[0] + goal.psi[1]) / 2, (goal.psi[1] - goal.psi[0]) / 2
        fits &= np.abs((heading - middle + np.pi) % (2 * np.pi) - np.pi) <= half
    return fits


def speed_fits(goal: GoalWindow, v: Array) -> Array:
    """Whether speeds [m/s] meet the window."""
    return np.ones(v.shape, bool) if goal.v is None else (v >= goal.v[0]) & (v <= goal.v[1])


def miss_distance(road: Road, s: Array, d: Array, v: Array) -> Array:
    """Distance [m, and m/s] of centres (s, d) at speeds v from the nearest window."""
    best = np.full(np.broadcast_shapes(s.shape, d.shape, v.shape), WORST_MISS)
    for goal in road.goals:
        miss = np.zeros_like(best)
        for value, interval in ((s, goal.s), (d, goal.d), (v, goal.v)):
            if interval is not None:
                miss = miss + np.maximum(np.maximum(interval[0] - value, value - interval[1]), 0.0)
        best = np.minimum(best, miss)
    return best
