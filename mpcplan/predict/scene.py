"""Those who are predicted along lanes: where they are on the lanes, and how they move."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from mpcplan.observation import Box, Observation
from mpcplan.predict.hypotheses import place_weights
from mpcplan.predict.kinds import Drivers, drivers
from mpcplan.predict.lanes import Lanes, Places
from mpcplan.predict.motion import Motion
from mpcplan.predict.paths import Paths
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import centres

EGO_KIND = "car"


@dataclass(frozen=True, eq=False)
class Scene:
    """The vehicles near the ego vehicle, and it as the last one (arrays by vehicle).

    Attributes:
        rows: (n - 1,) their rows in the snapshot, without the ego vehicle.
        boxes: (n, 6) columns :class:`Box`.
        motion: how they have moved lately.
        drivers: how they drive.
        places: where their fronts are on lanes.
        weight: probabilities of the places.
    """

    rows: Array
    boxes: Array
    motion: Motion
    drivers: Drivers
    places: Places
    weight: Array

    @property
    def ego(self) -> int:
        """Index of the ego vehicle."""
        return len(self.rows)

    @property
    def count(self) -> int:
        """Number of vehicles, the ego vehicle among them."""
        return len(self.boxes)


def scene_of(
    observation: Observation, moves: Motion, lanes: Lanes, paths: Paths, reach: float,
    off_lanes: Collection[str],
) -> Scene:  # fmt: skip
    """The scene of an observation.

    Args:
        observation: what is seen.
        moves: motion of all in its last snapshot.
        lanes: of the map.
        paths: of the map.
        reach: distance from the ego vehicle [m] from which on the others are left out.
        off_lanes: kinds that are left out.
    """
    now, state = observation.now, observation.state
    ego = np.array([*centres(state[None])[0], state[State.PSI], state[State.V],
                    CAR.length, CAR.width])  # fmt: skip
    kinds = now.kinds or ("unknown",) * len(now.ids)
    offset = now.boxes[:, [Box.X, Box.Y]] - ego[[Box.X, Box.Y]]
    near = np.hypot(*offset.T) < reach
    near &= np.array([kind not in off_lanes for kind in kinds], bool)
    rows = np.flatnonzero(near)
    boxes = np.vstack([now.boxes[rows], ego])
    along = np.column_stack([np.cos(boxes[:, Box.PSI]), np.sin(boxes[:, Box.PSI])])
    motion = Motion(
        np.append(moves.acceleration[rows], 0.0),
        np.append(moves.yaw_rate[rows], 0.0),
        np.vstack([moves.velocity[rows], ego[Box.V] * along[-1]]),
    )
    fronts = boxes[:, [Box.X, Box.Y]] + boxes[:, Box.LENGTH, None] / 2 * along
    places = lanes.match(fronts, boxes[:, Box.PSI])
    weight = place_weights(places, motion.velocity, paths, len(boxes))
    return Scene(
        rows, boxes, motion, drivers([*(kinds[i] for i in rows), EGO_KIND]), places, weight
    )
