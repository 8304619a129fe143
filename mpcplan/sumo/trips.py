"""Where each recorded obstacle goes: the lanes of its record, its route in the folder, onward.

What the record tells comes first. Then follows the rest of the route that the folder's route file
gives the vehicle of the same id, if it passes the last recorded edge, and then the straightest way
to the net's end.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mpcplan.observation import Box
from mpcplan.sumo import safe_xml
from mpcplan.sumo.drivers import ANY, PASSENGER
from mpcplan.sumo.lanes import LaneGraph, Place
from mpcplan.sumo.matching import match
from mpcplan.sumo.onward import allows, edges_of, onward, with_approach
from mpcplan.trajectory import Array

SAMPLING = 3  # every so many time steps of a record are matched to lanes


@dataclass(frozen=True)
class Trip:
    """How a vehicle begins and where it goes.

    Attributes:
        start: its first place on a lane.
        vehicle_class: SUMO's class, one that all recorded lanes admit.
        edges: the route.
    """

    start: Place
    vehicle_class: str
    edges: tuple[str, ...]


def trip(
    graph: LaneGraph, boxes: Array, vehicle_class: str, hint: Sequence[str] = ()
) -> Trip | None:
    """The trip of a record, None where no lane leads the way of its first box.

    Args:
        boxes: (n, 6) at consecutive time steps, file coordinates, columns :class:`Box`.
        vehicle_class: SUMO's class that suits the vehicle.
        hint: edges of its route in the folder's files, none if unknown.
    """
    sampled = boxes[::SAMPLING] if len(boxes) > SAMPLING else boxes
    places, lanes = match(graph, fronts(sampled), sampled[:, Box.PSI], graph.on_route(hint))
    if not places:
        return None
    chosen = next(
        (c for c in (vehicle_class, PASSENGER) if all(allows(graph, lane, c) for lane in lanes)),
        ANY,
    )
    edges = list(edges_of(graph, with_approach(graph, lanes)))
    last: Sequence[str] = lanes[-1:]
    for edge in _rest(hint, edges[-1]):
        entered = [lane for lane in graph.after(edges[-1], edge) if allows(graph, lane, chosen)]
        if not entered:
            break
        edges.append(edge)
        last = entered
    beyond = onward(graph, last, chosen, frozenset(edges))
    return Trip(places[0], chosen, (*edges, *edges_of(graph, beyond)) if beyond else tuple(edges))


def fronts(boxes: Array) -> Array:
    """(n, 2) middles of the front bumpers [m] of boxes (n, 6)."""
    psi = boxes[:, Box.PSI]
    half = boxes[:, Box.LENGTH, None] / 2
    return boxes[:, [Box.X, Box.Y]] + half * np.column_stack([np.cos(psi), np.sin(psi)])


def hints(files: Iterable[Path]) -> Mapping[str, tuple[str, ...]]:
    """The edges of every vehicle's route in route files, by SUMO's id of the vehicle."""
    routes: dict[str, tuple[str, ...]] = {}
    found: dict[str, tuple[str, ...]] = {}
    for file in files:
        root = safe_xml.check_routes(file)
        routes |= {r.get("id", ""): _edges(r.get("edges")) for r in root.findall("route")}
        for vehicle in root.findall("vehicle"):
            own = vehicle.find("route")
            named = routes.get(vehicle.get("route", ""), ())
            found[vehicle.get("id", "")] = named if own is None else _edges(own.get("edges"))
    return found


def _edges(text: str | None) -> tuple[str, ...]:
    return tuple((text or "").split())


def _rest(edges: Sequence[str], after: str) -> Sequence[str]:
    """What follows an edge in a route."""
    return edges[edges.index(after) + 1 :] if after in edges else ()
