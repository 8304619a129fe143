"""How each kind of road user drives.

The values are those of the vehicle types of the public interactive scenarios; what these leave open
is SUMO's default (https://sumo.dlr.de/docs/Vehicle_Type_Parameter_Defaults.html). Pedestrians are
never predicted along lanes.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mpcplan.observation import Snapshot
from mpcplan.trajectory import Array

IMPERFECTION = 0.5  # sigma of the Krauss model


@dataclass(frozen=True)
class Kind:
    """How a kind of road user drives.

    Attributes:
        acceleration: the highest [m/s^2].
        deceleration: that it counts on [m/s^2].
        gap: kept when standing [m].
        speed: the highest [m/s].
    """

    acceleration: float
    deceleration: float
    gap: float
    speed: float


CAR = Kind(2.9, 4.5, 1.0, 50.0)
KINDS = {
    "truck": Kind(1.3, 4.0, 2.5, 36.1),
    "bus": Kind(1.2, 4.0, 2.5, 23.6),
    "bicycle": Kind(1.2, 3.0, 1.0, 6.94),
    "motorcycle": Kind(2.5, 4.5, 2.5, 36.1),
}
DECELERATIONS = tuple(sorted({kind.deceleration for kind in (CAR, *KINDS.values())}))
STANDING = frozenset({
    "parkedVehicle", "constructionZone", "roadBoundary", "building", "pillar", "median_strip",
})  # fmt: skip
OFF_LANES = STANDING | {"pedestrian", "train"}  # kinds that do not follow lanes


@dataclass(frozen=True, eq=False)
class Drivers:
    """The parameters of many road users, all (n,); see :class:`Kind`.

    Attributes:
        acceleration: the highest [m/s^2].
        usual: the mean acceleration of a free driver, who is imperfect [m/s^2].
        deceleration: that they count on [m/s^2].
        gap: kept when standing [m].
        speed: the highest [m/s].
    """

    acceleration: Array
    usual: Array
    deceleration: Array
    gap: Array
    speed: Array


def drivers(kinds: Iterable[str]) -> Drivers:
    """The parameters of road users of kinds in CommonRoad's words; the unknown drive like cars."""
    found = [KINDS.get(name, CAR) for name in kinds]
    acceleration, deceleration, gap, speed = np.array(
        [(kind.acceleration, kind.deceleration, kind.gap, kind.speed) for kind in found]
    ).reshape(-1, 4).T  # fmt: skip
    # Krauss: every step's speed is lowered by a random part of sigma a dt, half of it on average
    return Drivers(acceleration, acceleration * (1 - IMPERFECTION / 2), deceleration, gap, speed)


def standing(seen: Snapshot) -> Array:
    """(n,) who of a snapshot will never move."""
    return np.array([seen.kind_of(number) in STANDING for number in seen.ids], bool)
