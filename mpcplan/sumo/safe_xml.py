"""SUMO's XML files from strangers: only what describes a road or a vehicle is let through.

SUMO's files can name further files: detectors, edge data, timed events and calibrators write to
them, <include>, images and emission classes read from them, devices write when a vehicle's <param>
asks for it. A list of these would never be complete, so the elements that SUMO may see are listed
instead, and within them the attributes and parameters that concern files are refused.
"""

import re
from pathlib import Path
from xml.etree.ElementTree import Element

from mpcplan import scenario_xml
from mpcplan.errors import InputError

MAX_BYTES = 50_000_000  # of one file; the genuine ones have up to 1,000,000
_NET = {"net", "location", "type", "restriction", "edge", "lane", "stopOffset", "neigh"} | {
    "junction",
    "request",
    "connection",
    "roundabout",
    "prohibition",
    "tlLogic",
    "phase",
    "param",
}
_VEHICLES = {"vehicle", "vType", "vTypeDistribution", "route", "routeDistribution", "trip", "flow"}
_ROUTES = (
    _VEHICLES
    | {"routes", "additional", "location", "person", "personTrip", "walk"}
    | {
        "stop",
        "param",
    }
)
# Control of traffic lights that reads and writes nothing
_LIGHTS = {"static", "actuated", "delay_based", "off", "rail_signal", "rail_crossing"}
# Attributes and parameters that name files, or the devices that write them
_FILES = re.compile(r"file|output|path|href|dest\b|device|url|^schema|log$", re.IGNORECASE)
_NAMES_FILES = re.compile(r"phem|/", re.IGNORECASE)  # emission classes with tables in files
_SCHEMA = "{http://www.w3.org/2001/XMLSchema-instance}"  # SUMO is told not to validate
_GRIDS = re.compile(r"grids|catalog|/", re.IGNORECASE)  # tables of the library PROJ


def check_net(path: Path) -> Element:
    """The root of a .net.xml that SUMO may load.

    Raises:
        InputError: broken XML, a document type, another kind of file, or an element or attribute
            that concerns other files.
    """
    return _check(path, _root(path, ("net",)), _NET)


def check_routes(path: Path) -> Element:
    """The root of a route or additional file that SUMO may load.

    Raises:
        InputError: as :func:`check_net`.
    """
    return _check(path, routes_root(path), _ROUTES)


def routes_root(path: Path) -> Element:
    """The root of a route or additional file that is for us alone: safe to parse, not more.

    Raises:
        InputError: broken XML, a document type, or another kind of file.
    """
    return _root(path, ("routes", "additional"))


def _root(path: Path, tags: tuple[str, ...]) -> Element:
    root = scenario_xml.safe_root(path, MAX_BYTES)
    if root.tag not in tags:
        expected = " or ".join(f"<{tag}>" for tag in tags)
        raise InputError(f"{path}: the root is <{root.tag}>, {expected} is expected")
    return root


def _check(path: Path, root: Element, allowed: set[str]) -> Element:
    for element in root.iter():
        try:
            _check_element(element, allowed)
        except InputError as error:
            raise InputError(f"{path}: {scenario_xml.name(element)}: {error}") from error
    return root


def _check_element(element: Element, allowed: set[str]) -> None:
    if element.tag not in allowed:
        raise InputError("this element is refused, it may read or write other files")
    for name in element.attrib:
        if not name.startswith(_SCHEMA) and _FILES.search(name):
            raise InputError(f"the attribute {name!r} is refused, it may name another file")
    if element.tag == "param" and _FILES.search(element.get("key", "")):
        raise InputError(f"the key {element.get('key')!r} is refused, it may name another file")
    if element.tag == "tlLogic" and element.get("type", "static") not in _LIGHTS:
        raise InputError(f"the type {element.get('type')!r} is refused, it may write files")
    if _GRIDS.search(element.get("projParameter", "")):
        raise InputError("this projParameter is refused, it reads tables from files")
    if _NAMES_FILES.search(element.get("emissionClass", "").replace("HBEFA3/", "")):
        raise InputError("this emissionClass is refused, it reads tables from files")
