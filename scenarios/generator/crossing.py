"""A crossing of two two-way roads without lights.

All lengths are in metres, angles in radians.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from commonroad.scenario.intersection import Intersection, IntersectionIncomingElement

from .junctions import JUNCTION_HALF, LEFT_TURN_RADIUS, RIGHT_TURN_RADIUS
from .paths import Path, Segment, arc, build_path, straight
from .roads import HALF_LANE, LANE_WIDTH, SIGN_MARGIN, TWO_WAY, RoadMap

ARM = 100.0
QUARTER = math.pi / 2
INTERSECTION_ID = 600
INCOMING_ID = 601  # first id of the incoming groups
SOUTH, EAST, NORTH, WEST = range(4)  # counter-clockwise
RIGHT, STRAIGHT, LEFT = 1, 2, 3  # how many arms on a turn leads


class Crossing(NamedTuple):
    """Four arms, numbered counter-clockwise, and the lanelets that lead away on them."""

    road: RoadMap
    exits: list[int]

    @staticmethod
    def route(start: int, end: int) -> Path:
        """Lane centre from the far end of an arm to the far end of another."""
        turn = _turn((end - start) % 4)
        return build_path(straight(ARM), turn, straight(ARM)).placed(ARM, *_mouth(start))


def crossing() -> Crossing:
    """Two roads that meet at the origin, all twelve turns; who comes from the south or the north
    has to give way."""
    road = RoadMap()
    arms = [_add_arm(road, arm) for arm in range(4)]
    links: dict[tuple[int, int], int] = {}
    for start in range(4):
        for turn in (RIGHT, STRAIGHT, LEFT):
            end = (start + turn) % 4
            path = build_path(_turn(turn)).placed(0.0, *_mouth(start))
            links[start, end] = road.add_along(path)
            road.connect(arms[start][0], links[start, end], arms[end][1])
    road.intersections.append(_intersection(arms, links))
    return Crossing(road, [away for _, away in arms])


def _turn(turn: int) -> Segment:
    """The piece of a route within the crossing."""
    if turn == STRAIGHT:
        return straight(2 * JUNCTION_HALF)
    return arc(-QUARTER, RIGHT_TURN_RADIUS) if turn == RIGHT else arc(QUARTER, LEFT_TURN_RADIUS)


def _mouth(arm: int) -> tuple[float, float, float]:
    """Where the lane of an arm enters the crossing: x, y, heading."""
    turn = arm * QUARTER
    x, y = HALF_LANE, -JUNCTION_HALF  # of the southern arm
    cos, sin = math.cos(turn), math.sin(turn)
    return cos * x - sin * y, sin * x + cos * y, QUARTER + turn


def _add_arm(road: RoadMap, arm: int) -> tuple[int, int]:
    """Two-way road away from the crossing; returns the lanelets (towards, away)."""
    heading = (arm - 1) * QUARTER
    x, y = JUNCTION_HALF * math.cos(heading), JUNCTION_HALF * math.sin(heading)
    outward = build_path(straight(ARM), x=x, y=y, heading=heading)
    away, towards = road.add_strip(outward, TWO_WAY)[0]
    if arm in (SOUTH, NORTH):
        road.give_way(towards, outward.point(0.0, LANE_WIDTH + SIGN_MARGIN))
    return towards, away


def _intersection(arms: list[tuple[int, int]], links: dict[tuple[int, int], int]) -> Intersection:
    """CommonRoad's intersection element; on the right of an arm lies the next one."""
    incomings = []
    for arm, (towards, _) in enumerate(arms):
        right, ahead, left = ({links[arm, (arm + t) % 4]} for t in (RIGHT, STRAIGHT, LEFT))
        neighbour = INCOMING_ID + (arm + 1) % 4
        incomings.append(
            IntersectionIncomingElement(INCOMING_ID + arm, {towards}, right, ahead, left, neighbour)
        )
    return Intersection(INTERSECTION_ID, incomings)
