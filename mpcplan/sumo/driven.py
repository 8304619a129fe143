"""A vehicle that starts as recorded and is then driven by SUMO.

It comes in within one step: it is added with its route and moved to where its record begins; the
step puts it exactly there; then SUMO is told its speed, which it would otherwise take from the
move. From the next step on SUMO drives it (:mod:`mpcplan.sumo.settling` on how it gets used to it).

SUMO gets the point of the lane's middle that is nearest to the recorded one, and its body is shown
where it was recorded (:mod:`mpcplan.sumo.shown`).
"""

import math
from collections.abc import Sequence

import libsumo
import numpy as np

from mpcplan.observation import Box
from mpcplan.sumo.drivers import add_type, driver_of
from mpcplan.sumo.lanes import LaneGraph
from mpcplan.sumo.records import Record
from mpcplan.sumo.session import Session, heading
from mpcplan.sumo.settling import Settling
from mpcplan.sumo.shown import Shown
from mpcplan.sumo.trips import Trip, fronts
from mpcplan.trajectory import Array


class Driven:
    """One such vehicle.

    Attributes:
        record: what the scenario says of it.
        trip: where it goes.
        driver: how it drives.
        lanes: all lanes of its route.
        name: SUMO's id.
        entered: time step at which it came in, None before.
        error: distance [m] at that step between where it was put and where SUMO has it.
    """

    def __init__(self, record: Record, trip: Trip, graph: LaneGraph) -> None:
        self.record, self.trip = record, trip
        self.driver = driver_of(record.kind)
        self.lanes = graph.on_route(trip.edges)
        self.name = str(record.id)
        self.entered: int | None = None
        self.error = math.nan
        self._settling = Settling(self.name, self.driver)
        self._shown = Shown()

    @property
    def start(self) -> Array:
        """(6,) box of its entry, file coordinates."""
        box: Array = self.record.boxes[0]
        return box

    def enter(self, session: Session, graph: LaneGraph) -> None:
        """Brings it into SUMO, to be there after the next step."""
        place = self.trip.start
        lane = graph.lanes[place.lane]
        speed = float(self.start[Box.V])
        length, width = float(self.start[Box.LENGTH]), float(self.start[Box.WIDTH])
        add_type(self.name, self.driver, self.trip.vehicle_class, length, width, speed)
        libsumo.route.add(self.name, self.trip.edges)
        libsumo.vehicle.add(self.name, self.name, self.name, depart="now")
        psi = lane.heading(place.offset)
        self._front = lane.point(place.offset)
        x, y = self._front - length / 2 * np.array([math.cos(psi), math.sin(psi)])
        session.move(self.name, np.array([x, y, psi, speed, length, width]), lane.name)

    def release(self, step: int) -> None:
        """Lets SUMO drive it, after the step in which it came in."""
        self.entered = step
        front = np.array(libsumo.vehicle.getPosition(self.name))
        self.error = float(np.hypot(*(front - self._front)))
        off, psi = fronts(self.start[None])[0] - front, float(self.start[Box.PSI])
        self._shown.begin(off, psi, front, heading(libsumo.vehicle.getAngle(self.name)))
        libsumo.vehicle.setPreviousSpeed(self.name, float(self.start[Box.V]))

    def settle(self, dt: float) -> None:
        """Before every later step, while SUMO drives it."""
        self._settling.step(dt)

    def shown(self, box: Sequence[float], dt: float) -> tuple[float, ...]:
        """(6,) box as others see it, given SUMO's, to be asked once a step."""
        return self._shown.step(box, dt)
