"""A player of the game: a body on its way."""

from dataclasses import dataclass

import numpy as np

from mpcplan.game.way import Place, Way
from mpcplan.trajectory import Array

EGO = -1  # the ego vehicle's id among players; those of obstacles are not negative


@dataclass(frozen=True, eq=False)
class Player:
    """The ego vehicle or another road user.

    Attributes:
        id: of the obstacle, or :data:`EGO`.
        way: along which it is expected to drive.
        place: (4,) present state, columns :class:`Place`.
        length, width: of the body [m].
        target: arc length [m] that it wants to reach.
    """

    id: int
    way: Way
    place: Array
    length: float
    width: float
    target: float

    def __post_init__(self) -> None:
        if self.place.shape != (len(Place),) or not np.isfinite(self.place).all():
            raise ValueError(f"a player's place must be {len(Place)} numbers, got {self.place}")

    @property
    def pose(self) -> Array:
        """(4,) present pose on the map, columns :class:`mpcplan.game.way.Pose`."""
        return self.way.pose(self.place)
