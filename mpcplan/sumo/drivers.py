"""The parameters by which SUMO drives each kind of vehicle.

Accelerations and gaps are those of the public interactive scenarios' own vehicle types, which have
the same values in all of them; what they leave open is SUMO's default for the vehicle class
(https://sumo.dlr.de/docs/Vehicle_Type_Parameter_Defaults.html).
"""

from dataclasses import dataclass

import libsumo

_DEFAULT_TYPE = "DEFAULT_VEHTYPE"
IMPERFECTION = 0.5  # sigma of the Krauss model, SUMO's default: seeded, so the same in every run
HEADWAY = 1.0  # s, tau of the Krauss model, SUMO's default
PASSENGER = "passenger"
ANY = "ignoring"  # the class that no lane refuses


@dataclass(frozen=True)
class Driver:
    """How a kind of vehicle drives.

    Attributes:
        vehicle_class: SUMO's vClass.
        accel: highest acceleration [m/s^2].
        decel: comfortable deceleration [m/s^2], which the safe speed rests on.
        emergency_decel: highest deceleration [m/s^2].
        speed_max: [m/s].
        gap_min: kept when standing [m].
    """

    vehicle_class: str
    accel: float
    decel: float
    emergency_decel: float
    speed_max: float
    gap_min: float


CAR = Driver(PASSENGER, 2.9, 4.5, 9.0, 50.0, 1.0)
TRUCK = Driver("truck", 1.3, 4.0, 7.0, 36.1, 2.5)
BUS = Driver("bus", 1.2, 4.0, 7.0, 23.6, 2.5)
BICYCLE = Driver("bicycle", 1.2, 3.0, 7.0, 6.94, 1.0)
MOTORCYCLE = Driver("motorcycle", 2.5, 4.5, 10.0, 36.1, 2.5)
DRIVERS = {
    "car": CAR,
    "taxi": CAR,
    "parkedVehicle": CAR,
    "priorityVehicle": CAR,
    "truck": TRUCK,
    "bus": BUS,
    "bicycle": BICYCLE,
    "motorcycle": MOTORCYCLE,
}


def driver_of(kind: str) -> Driver:
    """The driver of a kind of obstacle in CommonRoad's words; what is unknown drives like a car."""
    return DRIVERS.get(kind, CAR)


def add_type(
    name: str, driver: Driver, vehicle_class: str, length: float, width: float, speed: float
) -> None:
    """Makes SUMO's vehicle type for one vehicle that starts at a speed [m/s]."""
    types = libsumo.vehicletype
    types.copy(_DEFAULT_TYPE, name)
    types.setVehicleClass(name, vehicle_class)
    types.setLength(name, length)
    types.setWidth(name, width)
    types.setAccel(name, driver.accel)
    types.setDecel(name, driver.decel)
    types.setEmergencyDecel(name, max(driver.emergency_decel, driver.decel))
    types.setApparentDecel(name, driver.decel)
    types.setMaxSpeed(name, max(driver.speed_max, speed))
    types.setMinGap(name, driver.gap_min)
    types.setTau(name, HEADWAY)
    types.setImperfection(name, IMPERFECTION)
    types.setSpeedFactor(name, 1.0)
    types.setSpeedDeviation(name, 0.0)
