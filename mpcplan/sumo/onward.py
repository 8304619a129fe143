"""Routes for SUMO: the edges of a path of lanes, and how a path goes on to the net's end."""

import heapq
import math
from collections.abc import Collection, Sequence

from mpcplan.sumo.drivers import ANY
from mpcplan.sumo.lanes import LaneGraph

LANES_MAX = 200  # lanes after which a way is long enough
_CHANGE = 10.0  # m, what a lane change costs on the way to a goal


def edges_of(graph: LaneGraph, lanes: Sequence[str]) -> tuple[str, ...]:
    """The edges of a path of lanes as SUMO wants them in a route, those in junctions left out."""
    edges: list[str] = []
    for lane in lanes:
        edge = graph.lanes[lane].edge
        if not graph.lanes[lane].internal and edges[-1:] != [edge]:
            edges.append(edge)
    return tuple(edges)


def with_approach(graph: LaneGraph, lanes: Sequence[str]) -> tuple[str, ...]:
    """A path of lanes, begun with the lane before the junction where it begins in one."""
    path = list(lanes)
    while graph.lanes[path[0]].internal:
        before = [lane for lane in graph.predecessors[path[0]] if lane not in path]
        if not before:
            break
        path.insert(0, before[0])
    return tuple(path)


def onward(
    graph: LaneGraph, starts: Sequence[str], vehicle_class: str, driven: Collection[str] = ()
) -> tuple[str, ...]:
    """The lanes that follow one of ``starts`` to the net's end, as straight on as may be.

    Args:
        graph: the net.
        starts: lanes to choose the begin from.
        vehicle_class: SUMO's class; lanes that it may not use are left out.
        driven: edges that are not taken again, so that roundabouts end.
    """
    lanes: list[str] = []
    seen = {*driven, *(graph.lanes[lane].edge for lane in starts)}
    while len(lanes) < LANES_MAX:
        choices = [
            (_turn(graph, lane, follower), follower)
            for lane in starts
            for follower in graph.successors[lane]
            if allows(graph, follower, vehicle_class) and graph.lanes[follower].edge not in seen
        ]
        if not choices:
            break
        lanes.append(min(choices)[1])
        starts = lanes[-1:]
        seen.add(graph.lanes[lanes[-1]].edge)
    return tuple(lanes)


def allows(graph: LaneGraph, lane: str, vehicle_class: str) -> bool:
    """Whether a vehicle class may drive on a lane."""
    allowed = graph.lanes[lane].allowed
    return vehicle_class == ANY or not allowed or vehicle_class in allowed


def towards(graph: LaneGraph, start: str, ends: Collection[str]) -> tuple[str, ...]:
    """The shortest way along lanes and lane changes to any of some lanes, start included; empty
    where there is none."""
    queue: list[tuple[float, tuple[str, ...]]] = [(0.0, (start,))]
    known: set[str] = set()
    while queue:
        cost, path = heapq.heappop(queue)
        lane = path[-1]
        if lane in ends:
            return path
        if lane in known:
            continue
        known.add(lane)
        for other in graph.beside(lane):
            heapq.heappush(queue, (cost + _CHANGE, (*path, other)))
        for follower in graph.successors[lane]:
            heapq.heappush(queue, (cost + graph.lanes[lane].line.length, (*path, follower)))
    return ()


def _turn(graph: LaneGraph, lane: str, follower: str) -> float:
    """How far [rad] the way turns from a lane's end to its follower's."""
    here = graph.lanes[lane]
    ahead = graph.lanes[follower]
    turn = ahead.heading(ahead.line.length) - here.heading(here.line.length)
    return round(abs(math.atan2(math.sin(turn), math.cos(turn))), 6)
