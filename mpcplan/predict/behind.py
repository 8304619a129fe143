"""Who drives behind the ego vehicle in its lane.

They react to whatever it does, which a forecast cannot know: predicted with one motion of the ego
vehicle, they would run into every other one, and nothing that brakes would pass verification.
"""

import numpy as np

from mpcplan.observation import Box
from mpcplan.predict.hypotheses import Hypotheses, Leaders
from mpcplan.predict.paths import Paths
from mpcplan.predict.scene import Scene
from mpcplan.trajectory import Array

OWN_LANE = 1.5  # m, from a lane's centre, within which the ego vehicle drives on it


def followers(scene: Scene, found: Hypotheses, first: Array, ahead: Leaders, paths: Paths) -> Array:
    """Vehicles that follow the ego vehicle on its lane and can stay behind it, and theirs.

    Args:
        scene: the vehicles.
        found: their hypotheses.
        first: (n,) row of each vehicle's most likely one; -1: none.
        ahead: the hypotheses' leaders.
        paths: the ways.
    """
    known = np.flatnonzero(first[: scene.ego] >= 0)
    row = first[known]
    led = ahead.row[row] < len(found.path)
    known, row = known[led], row[led]
    by = found.vehicle[ahead.row[row]]
    v = scene.boxes[:, Box.V]
    gap = ahead.at[row] - scene.boxes[by, Box.LENGTH] - found.s[row]
    closing = np.maximum(v[known] - v[by], 0.0)
    stays = closing**2 <= 2 * scene.drivers.deceleration[known] * gap
    places = scene.places
    own = places.lane[(places.vehicle == scene.ego) & (np.abs(places.d) < OWN_LANE)]
    stays &= (by != scene.ego) | np.isfinite(paths.starts[found.path[row]][:, own]).any(axis=1)
    behind = np.zeros(scene.count, bool)
    behind[scene.ego] = True
    for _ in known:  # each round adds those behind the ones of the round before
        more = known[stays & behind[by] & ~behind[known]]
        if not len(more):
            break
        behind[more] = True
    return np.flatnonzero(behind[: scene.ego])
