"""Repairs of CommonRoad files that change no meaning, each told in a note.

commonroad-io requires ids that are unique over lanelets, signs, lights, obstacles, intersections
and their incomings ("ID 0 is already used"); published maps number incomings from 0 in every
intersection. Planning problems have their own ids, which stay: the solution refers to them.
"""

from collections.abc import Iterator
from itertools import count
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from mpcplan.errors import InputError
from mpcplan.scenario_xml import OBSTACLES, element_id, name

# Who keeps an id that several claim: lanelets first, nothing refers to intersections
_CLAIM_ORDER = ("lanelet", "trafficSign", "trafficLight", *OBSTACLES, "intersection")
_REFERENCE = {
    "trafficSign": "trafficSignRef",
    "trafficLight": "trafficLightRef",
    "incoming": "isLeftOf",
}
_LANELET_REFERENCES = ("predecessor", "successor", "adjacentLeft", "adjacentRight")


def repair(root: Element) -> tuple[str, ...]:
    """Repairs the tree in place; answers the notes.

    Raises:
        InputError: two lanelets or two planning problems have the same id, or an id is missing.
    """
    _refuse_ambiguous(root, "lanelet")
    _refuse_ambiguous(root, "planningProblem")
    complete_initial_states(root)
    notes = [*_drop_dangling(root), *_drop_unreferenced(root), *_renumber(root)]
    return tuple(notes)


def _refuse_ambiguous(root: Element, tag: str) -> None:
    seen: set[int] = set()
    for element in root.iterfind(tag):
        number = element_id(element)
        if number in seen:
            raise InputError(f"two elements <{tag}> have the id {number}")
        seen.add(number)


def complete_initial_states(root: Element) -> None:
    """Writes 0 for values that the problems' initial states leave out.

    commonroad-io 2024.3 stops reading an initial state at the first missing value: without an
    acceleration it ignores the yaw rate that the file gives.
    """
    for state in root.iterfind("planningProblem/initialState"):
        for field in ("acceleration", "yawRate", "slipAngle"):
            if state.find(field) is None:
                ElementTree.SubElement(ElementTree.SubElement(state, field), "exact").text = "0.0"


def _drop_dangling(root: Element) -> list[str]:
    """Removes the lanelets' references to lanelets, signs and lights that do not exist."""
    targets = {tag: _ids(root, "lanelet") for tag in _LANELET_REFERENCES}
    targets["trafficSignRef"] = _ids(root, "trafficSign")
    targets["trafficLightRef"] = _ids(root, "trafficLight")
    notes = []
    for lanelet in root.iterfind("lanelet"):
        for reference in list(lanelet):
            wanted = targets.get(reference.tag)
            if wanted is not None and reference.get("ref") not in wanted:
                lanelet.remove(reference)
                notes.append(
                    f"{name(lanelet)}: dropped {reference.tag} {reference.get('ref')}, "
                    "which does not exist"
                )
    return notes


def _ids(root: Element, tag: str) -> set[str | None]:
    return {element.get("id") for element in root.iterfind(tag)}


def _drop_unreferenced(root: Element) -> list[str]:
    """Removes signs and lights that no lanelet refers to: they have no effect."""
    notes = []
    for tag in ("trafficSign", "trafficLight"):
        used = {element.get("ref") for element in root.iterfind(f"lanelet/{_REFERENCE[tag]}")}
        for element in root.findall(tag):
            if element.get("id") not in used:
                root.remove(element)
                notes.append(f"dropped {name(element)}, to which no lanelet refers")
    return notes


def _renumber(root: Element) -> list[str]:
    """Gives new ids to all but the first claimant of an id."""
    fresh = count(1 + max(element_id(e) for e in root.iter() if e.get("id") is not None))
    claimed: set[int] = set()
    notes = []
    for tag in _CLAIM_ORDER:
        notes += _claim(root.findall(tag), root, claimed, fresh)
    for crossing in root.iterfind("intersection"):
        notes += _claim(crossing.findall("incoming"), crossing, claimed, fresh)
    return notes


def _claim(
    elements: list[Element], scope: Element, claimed: set[int], fresh: Iterator[int]
) -> list[str]:
    """Claims the elements' ids, and new ones for those taken; references in scope follow."""
    notes = []
    own: set[int] = set()
    for element in elements:
        old = element_id(element)
        if old in own and element.tag in ("trafficSign", "trafficLight"):
            scope.remove(element)  # the references cannot tell the two apart
            notes.append(f"dropped the second {name(element)}")
        elif old in claimed:
            new = next(fresh)
            notes.append(f"{name(element)} is now {new}: its id was taken")
            element.set("id", str(new))
            claimed.add(new)
            if old not in own:
                _redirect(scope, _REFERENCE.get(element.tag), old, new)
        claimed.add(old)
        own.add(old)
    return notes


def _redirect(scope: Element, tag: str | None, old: int, new: int) -> None:
    if tag is None:
        return
    for reference in scope.iter(tag):
        if reference.get("ref") == str(old):
            reference.set("ref", str(new))
