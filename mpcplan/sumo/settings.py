"""The organisers' settings of a simulation, from ``simulation_config.p``.

The file is a pickle of sumocr's DefaultConfig; only the values that move the traffic are taken.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpcplan.errors import InputError
from mpcplan.sumo.safe_pickle import Record, read, shown

FILE = "simulation_config.p"
_CONFIG = "sumocr.sumo_config.default.DefaultConfig"
_INTERVAL = "commonroad.common.util.Interval"
_KIND = "commonroad.scenario.obstacle.ObstacleType"
_RECORDS = frozenset({_CONFIG, _INTERVAL})
_VALUES = frozenset({_KIND})
_SUBSTEPS_MAX = 100
_PRESIMULATION_MAX = 100_000  # steps; the genuine files have 100 to 222
_SEED_MAX = 2**31 - 1  # SUMO's seed is a 32-bit number
_RESOLUTION_MAX = 100.0  # m
_EGO_LENGTH_MAX = 30.0  # m
_VALUE_MAX = 1000.0  # m, m/s or m/s^2, above all of vehicles

Range = float | tuple[float, float]


@dataclass(frozen=True)
class Settings:
    """How the organisers run a competition scenario.

    Attributes:
        presimulation_steps: time steps that SUMO runs before step 0.
        substeps: SUMO's steps in a time step.
        random_seed: for SUMO and for the vehicles' parameters.
        lateral_resolution: width of SUMO's sublanes [m]; 0: vehicles keep to lane centres.
        ego_length: the ego vehicle's length [m] by which the organisers place it.
        vehicle_parameters: for each parameter ('length', 'accel', ...) its value, or the interval
            from which it is drawn, for each kind of vehicle in CommonRoad's words ('car').
    """

    presimulation_steps: int
    substeps: int
    random_seed: int
    lateral_resolution: float
    ego_length: float
    vehicle_parameters: Mapping[str, Mapping[str, Range]]


def read_settings(path: Path, time_step: float) -> Settings:
    """The settings in a ``simulation_config.p``.

    Args:
        path: the file.
        time_step: of the scenario [s]; another one in the settings is an error.

    Raises:
        InputError: unsafe, broken, or a value is missing or out of its range.
    """
    record = read(path, _RECORDS, _VALUES)
    if not (isinstance(record, Record) and record.name == _CONFIG):
        raise InputError(f"{path}: not the settings of a simulation ({_CONFIG})")
    try:
        _number(record.fields, "dt", time_step, time_step)
        return Settings(
            presimulation_steps=_whole(record.fields, "presimulation_steps", 0, _PRESIMULATION_MAX),
            substeps=_whole(record.fields, "delta_steps", 1, _SUBSTEPS_MAX),
            random_seed=_whole(record.fields, "random_seed", 0, _SEED_MAX),
            lateral_resolution=_number(record.fields, "lateral_resolution", 0.0, _RESOLUTION_MAX),
            ego_length=_number(record.fields, "ego_veh_length", 0.0, _EGO_LENGTH_MAX),
            vehicle_parameters=_vehicle_parameters(record.fields.get("veh_params")),
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _number(fields: Mapping[str, Any], name: str, low: float, high: float) -> float:
    value = fields.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise InputError(f"{name} is {shown(value)}, a number from {low} to {high} is expected")
    return float(value)


def _whole(fields: Mapping[str, Any], name: str, low: int, high: int) -> int:
    value = _number(fields, name, low, high)
    if value != int(value):
        raise InputError(f"{name} is {value!r}, a whole number is expected")
    return int(value)


def _vehicle_parameters(value: Any) -> dict[str, dict[str, Range]]:
    """Intervals by parameter and kind of vehicle."""
    if not isinstance(value, dict):
        raise InputError("veh_params, the vehicles' parameters, is missing or no table")
    table: dict[str, dict[str, Range]] = {}
    for name, by_kind in value.items():
        if not (isinstance(name, str) and isinstance(by_kind, dict)):
            raise InputError(f"veh_params {shown(name)} is no table of values by kind of vehicle")
        table[name] = {_kind(kind): _range(name, entry) for kind, entry in by_kind.items()}
    return table


def _kind(value: Any) -> str:
    if not (isinstance(value, Record) and value.name == _KIND):
        raise InputError("veh_params has a table whose keys are no obstacle types")
    return str(value.arguments[0])


def _range(name: str, entry: Any) -> Range:
    """A number, or both ends of an interval.

    An interval of equal ends stays one: drawing from it uses up a random number.
    """
    drawn = isinstance(entry, Record)
    ends = (entry.fields.get("_start"), entry.fields.get("_end")) if drawn else (entry, entry)
    if not all(isinstance(end, int | float) and 0 < end < _VALUE_MAX for end in ends):
        shape = " to ".join(shown(end) for end in ends)
        raise InputError(f"veh_params {name!r} goes from {shape}; numbers > 0 are expected")
    low, high = (float(end) for end in ends)
    if low > high:
        raise InputError(f"veh_params {name!r} goes from {low} to {high}, which is no interval")
    return (low, high) if drawn else low
