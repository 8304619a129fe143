"""The ego vehicle in SUMO: it goes where we put it, and the others take it for one of theirs.

Others yield at junctions to vehicles whose routes cross theirs, so the ego vehicle needs a route:
to its goal, or straight on. Where lanes fork they lie on each other, and only the route tells which
one it is on: SUMO is told to keep to the route while the vehicle is on it. When it has left it, it
is given a new one.
"""

from collections.abc import Collection
from contextlib import suppress

import libsumo
import shapely

from mpcplan.observation import Box
from mpcplan.sumo.drivers import ANY, CAR, add_type
from mpcplan.sumo.lanes import LaneGraph, Place
from mpcplan.sumo.onward import edges_of, onward, towards, with_approach
from mpcplan.sumo.session import Session
from mpcplan.sumo.trips import fronts
from mpcplan.trajectory import Array

EGO = "ego"
REACH = 5.0  # m, from the middle of a lane, within which the ego vehicle is on it
ASIDE = 1.5  # m, from the middle of its lane, farther than which SUMO does not have it there
_OFF_ROUTE = 3.0  # m, that a lane of the route may be farther: turns are cut, or taken wide


class EgoVehicle:
    """SUMO's vehicle for the ego.

    Attributes:
        lanes: all lanes of its route.
        lane: where SUMO has it, '' before the first step.
    """

    def __init__(
        self, session: Session, graph: LaneGraph, box: Array, goal_lanes: Collection[str]
    ) -> None:
        """Adds it, to be on the road after the next step.

        Args:
            session: the simulation.
            graph: its net.
            box: (6,) at the start, file coordinates.
            goal_lanes: where it wants to go; none: straight on.
        """
        self._session, self._graph, self._goal_lanes = session, graph, goal_lanes
        self.lanes: frozenset[str] = frozenset()
        self.lane = ""
        self._left_route = False
        self._speed = float(box[Box.V])
        length, width = float(box[Box.LENGTH]), float(box[Box.WIDTH])
        add_type(EGO, CAR, ANY, length, width, self._speed)
        start = self._place_at(box)
        self._edges = self._way(start.lane if start else graph.nearest(fronts(box[None])[0]))
        libsumo.route.add(EGO, self._edges)
        libsumo.vehicle.add(EGO, EGO, EGO, depart="now")
        session.command(EGO)
        self.place(box)

    def place(self, box: Array) -> None:
        """Where it is to be after the next step: (6,) in file coordinates."""
        self._speed = float(box[Box.V])
        place = self._place_at(box)
        self._left_route = place is not None and place.lane not in self.lanes
        if place is None:
            self._session.place(EGO, box)
            return
        lane, on_route = self._graph.lanes[place.lane], not self._left_route
        self._session.place(EGO, self._nearer(box, place) if on_route else box, lane.name, on_route)

    def placed(self) -> None:
        """To be called after the step: SUMO learns the speed, and the route if it was left."""
        libsumo.vehicle.setPreviousSpeed(EGO, self._speed)
        self.lane = libsumo.vehicle.getLaneID(EGO)
        if not self._left_route or self.lane in self.lanes or self.lane not in self._graph.lanes:
            return
        edges = self._way(self.lane)
        with suppress(
            libsumo.TraCIException
        ):  # a junction with several ways in: SUMO's guess holds
            libsumo.vehicle.setRoute(EGO, edges)

    def _nearer(self, box: Array, place: Place) -> Array:
        """The box where SUMO still has it on the lane: one far aside of all lanes is not seen."""
        if place.distance <= ASIDE:
            return box
        front, line = fronts(box[None])[0], self._graph.lanes[place.lane].line
        middle = shapely.get_coordinates(line.interpolate(place.offset))[0]
        moved: Array = box.copy()
        moved[[Box.X, Box.Y]] += (1 - ASIDE / place.distance) * (middle - front)
        return moved

    def _place_at(self, box: Array) -> Place | None:
        """The lane it is on, rather one of its route; None off all lanes."""
        places = self._graph.near(fronts(box[None])[0], float(box[Box.PSI]), REACH)
        return min(places, key=self._strangeness, default=None)

    def _strangeness(self, place: Place) -> tuple[float, str]:
        """How badly a place suits the ego vehicle."""
        off_route = _OFF_ROUTE * (place.lane not in self.lanes)
        return place.distance + abs(place.turn) + off_route, place.lane

    def _way(self, lane: str) -> tuple[str, ...]:
        """The edges from a lane to the goal, if it can be reached, and onward."""
        lanes = towards(self._graph, lane, self._goal_lanes) or (lane,)
        lanes += onward(self._graph, lanes[-1:], ANY, edges_of(self._graph, lanes))
        edges = edges_of(self._graph, with_approach(self._graph, lanes))
        self.lanes = self._graph.on_route(edges)
        return edges
