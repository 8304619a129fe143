"""The traffic that was simulated with a run, as a CommonRoad scenario that anyone can check.

The file is the original one with its obstacles replaced by what was seen at every time step, so
map and planning problem stay as published. Obstacles that never moved in the file stay as well.
"""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from mpcplan import scenario_xml
from mpcplan.observation import Box, Snapshot
from mpcplan.predict.recorded import static_ids
from mpcplan.scenario import LoadedScenario
from mpcplan.trajectory import Array

MOVING = ("dynamicObstacle", "phantomObstacle")
Track = list[tuple[int, Array]]


def write_simulated(
    loaded: LoadedScenario, others: Iterable[Snapshot], path: Path, note: str = ""
) -> Path:
    """Writes the scenario with the simulated traffic, whole or not at all.

    Args:
        loaded: the interactive scenario.
        others: the others at every time step, in order.
        path: the file to be written.
        note: how the traffic came about, kept as a comment.
    """
    root = scenario_xml.parse(loaded.path)
    for element in [e for e in root if e.tag in MOVING]:
        root.remove(element)
    place = next((i for i, e in enumerate(root) if e.tag == "planningProblem"), len(root))
    tracks = _tracks(loaded, list(others), _free_id(root))
    root[place:place] = [_obstacle(*found) for found in tracks]
    remark = f"<!-- {note.replace('--', '-')} -->\n" if note else ""
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode", xml_declaration=False)
    partial = path.with_name(f".{path.name}.partial")
    declaration = "<?xml version='1.0' encoding='UTF-8'?>\n"
    partial.write_text(f"{declaration}{remark}{text}\n", encoding="utf-8")
    os.replace(partial, path)
    return path


def _free_id(root: Element) -> int:
    """An id that nothing in the file has, nor anything above it."""
    numbers = [int(e.get("id", "")) for e in root.iter() if e.get("id", "").lstrip("-").isdigit()]
    return max(numbers, default=0) + 1


def _tracks(
    loaded: LoadedScenario, others: list[Snapshot], free: int
) -> Iterator[tuple[int, str, Track]]:
    """(id, kind, track) of every obstacle, in file coordinates; one that was away for a while comes
    back under an id of its own, as a trajectory in a file has no gaps."""
    standing = static_ids(loaded.scenario)
    ids = sorted({i for seen in others for i in seen.ids} - standing)
    free = max([free, *(i + 1 for i in ids)])
    for number in ids:
        pieces, kind = _pieces(others, number, loaded.origin)
        for k, piece in enumerate(pieces):
            yield (number if k == 0 else free), kind, piece
            free += k > 0


def _pieces(others: list[Snapshot], number: int, origin: Array) -> tuple[list[Track], str]:
    """The stretches of consecutive time steps at which an obstacle was there, and its kind."""
    pieces: list[Track] = []
    kind, before = "unknown", None
    for seen in others:
        box = seen.box_of(number)
        if box is None:
            continue
        kind = seen.kind_of(number)
        box = box.copy()
        box[[Box.X, Box.Y]] += origin
        if before != seen.step - 1:
            pieces.append([])
        pieces[-1].append((seen.step, box))
        before = seen.step
    return pieces, kind


def _obstacle(number: int, kind: str, track: Track) -> Element:
    obstacle = Element("dynamicObstacle", id=str(number))
    SubElement(obstacle, "type").text = kind
    rectangle = SubElement(SubElement(obstacle, "shape"), "rectangle")
    first = track[0][1]
    SubElement(rectangle, "length").text = repr(float(first[Box.LENGTH]))
    SubElement(rectangle, "width").text = repr(float(first[Box.WIDTH]))
    _fill(SubElement(obstacle, "initialState"), *track[0])
    if len(track) > 1:
        trajectory = SubElement(obstacle, "trajectory")
        for step, box in track[1:]:
            _fill(SubElement(trajectory, "state"), step, box)
    return obstacle


def _fill(state: Element, step: int, box: Array) -> None:
    """Position, heading, time and speed of a state."""
    point = SubElement(SubElement(state, "position"), "point")
    SubElement(point, "x").text = repr(float(box[Box.X]))
    SubElement(point, "y").text = repr(float(box[Box.Y]))
    _exact(state, "orientation", repr(float(box[Box.PSI])))
    _exact(state, "time", str(step))
    _exact(state, "velocity", repr(float(box[Box.V])))


def _exact(state: Element, name: str, value: str) -> None:
    SubElement(SubElement(state, name), "exact").text = value
