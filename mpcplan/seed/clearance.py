"""Which poses of the body are free of standing rectangles and on the road.

Exact where it matters: rectangles against rectangles by separating axes, the body against the
drivable area as polygons.
"""

from dataclasses import dataclass

import numpy as np
import shapely

from mpcplan.predict.occupancy import Occupancy
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import rectangles

STANDING = 0.5  # m/s, who is slower stands,
WHILE = 15  # time steps, and is in the way if it does so for at least as long
BODY_RADIUS = float(np.hypot(CAR.length, CAR.width)) / 2  # m


@dataclass(frozen=True, eq=False)
class Boxes:
    """Rectangles, all (m,): centre [m], heading [rad], length and width [m]."""

    x: Array
    y: Array
    psi: Array
    length: Array
    width: Array

    def grown(self, gap: float) -> "Boxes":
        """The same with a gap [m] on every side."""
        return Boxes(self.x, self.y, self.psi, self.length + 2 * gap, self.width + 2 * gap)


def standing(window: Occupancy) -> Boxes:
    """Where the others stand, or will come to stand for a while."""
    with np.errstate(invalid="ignore"):
        still = np.abs(window.v) < STANDING
    last = max(still.shape[1] - WHILE, 1)  # near the end of time who stands now stays
    stays = still[:, :last] & still[:, -last:]
    rows = np.flatnonzero(stays.any(axis=1))
    return _boxes(window, rows, stays[rows].argmax(axis=1))


def _boxes(window: Occupancy, rows: Array, columns: Array) -> Boxes:
    values = (window.x, window.y, window.psi, window.length, window.width)
    return Boxes(*(value[rows, columns] for value in values))


def touches(x: Array, y: Array, psi: Array, boxes: Boxes) -> Array:
    """(n,) whether the body with its rear axle at poses (n,) overlaps any of the boxes."""
    hit = np.zeros(len(x), bool)
    cx, cy = x + CAR.rear_to_centre * np.cos(psi), y + CAR.rear_to_centre * np.sin(psi)
    far = BODY_RADIUS + np.hypot(boxes.length, boxes.width) / 2
    near = (cx[:, None] - boxes.x) ** 2 + (cy[:, None] - boxes.y) ** 2 < far**2
    pose, box = np.nonzero(near)
    own, turn = psi[pose], boxes.psi[box]
    dx, dy = boxes.x[box] - cx[pose], boxes.y[box] - cy[pose]
    apart = np.zeros(len(pose), bool)
    for axis in (own, own + np.pi / 2, turn, turn + np.pi / 2):
        reach = CAR.length * np.abs(np.cos(own - axis)) + CAR.width * np.abs(np.sin(own - axis))
        reach += boxes.length[box] * np.abs(np.cos(turn - axis))
        reach += boxes.width[box] * np.abs(np.sin(turn - axis))
        apart |= np.abs(dx * np.cos(axis) + dy * np.sin(axis)) > reach / 2
    hit[pose[~apart]] = True
    return hit


def on_road(x: Array, y: Array, psi: Array, area: shapely.Geometry, spare: float) -> Array:
    """(n,) whether the body, grown by ``spare`` [m], lies within the area at poses (n,)."""
    states = np.zeros((len(x), len(State)))
    states[:, State.X], states[:, State.Y], states[:, State.PSI] = x, y, psi
    bodies = shapely.polygons(rectangles(states, margin=spare))
    inside: Array = shapely.covers(area, bodies)
    return inside
