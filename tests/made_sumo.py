"""Interactive folders made by the tests: the straight road of :mod:`made` as a SUMO net."""

import pickle
import sys
from pathlib import Path
from types import ModuleType

import made
from commonroad.common.util import Interval
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.scenario.obstacle import ObstacleType

NAME = "ZAM_Straight-1_1_I-1"
ROAD = 2 * made.LENGTH  # m, the net's only edge
SPEED = 13.9  # m/s, its limit
EGO = "egoVehicle2"
SEED = 7
LATE = 1.0  # s, when vehicle 3 departs

CONFIG = """<configuration>
  <input>
    <net-file value="{name}.net.xml"/>
    <route-files value="{name}.vehicle.rou.xml"/>
    <additional-files value="{name}.add.xml"/>
  </input>
  <processing><time-to-teleport value="-1"/></processing>
  {more}
</configuration>
"""
VEHICLE = """<vehicle id="{id}" depart="{depart}" departLane="{lane}" departPos="{at}"
 departSpeed="{speed}" {more}><route edges="road"/></vehicle>
"""


def write(folder: Path, problem: PlanningProblem | None = None, **more: str) -> Path:
    """Writes a presimulated folder; its ego vehicle starts between vehicles 0 and 1.

    Args:
        folder: where; must not exist.
        problem: the planning problem; None: 60 m into the road, where nobody is.
        more: ``config``, ``routes``, ``additional``, ``net``: XML added to those files.
    """
    folder.mkdir()
    problem = problem or made.problem(100, made.state(100, made.LANE / 2, 10))
    written = made.write(folder, problem, obstacles=[])
    written.rename(folder / f"{NAME}.cr.xml")
    config = CONFIG.format(name=NAME, more=more.get("config", ""))
    (folder / f"{NAME}.sumo.cfg").write_text(config)
    (folder / f"{NAME}.net.xml").write_text(net(more.get("net", "")))
    routes = vehicle("0", 40) + vehicle("1", 10, lane=1) + vehicle(EGO, 20)
    routes += vehicle("3", 5, depart=LATE)  # SUMO leaves out who departs earlier than who is before
    routes = f"<routes>{more.get('routes', '')}{routes}</routes>"
    (folder / f"{NAME}.vehicle.rou.xml").write_text(routes)
    additional = f"<additional>{more.get('additional', '')}</additional>"
    (folder / f"{NAME}.add.xml").write_text(additional)
    (folder / "simulation_config.p").write_bytes(settings())
    return folder


def vehicle(
    number: str, at: float, depart: float = 0, lane: int = 0, speed: float = 10, more: str = ""
) -> str:
    """A vehicle of a route file, from a position [m] on a lane on, with a speed [m/s]."""
    return VEHICLE.format(id=number, at=at, depart=depart, lane=lane, speed=speed, more=more)


def net(more: str = "") -> str:
    """The straight road as a SUMO net of one edge with two lanes."""
    (x, y), (end, _) = made.at(0, 0), made.at(ROAD, 0)
    lanes = "".join(
        f'<lane id="road_{i}" index="{i}" speed="{SPEED}" length="{ROAD}" '
        f'width="{made.LANE}" shape="{x},{y + (i + 0.5) * made.LANE} '
        f'{end},{y + (i + 0.5) * made.LANE}"/>'
        for i in range(2)
    )
    ends = "".join(
        f'<junction id="{number}" type="dead_end" x="{at}" y="{y}" incLanes="{incoming}" '
        f'intLanes="" shape="{at},{y} {at},{y + 2 * made.LANE}"/>'
        for number, at, incoming in (("a", x, ""), ("b", end, "road_0 road_1"))
    )
    box = f"{x},{y},{end},{y + 2 * made.LANE}"
    return (
        f'<net version="1.9"><location netOffset="0.00,0.00" convBoundary="{box}" '
        f'origBoundary="{box}" projParameter="!"/><edge id="road" from="a" to="b" priority="1">'
        f"{lanes}</edge>{ends}{more}</net>"
    )


class DefaultConfig:
    """Settings by the name under which the organisers' simulator pickles them."""


DefaultConfig.__module__ = "sumocr.sumo_config.default"
DefaultConfig.__qualname__ = "DefaultConfig"


def settings(protocol: int = 4, **changed: object) -> bytes:
    """The pickle of settings, with some values changed."""
    car, bicycle = ObstacleType.CAR, ObstacleType.BICYCLE
    config = DefaultConfig()
    config.__dict__ |= {
        "dt": 0.1, "delta_steps": 1, "presimulation_steps": 20, "random_seed": SEED,
        "lateral_resolution": 1.2, "ego_veh_length": 5.0, "logging_level": "INFO",
        "scenarios_path": None, "ego_ids": [], "departure_interval_vehicles": Interval(0, 15),
        "veh_params": {
            "length": {car: Interval(4.0, 5.5), bicycle: 2.0},
            "width": {car: Interval(1.8, 2.1), bicycle: 0.68},
            "minGap": {car: Interval(3.5, 5.0), bicycle: 1.0},
            "accel": {car: Interval(2.0, 2.9), bicycle: Interval(1, 1.4)},
            "decel": {car: Interval(4, 7.5), bicycle: Interval(2.5, 3.5)},
            "maxSpeed": {car: 50.0, bicycle: 6.9},
        },
    } | changed  # fmt: skip
    return dumped(config, protocol)


def dumped(value: object, protocol: int = 4) -> bytes:
    """A pickle in which :class:`DefaultConfig` has its genuine name."""
    parts = DefaultConfig.__module__.split(".")
    names = [".".join(parts[: depth + 1]) for depth in range(len(parts))]
    sys.modules |= {name: ModuleType(name) for name in names}
    sys.modules[names[-1]].DefaultConfig = DefaultConfig
    try:
        return pickle.dumps(value, protocol)
    finally:
        for name in names:
            del sys.modules[name]
