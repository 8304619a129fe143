"""Scenarios with curves and junctions; stations in m, speeds in m/s, times in s."""

from __future__ import annotations

import math
from typing import NamedTuple

from commonroad.scenario.obstacle import ObstacleType
from commonroad.scenario.scenario import Tag

from .frame import MAP_TURN
from .junctions import Roundabout, on_ramp, roundabout, t_junction
from .model import TRUCK, Actor, Case, Goal, Range, Task, Zone
from .motion import Motion, Phase, Shift
from .paths import Path, Segment, build_path, straight
from .roads import HALF_LANE, LANE_WIDTH, TWO_WAY, RoadMap

URBAN_LIMIT = 50 / 3.6  # [m/s]
SLOW_LIMIT = 40 / 3.6  # [m/s]


class Bend(NamedTuple):
    """Curved two-way road with its two lane centres in driving direction."""

    road: RoadMap
    middle: Path
    right: Path
    oncoming: Path


def bend(*segments: Segment, cuts: tuple[float, ...] = ()) -> Bend:
    """Two-way road along the given segments, cut into lanelets at the stations `cuts`."""
    middle = build_path(*segments)
    road = RoadMap()
    road.add_strip(middle, TWO_WAY, cuts)
    right, left = middle.offset(-HALF_LANE), middle.offset(HALF_LANE)
    return Bend(road, middle, right, left.reversed())


def blend(start: float, end: float, length: float) -> Segment:
    """Clothoid between two curvatures [1/m]."""
    return Segment(length, start, end)


def turn(angle: float, curvature: float, transition: float) -> tuple[Segment, ...]:
    """Curve through `angle` [rad] > 0 with clothoids of the length `transition` at both ends."""
    inner = angle / abs(curvature) - transition
    return (
        blend(0.0, curvature, transition),
        blend(curvature, curvature, inner),
        blend(curvature, 0.0, transition),
    )


def tight_curve() -> Case:
    """Right curve that is too tight for the initial speed."""
    radius = 15.0 + HALF_LANE  # of the road centre; the own lane has 15 m
    right_angle = turn(math.pi / 2, -1.0 / radius, 6.0)
    b = bend(straight(60.0), *right_angle, straight(100.0), cuts=(60.0,))
    example = Motion(b.right, 20.0, 14.0, (Phase(3.6, -1.65),))
    return Case(
        "TightCurve",
        b.road,
        [Task(example, Goal(85, 120, Zone(b.right, 115.0, 20.0)))],
        [Actor(Motion(b.oncoming, 40.0, 7.0))],
        (Tag.URBAN, Tag.LANE_FOLLOWING, Tag.ONCOMING_TRAFFIC, Tag.TURN_RIGHT),
        "Start at 14 m/s, 40 m before a right-angle curve with a radius of 15 m.",
        "rectangle 15 to 35 m beyond the curve, steps 85 to 120",
        "Brake to about 8 m/s before the curve, stay in the lane, accelerate afterwards.",
    )


def goal_intervals() -> Case:
    """Velocity and orientation have to match in the goal rectangle."""
    angle = math.radians(50.0)
    b = bend(straight(50.0), *turn(angle, 1.0 / 60.0, 15.0), straight(130.0), cuts=(50.0,))
    b.road.limit_speed(SLOW_LIMIT, b.middle, 10.0)
    example = Motion(b.right, 25.0, 11.0, (Phase(8.0, -0.5),))
    tolerance = 0.1
    goal = Goal(
        95,
        110,
        Zone(b.right, 120.0, 16.0),
        velocity=Range(6.0, 8.0),
        orientation=Range(angle - tolerance, angle + tolerance),
    )
    return Case(
        "GoalIntervals",
        b.road,
        [Task(example, goal)],
        [Actor(Motion(b.right, 60.0, 11.0)), Actor(Motion(b.oncoming, 60.0, 9.0))],
        (Tag.URBAN, Tag.LANE_FOLLOWING, Tag.ONCOMING_TRAFFIC, Tag.SPEED_LIMIT),
        "Gentle left curve with a speed limit of 40 km/h; the car ahead drives away.",
        f"rectangle, 6 to 8 m/s, orientation {angle + MAP_TURN:.3f} +- {tolerance} rad, "
        "steps 95 to 110",
        "Slow down from 11 to 7 m/s so that place, speed, heading and time fit together.",
    )


def s_bend() -> Case:
    """Left-right combination with a radius of 40 m."""
    k = 1.0 / 40.0
    curves = (blend(0, k, 12.0), blend(k, k, 18.0), blend(k, -k, 24.0))
    curves += (blend(-k, -k, 18.0), blend(-k, 0, 12.0))
    b = bend(straight(50.0), *curves, straight(110.0), cuts=(50.0, 134.0))
    return Case(
        "SBend",
        b.road,
        [Task(Motion(b.right, 20.0, 11.5), Goal(90, 120, Zone(b.right, 152.5, 25.0)))],
        [Actor(Motion(b.oncoming, 60.0, 10.0))],
        (Tag.URBAN, Tag.LANE_FOLLOWING, Tag.ONCOMING_TRAFFIC),
        "S-shaped two-way road with radii of 40 m; one oncoming car.",
        "rectangle beyond the bend, steps 90 to 120",
        "Follow the lane smoothly, lateral acceleration stays below 4 m/s^2.",
    )


def oncoming() -> Case:
    """Three bends in a row with an oncoming truck close to the centre line."""
    k = 1.0 / 35.0
    curves = (blend(0, k, 12.0), blend(k, k, 8.0), blend(k, -k, 24.0), blend(-k, -k, 8.0))
    curves += (blend(-k, k, 24.0), blend(k, k, 8.0), blend(k, 0, 12.0))
    b = bend(straight(40.0), *curves, straight(110.0), cuts=(40.0, 136.0))
    b.road.limit_speed(URBAN_LIMIT, b.middle, 10.0)
    truck = Motion(b.oncoming, 90.0, 9.0, d=0.2)
    return Case(
        "Oncoming",
        b.road,
        [Task(Motion(b.right, 20.0, 11.0), Goal(100, 140, Zone(b.right, 157.5, 25.0)))],
        [Actor(truck, TRUCK, ObstacleType.TRUCK), Actor(Motion(b.oncoming, 60.0, 9.0))],
        (Tag.RURAL, Tag.LANE_FOLLOWING, Tag.ONCOMING_TRAFFIC, Tag.SPEED_LIMIT),
        "Winding two-way road (radii of 35 m); a truck near the centre line and a car come across.",
        "rectangle beyond the bends, steps 100 to 140",
        "Stay in the own lane, do not cut the bends.",
    )


def merge() -> Case:
    """On-ramp whose lane ends; cars on the main lane."""
    layout = on_ramp()
    example = Motion(layout.ramp, 20.0, 17.0, (Phase(4.0, 0.5),), (Shift(4.5, 3.5, LANE_WIDTH),))
    cars = [Actor(Motion(layout.main, station, 19.0)) for station in (130.0, 94.0, 47.0)]
    return Case(
        "Merge",
        layout.road,
        [Task(example, Goal(95, 120, lanelets=(layout.goal,)))],
        cars,
        (Tag.HIGHWAY, Tag.MERGING_LANES, Tag.SLIP_ROAD),
        "On-ramp with an acceleration lane of 90 m plus taper; three cars with 19 m/s.",
        "main lanelet beyond the end of the ramp, steps 95 to 120",
        "Adapt the speed to the gap between the second and the third car and merge in time.",
    )


def junction_turn() -> Case:
    """Left turn from the side road across the main road."""
    layout = t_junction()
    phases = (Phase(2.5, -1.6), Phase(5.0), Phase(2.0, 1.0))
    return Case(
        "TJunction",
        layout.road,
        [
            Task(
                Motion(layout.south_to_west, 25.0, 8.0, phases),
                Goal(100, 150, lanelets=(layout.goal,)),
            )
        ],
        [
            Actor(Motion(layout.west_to_east, 105.0, 9.0)),
            Actor(Motion(layout.east_to_west, 100.0, 9.0)),
            Actor(Motion(layout.east_to_west, 25.0, 8.0)),
        ],
        (Tag.URBAN, Tag.INTERSECTION, Tag.TURN_LEFT),
        "Left turn from the side road; one car comes from the left, two from the right.",
        "lanelet of the western arm, steps 100 to 150",
        "Let the first two cars pass, turn into the large gap before the third one.",
    )


def roundabout_entry() -> Case:
    """Enter a roundabout behind a circulating car and leave at the second exit."""
    layout: Roundabout = roundabout()
    south, east, north, west = range(4)
    example = Motion(layout.route(south, north), 65.0, 8.0, (Phase(2.0, -1.0),))
    return Case(
        "Roundabout",
        layout.road,
        [Task(example, Goal(130, 180, lanelets=(layout.exits[north],)))],
        [
            Actor(Motion(layout.route(west, east), 107.6, 6.0)),
            Actor(Motion(layout.route(north, south), 65.0, 6.0)),
        ],
        (Tag.URBAN, Tag.ROUNDABOUT, Tag.INTERSECTION),
        "Single-lane roundabout; a car from the left crosses the own entry at about 5 s.",
        "lanelet of the northern exit, steps 130 to 180",
        "Slow down, enter behind the circulating car, leave at the second exit.",
    )


def curved_cases() -> list[Case]:
    """All scenarios of this module."""
    return [
        tight_curve(),
        goal_intervals(),
        s_bend(),
        oncoming(),
        merge(),
        junction_turn(),
        roundabout_entry(),
    ]
