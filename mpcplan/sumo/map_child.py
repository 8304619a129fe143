"""Child process of :mod:`mpcplan.sumo.map_conversion`: one map made into a SUMO net.

Usage: python -m mpcplan.sumo.map_child SCENARIO NET ANSWER

Writes the net and ``{"error": ""}`` as JSON to ANSWER, or the cause of the failure as the error.
Whatever the converter and netconvert print goes to this process's stdout and stderr, which the
parent keeps.
"""

import json
import logging
import os
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from commonroad.scenario.scenario import Scenario

from mpcplan.errors import InputError, TrafficError
from mpcplan.scenario import LoadedScenario, load
from mpcplan.sumo.session import Options, Session
from mpcplan.trajectory import Array

URBAN_LIMIT = 50 / 3.6  # m/s, the least speed limit of a map without posted limits
_NETCONVERT = "commonroad_sumo.helpers"  # the logger that gets netconvert's words


class _Words(logging.Handler):
    """Keeps what netconvert says of errors."""

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.errors: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep the error lines of a message."""
        lines = record.getMessage().splitlines()
        self.errors += [line.strip() for line in lines if line.startswith("Error")]


def convert(scenario: Path, net: Path) -> None:
    """Writes the SUMO net of a scenario's map, in the file's coordinates.

    Raises:
        InputError: the map cannot be converted, or SUMO refuses the net; says why.
    """
    loaded = load(scenario)
    with tempfile.TemporaryDirectory(prefix="mpcplan-") as folder:
        made = _converted(loaded.scenario, _speed_limit(loaded), Path(folder))
        root = ElementTree.parse(made).getroot()  # without the comment, which has date and paths
    _move(root, loaded.origin)
    _drop_oncoming(root)
    ElementTree.ElementTree(root).write(net, encoding="utf-8", xml_declaration=True)
    try:
        Session(Options(net)).close()
    except TrafficError as error:
        raise InputError(f"SUMO refuses the converted map: {error}") from error


def _converted(scenario: Scenario, limit: float, folder: Path) -> Path:
    """commonroad-sumo's net, in the scenario's local coordinates."""
    from commonroad_sumo.cr2sumo.map_converter.map_converter import (
        CR2SumoMapConverter,
        CR2SumoMapConverterConfig,
    )

    words = _Words()
    logging.getLogger(_NETCONVERT).addHandler(words)
    logging.getLogger(_NETCONVERT).setLevel(logging.DEBUG)
    config = CR2SumoMapConverterConfig.from_scenario(scenario)
    config.overwrite_speed_limit = limit  # posted limits override it
    try:
        CR2SumoMapConverter(scenario, config).create_sumo_files(folder)
    except Exception as error:  # it lets all its inner errors through
        detail = " ".join(str(error).split()) or "no detail given"
        raise InputError(f"commonroad-sumo failed: {type(error).__name__}: {detail}") from error
    nets = sorted(folder.glob("*.net.xml"))
    if not nets:
        raise InputError("netconvert failed: " + (" ".join(words.errors) or "no detail given"))
    return nets[0]


def _speed_limit(loaded: LoadedScenario) -> float:
    """Speed limit [m/s] where none is posted: what the fastest one drives.

    The converter's own 130 km/h would have everybody race through towns.
    """
    speeds = [URBAN_LIMIT]
    for obstacle in loaded.scenario.dynamic_obstacles:
        states = [obstacle.initial_state]
        if obstacle.prediction is not None:
            states += getattr(obstacle.prediction, "trajectory", obstacle.prediction).state_list
        speeds += [float(state.velocity) for state in states if state.has_value("velocity")]
    return max(speeds)


def _move(root: Element, by: Array) -> None:
    """Moves a net by (2,) [m], whole metres: to the file's coordinates."""
    for element in root.iter():
        if "shape" in element.attrib:
            element.set("shape", _moved(element.get("shape", ""), by))
        if element.tag == "junction":
            x, y = _moved(f"{element.get('x')},{element.get('y')}", by).split(",")
            element.set("x", x)
            element.set("y", y)
        for name in ("convBoundary", "origBoundary"):
            if name in element.attrib:
                low_x, low_y, high_x, high_y = element.get(name, "").split(",")
                corners = _moved(f"{low_x},{low_y} {high_x},{high_y}", by)
                element.set(name, corners.replace(" ", ","))


def _moved(points: str, by: Array) -> str:
    """Points 'x,y x,y ...' moved; two decimals, as netconvert writes them."""
    numbers = [[float(value) for value in point.split(",")[:2]] for point in points.split()]
    return " ".join(f"{x + by[0]:.2f},{y + by[1]:.2f}" for x, y in numbers)


def _drop_oncoming(root: Element) -> None:
    """Takes out which lanes are oncoming ones: SUMO's cars would overtake on them, which they do
    in no public interactive scenario."""
    for lane in root.iter("lane"):
        for neighbour in lane.findall("neigh"):
            lane.remove(neighbour)


def main(arguments: list[str]) -> None:
    """Do the conversion and write the answer."""
    scenario, net, answer = map(Path, arguments)
    try:
        convert(scenario, net)
        error = ""
    except InputError as caught:
        error = str(caught).removeprefix(f"{scenario}: ")
    answer.write_text(json.dumps({"error": error}), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
    sys.stdout.flush()
    os._exit(0)  # without the extension modules' leak reports
