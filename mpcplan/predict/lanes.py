"""The lanes as a graph with geometry, and which of them a vehicle is on.

Everything is precomputed once per map: centre lines, successors, neighbours, speed limits, and a
search tree over samples of the centre lines by which many vehicles are matched at once.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from scipy.spatial import cKDTree

from mpcplan.road.reference import drop_repeated
from mpcplan.trajectory import Array

SAMPLING = 2.0  # m, between samples of a centre line in the search tree
NEAREST = 24  # samples looked at per vehicle
REACH = 3.0  # m, from a lane's centre line, within which a vehicle may be on the lane
TURN_MAX = math.pi / 3  # rad, between a vehicle's and its lane's direction
OVERLAP = 0.5  # m, by which a place may lie before or after its lane


@dataclass(frozen=True, eq=False)
class Lane:
    """One lanelet.

    Attributes:
        id: of the lanelet.
        points: (n, 2) centre line [m].
        s: (n,) arc lengths [m] of ``points``.
        successors: indices of the lanes that follow.
        predecessors: indices of the lanes that lead here.
        beside: indices of the neighbours of the same direction.
        limit: posted speed [m/s], infinity where no sign stands.
        crossing: whether it lies within an intersection.
    """

    id: int
    points: Array
    s: Array
    successors: tuple[int, ...]
    predecessors: tuple[int, ...]
    beside: tuple[int, ...]
    limit: float
    crossing: bool

    @property
    def length(self) -> float:
        """Length of the centre line [m]."""
        return float(self.s[-1])

    @property
    def end(self) -> Array:
        """(2,) vector along its last piece."""
        last: Array = self.points[-1] - self.points[-2]
        return last

    @property
    def turn(self) -> float:
        """Change of direction [rad] from its begin to its end, to the left."""
        return angle_between(self.points[1] - self.points[0], self.end)


@dataclass(frozen=True, eq=False)
class Places:
    """Where vehicles are on lanes: one row per vehicle and lane (all arrays (p,)).

    Attributes:
        vehicle: index of the vehicle, ascending.
        lane: index of the lane.
        s: arc length [m] on the lane.
        d: offset [m] from its centre line, to the left.
        turn: heading [rad] relative to the lane.
        direction: (p, 2) unit vectors along the lane.
    """

    vehicle: Array
    lane: Array
    s: Array
    d: Array
    turn: Array
    direction: Array

    def pick(self, index: Array) -> "Places":
        """The rows at an index."""
        return Places(*(values[index] for values in vars(self).values()))


class Lanes:
    """All lanes of a map.

    Attributes:
        lanes: by the lanelets' ids, ascending.
        index: of the lane, by the lanelet's id.
    """

    def __init__(self, network: LaneletNetwork) -> None:
        found = sorted(network.lanelets, key=lambda lanelet: lanelet.lanelet_id)
        self.index = {lanelet.lanelet_id: i for i, lanelet in enumerate(found)}
        limits, crossings = _limits(network), _crossings(network)
        self.lanes = tuple(
            _lane(lanelet, self.index, limits, lanelet.lanelet_id in crossings) for lanelet in found
        )
        self._length = np.array([lane.length for lane in self.lanes])
        self._sample()

    def _sample(self) -> None:
        """Samples of all centre lines with their lane, arc length and direction."""
        parts = []
        for i, lane in enumerate(self.lanes):
            count = max(math.ceil(lane.length / SAMPLING), 1)
            s = (np.arange(count) + 0.5) * lane.length / count
            piece = np.clip(np.searchsorted(lane.s, s, side="right") - 1, 0, len(lane.s) - 2)
            step = lane.points[piece + 1] - lane.points[piece]
            step = step / np.hypot(*step.T)[:, None]
            points = lane.points[piece] + (s - lane.s[piece])[:, None] * step
            parts.append(np.column_stack([np.full(count, i), s, points, step]))
        table = np.vstack(parts)
        self._lane_of, self._s_of = table[:, 0].astype(int), table[:, 1]
        self._point_of, self._direction_of = table[:, 2:4], table[:, 4:6]
        self._tree = cKDTree(self._point_of)
        self._nearest = min(NEAREST, len(table))

    def match(self, points: Array, headings: Array) -> Places:
        """The lanes on which points (n, 2) with headings (n,) lie; a point may lie on several.

        A lane counts where its centre line is within :data:`REACH` and leads the same way. Where
        a lane and one that follows it both hold a point, only the latter counts.
        """
        n, k = len(points), self._nearest
        near = self._tree.query(points, k=[*range(1, k + 1)], distance_upper_bound=2 * REACH)[1]
        vehicle, near = np.repeat(np.arange(n), k), near.ravel()
        known = near < len(self._lane_of)
        vehicle, near = vehicle[known], near[known]
        key = vehicle * len(self.lanes) + self._lane_of[near]
        first = np.unique(key, return_index=True)[1]  # the nearest sample of each lane
        vehicle, near = vehicle[first], near[first]
        lane, direction = self._lane_of[near], self._direction_of[near]
        offset = points[vehicle] - self._point_of[near]
        s = self._s_of[near] + (offset * direction).sum(1)
        d = direction[:, 0] * offset[:, 1] - direction[:, 1] * offset[:, 0]
        turn = headings[vehicle] - np.arctan2(direction[:, 1], direction[:, 0])
        turn = (turn + math.pi) % (2 * math.pi) - math.pi
        kept = (np.abs(d) < REACH) & (np.abs(turn) < TURN_MAX)
        kept &= (s > -OVERLAP) & (s < self._length[lane] + OVERLAP)
        places = Places(vehicle, lane, np.clip(s, 0.0, self._length[lane]), d, turn, direction)
        return self._without_passed(places.pick(np.flatnonzero(kept)))

    def _without_passed(self, places: Places) -> Places:
        """Without lanes of which a follower holds the same vehicle too."""
        ends = places.s > self._length[places.lane] - OVERLAP
        kept = np.ones(len(ends), bool)
        for i in np.flatnonzero(ends):
            same = places.lane[places.vehicle == places.vehicle[i]]
            kept[i] = not np.isin(same, self.lanes[places.lane[i]].successors).any()
        return places.pick(np.flatnonzero(kept))


def _lane(
    lanelet: Lanelet, index: dict[int, int], limits: dict[int, float], crossing: bool
) -> Lane:
    points = drop_repeated(np.asarray(lanelet.center_vertices, float))
    if len(points) < 2:
        points = np.asarray(lanelet.center_vertices, float)[[0, -1]] + [[0.0, 0.0], [1e-3, 0.0]]
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    beside = (
        (lanelet.adj_left, lanelet.adj_left_same_direction),
        (lanelet.adj_right, lanelet.adj_right_same_direction),
    )

    def known(ids: Iterable[int]) -> tuple[int, ...]:
        return tuple(sorted(index[i] for i in ids if i in index))

    limit = limits.get(lanelet.lanelet_id, math.inf)
    return Lane(
        lanelet.lanelet_id, points, s, known(lanelet.successor), known(lanelet.predecessor),
        known(i for i, same in beside if same), limit, crossing,
    )  # fmt: skip


def _limits(network: LaneletNetwork) -> dict[int, float]:
    """Posted speed [m/s] by lanelet.

    Read from the signs themselves: the interpreter of commonroad-io knows a few countries only.
    """
    posted: dict[int, float] = {}
    for sign in network.traffic_signs:
        for element in sign.traffic_sign_elements:
            if element.traffic_sign_element_id.name == "MAX_SPEED" and element.additional_values:
                posted[sign.traffic_sign_id] = float(element.additional_values[0])
    return {
        lanelet.lanelet_id: min(posted[i] for i in lanelet.traffic_signs if i in posted)
        for lanelet in network.lanelets
        if any(i in posted for i in lanelet.traffic_signs)
    }


def _crossings(network: LaneletNetwork) -> set[int]:
    """Lanelets within intersections."""
    return {
        lanelet
        for intersection in network.intersections
        for incoming in intersection.incomings
        for ways in (
            incoming.successors_left, incoming.successors_straight, incoming.successors_right,
        )
        for lanelet in ways or ()
    }  # fmt: skip


def angle_between(a: Array, b: Array) -> float:
    """Angle [rad] in (-pi, pi] from a vector (2,) to another, to the left."""
    return math.atan2(float(a[0] * b[1] - a[1] * b[0]), float(a @ b))
