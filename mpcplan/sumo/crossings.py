"""Where lanes cross or run together without SUMO knowing.

SUMO's junction model lets vehicles yield where lanes conflict within one junction. In nets made of
lanelets a crossing often consists of several junctions, one for each fork and each merge, and the
lanes that cross between them belong to different ones: SUMO's cars then drive through each other.
"""

import math
from dataclasses import dataclass

import libsumo
import numpy as np
import shapely

from mpcplan.sumo.lanes import LaneGraph, Place

WIDTH = 2.2  # m, lanes whose middles come nearer than this cannot be used side by side
SOON = 10.0  # m, after a lane's end: what begins there is on the same way
_SPACING = 0.5  # m, between the points at which lanes are compared
_TOGETHER = math.pi / 4  # rad, up to which lanes run together
_AGAINST = math.pi * 5 / 6  # rad, from which they run against each other
_NARROW = 30.0  # m, of lanes against each other, up to which one waits for the other


@dataclass(frozen=True)
class Stretch:
    """A lane's part of a conflict.

    Attributes:
        zone: number of the conflict.
        side: 0 or 1, which of its two lanes this is.
        begin: from the lane's begin [m].
        end: from the lane's begin [m].
        together: whether both lanes lead the same way there.
    """

    zone: int
    side: int
    begin: float
    end: float
    together: bool


def conflicts(graph: LaneGraph) -> dict[str, tuple[Stretch, ...]]:
    """The stretches of each lane that conflict with another lane unknown to SUMO.

    Long stretches where lanes run against each other are left out: waiting would not help.
    """
    found: dict[str, list[Stretch]] = {}
    zones = 0
    for one in sorted(graph.lanes):
        foes = _known_foes(graph, one)
        for other in graph.within(graph.lanes[one].line.buffer(WIDTH)):
            if other <= one or other in foes or one in _known_foes(graph, other):
                continue
            for begin, end, along, until, turn in _meetings(graph, one, other):
                if turn > _AGAINST and end - begin > _NARROW:
                    continue
                together = turn < _TOGETHER
                found.setdefault(one, []).append(Stretch(zones, 0, begin, end, together))
                found.setdefault(other, []).append(Stretch(zones, 1, along, until, together))
                zones += 1
    return {lane: tuple(stretches) for lane, stretches in found.items()}


def _known_foes(graph: LaneGraph, lane: str) -> frozenset[str]:
    """The lanes that need no further care: of the same edge, soon after it, forking off with it,
    merging with it, and those to which SUMO makes it yield."""
    beside = {other for other in graph.lanes if graph.lanes[other].edge == graph.lanes[lane].edge}
    ahead, behind = graph.successors[lane], graph.predecessors[lane]
    forks = {fork for before in behind for fork in graph.successors[before]}
    merges = {merge for after in ahead for merge in graph.predecessors[after]}
    foes = libsumo.lane.getInternalFoes(lane) if graph.lanes[lane].internal else ()
    length = graph.lanes[lane].line.length
    soon = graph.paths(Place(lane, length, 0.0, 0.0), SOON)
    return frozenset(beside | forks | merges | set(foes) | soon.keys())


def _meetings(
    graph: LaneGraph, one: str, other: str
) -> list[tuple[float, float, float, float, float]]:
    """Where two lanes are nearer than WIDTH: begin and end on the one, begin and end on the
    other [m], and the angle between them [rad]."""
    line, beside = graph.lanes[one].line, graph.lanes[other].line
    offsets = np.linspace(0, line.length, max(math.ceil(line.length / _SPACING), 1) + 1)
    points = shapely.line_interpolate_point(line, offsets)
    near = shapely.distance(points, beside) < WIDTH
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(int)))
    meetings = []
    for first, stop in edges.reshape(-1, 2):
        along = shapely.line_locate_point(beside, points[first:stop])
        middle = (first + stop - 1) // 2
        at = float(along[middle - first])
        turn = graph.lanes[one].heading(float(offsets[middle])) - graph.lanes[other].heading(at)
        turn = abs(math.remainder(turn, 2 * math.pi))
        begin, end = float(offsets[first]), float(offsets[stop - 1])
        aside = WIDTH * abs(math.sin(turn))  # the other's points that are as near as these
        from_, until = max(along.min() - aside, 0.0), min(along.max() + aside, beside.length)
        meetings.append((begin, end, float(from_), float(until), turn))
    return meetings
