"""What SUMO's cars are told beside SUMO's own rules: to yield (:mod:`mpcplan.sumo.yielding`).

They follow, or stop for, bodies that reach into their lane and that SUMO does not have there. On
demand they also yield where lanes conflict unknown to SUMO. That is off by default: at junctions of
equal roads everybody, the ego vehicle included, then ends up waiting for everybody else.
"""

import math
from collections.abc import Collection, Iterable, Mapping

import libsumo

from mpcplan.observation import Box, box_corners
from mpcplan.sumo.crossings import conflicts
from mpcplan.sumo.lanes import LaneGraph
from mpcplan.sumo.meetings import Mover
from mpcplan.sumo.ways import Ways
from mpcplan.sumo.yielding import Body, Yielding
from mpcplan.trajectory import Array

HALF_CAR = 1.0  # m, half of a car's width: a body nearer to a lane's middle is in the way
_FREE = -1.0  # setSpeed's word for: as SUMO thinks fit
_CHECKED = 31  # SUMO's default speed mode
_HARDER = _CHECKED - 4  # the same without the limit of the deceleration


class Courtesy:
    """Keeps SUMO's cars from driving through each other and through the ego vehicle."""

    def __init__(self, graph: LaneGraph, dt: float, crossings: bool = False) -> None:
        """For a net and a time step [s]; ``crossings``: yield at crossings unknown to SUMO too."""
        self._graph = graph
        self._ways = Ways(graph, conflicts(graph) if crossings else {})
        self._yielding = Yielding(dt)
        self._lengths: dict[str, float] = {}
        self._dt = dt
        self._told: frozenset[str] = frozenset()

    def step(
        self,
        routes: Mapping[str, Collection[str]],
        unsteered: str,
        bodies: Iterable[tuple[Array, str]],
    ) -> None:
        """Before every step: tells those who have to yield how fast they may go.

        Args:
            routes: the lanes of the routes of all vehicles on the road, by SUMO's id.
            unsteered: the one among them that takes no orders.
            bodies: (6,) box in file coordinates of each that SUMO's cars may not see, and the lane
                on which SUMO has it, if any.
        """
        lanes = {name: libsumo.vehicle.getLaneID(name) for name in routes}
        movers = [
            self._mover(name, lanes[name], route, name != unsteered)
            for name, route in routes.items()
            if lanes[name] in self._graph.lanes  # else off the road
        ]
        reached = [body for box, lane in bodies for body in self._bodies(box, lane)]
        limits = self._yielding.limits(movers, reached)
        speeds = {mover.name: mover.speed for mover in movers}
        for name in sorted(self._told - limits.keys()):
            if name in speeds:
                libsumo.vehicle.setSpeed(name, _FREE)
        for name, limit in limits.items():
            slowing = (speeds[name] - limit) / self._dt
            harder = slowing > libsumo.vehicle.getDecel(name)
            libsumo.vehicle.setSpeedMode(name, _HARDER if harder else _CHECKED)
            libsumo.vehicle.setSpeed(name, limit)
        self._told = frozenset(limits)

    def _mover(self, name: str, lane: str, route: Collection[str], steered: bool) -> Mover:
        get = libsumo.vehicle
        if name not in self._lengths:
            self._lengths[name] = get.getLength(name)
        length = self._lengths[name]
        way = self._ways.of(name, lane, route, length)
        return Mover(name, way, get.getLanePosition(name), get.getSpeed(name), length, steered)

    def _bodies(self, box: Array, known_lane: str) -> list[Body]:
        """What of a box reaches into lanes, but for that on which SUMO has it."""
        bodies = []
        for lane, along in self._graph.along(box_corners(box), HALF_CAR):
            if lane != known_lane:
                middle = sum(along) / len(along)
                turn = float(box[Box.PSI]) - self._graph.lanes[lane].heading(middle)
                speed = float(box[Box.V]) * math.cos(turn)
                bodies.append(Body(lane, min(along), max(along), speed))
        return bodies
