"""Where lanes cross or merge, and who yields there.

Within an intersection the rules are those by which SUMO's netconvert gives priority where all roads
are alike: the two roads that oppose each other best are the main road and go first; among equals a
left turn yields to oncoming traffic, and everybody to who comes from the right. Everywhere else who
comes first drives first.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
import shapely
from commonroad.scenario.lanelet import LaneletNetwork

from mpcplan.predict.lanes import Lanes, angle_between

LEFT = 0.5  # rad, lanes that turn by more than this to the left are left turns
ONCOMING = math.pi / 4  # rad, from the opposite direction, within which traffic is oncoming


class Rule(Enum):
    """Who goes first."""

    YIELD = "the other one"
    GO = "this one"
    FIRST_COME = "who comes first"


@dataclass(frozen=True)
class Conflict:
    """A lane's meeting with another lane.

    Attributes:
        other: index of the other lane.
        at: arc length [m] of the meeting on this lane.
        there: arc length [m] of the meeting on the other lane.
        rule: who goes first.
        merges: whether both lanes go on as one from there.
    """

    other: int
    at: float
    there: float
    rule: Rule
    merges: bool = False


def conflicts(network: LaneletNetwork, lanes: Lanes) -> Mapping[int, tuple[Conflict, ...]]:
    """For each lane that meets others: its conflicts, by the other lane's index."""
    found: dict[int, list[Conflict]] = {}
    yields = _yields(network, lanes)
    for one, other, at, there in _meetings(lanes):
        for lane, foe, own, theirs in ((one, other, at, there), (other, one, there, at)):
            rule = Rule.FIRST_COME
            if (lane, foe) in yields:
                rule = Rule.YIELD if yields[lane, foe] else Rule.GO
            merges = not {*lanes.lanes[lane].successors}.isdisjoint(lanes.lanes[foe].successors)
            found.setdefault(lane, []).append(Conflict(foe, own, theirs, rule, merges))
    return {
        lane: tuple(sorted(some, key=lambda conflict: conflict.other))
        for lane, some in sorted(found.items())
    }


def _meetings(lanes: Lanes) -> list[tuple[int, int, float, float]]:
    """Pairs of lanes that cross, or end together, with the arc lengths [m] of the meeting."""
    known = lanes.lanes
    lines = np.array([shapely.LineString(lane.points) for lane in known])
    met: dict[tuple[int, int], tuple[float, float]] = {}
    for a, b in zip(*shapely.STRtree(lines).query(lines, predicate="crosses"), strict=True):
        one, other = int(min(a, b)), int(max(a, b))
        if (one, other) in met or _forks(lanes, one, other):
            continue
        point = shapely.centroid(shapely.intersection(lines[one], lines[other]))
        met[one, other] = (
            float(shapely.line_locate_point(lines[one], point)),
            float(shapely.line_locate_point(lines[other], point)),
        )
    for lane in known:
        for one, other in itertools.combinations(lane.predecessors, 2):
            met[one, other] = known[one].length, known[other].length
    return [(one, other, *arcs) for (one, other), arcs in sorted(met.items())]


def _forks(lanes: Lanes, one: int, other: int) -> bool:
    """Whether two lanes begin together: who drives on them drives behind each other there."""
    return bool({*lanes.lanes[one].predecessors} & {*lanes.lanes[other].predecessors})


def _yields(network: LaneletNetwork, lanes: Lanes) -> dict[tuple[int, int], bool]:
    """For pairs of lanes through the same intersection: whether the first yields."""
    found: dict[tuple[int, int], bool] = {}
    for intersection in sorted(network.intersections, key=lambda known: known.intersection_id):
        incoming = sorted(
            lanes.index[i]
            for part in intersection.incomings
            for i in part.incoming_lanelets
            if i in lanes.index
        )
        main = _main_road(lanes, incoming)
        ways = [(road, way) for road in incoming for way in lanes.lanes[road].successors]
        for (road, way), (other_road, other) in itertools.permutations(ways, 2):
            if road != other_road and way != other:
                pair = (road in main, other_road in main)
                found[way, other] = _gives_way(lanes, (road, way), (other_road, other), pair)
    return found


def _main_road(lanes: Lanes, incoming: Sequence[int]) -> set[int]:
    """The two roads into an intersection that oppose each other best."""
    pairs = list(itertools.combinations(incoming, 2))
    if not pairs:
        return set(incoming)
    ends = {road: lanes.lanes[road].end for road in incoming}
    one, other = max(pairs, key=lambda pair: abs(angle_between(ends[pair[0]], ends[pair[1]])))
    return {one, other}


def _gives_way(
    lanes: Lanes, own: tuple[int, int], other: tuple[int, int], main: tuple[bool, bool]
) -> bool:
    """Whether who comes from a road by a way, both lanes, yields to another one."""
    if main[0] != main[1]:
        return main[1]
    angle = angle_between(lanes.lanes[own[0]].end, lanes.lanes[other[0]].end)
    if math.pi - abs(angle) < ONCOMING:
        return lanes.lanes[own[1]].turn > LEFT >= lanes.lanes[other[1]].turn
    return angle > 0  # who comes from the right crosses to the left
