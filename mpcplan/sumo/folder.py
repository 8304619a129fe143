"""Folders of interactive scenarios: what belongs to them, checked before SUMO sees any of it.

Two kinds exist. In the competition's folders of 2022 ("presimulated") the route file holds the
traffic and the ego vehicle, and SUMO runs alone for a while before step 0. In the folders of 2021,
and in those that this package makes, the traffic starts as the .cr.xml records it.

A folder comes from strangers and is read-only to us. SUMO is never given the .sumo.cfg: the few
options that shape the traffic are taken out of it (:attr:`SumoFolder.options`), so that a request
for output in it has no effect. Its files must lie in the folder, and may not name further files.
"""

import os
import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from mpcplan import scenario_checks, scenario_xml
from mpcplan.errors import InputError
from mpcplan.sumo import safe_xml
from mpcplan.sumo.settings import FILE as SETTINGS_FILE
from mpcplan.sumo.settings import Settings, read_settings

SCENARIO, CONFIG, NET = ".cr.xml", ".sumo.cfg", ".net.xml"
EGO = "egoVehicle"  # how the ids of ego vehicles in route files begin

# Options in a .sumo.cfg that shape the traffic; all others are left aside
OPTIONS = (
    "time-to-teleport",
    "max-depart-delay",
    "lateral-resolution",
    "lanechange.duration",
    "collision.action",
    "collision.mingap-factor",
    "collision.check-junctions",
    "ignore-junction-blocker",
    "ignore-route-errors",
    "default.speeddev",
    "default.emergencydecel",
    "step-method.ballistic",
)
# A word or a number: on a command line, anything else could be read as a further option
_OPTION_VALUE = re.compile(r"[A-Za-z]+|-?[0-9]+(\.[0-9]+)?")
_UNREADABLE = re.compile(r",|\$\{")  # SUMO divides lists there, or puts in a variable's value
_FILES = {"net-file": ("net-file", "net", "n")} | {
    "route-files": ("route-files", "routes", "r"),
    "additional-files": ("additional-files", "additional", "a"),
}


@dataclass(frozen=True)
class SumoFolder:
    """An interactive scenario's folder; every file that it names has been checked.

    Attributes:
        path: the folder.
        name: the scenario's name, that of its .cr.xml.
        scenario: the .cr.xml.
        net: the .net.xml.
        routes: route files of the .sumo.cfg, absolute paths. Of a presimulated folder SUMO loads
            them, so they have been searched for requests to read or write other files; else they
            are for us alone.
        additional: additional files of the .sumo.cfg, likewise.
        options: options of the .sumo.cfg that shape the traffic, names without dashes.
        settings: the organisers' settings; None for folders that are not presimulated.
        presimulated: True: SUMO's own traffic from the route file; False: the traffic starts from
            the obstacles in the .cr.xml.
        ego: id of the ego vehicle in the route file; '' for folders that are not presimulated.
    """

    path: Path
    name: str
    scenario: Path
    net: Path
    routes: tuple[Path, ...]
    additional: tuple[Path, ...]
    options: tuple[tuple[str, str], ...]
    settings: Settings | None
    presimulated: bool
    ego: str = ""


def is_folder(path: Path) -> bool:
    """Whether a path is a folder with one .cr.xml and a .sumo.cfg or .net.xml; opens no file."""
    if not path.is_dir():
        return False
    try:
        names = os.listdir(path)
    except OSError:
        return False
    one = sum(name.endswith(SCENARIO) for name in names) == 1
    return one and any(name.endswith((CONFIG, NET)) for name in names)


def read_folder(path: Path) -> SumoFolder:
    """Reads and checks a folder.

    Raises:
        InputError: a file is missing, ambiguous, broken or unsafe; names the file and the reason.
    """
    root = _root(path)
    scenario = _only(root, SCENARIO)
    config = _config(root)
    net, routes, additional = _files(root, config)
    safe_xml.check_net(net)
    for file in additional:
        safe_xml.routes_root(file)
    ego, settings = _ego(root, routes), None
    if ego:
        settings = read_settings(_inside(root, SETTINGS_FILE), scenario_checks.TIME_STEP)
        for file in (*routes, *additional):
            safe_xml.check_routes(file)
    return SumoFolder(
        path=path,
        name=scenario.name.removesuffix(SCENARIO),
        scenario=scenario,
        net=net,
        routes=routes,
        additional=additional,
        options=_options(root, config),
        settings=settings,
        presimulated=bool(ego),
        ego=ego,
    )


def _root(path: Path) -> Path:
    """The folder as an absolute path without links."""
    if not path.is_dir():
        raise InputError(f"{path}: no such folder")
    if not is_folder(path):
        raise InputError(
            f"{path}: this is a folder, but not one of an interactive scenario: exactly one "
            f"*{SCENARIO} and a *{CONFIG} or *{NET} are expected in it; to load one file, name it"
        )
    root = path.resolve()
    if _UNREADABLE.search(str(root)):
        raise InputError(f"{root}: SUMO cannot read paths with a comma or '${{'; move the folder")
    return root


def _only(root: Path, ending: str) -> Path:
    """The folder's only file with an ending."""
    names = sorted(name for name in os.listdir(root) if name.endswith(ending))
    if len(names) != 1:
        found = ", ".join(names) or "none"
        raise InputError(f"{root}: exactly one *{ending} is expected, found: {found}")
    return _inside(root, names[0])


def _inside(root: Path, name: str) -> Path:
    """A file that a folder names, absolute; it must be a regular file within the folder."""
    given = Path(name)
    if _UNREADABLE.search(name):
        raise InputError(f"{root}: SUMO cannot read the file name {name!r}; rename the file")
    if given.is_absolute() or ".." in given.parts or not name.strip():
        raise InputError(f"{root}: the file name {name!r} leads out of the folder; refused")
    path = root / given
    if not path.exists():
        raise InputError(f"{path}: no such file, but the scenario needs it")
    if not path.resolve().is_relative_to(root):
        raise InputError(f"{path}: a link that leads out of the folder; refused")
    if not path.is_file():
        raise InputError(f"{path}: not a regular file")
    return path


def _config(root: Path) -> Element | None:
    """The .sumo.cfg; None where there is none."""
    if not any(name.endswith(CONFIG) for name in os.listdir(root)):
        return None
    path = _only(root, CONFIG)
    tree = scenario_xml.safe_root(path)
    if tree.tag not in ("configuration", "sumoConfiguration"):
        raise InputError(f"{path}: not a SUMO configuration: the root is <{tree.tag}>")
    return tree


def _value(config: Element, names: tuple[str, ...]) -> str:
    """The last value that a configuration gives an option; '' where it gives none."""
    values = [
        element.get("value", element.get("v", element.text or ""))
        for element in config.iter()
        if element.tag in names
    ]
    return values[-1].strip() if values else ""


def _files(root: Path, config: Element | None) -> tuple[Path, tuple[Path, ...], tuple[Path, ...]]:
    """Net, route files and additional files; without a configuration the folder's only net."""
    if config is None:
        return _only(root, NET), (), ()
    names = {
        option: tuple(name.strip() for name in _value(config, keys).split(",") if name.strip())
        for option, keys in _FILES.items()
    }
    if len(names["net-file"]) > 1:
        raise InputError(f"{root}: the *{CONFIG} names more than one net-file")
    net = _inside(root, names["net-file"][0]) if names["net-file"] else _only(root, NET)
    routes = tuple(_inside(root, name) for name in names["route-files"])
    additional = tuple(_inside(root, name) for name in names["additional-files"])
    return net, routes, additional


def _options(root: Path, config: Element | None) -> tuple[tuple[str, str], ...]:
    """The options that shape the traffic."""
    if config is None:
        return ()
    given = [(name, _value(config, (name,))) for name in OPTIONS]
    for name, value in given:
        if value and not _OPTION_VALUE.fullmatch(value):
            raise InputError(
                f"{root}: the *{CONFIG} gives {name} the value {value!r}; a word or a number is "
                "expected"
            )
    return tuple((name, value) for name, value in given if value)


def _ego(root: Path, routes: tuple[Path, ...]) -> str:
    """Id of the ego vehicle in the route files; '' where there is none."""
    trees = [safe_xml.routes_root(file) for file in routes]
    names = [vehicle.get("id", "") for tree in trees for vehicle in tree.iter("vehicle")]
    egos = [name for name in names if name.startswith(EGO)]
    if len(egos) > 1:
        raise InputError(f"{root}: {len(egos)} ego vehicles in the route files; one is supported")
    return egos[0] if egos else ""
