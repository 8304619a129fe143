"""The lanes that each vehicle is about to drive on, and those it has just left."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from mpcplan.sumo.crossings import Stretch
from mpcplan.sumo.lanes import LaneGraph
from mpcplan.trajectory import Array

AHEAD = 90.0  # m, that a way reaches ahead of a lane's end
ROOM = 2.0  # m, that a vehicle waiting between two crossings needs beside its length
BEHIND = 25.0  # m, that it reaches back from a lane's begin: longer than any vehicle


@dataclass(frozen=True, eq=False)
class Way:
    """Lanes in driving order.

    Attributes:
        lane: where the vehicle's front is.
        lanes: ids, and where each begins [m] as seen from the begin of ``lane``.
        ids: the same ids.
        zones: (k,) twice the number of each conflict on the way, plus its side.
        together: (k,) whether the lanes of the conflict lead the same way.
        begins: (k,) where it begins [m], as seen from the begin of ``lane``.
        ends: (k,) where it ends [m].
        holds: (k,) where to wait for it [m]: before all crossings between which there is no room
            for the vehicle.
    """

    lane: str
    lanes: tuple[tuple[str, float], ...]
    ids: frozenset[str]
    zones: Array
    together: Array
    begins: Array
    ends: Array
    holds: Array


class Ways:
    """The ways of all vehicles, renewed where one enters another lane."""

    def __init__(self, graph: LaneGraph, stretches: Mapping[str, tuple[Stretch, ...]]) -> None:
        self._graph, self._stretches = graph, stretches
        self._known: dict[str, Way] = {}

    def of(self, vehicle: str, lane: str, route: Collection[str], length: float) -> Way:
        """The way of a vehicle of a length [m] whose front is on a lane of its route."""
        known = self._known.get(vehicle)
        if known is None or known.lane != lane:
            lanes = (*self._behind(known, lane), *self._ahead(lane, route))
            known = self._way(lane, lanes, length)
            self._known[vehicle] = known
        return known

    def _way(self, lane: str, lanes: tuple[tuple[str, float], ...], length: float) -> Way:
        found = [(s, at) for known, at in lanes for s in self._stretches.get(known, ())]
        found.sort(key=lambda item: item[1] + item[0].begin)
        return Way(
            lane,
            lanes,
            frozenset(known for known, _ in lanes),
            np.array([2 * s.zone + s.side for s, _ in found], int),
            np.array([s.together for s, _ in found], bool),
            np.array([at + s.begin for s, at in found], float),
            np.array([at + s.end for s, at in found], float),
            np.array(_holds(found, length + ROOM), float),
        )

    def _behind(self, before: Way | None, lane: str) -> list[tuple[str, float]]:
        """The lanes on which the vehicle's tail may still be."""
        if before is None:
            return []
        start = next((at for known, at in before.lanes if known == lane), None)
        if start is None:  # a lane beside
            return []
        left = ((known, at - start) for known, at in before.lanes if at < start)
        return [(known, at) for known, at in left if at + self._length(known) > -BEHIND]

    def _ahead(self, lane: str, route: Collection[str]) -> list[tuple[str, float]]:
        lanes, end = [(lane, 0.0)], self._length(lane)
        limit = end + AHEAD
        while end < limit:
            follower = self._next(lanes[-1][0], route)
            if follower is None or any(follower == known for known, _ in lanes):
                break
            lanes.append((follower, end))
            end += self._length(follower)
        return lanes

    def _next(self, lane: str, route: Collection[str]) -> str | None:
        """The lane after a lane; where a route asks for a lane change before, that after it."""
        for known in (lane, *self._graph.beside(lane)):
            for follower in self._graph.successors[known]:
                if follower in route:
                    return follower
        return None

    def _length(self, lane: str) -> float:
        return self._graph.lanes[lane].line.length


def _holds(stretches: list[tuple[Stretch, float]], room: float) -> list[float]:
    """Where to wait for each stretch, given where its lane begins, sorted by begin."""
    holds: list[float] = []
    hold = end = -math.inf
    for stretch, at in stretches:
        begin = at + stretch.begin
        if stretch.together:
            holds.append(begin)
            continue
        if begin > end + room:
            hold = begin
        end = max(end, at + stretch.end)
        holds.append(hold)
    return holds
