"""Which poses of the body keep clear of who stands, and on the road.

Both are exact: rectangles against rectangles by separating axes, the body against the drivable area
as polygons.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
import shapely

from mpcplan.predict.occupancy import VALUES, Occupancy
from mpcplan.seed.blocked import touching
from mpcplan.seed.passing import STANDING, WHILE
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import rectangles

SPARE = 0.05  # m, kept to the road's edge: the vehicle follows a path only nearly
BODY_RADIUS = float(np.hypot(CAR.length, CAR.width)) / 2  # m

Poses = tuple[Array, Array, Array]
"""x [m], y [m] and heading [rad] of rear axles, (n,) each."""


@dataclass(frozen=True, eq=False)
class Boxes:
    """Rectangles, all (m,): centre [m], heading [rad], length and width [m]."""

    x: Array
    y: Array
    psi: Array
    length: Array
    width: Array

    def pick(self, index: Array) -> "Boxes":
        """The boxes at an index."""
        return Boxes(*(getattr(self, f.name)[index] for f in fields(self)))

    def grown(self, gap: Array) -> "Boxes":
        """The same with gaps (m,) [m] on every side."""
        return Boxes(self.x, self.y, self.psi, self.length + 2 * gap, self.width + 2 * gap)

    def ahead(self, way: float) -> "Boxes":
        """The same with so much [m] more before them."""
        along = way / 2 * np.cos(self.psi), way / 2 * np.sin(self.psi)
        return Boxes(self.x + along[0], self.y + along[1], self.psi, self.length + way, self.width)


class Clearance:
    """What is free of boxes, and on the road, for a vehicle that is at a pose at present.

    A gap to a box, or to the road's edge, that is not kept at present need not be kept later.
    """

    def __init__(self, area: shapely.Geometry, boxes: Boxes, gap: float, present: Poses) -> None:
        self._area = area
        gaps = np.full(len(boxes.x), gap)
        gaps[overlaps(present, boxes.grown(gaps))[0]] = 0.0
        apart = ~overlaps(present, boxes)[0]
        self._boxes = boxes.grown(gaps).pick(np.flatnonzero(apart))
        self._spare = SPARE if on_road(present, area, SPARE)[0] else 0.0

    def of_boxes(self, poses: Poses) -> Array:
        """(n,) whether no box is touched."""
        return np.asarray(~overlaps(poses, self._boxes).any(axis=1))

    def of_edges(self, poses: Poses) -> Array:
        """(n,) whether the body is on the road."""
        return on_road(poses, self._area, self._spare)


def standing(window: Occupancy) -> Boxes:
    """Where the others stand, or will come to stand for a while."""
    with np.errstate(invalid="ignore"):
        still = np.abs(window.v) < STANDING
    last = max(still.shape[1] - WHILE, 1)  # near the end of time who stands now stays
    stays = still[:, :last] & still[:, -last:]
    rows = np.flatnonzero(stays.any(axis=1))
    values = (window.x, window.y, window.psi, window.length, window.width)
    return Boxes(*(value[rows, stays[rows].argmax(axis=1)] for value in values))


def kept_standing(window: Occupancy) -> Occupancy:
    """The others, of whom those who stand at present go on doing so: who waits may well be waiting
    for the vehicle, and would be in its way for ever if it waited too."""
    with np.errstate(invalid="ignore"):
        rows = np.abs(window.v[:, 0]) < STANDING
    held = {name: getattr(window, name).copy() for name in VALUES}
    for values in held.values():
        values[rows] = values[rows, :1]
    return replace(window, **held)


def overlaps(poses: Poses, boxes: Boxes) -> Array:
    """(n, m) whether the body at poses overlaps boxes."""
    x, y, psi = poses
    dx = boxes.x - (x + CAR.rear_to_centre * np.cos(psi))[:, None]
    dy = boxes.y - (y + CAR.rear_to_centre * np.sin(psi))[:, None]
    far = BODY_RADIUS + np.hypot(boxes.length, boxes.width) / 2
    found: Array = dx**2 + dy**2 < far**2
    pose, box = np.nonzero(found)
    found[pose, box] = touching(
        dx[pose, box], dy[pose, box], (psi[pose], boxes.psi[box]),
        (CAR.length / 2, CAR.width / 2), (boxes.length[box] / 2, boxes.width[box] / 2),
    )  # fmt: skip
    return found


def on_road(poses: Poses, area: shapely.Geometry, spare: float) -> Array:
    """(n,) whether the body, grown by ``spare`` [m], lies within the area at poses."""
    states = np.zeros((len(poses[0]), len(State)))
    states[:, State.X], states[:, State.Y], states[:, State.PSI] = poses
    bodies = shapely.polygons(rectangles(states, margin=spare))
    inside: Array = shapely.covers(area, bodies)
    return inside
