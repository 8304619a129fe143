"""Whom the ego vehicle stands in the way of: nobody drives through a body that lies across his way.

A vehicle that turns is on no lane of those whose ways it crosses, and leads none of them. Who comes
to it waits before it until it is expected to have driven on by its length and the width of the one
who waits.
"""

import numpy as np

from mpcplan.observation import Box
from mpcplan.predict.hypotheses import Hypotheses
from mpcplan.predict.paths import Paths
from mpcplan.predict.scene import Scene
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

LOOK = 15.0  # m ahead of fronts, within which bodies are looked for,
SPACING = 0.5  # m, at samples of this spacing
CLEAR = 0.3  # m, kept to either side of a body,
GAP = 0.5  # m, and before it
ALIKE = 0.4  # rad: who is turned by less drives along the way, and is followed


def held_up(
    scene: Scene, found: Hypotheses, paths: Paths, ego_s: Array, step: float
) -> tuple[Array, Array]:
    """Arc lengths (h,) [m] at which hypotheses wait for the ego vehicle's body to be gone
    (infinity: nowhere), and until when [s].

    Args:
        scene: the vehicles.
        found: their hypotheses.
        paths: the ways.
        ego_s: (k + 1,) the ego vehicle's arc lengths as it is expected to drive [m].
        step: between these [s].
    """
    boxes, ego = scene.boxes[found.vehicle], scene.boxes[scene.ego]
    ahead = np.arange(0.0, LOOK + SPACING, SPACING)
    points = paths.at(found.path[:, None], found.s[:, None] + ahead)
    axis = np.gradient(points, axis=1)
    psi = np.arctan2(axis[..., 1], axis[..., 0])
    half = boxes[:, Box.WIDTH, None] / 2
    c, s = np.cos(ego[Box.PSI]), np.sin(ego[Box.PSI])
    inside = np.zeros(psi.shape, bool)
    for side in (-half, 0.0, half):
        dx = points[..., 0] - side * np.sin(psi) - ego[Box.X]
        dy = points[..., 1] + side * np.cos(psi) - ego[Box.Y]
        inside |= (np.abs(c * dx + s * dy) < CAR.length / 2 + CLEAR) & (
            np.abs(c * dy - s * dx) < CAR.width / 2 + CLEAR
        )
    inside &= np.cos(psi - ego[Box.PSI]) < np.cos(ALIKE)
    inside[found.vehicle == scene.ego] = False
    met = inside.any(axis=1)
    stop = np.where(met, found.s + np.maximum(ahead[inside.argmax(axis=1)] - GAP, 0.0), np.inf)
    gone = CAR.length + boxes[:, Box.WIDTH]
    release = step * (ego_s[:, None] - ego_s[0] < gone).sum(axis=0)
    return stop, np.where(met, release, 0.0)
