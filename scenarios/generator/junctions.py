"""Road layouts that need more than parallel lanes: on-ramp, T-junction and roundabout.

All lengths are in metres, angles in radians.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from commonroad.common.common_lanelet import LaneletType
from commonroad.scenario.intersection import Intersection, IntersectionIncomingElement

from .paths import Path, Segment, arc, build_path, straight
from .roads import HALF_LANE, LANE_WIDTH, TWO_WAY, Lane, RoadMap

QUARTER = math.pi / 2
INTERSECTION_ID = 600
INCOMING_ID = 601  # first id of the incoming groups

# On-ramp: the acceleration lane begins at x = 0 with its centre at y = 0.
RAMP_STRAIGHT = 40.0
RAMP_TRANSITION = 10.0
RAMP_CURVATURE = 1.0 / 80.0
RAMP_LENGTH = RAMP_STRAIGHT + 3 * RAMP_TRANSITION
ACCELERATION_LENGTH = 90.0
TAPER_LENGTH = 30.0
TAPER_END_WIDTH = 0.5
MAIN_BEFORE = 130.0
MAIN_AFTER = 210.0

# T-junction: the centre lines meet at the origin.
JUNCTION_HALF = 10.0  # distance of the arms from the centre
SIDE_ROAD = 60.0
MAIN_ARM = 140.0
RIGHT_TURN_RADIUS = JUNCTION_HALF - HALF_LANE
LEFT_TURN_RADIUS = JUNCTION_HALF + HALF_LANE

# Roundabout: counter-clockwise circle around the origin with four arms.
CIRCLE_RADIUS = 16.0
ENTRY_RADIUS = 12.0
ENTRY_ANGLE = math.pi / 3
ARM_LENGTH = 100.0
ARM_OFFSET = 2.0  # lane centre from the axis of the arm


class Ramp(NamedTuple):
    """On-ramp layout: `main` and `ramp` are lane centres, `goal` the main lanelet beyond."""

    road: RoadMap
    main: Path
    ramp: Path
    goal: int


def on_ramp() -> Ramp:
    """Highway lane with a ramp whose acceleration lane ends after a taper."""
    road = RoadMap(LaneletType.HIGHWAY)
    end = ACCELERATION_LENGTH + TAPER_LENGTH
    ramp = build_path(
        straight(RAMP_STRAIGHT),
        Segment(RAMP_TRANSITION, 0.0, -RAMP_CURVATURE),
        Segment(RAMP_TRANSITION, -RAMP_CURVATURE, -RAMP_CURVATURE),
        Segment(RAMP_TRANSITION, -RAMP_CURVATURE, 0.0),
        straight(end + MAIN_AFTER),  # beyond the taper only a route, not a lanelet
    ).placed(RAMP_LENGTH, 0.0, 0.0, 0.0)
    main = build_path(straight(MAIN_BEFORE + end + MAIN_AFTER), x=-MAIN_BEFORE, y=LANE_WIDTH)
    cuts = [MAIN_BEFORE, MAIN_BEFORE + ACCELERATION_LENGTH, MAIN_BEFORE + end]
    lane = (Lane(-HALF_LANE, HALF_LANE),)
    lanes = [row[0] for row in road.add_strip(main, lane, tuple(cuts))]
    approach = road.add_along(ramp, 0.0, RAMP_LENGTH)
    acceleration = road.add_along(ramp, RAMP_LENGTH, RAMP_LENGTH + ACCELERATION_LENGTH)
    taper = _add_taper(road, ramp, RAMP_LENGTH + ACCELERATION_LENGTH)
    road.connect(approach, acceleration, taper)
    road.put_beside(acceleration, lanes[1], right_forward=True, left_forward=True)
    road.put_beside(taper, lanes[2], right_forward=True, left_forward=True)
    return Ramp(road, main, ramp, lanes[3])


def _add_taper(road: RoadMap, path: Path, start: float) -> int:
    """Last lanelet of the acceleration lane, narrowing linearly from the station `start`."""
    s = path.vertex_stations(start, start + TAPER_LENGTH)
    narrowing = (LANE_WIDTH - TAPER_END_WIDTH) * (s - start) / TAPER_LENGTH
    return road.add(path.point(s, narrowing - HALF_LANE), path.point(s, HALF_LANE))


class TJunction(NamedTuple):
    """T-junction with routes (lane centres) and the lanelets that lead away west and east."""

    road: RoadMap
    south_to_west: Path
    south_to_east: Path
    west_to_east: Path
    east_to_west: Path
    goal: int
    east: int


def t_junction() -> TJunction:
    """Main road west-east, side road from the south, all six turns, no signs."""
    road = RoadMap()
    half = JUNCTION_HALF
    arms = {  # name: (towards the junction, away from it)
        "south": _add_arm(road, build_path(straight(SIDE_ROAD), y=-half, heading=-QUARTER)),
        "west": _add_arm(road, build_path(straight(MAIN_ARM), x=-half, heading=math.pi)),
        "east": _add_arm(road, build_path(straight(MAIN_ARM), x=half)),
    }
    south = {"x": HALF_LANE, "y": -half, "heading": QUARTER}
    west = {"x": -half, "y": -HALF_LANE, "heading": 0.0}
    east = {"x": half, "y": HALF_LANE, "heading": math.pi}
    right, left = arc(-QUARTER, RIGHT_TURN_RADIUS), arc(QUARTER, LEFT_TURN_RADIUS)
    across = straight(2 * half)
    turns = (
        ("south", "east", build_path(right, **south)),
        ("south", "west", build_path(left, **south)),
        ("west", "east", build_path(across, **west)),
        ("west", "south", build_path(right, **west)),
        ("east", "west", build_path(across, **east)),
        ("east", "south", build_path(left, **east)),
    )
    links = {}
    for origin, target, path in turns:
        links[origin, target] = road.add_along(path)
        road.connect(arms[origin][0], links[origin, target], arms[target][1])
    road.intersections.append(_intersection(arms, links))
    far = half + MAIN_ARM
    return TJunction(
        road,
        build_path(straight(SIDE_ROAD), left, straight(MAIN_ARM)).placed(SIDE_ROAD, **south),
        build_path(straight(SIDE_ROAD), right, straight(MAIN_ARM)).placed(SIDE_ROAD, **south),
        build_path(straight(2 * far), x=-far, y=-HALF_LANE),
        build_path(straight(2 * far), x=far, y=HALF_LANE, heading=math.pi),
        arms["west"][1],
        arms["east"][1],
    )


def _add_arm(road: RoadMap, outward: Path) -> tuple[int, int]:
    """Two-way road along `outward`; returns the lanelets (towards, away from) its start."""
    away, towards = road.add_strip(outward, TWO_WAY)[0]
    return towards, away


def _intersection(
    arms: dict[str, tuple[int, int]], links: dict[tuple[str, str], int]
) -> Intersection:
    """CommonRoad intersection element of the T-junction."""
    turns = {  # name: (right, straight, left)
        "south": ("east", None, "west"),
        "west": ("south", "east", None),
        "east": (None, "west", "south"),
    }
    left_of = {"south": "east", "west": "south"}  # the incoming on the right-hand side
    ids = {name: INCOMING_ID + i for i, name in enumerate(arms)}
    incomings = []
    for name, targets in turns.items():
        right, ahead, left = ({links[name, t]} if t else set() for t in targets)
        neighbour = ids.get(left_of.get(name))
        incomings.append(
            IntersectionIncomingElement(ids[name], {arms[name][0]}, right, ahead, left, neighbour)
        )
    return Intersection(INTERSECTION_ID, incomings)


class Roundabout(NamedTuple):
    """Roundabout whose arms are numbered counter-clockwise: 0 south, 1 east, 2 north, 3 west."""

    road: RoadMap
    exits: list[int]

    @staticmethod
    def route(entry: int, exit_arm: int) -> Path:
        """Lane centre from the far end of arm `entry` to the far end of arm `exit_arm`."""
        return _circle_route(entry, (exit_arm - entry) % 4)


def roundabout() -> Roundabout:
    """Circle of eight lanelets with an entry and an exit at each of the four arms."""
    road = RoadMap()
    entry_length = ARM_LENGTH + ENTRY_RADIUS * ENTRY_ANGLE
    short, long = 2 * ENTRY_ANGLE - QUARTER, 2 * (QUARTER - ENTRY_ANGLE)
    entries, exits, after_entry, after_exit, tails = [], [], [], [], []
    for arm in range(4):
        route = _circle_route(arm, 1)
        exit_start = entry_length + short * CIRCLE_RADIUS
        exit_end = exit_start + ENTRY_RADIUS * ENTRY_ANGLE
        first = road.add_along(route, 0.0, ARM_LENGTH)
        entries.append(road.add_along(route, ARM_LENGTH, entry_length))
        road.connect(first, entries[-1])
        after_entry.append(road.add_along(route, entry_length, exit_start))
        through = _circle_route(arm, 2)
        after_exit.append(road.add_along(through, exit_start, exit_start + long * CIRCLE_RADIUS))
        exits.append(road.add_along(route, exit_start, exit_end))
        tails.append(road.add_along(route, exit_end, route.length))
        road.connect(exits[-1], tails[-1])
    for arm in range(4):
        road.connect(entries[arm], after_entry[arm], after_exit[arm], after_entry[(arm + 1) % 4])
        road.connect(after_entry[arm], exits[arm])
    return Roundabout(road, [tails[(arm - 1) % 4] for arm in range(4)])


def _circle_route(entry: int, quarters: int) -> Path:
    """Lane centre entering from arm `entry` and leaving `quarters` arms later."""
    on_circle = quarters * QUARTER - 2 * (QUARTER - ENTRY_ANGLE)
    path = build_path(
        straight(ARM_LENGTH),
        arc(-ENTRY_ANGLE, ENTRY_RADIUS),
        arc(on_circle, CIRCLE_RADIUS),
        arc(-ENTRY_ANGLE, ENTRY_RADIUS),
        straight(ARM_LENGTH),
    )
    turn = entry * QUARTER
    corner = np.array([ARM_OFFSET, -(CIRCLE_RADIUS + ENTRY_RADIUS) * math.sin(ENTRY_ANGLE)])
    x = corner[0] * math.cos(turn) - corner[1] * math.sin(turn)
    y = corner[0] * math.sin(turn) + corner[1] * math.cos(turn)
    return path.placed(ARM_LENGTH, x, y, QUARTER + turn)
