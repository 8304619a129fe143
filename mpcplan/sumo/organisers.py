"""SUMO run as the organisers of the competition of 2022 run it (their simulator is sumocr).

Everything that moves a road user follows theirs: seed, sublanes, the draws of parameters
(:mod:`mpcplan.sumo.draws`), the ego vehicle of the route file, which SUMO drives up to step 0, and
how it is placed from then on. With their version of SUMO the traffic is theirs.
"""

import math
from pathlib import Path

import libsumo
import numpy as np

from mpcplan.errors import TrafficError
from mpcplan.observation import Box
from mpcplan.scenario_checks import TIME_STEP
from mpcplan.sumo import safe_xml
from mpcplan.sumo.draws import PEDESTRIAN, Draws
from mpcplan.sumo.folder import SumoFolder
from mpcplan.sumo.session import ANYWHERE, UNCHECKED, Options, Session, angle, heading
from mpcplan.sumo.settings import Settings
from mpcplan.trajectory import Array

ORGANISERS_SUMO = "1.12.0"
_NO_LANE = ("dummy", -1)  # moveToXY then takes the lane nearest to the position
_AGAIN = "mpcplan-again"  # our route for an ego vehicle that SUMO took off the road


class Simulation:
    """SUMO with the folder's traffic; boxes are in file coordinates.

    Attributes:
        notes: what a reader of the result should know, one sentence each.
    """

    def __init__(self, folder: SumoFolder, settings: Settings) -> None:
        """Starts SUMO.

        Raises:
            TrafficError: SUMO refuses the files, or another simulation is alive.
        """
        self._ego, self._substeps = folder.ego, settings.substeps
        self._routes = folder.routes
        self._draws = Draws(settings)
        self.notes: tuple[str, ...] = ()
        self._session = Session(_options(folder, settings))

    def close(self) -> None:
        """Ends it; twice does no harm."""
        self._session.close()

    def presimulate(self, steps: int) -> None:
        """Time steps in which SUMO drives the ego vehicle too."""
        for _ in range(steps * self._substeps):
            self._session.step()
            self._draws.draw_new()

    def step(self, before: Array, after: Array) -> None:
        """One time step in which the ego vehicle goes from one box (6,) to another."""
        turn = after[Box.PSI] - before[Box.PSI]
        way = after - before
        way[Box.PSI] = math.atan2(math.sin(turn), math.cos(turn))
        for k in range(1, self._substeps + 1):
            self._place(after - (1 - k / self._substeps) * way)
            self._session.step()
        self._draws.draw_new()

    def ego_box(self) -> Array | None:
        """(6,) of SUMO's ego vehicle; None where it is not on the road."""
        on_road = self._ego in self._session.ids()
        return np.array(self._session.box(self._ego)) if on_road else None

    def users(self) -> list[tuple[str, str, Array]]:
        """Name, kind and box (6,) of all others, with SUMO's angles as headings."""
        seen = self._session.vehicles(but=self._ego)
        users = list(zip(seen.ids, seen.kinds, seen.boxes, strict=True))
        for vehicle, _, box in users:
            box[Box.V] = math.hypot(box[Box.V], libsumo.vehicle.getLateralSpeed(vehicle))
        persons = sorted(libsumo.person.getIDList())
        return users + [(f"person {name}", PEDESTRIAN, _person(name)) for name in persons]

    def _place(self, box: Array) -> None:
        """Puts the ego vehicle somewhere; it is there after the next step."""
        try:
            self._move(box)
        except libsumo.TraCIException:
            self._bring_back(box)

    def _bring_back(self, box: Array) -> None:
        """Adds an ego vehicle that SUMO never let in or took off at its route's end."""
        self.notes = (
            "SUMO's ego vehicle had left the road, or never entered it; it was added again",
        )
        try:
            if _AGAIN not in libsumo.route.getIDList():
                libsumo.route.add(_AGAIN, _route_of(self._routes, self._ego))
            libsumo.vehicle.add(self._ego, _AGAIN, departPos="base")
            self._move(box)
        except libsumo.TraCIException as error:
            raise TrafficError(
                f"SUMO does not take the ego vehicle {self._ego}: {error}"
            ) from error

    def _move(self, box: Array) -> None:
        # The lane change mode stays: changing it would use up other random numbers of SUMO's
        x, y, psi, v, length, _ = (float(value) for value in box)
        front = x + length / 2 * math.cos(psi), y + length / 2 * math.sin(psi)
        libsumo.vehicle.moveToXY(self._ego, *_NO_LANE, *front, angle(psi), ANYWHERE)
        libsumo.vehicle.setSpeedMode(self._ego, UNCHECKED)
        libsumo.vehicle.setSpeed(self._ego, v)


def version() -> str:
    """Of SUMO, '1.28.0'."""
    return str(libsumo.getVersion()[1]).split()[-1]


def _options(folder: SumoFolder, settings: Settings) -> Options:
    """The organisers' options; with sublanes, lane changes take no fixed time."""
    given = dict(folder.options) | {"xml-validation.routes": "never"}
    given.pop("lateral-resolution", None)
    if settings.lateral_resolution > 0:
        given.pop("lanechange.duration", None)
    return Options(
        net=folder.net,
        dt=TIME_STEP / settings.substeps,
        seed=settings.random_seed,
        routes=folder.routes,
        additional=folder.additional,
        lateral_resolution=settings.lateral_resolution,
        further=tuple(given.items()),
    )


def _person(name: str) -> Array:
    """(6,) box of a pedestrian."""
    x, y = libsumo.person.getPosition(name)
    psi, length = heading(libsumo.person.getAngle(name)), libsumo.person.getLength(name)
    centre = x - length / 2 * math.cos(psi), y - length / 2 * math.sin(psi)
    speed, width = libsumo.person.getSpeed(name), libsumo.person.getWidth(name)
    return np.array([*centre, psi, speed, length, width])


def _route_of(routes: tuple[Path, ...], ego: str) -> list[str]:
    """The ego vehicle's edges as its route file gives them."""
    for file in routes:
        root = safe_xml.check_routes(file)
        named = {route.get("id"): route for route in root.findall("route")}
        for vehicle in root.iter("vehicle"):
            own = vehicle.find("route")
            route = named.get(vehicle.get("route")) if own is None else own
            if vehicle.get("id") == ego and route is not None:
                return route.get("edges", "").split()
    raise TrafficError(f"the route file gives the ego vehicle {ego} no edges")
