"""A CommonRoad file's XML tree: parsed safely and moved to local coordinates."""

from contextlib import suppress
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np

from mpcplan.errors import InputError
from mpcplan.trajectory import Array

OBSTACLES = (
    "staticObstacle",
    "dynamicObstacle",
    "obstacle",  # 2018b
    "environmentObstacle",
    "phantomObstacle",
)
# The shape of these is given in the obstacle's own frame and must not be moved
_LOCAL_SHAPES = ("staticObstacle", "dynamicObstacle", "obstacle")


class _RootReached(Exception):  # noqa: N818 (no error)
    """Ends the scan of a document's prologue."""


def parse(path: Path) -> Element:
    """The root of a CommonRoad file.

    Raises:
        InputError: the file is missing, a folder, unreadable, broken XML, no CommonRoad file, or
            declares a document type (entities could read other files or exhaust the memory).
    """
    root = _parsed(_read(path))
    if root.tag != "commonRoad":
        raise InputError(f"not a CommonRoad file: the root is <{root.tag}>, not <commonRoad>")
    return root


def safe_root(path: Path, max_bytes: int = 0) -> Element:
    """The root of an XML file of any kind.

    Args:
        path: the file.
        max_bytes: longer files are refused; 0: no limit.

    Raises:
        InputError: the file is missing, unreadable, too long, broken XML, or declares a document
            type; names the file.
    """
    try:
        data = _read(path)
        if 0 < max_bytes < len(data):
            raise InputError(f"longer than {max_bytes} bytes")
        return _parsed(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _parsed(data: bytes) -> Element:
    try:
        _refuse_doctype(data)
        return ElementTree.fromstring(data)
    except (expat.ExpatError, ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(f"broken XML: {error}") from error


def _read(path: Path) -> bytes:
    if path.is_dir():
        raise InputError("this is a folder, a file is expected")
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise InputError("no such file") from error
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}") from error


def _refuse_doctype(data: bytes) -> None:
    def refuse(*_: object) -> None:
        raise InputError("document type declarations (<!DOCTYPE, <!ENTITY) are refused")

    def stop(*_: object) -> None:
        raise _RootReached

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = stop  # a document type can only stand before the root
    with suppress(_RootReached):
        parser.Parse(data, True)


def name(element: Element) -> str:
    """How an element is called in messages: 'lanelet 12', 'planningProblem 3'."""
    number = element.get("id")
    return f"{element.tag} {number}" if number is not None else f"<{element.tag}>"


def element_id(element: Element) -> int:
    """The id of an element; raises InputError when it is missing or no whole number."""
    try:
        return int(element.get("id", ""))
    except ValueError as error:
        raise InputError(f"<{element.tag}> has the id {element.get('id')!r}, no number") from error


def whole_metres(root: Element) -> Array:
    """(2,) initial position of the first problem, rounded to metres: the local frame's origin.

    Whole metres keep the digits of the file's coordinates.
    """
    point = root.find("planningProblem/initialState/position/point")
    assert point is not None  # checked before
    return np.round([float(point.findtext("x", "")), float(point.findtext("y", ""))])


def move(root: Element, origin: Array) -> bool:
    """Subtracts the origin [m] from all coordinates in place and drops heights.

    Done in the tree because commonroad-io 2024.3, when it translates a scenario, leaves the
    lanelets' spatial index and cached occupancies behind and fails with environment obstacles.

    Returns:
        Whether the file had heights (z).
    """
    heights = False
    for owner in root:
        for part in owner:
            if not (part.tag == "shape" and owner.tag in _LOCAL_SHAPES):
                heights |= _move_part(part, origin)
    return heights


def _move_part(part: Element, origin: Array) -> bool:
    heights = False
    for element in part.iter():
        if element.tag in ("rectangle", "circle") and element.find("center") is None:
            _add_centre(element)
    for element in part.iter():
        if element.tag in ("point", "center"):
            _shift(element, "x", origin[0])
            _shift(element, "y", origin[1])
            height = element.find("z")
            if height is not None:
                element.remove(height)
                heights = True
    return heights


def _add_centre(shape: Element) -> None:
    """Writes the default centre (0, 0) of a shape, so that it moves with the rest."""
    centre = ElementTree.SubElement(shape, "center")
    for axis in ("x", "y"):
        ElementTree.SubElement(centre, axis).text = "0.0"


def _shift(point: Element, axis: str, offset: float) -> None:
    coordinate = point.find(axis)
    if coordinate is not None:
        coordinate.text = repr(float(coordinate.text or "") - float(offset))
