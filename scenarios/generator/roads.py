"""Lanelet networks: parallel lanes along a path, single connecting lanelets, traffic signs."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from commonroad.common.common_lanelet import LaneletType, LineMarking
from commonroad.scenario.intersection import Intersection
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad.scenario.traffic_sign import (
    TrafficSign,
    TrafficSignElement,
    TrafficSignIDZamunda,
)

from .frame import turned_points
from .paths import Path

LANE_WIDTH = 3.5  # [m]
HALF_LANE = LANE_WIDTH / 2  # [m]
COORDINATE_DIGITS = 4  # decimals of every coordinate [m]
SNAP_DISTANCE = 1e-3  # ends of bounds closer than this are the same point [m]
SIGN_ID_BASE = 500  # traffic signs have the ids 501, 502, ...
SIGN_MARGIN = 1.0  # distance of a traffic sign from the road edge [m]


class Lane(NamedTuple):
    """Lane between two offsets [m] of the reference path; `forward` is False if oncoming."""

    right: float
    left: float
    forward: bool = True


RIGHT_LANE = Lane(-LANE_WIDTH, 0.0)
LEFT_LANE = Lane(0.0, LANE_WIDTH)
ONCOMING_LANE = Lane(0.0, LANE_WIDTH, forward=False)
TWO_LANES = (RIGHT_LANE, LEFT_LANE)
TWO_WAY = (RIGHT_LANE, ONCOMING_LANE)


def rounded(points: np.ndarray) -> np.ndarray:
    """Coordinates [m] as they are stored in the file (without negative zeros)."""
    return np.round(points, COORDINATE_DIGITS) + 0.0


def _add_sign(
    network: LaneletNetwork,
    number: int,
    element: TrafficSignElement,
    position: np.ndarray,
    first: int,
    lanelets: set[int],
) -> None:
    """Put up a sign at `position` [m], seen first from the lanelet `first`, valid on `lanelets`."""
    place = rounded(turned_points(position))
    sign = TrafficSign(SIGN_ID_BASE + number, [element], {first}, place)
    network.add_traffic_sign(sign, lanelets)


@dataclass
class Draft:
    """Lanelet under construction."""

    right: np.ndarray
    left: np.ndarray
    predecessors: list[int] = field(default_factory=list)
    successors: list[int] = field(default_factory=list)
    beside_right: tuple[int, bool] | None = None
    beside_left: tuple[int, bool] | None = None
    marking_right: LineMarking = LineMarking.SOLID
    marking_left: LineMarking = LineMarking.SOLID


class RoadMap:
    """Collects lanelets and signs and turns them into a CommonRoad lanelet network."""

    def __init__(self, kind: LaneletType = LaneletType.URBAN) -> None:
        """Start an empty map whose lanelets are all of the type `kind`."""
        self.kind = kind
        self.drafts: dict[int, Draft] = {}
        self.ends: list[np.ndarray] = []
        self.limits: list[tuple[float, np.ndarray]] = []
        self.yields: list[tuple[int, np.ndarray]] = []
        self.intersections: list[Intersection] = []

    def add(self, right: np.ndarray, left: np.ndarray) -> int:
        """Add a lanelet with the given bounds [m] in driving direction; returns its id."""
        lanelet_id = len(self.drafts) + 1
        self.drafts[lanelet_id] = Draft(self._snapped(right), self._snapped(left))
        return lanelet_id

    def _snapped(self, bound: np.ndarray) -> np.ndarray:
        """Rounded bound whose ends coincide exactly with ends of earlier bounds next to them."""
        bound = rounded(bound)
        for index in (0, -1):
            near = [end for end in self.ends if np.abs(end - bound[index]).max() < SNAP_DISTANCE]
            if near:
                bound[index] = near[0]
            else:
                self.ends.append(bound[index].copy())
        return bound

    def add_along(self, path: Path, start: float = 0.0, end: float | None = None) -> int:
        """Add one lanelet of normal width whose centre is `path` from `start` to `end` [m]."""
        s = path.vertex_stations(start, path.length if end is None else end)
        return self.add(path.point(s, -HALF_LANE), path.point(s, HALF_LANE))

    def connect(self, *chain: int) -> None:
        """Make every lanelet of the chain the predecessor of the next one."""
        for first, second in pairwise(chain):
            self.drafts[first].successors.append(second)
            self.drafts[second].predecessors.append(first)

    def put_beside(self, right: int, left: int, right_forward: bool, left_forward: bool) -> None:
        """Declare two lanelets adjacent, `right` lying right of `left` seen along the path."""
        same = right_forward == left_forward
        self._set_neighbour(right, left, right_forward, same)
        self._set_neighbour(left, right, not left_forward, same)

    def _set_neighbour(self, lanelet: int, other: int, on_left: bool, same: bool) -> None:
        draft = self.drafts[lanelet]
        if on_left:
            draft.beside_left, draft.marking_left = (other, same), LineMarking.DASHED
        else:
            draft.beside_right, draft.marking_right = (other, same), LineMarking.DASHED

    def add_strip(
        self, path: Path, lanes: tuple[Lane, ...], cuts: tuple[float, ...] = ()
    ) -> list[list[int]]:
        """Parallel lanes (from right to left) along `path`, cut at the stations `cuts` [m].

        Returns the lanelet ids as [section][lane].
        """
        edges = (0.0, *cuts, path.length)
        table: list[list[int]] = []
        for start, end in pairwise(edges):
            s = path.vertex_stations(start, end)
            table.append([self._add_lane(path, s, lane) for lane in lanes])
            for i in range(len(lanes) - 1):
                pair = table[-1][i : i + 2]
                self.put_beside(*pair, lanes[i].forward, lanes[i + 1].forward)
        for i, lane in enumerate(lanes):
            chain = [row[i] for row in table]
            self.connect(*(chain if lane.forward else chain[::-1]))
        return table

    def _add_lane(self, path: Path, s: np.ndarray, lane: Lane) -> int:
        right, left = path.point(s, lane.right), path.point(s, lane.left)
        return self.add(right, left) if lane.forward else self.add(left[::-1], right[::-1])

    def limit_speed(self, speed: float, path: Path, s: float) -> None:
        """Speed limit [m/s] for all lanelets, with the sign right of the road at station `s`."""
        self.limits.append((speed, path.point(s, -LANE_WIDTH - SIGN_MARGIN)))

    def give_way(self, lanelet: int, position: np.ndarray) -> None:
        """Sign at `position` [m] that who comes from `lanelet` has to give way."""
        self.yields.append((lanelet, position))

    def network(self) -> LaneletNetwork:
        """The finished lanelet network in the frame of the file."""
        network = LaneletNetwork()
        for lanelet_id, draft in self.drafts.items():
            network.add_lanelet(self._lanelet(lanelet_id, draft))
        for number, (speed, position) in enumerate(self.limits, start=1):
            element = TrafficSignElement(TrafficSignIDZamunda.MAX_SPEED, [f"{speed:.2f}"])
            _add_sign(network, number, element, position, min(self.drafts), set(self.drafts))
        for number, (lanelet, position) in enumerate(self.yields, start=1 + len(self.limits)):
            element = TrafficSignElement(TrafficSignIDZamunda.YIELD, [])
            _add_sign(network, number, element, position, lanelet, {lanelet})
        for intersection in self.intersections:
            network.add_intersection(intersection)
        return network

    def _lanelet(self, lanelet_id: int, draft: Draft) -> Lanelet:
        left_id, left_same = draft.beside_left or (None, None)
        right_id, right_same = draft.beside_right or (None, None)
        left, right = rounded(turned_points(draft.left)), rounded(turned_points(draft.right))
        return Lanelet(
            left,
            0.5 * (left + right),
            right,
            lanelet_id,
            draft.predecessors,
            draft.successors,
            left_id,
            left_same,
            right_id,
            right_same,
            draft.marking_left,
            draft.marking_right,
            lanelet_type={self.kind},
        )
