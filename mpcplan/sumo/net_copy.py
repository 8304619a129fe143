"""Copies of SUMO nets in which vehicles move as they drive.

Nets made of lanelets are cut at junctions, and what netconvert leaves is not always a road. Lanes
keep the length that they had before they were cut: SUMO squeezes the motion, and a car of 10 m/s is
seen to stand for two seconds at a lane of 10 cm that counts 18 m. Lanes that were cut away whole
come out turned round, and lanes in junctions leap or lead backwards. Both are mended: every lane is
as long as it is drawn, and where lanes do not follow each other they are drawn anew along the
lanelets that they were made of (an edge has the id of its lanelet, or of one beside it). And since
SUMO knows no lateral acceleration, short lanes get a speed limit for their sharpest curve, as
netconvert gives it to those in junctions.
"""

import itertools
import math
import re
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from commonroad.scenario.lanelet import LaneletNetwork

from mpcplan import scenario_xml
from mpcplan.errors import InputError
from mpcplan.sumo.polyline import between, joined, leap, length, parse, sharpest_turn, text
from mpcplan.trajectory import Array

_NUMBERS = {"x", "y", "shape", "speed", "length", "width", "index", "fromLane", "toLane"} | {
    "priority",
    "numLanes",
    "netOffset",
}
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_SHORTEST = 0.1  # m, the shortest lane that SUMO takes
_OFF = 0.3  # m, by which a lane may be off its lanelet, and the next lane off its end
_TURN = 1.0  # rad, by which the next lane may turn at once
_STUB = 1.0  # m, lanes of this length may be drawn anew
_LATERAL = 5.5  # m/s^2, netconvert's limit-turn-speed
_CURVE = 5.0  # m, length over which curves are measured
_LONG = 50.0  # m, of lanes that are slow because of a curve
_ROUNDS = 5
_MIDDLE = (0.45, 0.55)  # parts of a lanelet between which a lane is drawn that was cut away


def write_mended(net: Path, lanelets: LaneletNetwork, origin: Array, to: Path) -> tuple[str, ...]:
    """Writes a net in file coordinates in which every lane is as long as it is drawn, and lanes
    follow each other.

    Args:
        net: the original.
        lanelets: the map that it was made of, in local coordinates.
        origin: (2,) file coordinates [m] of the local frame's origin.
        to: the file to write.

    Returns:
        the ids of the lanes that were drawn anew.

    Raises:
        InputError: the net is no well-formed XML, declares a document type, or a number in it is
            none.
    """
    root = scenario_xml.safe_root(net)
    _check_numbers(root, net)
    offset = _take_offset(root)
    lanes = {lane.get("id", ""): lane for lane in root.iter("lane")}
    shapes = {name: parse(lane.get("shape", "")) - offset for name, lane in lanes.items()}
    drawn = _draw(root, shapes, _centres(root, lanelets, origin))
    for name, shape in (shapes | drawn).items():
        if name in drawn or np.any(offset):
            lanes[name].set("shape", text(shape))
        lanes[name].set("length", f"{max(length(shape), _SHORTEST):.6f}")
        limit = _curve_speed(shape)
        if limit < float(lanes[name].get("speed", "inf")):
            lanes[name].set("speed", f"{limit:.2f}")
    ElementTree.ElementTree(root).write(to, encoding="utf-8", xml_declaration=True)
    return tuple(sorted(drawn))


def _check_numbers(root: Element, net: Path) -> None:
    """Raises InputError where a number is none: SUMO would take the whole process down with it."""
    for element in root.iter():
        for name in sorted(_NUMBERS.intersection(element.keys())):
            for word in element.get(name, "").replace(",", " ").split() or [""]:
                if not _NUMBER.fullmatch(word):
                    raise InputError(
                        f"{net}: {element.tag} {element.get('id', '')}: the attribute {name} is no "
                        f"number: {word!r}"
                    )


def _take_offset(root: Element) -> Array:
    """(2,) the net's offset from file coordinates [m], which the net then says is zero."""
    location = root.find("location")
    if location is None:
        return np.zeros(2)
    offset = parse(location.get("netOffset", "0,0"))[0]
    location.set("netOffset", "0.00,0.00")
    return offset


def _curve_speed(shape: Array) -> float:
    """The speed [m/s] at which the lane's sharpest curve takes the lateral acceleration that
    netconvert allows in junctions; without limit where the lane is long, since most of it is
    straighter."""
    if not _CURVE <= length(shape) <= _LONG:
        return math.inf
    radius = _CURVE / max(sharpest_turn(shape, _CURVE), 1e-9)
    return math.sqrt(_LATERAL * radius)


def _centres(root: Element, lanelets: LaneletNetwork, origin: Array) -> dict[str, Array]:
    """The centre line in file coordinates of each lane's lanelet, for lanes with a known one."""
    found = {}
    for edge in root.iter("edge"):
        name = edge.get("id", "")
        row = _row(lanelets, int(name)) if name.isdigit() else []
        lanes = sorted(edge.findall("lane"), key=lambda lane: int(lane.get("index", 0)))
        if len(row) == len(lanes):
            for lane, lanelet in zip(lanes, row, strict=True):
                centre = lanelets.find_lanelet_by_id(lanelet).center_vertices
                found[lane.get("id", "")] = centre + origin
    return found


def _row(lanelets: LaneletNetwork, lanelet: int) -> list[int]:
    """A lanelet and those beside it that lead the same way, from the right."""
    known = lanelets.find_lanelet_by_id(lanelet)
    if known is None:
        return []
    row, at = [lanelet], known
    while at.adj_right is not None and at.adj_right_same_direction and at.adj_right not in row:
        row.insert(0, at.adj_right)
        at = lanelets.find_lanelet_by_id(at.adj_right)
    at = known
    while at.adj_left is not None and at.adj_left_same_direction and at.adj_left not in row:
        row.append(at.adj_left)
        at = lanelets.find_lanelet_by_id(at.adj_left)
    return row


def _draw(
    root: Element, shapes: Mapping[str, Array], centres: Mapping[str, Array]
) -> dict[str, Array]:
    """The lanes that have to be drawn anew, and how."""
    chains = [c for c in _chains(root) if c[0] in centres and c[-1] in centres]
    chains = [chain for chain in chains if all(name in shapes for name in chain)]
    drawn: dict[str, Array] = {}
    for _ in range(_ROUNDS):  # what is drawn anew may no longer fit its other neighbours
        now = {**shapes, **drawn}
        broken = [chain for chain in chains if _is_broken([now[name] for name in chain])]
        anew = {end for chain in broken for end in (chain[0], chain[-1])} - drawn.keys()
        if not anew and drawn:
            break
        for name in sorted(anew):
            drawn |= _lane_anew(name, shapes[name], centres[name])
        for chain in chains:
            if chain in broken or chain[0] in drawn or chain[-1] in drawn:
                drawn |= _junction_anew(chain, {**shapes, **drawn}, centres)
    return drawn


def _chains(root: Element) -> list[tuple[str, ...]]:
    """For every connection the lane before it, the lanes in the junction, and the lane after."""
    on: dict[str, tuple[str, str]] = {}  # what follows a lane in a junction, and in it
    starts = []
    for link in root.iter("connection"):
        before = f"{link.get('from', '')}_{link.get('fromLane', '')}"
        after = f"{link.get('to', '')}_{link.get('toLane', '')}"
        via = link.get("via", "")
        if before.startswith(":"):
            on[before] = (via, after)
        elif via:
            starts.append((before, via, after))
    chains = []
    for before, via, after in starts:
        inside = [via]
        while on.get(inside[-1], ("", ""))[0] and on[inside[-1]][0] not in inside:
            inside.append(on[inside[-1]][0])
        chains.append((before, *inside, after))
    return chains


def _is_broken(shapes: list[Array]) -> bool:
    """Whether lanes leap or turn back where one follows the other."""
    found = [leap(one, other) for one, other in itertools.pairwise(shapes)]
    return any(gap > _OFF or turn > _TURN for gap, turn in found)


def _lane_anew(name: str, shape: Array, centre: Array) -> dict[str, Array]:
    """A lane drawn along its lanelet; nothing where it is there already."""
    line = shapely.LineString(centre)
    ends = shapely.points(shape[[0, -1]])
    first, last = (float(at) for at in shapely.line_locate_point(line, ends))
    off = float(shapely.distance(line, ends).max())
    if off <= _OFF and last > first:
        return {}
    if last - first < _STUB:
        first, last = (part * line.length for part in _MIDDLE)
    return {name: between(centre, first, last)}


def _junction_anew(
    chain: tuple[str, ...], shapes: Mapping[str, Array], centres: Mapping[str, Array]
) -> dict[str, Array]:
    """The lanes in a junction drawn along the rest of the lanelet before and the first part of the
    lanelet after, shared among them as before."""
    before, after = chain[0], chain[-1]
    begin, end = shapes[before][-1], shapes[after][0]
    left = shapely.LineString(centres[before]).project(shapely.Point(begin))
    entered = shapely.LineString(centres[after]).project(shapely.Point(end))
    rest = between(centres[before], left, np.inf), between(centres[after], 0.0, entered)
    way = joined(begin, np.vstack(rest), end)
    lengths = np.array([max(length(shapes[name]), _SHORTEST) for name in chain[1:-1]])
    marks = length(way) * np.concatenate([[0.0], np.cumsum(lengths) / lengths.sum()])
    pieces = itertools.pairwise(marks)
    return {name: between(way, *piece) for name, piece in zip(chain[1:-1], pieces, strict=True)}
