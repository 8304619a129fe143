"""Which lanes a recorded trajectory drove on: the most probable path through the lane graph.

Hidden Markov map matching (Newson and Krumm, "Hidden Markov map matching through noise and
sparseness", 2009): a sample's places on nearby lanes are weighted by distance and heading, steps
between them by how far the way along the lanes differs from the way driven; Viterbi's recursion
finds the best sequence. It takes junctions, where many lanes overlap, and lane changes alike.
"""

import math
from collections.abc import Collection

import numpy as np

from mpcplan.sumo.lanes import LaneGraph, Place
from mpcplan.trajectory import Array

REACH = 3.0  # m, from a lane's middle, within which a vehicle's front counts as on the lane
REACH_FAR = 6.0  # m, where nothing is within REACH: it overtakes beside its lane
TURN_MAX = math.pi / 3  # rad, from a lane; who is turned more drives across it
_DISTANCE = 0.5  # m, typical distance from the middle
_TURN = 0.2  # rad, typical angle to the lane
_WAY = 1.0  # m, typical difference of ways
_OFF_ROUTE = 9.0  # cost of a place off the known route: as much as 1.5 m from the middle
_SLACK = 10.0  # m, by which the way along the lanes may be longer


def match(
    graph: LaneGraph, fronts: Array, psi: Array, route: Collection[str] = ()
) -> tuple[tuple[Place, ...], tuple[str, ...]]:
    """The lanes of a trajectory, as far from its begin as it follows lanes.

    Args:
        graph: the net.
        fronts: (n, 2) middle of the front bumper [m], file coordinates.
        psi: (n,) headings [rad].
        route: lanes that the vehicle is meant to use; empty: not known.

    Returns:
        the place of each sample up to the first that no lane explains, and all lanes driven
        on, in order; both empty where the first sample is on no lane.
    """

    def near(i: int) -> dict[Place, float]:
        places: list[Place] = []
        for reach in (REACH, REACH_FAR):
            places = places or graph.near(fronts[i], psi[i], reach, TURN_MAX)
        return {p: _fit(p) + _OFF_ROUTE * bool(route and p.lane not in route) for p in places}

    layers = [near(0)]
    came: list[dict[Place, tuple[Place, tuple[str, ...]]]] = [{}]
    for i in range(1, len(fronts)):
        driven = float(np.hypot(*(fronts[i] - fronts[i - 1])))
        layer, back = _layer(graph, layers[-1], near(i), driven)
        if not layer:
            break
        layers.append(layer)
        came.append(back)
    if not layers[0]:
        return (), ()
    return _traced(layers, came)


def _fit(place: Place) -> float:
    """Cost of a place for a sample."""
    return (place.distance / _DISTANCE) ** 2 + (place.turn / _TURN) ** 2


def _layer(
    graph: LaneGraph, before: dict[Place, float], fits: dict[Place, float], driven: float
) -> tuple[dict[Place, float], dict[Place, tuple[Place, tuple[str, ...]]]]:
    """Cost of the best way to each place of the next sample, and where it came from."""
    layer: dict[Place, float] = {}
    back: dict[Place, tuple[Place, tuple[str, ...]]] = {}
    for start, cost in before.items():
        ways = graph.paths(start, driven + _SLACK)
        for place, fit in fits.items():
            if place.lane not in ways:
                continue
            begin, path = ways[place.lane]
            way = begin + place.offset
            total = cost + fit + abs(way - driven) / _WAY
            if total < layer.get(place, math.inf):
                layer[place], back[place] = total, (start, path)
    return layer, back


def _traced(
    layers: list[dict[Place, float]], came: list[dict[Place, tuple[Place, tuple[str, ...]]]]
) -> tuple[tuple[Place, ...], tuple[str, ...]]:
    """The best sequence, read backwards from its end."""
    place = min(layers[-1], key=lambda p: (layers[-1][p], p.lane))
    places, lanes = [place], [place.lane]
    for back in reversed(came[1:]):
        place, path = back[place]
        places.append(place)
        lanes += list(reversed(path[:-1]))
    return tuple(reversed(places)), tuple(reversed(lanes))
