"""The lanes of SUMO's net as a graph: where they lie and what follows what.

A lane's direct successors are the internal lanes of junctions where there are any, so that a path
through the graph is a path on the ground. All coordinates are the file's.
"""

import bisect
import heapq
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import libsumo
import numpy as np
import shapely

from mpcplan.trajectory import Array

_LANE_CHANGE = 2.0  # m, what a change to the lane beside costs a path
_SPARE = 10.0  # m, by which lanes are looked up farther than needed, for the next times


@dataclass(frozen=True, eq=False)
class Lane:
    """One lane.

    Attributes:
        id: SUMO's id.
        edge: SUMO's id of its edge.
        index: from the right, 0 the rightmost.
        line: the middle.
        allowed: SUMO's vehicle classes that may drive here; empty: all.
    """

    id: str
    edge: str
    index: int
    line: shapely.LineString
    allowed: frozenset[str]

    @property
    def internal(self) -> bool:
        """Whether it lies in a junction; routes leave such edges out."""
        return self.edge.startswith(":")

    @property
    def name(self) -> tuple[str, int]:
        """Edge and index, as SUMO wants them together."""
        return self.edge, self.index

    def point(self, offset: float) -> Array:
        """(2,) point [m] at a distance [m] from its begin."""
        point: Array = np.array(self.line.interpolate(offset).coords[0])
        return point

    def heading(self, offset: float) -> float:
        """Direction [rad] at a distance [m] from its begin."""
        begins, headings = self._pieces
        return headings[max(bisect.bisect_right(begins, offset) - 1, 0)]

    @cached_property
    def _pieces(self) -> tuple[list[float], list[float]]:
        """Where each straight piece begins [m], and its direction [rad]."""
        steps = np.diff(np.asarray(self.line.coords), axis=0)
        lengths = np.hypot(*steps.T)
        begins = np.concatenate([[0.0], np.cumsum(lengths[:-1])])
        return begins.tolist(), np.arctan2(steps[:, 1], steps[:, 0]).tolist()


@dataclass(frozen=True)
class Place:
    """A point on a lane: distance [m] from the lane's begin, distance from its middle [m], and
    heading [rad] relative to the lane's."""

    lane: str
    offset: float
    distance: float
    turn: float


class LaneGraph:
    """All lanes of the net that is loaded."""

    def __init__(self) -> None:
        self.lanes: dict[str, Lane] = {}
        self.successors: dict[str, tuple[str, ...]] = {}
        self._collect()
        self.predecessors: dict[str, list[str]] = {lane: [] for lane in self.lanes}
        for lane in sorted(self.successors):
            for follower in self.successors[lane]:
                self.predecessors[follower].append(lane)
        self._beside = _beside(self.lanes)
        self._of_edge: dict[str, list[str]] = {}
        for lane in sorted(self.lanes):
            self._of_edge.setdefault(self.lanes[lane].edge, []).append(lane)
        self._ids = sorted(self.lanes)
        self._lines = np.array([self.lanes[lane].line for lane in self._ids], object)
        self._tree = shapely.STRtree(self._lines)
        self._spot = (0.0, 0.0, -math.inf)  # x, y, radius [m] of what is kept
        self._kept = np.empty(0, int), self._lines[:0]

    def _collect(self) -> None:
        """All lanes; SUMO's list leaves those in junctions out."""
        waiting = sorted(libsumo.lane.getIDList())
        while waiting:
            lane = waiting.pop()
            if lane in self.lanes:
                continue
            self.lanes[lane] = _lane(lane)
            links = libsumo.lane.getLinks(lane)
            self.successors[lane] = tuple(sorted(link[4] or link[0] for link in links))
            waiting += self.successors[lane]

    def near(
        self, point: Array, psi: float, reach: float, turn_max: float = math.pi / 2
    ) -> list[Place]:
        """Places within ``reach`` [m] on lanes that lead the way psi within an angle [rad], by lane
        id."""
        spot = shapely.points(point)
        around, lines = self._around(float(point[0]), float(point[1]), reach)
        distances = shapely.distance(lines, spot)
        there = np.flatnonzero(distances <= reach)
        offsets = shapely.line_locate_point(lines[there], spot).tolist()
        found = []
        for i, offset, distance in zip(
            around[there].tolist(), offsets, distances[there].tolist(), strict=True
        ):
            lane = self.lanes[self._ids[i]]
            turn = psi - lane.heading(offset)
            turn = math.atan2(math.sin(turn), math.cos(turn))
            if abs(turn) <= turn_max:
                found.append(Place(lane.id, offset, distance, turn))
        return found

    def nearest(self, point: Array) -> str:
        """The lane nearest to a point, whatever way it leads."""
        return self._ids[int(self._tree.nearest(shapely.Point(point)))]

    def within(self, area: shapely.Geometry) -> tuple[str, ...]:
        """The lanes that touch an area, sorted."""
        return tuple(self._ids[i] for i in sorted(self._tree.query(area, predicate="intersects")))

    def along(self, corners: Array, reach: float) -> list[tuple[str, list[float]]]:
        """Where a body lies along the lanes within ``reach`` [m] of it, by lane id.

        Args:
            corners: (m, 2) of the body [m], the first opposite the third.
            reach: from a lane's middle [m].

        Returns:
            lane's id, and distances [m] of the corners from the lane's begin.
        """
        area, spots = shapely.polygons(corners), shapely.points(corners)
        (x, y), (other_x, other_y) = corners[0].tolist(), corners[2].tolist()
        around, lines = self._around(x, y, math.hypot(other_x - x, other_y - y) + reach)
        there = np.flatnonzero(shapely.distance(lines, area) <= reach)
        along = shapely.line_locate_point(lines[there, None], spots).tolist()
        return [(self._ids[i], row) for i, row in zip(around[there].tolist(), along, strict=True)]

    def _around(self, x: float, y: float, reach: float) -> tuple[Array, Array]:
        """Numbers and lines of all lanes within ``reach`` [m] of a point and of some beyond, the
        same ones as long as they serve."""
        if math.hypot(x - self._spot[0], y - self._spot[1]) + reach > self._spot[2]:
            radius = reach + _SPARE
            spot = shapely.points(x, y)
            found = np.sort(self._tree.query(spot, predicate="dwithin", distance=radius))
            self._spot, self._kept = (x, y, radius), (found, self._lines[found])
        return self._kept

    def normal(self, lane: str) -> str:
        """The edge of a lane; of one in a junction that of the lane before it."""
        seen: list[str] = []
        while self.lanes[lane].internal and lane not in seen and self.predecessors[lane]:
            seen.append(lane)
            lane = self.predecessors[lane][0]
        return self.lanes[lane].edge

    def beside(self, lane: str) -> tuple[str, ...]:
        """The lanes next to a lane on its edge."""
        return self._beside[lane]

    def after(self, edge: str, follower: str) -> tuple[str, ...]:
        """The lanes of an edge that are entered from another, sorted; none if they do not meet."""
        return tuple(
            sorted(
                {
                    path[-1]
                    for lane in self._of_edge.get(edge, ())
                    for path in self._through_junction(lane)
                    if self.lanes[path[-1]].edge == follower
                }
            )
        )

    def on_route(self, edges: Sequence[str]) -> frozenset[str]:
        """All lanes of a route, those in junctions included; unknown edges are left out."""
        found = {lane for edge in edges for lane in self._of_edge.get(edge, ())}
        for edge, follower in itertools.pairwise(edges):
            for lane in self._of_edge.get(edge, ()):
                for path in self._through_junction(lane):
                    if self.lanes[path[-1]].edge == follower:
                        found.update(path)
        return frozenset(found)

    def _through_junction(self, lane: str) -> list[tuple[str, ...]]:
        """The ways from a lane through the junction at its end, each to the first lane after it."""
        done: list[tuple[str, ...]] = []
        waiting: list[tuple[str, ...]] = [(follower,) for follower in self.successors[lane]]
        while waiting:
            path = waiting.pop()
            if not self.lanes[path[-1]].internal:
                done.append(path)
            else:
                ahead = [lane for lane in self.successors[path[-1]] if lane not in path]
                waiting += [(*path, follower) for follower in ahead]
        return done

    def paths(self, start: Place, reach: float) -> dict[str, tuple[float, tuple[str, ...]]]:
        """What can be reached within a distance.

        Returns:
            for each lane the cost to its begin [m] (counted from ``start``, lane changes added; the
            start's own lane at minus its offset) and the lanes on the way, both ends included.
        """
        known: dict[str, tuple[float, tuple[str, ...]]] = {}
        queue: list[tuple[float, tuple[str, ...]]] = [(-start.offset, (start.lane,))]
        while queue:
            cost, path = heapq.heappop(queue)
            lane = path[-1]
            if lane in known:
                continue
            known[lane] = (cost, path)
            for other in self._beside[lane]:
                heapq.heappush(queue, (cost + _LANE_CHANGE, (*path, other)))
            end = cost + self.lanes[lane].line.length
            if end <= reach:
                for follower in self.successors[lane]:
                    heapq.heappush(queue, (end, (*path, follower)))
        return known


def _lane(lane: str) -> Lane:
    edge, index = libsumo.lane.getEdgeID(lane), int(lane.rsplit("_", 1)[1])
    line = shapely.LineString(libsumo.lane.getShape(lane))
    return Lane(lane, edge, index, line, frozenset(libsumo.lane.getAllowed(lane)))


def _beside(lanes: dict[str, Lane]) -> dict[str, tuple[str, ...]]:
    at = {(lane.edge, lane.index): lane.id for lane in lanes.values()}
    return {
        lane.id: tuple(
            at[lane.edge, i] for i in (lane.index - 1, lane.index + 1) if (lane.edge, i) in at
        )
        for lane in lanes.values()
    }
