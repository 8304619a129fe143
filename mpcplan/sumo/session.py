"""One SUMO simulation in this process, by libsumo.

SUMO and the scenario's files share coordinates ("file coordinates" here). SUMO gives the middle of
a vehicle's front bumper and an angle from north, clockwise; boxes have the centre and a heading
from east, counter-clockwise:

    psi = 90 deg - angle,  centre = front - L / 2 [cos psi, sin psi].

We pass every option ourselves and never a ``.sumo.cfg``, which could ask for output files in the
scenario's folder. The files must have been checked (:mod:`mpcplan.sumo.folder`): SUMO's reader
takes the whole process down where XML is broken.
"""

import math
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import libsumo
import numpy as np

from mpcplan.errors import TrafficError
from mpcplan.observation import Box
from mpcplan.trajectory import Array

# SUMO's vehicle classes (vClass) in CommonRoad's words; all others are 'unknown'
KINDS = {
    "passenger": "car",
    "private": "car",
    "evehicle": "car",
    "hov": "car",
    "vip": "car",
    "taxi": "taxi",
    "truck": "truck",
    "trailer": "truck",
    "delivery": "truck",
    "bus": "bus",
    "coach": "bus",
    "emergency": "priorityVehicle",
    "authority": "priorityVehicle",
    "army": "priorityVehicle",
    "motorcycle": "motorcycle",
    "moped": "motorcycle",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
    "tram": "train",
    "rail": "train",
    "rail_urban": "train",
    "rail_electric": "train",
    "rail_fast": "train",
}
UNKNOWN_KIND = "unknown"
ANYWHERE = 2  # moveToXY's keepRoute: exactly where told, on or off the route or road
ON_ROUTE = 3  # exactly where told, for SUMO on a lane of the route
UNCHECKED = 0  # speed and lane change modes: SUMO does nothing of its own


@dataclass(frozen=True)
class Options:
    """How SUMO is started.

    Attributes:
        net: the road network's file.
        dt: step length [s].
        seed: of SUMO's random numbers.
        routes: route files, none where vehicles are added one by one.
        additional: further files (vehicle types).
        lateral_resolution: width of the sublanes [m]; 0: none, then lane changes take
            ``lanechange_duration``.
        lanechange_duration: [s]; 0 without sublanes means a jump from lane to lane.
        further: further options of SUMO, names without dashes; they override all of these.
    """

    net: Path
    dt: float = 0.1
    seed: int = 0
    routes: tuple[Path, ...] = ()
    additional: tuple[Path, ...] = ()
    lateral_resolution: float = 0.0
    lanechange_duration: float = 0.0
    further: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, eq=False)
class Vehicles:
    """All vehicles in the simulation at one time, sorted by SUMO's id.

    Attributes:
        ids: (n,) SUMO's ids.
        boxes: (n, 6) in file coordinates, columns :class:`Box`.
        kinds: (n,) in CommonRoad's words.
    """

    ids: tuple[str, ...]
    boxes: Array
    kinds: tuple[str, ...]


class Session:
    """A running simulation; only one can be alive in a process, one after another is fine."""

    _alive: "Session | None" = None

    def __init__(self, options: Options) -> None:
        """Starts SUMO.

        Raises:
            TrafficError: another simulation runs in this process, or SUMO refuses the files.
        """
        if Session._alive is not None:
            raise TrafficError(
                "a SUMO simulation is running in this process already; close it first, or use "
                "another process"
            )
        _start(options)
        Session._alive = self
        self._bodies: dict[str, tuple[float, float, str]] = {}

    def close(self) -> None:
        """Ends the simulation; once is enough, twice does no harm."""
        if Session._alive is self:
            Session._alive = None
            libsumo.close()

    def __enter__(self) -> "Session":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(libsumo.simulation.getTime())

    def step(self) -> None:
        """Advances by one time step.

        Raises:
            TrafficError: SUMO cannot go on.
        """
        try:
            libsumo.simulationStep()
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            raise TrafficError(f"SUMO stopped at {self.time:.1f} s: {error}") from error

    def ids(self) -> tuple[str, ...]:
        """The ids of all vehicles on the road, sorted."""
        return tuple(sorted(libsumo.vehicle.getIDList()))

    def vehicles(self, but: str = "") -> Vehicles:
        """Where all vehicles are now, one of them left out if told so."""
        ids, get = tuple(known for known in self.ids() if known != but), libsumo.vehicle
        bodies = [self._body(known) for known in ids]
        rows = [
            (*get.getPosition(known), get.getAngle(known), get.getSpeed(known), length, width)
            for known, (length, width, _) in zip(ids, bodies, strict=True)
        ]  # in the order of Box, but for the front and SUMO's angle
        boxes = np.array(rows).reshape(-1, len(Box))
        boxes[:, Box.PSI] = psi = _headings(boxes[:, Box.PSI])
        half = boxes[:, Box.LENGTH] / 2
        boxes[:, Box.X] -= half * np.cos(psi)
        boxes[:, Box.Y] -= half * np.sin(psi)
        return Vehicles(ids, boxes, tuple(kind for _, _, kind in bodies))

    def box(self, vehicle: str) -> tuple[float, ...]:
        """Where one vehicle is now, in file coordinates, in the order of :class:`Box`."""
        length, width, _ = self._body(vehicle)
        front_x, front_y = libsumo.vehicle.getPosition(vehicle)
        psi = heading(libsumo.vehicle.getAngle(vehicle))
        x = front_x - length / 2 * math.cos(psi)
        y = front_y - length / 2 * math.sin(psi)
        return x, y, psi, libsumo.vehicle.getSpeed(vehicle), length, width

    def _body(self, vehicle: str) -> tuple[float, float, str]:
        """Length, width [m] and kind, asked once: they do not change."""
        if vehicle not in self._bodies:
            get = libsumo.vehicle
            kind = KINDS.get(get.getVehicleClass(vehicle), UNKNOWN_KIND)
            self._bodies[vehicle] = (get.getLength(vehicle), get.getWidth(vehicle), kind)
        return self._bodies[vehicle]

    def command(self, vehicle: str) -> None:
        """Takes a vehicle out of SUMO's hands: it goes where :meth:`place` puts it."""
        libsumo.vehicle.setSpeedMode(vehicle, UNCHECKED)
        libsumo.vehicle.setLaneChangeMode(vehicle, UNCHECKED)

    def place(
        self, vehicle: str, box: Array, lane: tuple[str, int] = ("", -1), on_route: bool = False
    ) -> None:
        """Puts a vehicle somewhere, to go on at the box's speed; see :meth:`move`."""
        self.move(vehicle, box, lane, on_route)
        libsumo.vehicle.setSpeed(vehicle, float(box[Box.V]))

    def move(
        self, vehicle: str, box: Array, lane: tuple[str, int] = ("", -1), on_route: bool = False
    ) -> None:
        """Puts a vehicle somewhere; it is exactly there after the next step.

        Args:
            vehicle: SUMO's id.
            box: (6,) in file coordinates, columns :class:`Box`.
            lane: edge and index of the lane that is meant where several lie there; none: the
                nearest.
            on_route: whether it must be a lane of the vehicle's route.
        """
        x, y, psi, _, length, _ = (float(value) for value in box)
        front = x + length / 2 * math.cos(psi), y + length / 2 * math.sin(psi)
        keep = ON_ROUTE if on_route else ANYWHERE
        libsumo.vehicle.moveToXY(vehicle, *lane, *front, angle(psi), keep)

    def remove(self, vehicle: str) -> None:
        """Takes a vehicle off the road."""
        libsumo.vehicle.remove(vehicle)
        self._bodies.pop(vehicle, None)


def heading(sumo_angle: float) -> float:
    """CommonRoad's heading [rad] in [-pi, pi] of SUMO's angle [deg]."""
    return float(_headings(np.array(sumo_angle)))


def _headings(angles: Array) -> Array:
    psi = np.radians(90.0 - angles)
    return np.arctan2(np.sin(psi), np.cos(psi))


def angle(psi: float) -> float:
    """SUMO's angle [deg] in [0, 360) of a heading [rad]."""
    return (90.0 - math.degrees(psi)) % 360.0


def _start(options: Options) -> None:
    """Starts SUMO quietly; what it says is kept for the error."""
    with tempfile.TemporaryFile() as said:
        try:
            with _overhear(said):
                libsumo.start(["sumo", *_command_line(options)])
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            said.seek(0)
            lines = said.read().decode(errors="replace").splitlines()
            reason = " ".join(line for line in lines if line.startswith("Error")) or str(error)
            raise TrafficError(f"{options.net}: SUMO does not start: {reason}") from error


@contextmanager
def _overhear(file: IO[bytes]) -> Iterator[None]:
    """Writes to a file what is written below Python to stdout and stderr: SUMO's messages come
    before any log file of its own is open."""
    kept = [os.dup(fd) for fd in (1, 2)]
    try:
        for fd in (1, 2):
            os.dup2(file.fileno(), fd)
        yield
    finally:
        for fd, copy in zip((1, 2), kept, strict=True):
            os.dup2(copy, fd)
            os.close(copy)


def _command_line(options: Options) -> list[str]:
    """SUMO's command line: quiet, no output files, nobody vanishes for standing too long or for
    touching another."""
    given = {
        "net-file": str(options.net),
        "step-length": repr(options.dt),
        "seed": str(options.seed),
        "verbose": "false",
        "no-step-log": "true",
        "no-warnings": "true",
        "duration-log.disable": "true",
        "xml-validation": "never",
        "xml-validation.net": "never",
        "time-to-teleport": "-1",
        "collision.action": "none",
        "collision.check-junctions": "false",
        "lanechange.duration": repr(options.lanechange_duration),
    }
    if options.lateral_resolution > 0:
        given["lateral-resolution"] = repr(options.lateral_resolution)
    if options.routes:
        given["route-files"] = ",".join(map(str, options.routes))
    if options.additional:
        given["additional-files"] = ",".join(map(str, options.additional))
    given |= dict(options.further)
    return [word for name, value in given.items() for word in (f"--{name}", value)]
