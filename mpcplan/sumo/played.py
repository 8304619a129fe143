"""An obstacle that SUMO does not drive: it stands, or moves as recorded.

SUMO's cars see it where it reaches into their way; beside the lanes they need not.
"""

import math

import libsumo
import numpy as np

from mpcplan.observation import Box
from mpcplan.sumo.drivers import ANY, add_type, driver_of
from mpcplan.sumo.lanes import LaneGraph
from mpcplan.sumo.records import Record
from mpcplan.sumo.session import Session
from mpcplan.sumo.trips import fronts
from mpcplan.trajectory import Array

ANY_WAY = math.pi  # rad
HEEDED = 2.0  # s, for which drivers expect it to go on as it does
CORRIDOR = 1.0  # m, from a lane's middle: who does not reach into it is in nobody's way


class Played:
    """One such obstacle.

    Attributes:
        record: what the scenario says of it.
        name: SUMO's id.
        lane: the lane on which SUMO has it, '' where it is in nobody's way.
    """

    def __init__(self, record: Record, goes_on: bool, dt: float) -> None:
        """With ``goes_on`` it keeps its last speed and heading when its record ends."""
        self.record = record
        self.name = str(record.id)
        self.lane = ""
        self._goes_on, self._dt = goes_on, dt
        self._placed: Array | None = None

    def box(self, step: int) -> Array | None:
        """(6,) at a time step, file coordinates; None where it is not there."""
        known = self.record.at(step)
        beyond = step - self.record.last_step
        if known is not None or beyond <= 0 or not self._goes_on:
            return known
        last: Array = self.record.boxes[-1].copy()
        way = last[Box.V] * self._dt * beyond
        last[[Box.X, Box.Y]] += way * np.array([np.cos(last[Box.PSI]), np.sin(last[Box.PSI])])
        return last

    def reach(self, step: int) -> Array | None:
        """(6,) box of where it is at a time step and soon will be if it goes on, for drivers to
        heed; None where it is not there."""
        box = self.box(step)
        if box is None:
            return None
        reach, way = box.copy(), float(box[Box.V]) * HEEDED
        reach[Box.X] += way / 2 * math.cos(box[Box.PSI])
        reach[Box.Y] += way / 2 * math.sin(box[Box.PSI])
        reach[Box.LENGTH] += way
        return reach

    def place(self, session: Session, graph: LaneGraph, step: int) -> None:
        """Puts it where it is to be after the next step, or takes it off the road."""
        box = self.box(step)
        if self._placed is not None and box is not None and np.array_equal(box, self._placed):
            return  # SUMO leaves it where it is
        self._placed = box
        lane = "" if box is None else _lane_blocked(graph, box)
        if box is None or not lane:
            self._leave(session)
            return
        if not self.lane:
            self._enter(session, graph, box, lane)
        self.lane = lane
        known = graph.lanes[lane]
        session.place(self.name, box, known.name)

    def _enter(self, session: Session, graph: LaneGraph, box: Array, lane: str) -> None:
        length, width = float(box[Box.LENGTH]), float(box[Box.WIDTH])
        driver = driver_of(self.record.kind)
        if self.name not in libsumo.vehicletype.getIDList():
            add_type(self.name, driver, ANY, length, width, float(box[Box.V]))
            libsumo.route.add(self.name, [graph.normal(lane)])
        libsumo.vehicle.add(self.name, self.name, self.name, depart="now")
        session.command(self.name)

    def _leave(self, session: Session) -> None:
        if self.lane:
            session.remove(self.name)
            self.lane = ""


def _lane_blocked(graph: LaneGraph, box: Array) -> str:
    """The lane in whose corridor an obstacle stands, whatever way it faces; '': no one's."""
    reach = CORRIDOR + float(box[Box.WIDTH]) / 2
    places = graph.near(fronts(box[None])[0], float(box[Box.PSI]), reach, ANY_WAY)
    return min(places, key=lambda p: (p.distance, p.lane)).lane if places else ""
