"""From the frame in which the cases are described to the frame of the files.

The cases are described with straight roads along the x axis. In the files every map is turned as
a whole, because the official cost evaluator takes an obstacle whose orientation is exactly 0 for
an axis-aligned rectangle without a centre and leaves it out of the distance cost.

The angle cannot be chosen freely: at many angles the road boundary construction of the official
checker crashes on the rounded lanelet vertices. The tests check this for every file.
"""

from __future__ import annotations

import math

import numpy as np

from .motion import Pose

MAP_TURN = 0.35  # angle of all maps about the origin [rad]; no straight road is parallel to an axis


def turned_points(points: np.ndarray) -> np.ndarray:
    """Position(s) [m] in the file."""
    x, y = points[..., 0], points[..., 1]
    cos, sin = math.cos(MAP_TURN), math.sin(MAP_TURN)
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)  # bitwise equal for equal rows


def turned_pose(pose: Pose) -> Pose:
    """Pose in the file."""
    x, y = turned_points(np.array([pose.x, pose.y]))
    return pose._replace(x=float(x), y=float(y), orientation=pose.orientation + MAP_TURN)
