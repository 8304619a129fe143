"""Parameters of the competition's road users, drawn as the organisers' simulator (sumocr) does.

After every step of SUMO, each road user that is new gets values from the settings' intervals, the
vehicles first, each group in the order of SUMO's list. One generator, numpy's legacy one with the
settings' seed, makes all draws, so that one draw more or less changes everybody after it.
"""

import libsumo
import numpy as np

from mpcplan.sumo.session import KINDS
from mpcplan.sumo.settings import Range, Settings

PEDESTRIAN = "pedestrian"
# Drawn in this order; pedestrians only have the first three, but use up random numbers for all
_PARAMETERS = ("width", "length", "minGap", "accel", "decel", "maxSpeed")


class Draws:
    """Gives every new road user its parameters."""

    def __init__(self, settings: Settings) -> None:
        self._table = settings.vehicle_parameters
        self._random = np.random.RandomState(settings.random_seed)
        self._vehicles: set[str] = set()
        self._persons: set[str] = set()

    def draw_new(self) -> None:
        """Parameters for all that SUMO did not list before; to be called after every step."""
        for vehicle in libsumo.vehicle.getIDList():
            if vehicle not in self._vehicles:
                self._vehicles.add(vehicle)
                _set_vehicle(vehicle, self._values(kind_of(vehicle)))
        for person in libsumo.person.getIDList():
            if person not in self._persons:
                self._persons.add(person)
                _set_person(person, self._values(PEDESTRIAN))

    def _values(self, kind: str) -> dict[str, float]:
        """What the table has for a kind of road user."""
        ranges = ((name, self._table.get(name, {}).get(kind)) for name in _PARAMETERS)
        return {name: self._drawn(given) for name, given in ranges if given is not None}

    def _drawn(self, given: Range) -> float:
        """Only intervals use up a random number, also those of no width."""
        return float(self._random.uniform(*given)) if isinstance(given, tuple) else given


def kind_of(vehicle: str) -> str:
    """What a vehicle is, in CommonRoad's words; '' where there is no word for it."""
    return KINDS.get(libsumo.vehicle.getVehicleClass(vehicle), "")


def _set_vehicle(vehicle: str, values: dict[str, float]) -> None:
    setters = {
        "width": libsumo.vehicle.setWidth,
        "length": libsumo.vehicle.setLength,
        "minGap": libsumo.vehicle.setMinGap,
        "accel": libsumo.vehicle.setAccel,
        "decel": libsumo.vehicle.setDecel,
        "maxSpeed": libsumo.vehicle.setMaxSpeed,
    }
    for name, value in values.items():
        setters[name](vehicle, value)


def _set_person(person: str, values: dict[str, float]) -> None:
    setters = {
        "width": libsumo.person.setWidth,
        "length": libsumo.person.setLength,
        "minGap": libsumo.person.setMinGap,
    }
    for name, value in values.items():
        if name in setters:
            setters[name](person, value)
