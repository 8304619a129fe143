"""Scenarios on straight roads; stations in m, speeds in m/s, times in s, steps of 0.1 s.

The numbers in the cases describe the situation itself: `Motion(path, station, speed, phases,
shifts)`, `Phase(duration, acceleration)` and `Shift(start, duration, distance)`.
"""

from __future__ import annotations

from typing import NamedTuple

from commonroad.scenario.obstacle import ObstacleType
from commonroad.scenario.scenario import Tag

from .model import BICYCLE, Actor, Case, Goal, Range, Size, Task, Zone
from .motion import Motion, Phase, Shift
from .paths import Path, build_path, straight
from .roads import HALF_LANE, LANE_WIDTH, TWO_LANES, TWO_WAY, Lane, RoadMap

URBAN_LIMIT = 50 / 3.6  # [m/s]


class Street(NamedTuple):
    """Straight road: lane centres in driving direction and lanelet ids [section][lane]."""

    road: RoadMap
    middle: Path
    right: Path
    left: Path
    lanelets: list[list[int]]


def street(lanes: tuple[Lane, ...], length: float, *cuts: float) -> Street:
    """Straight road of `length`, its lanes cut into lanelets at the stations `cuts`."""
    middle = build_path(straight(length))
    road = RoadMap()
    lanelets = road.add_strip(middle, lanes, cuts)
    left = middle.offset(HALF_LANE)
    if not lanes[1].forward:
        left = left.reversed()
    return Street(road, middle, middle.offset(-HALF_LANE), left, lanelets)


def free_road() -> Case:
    """Nobody else is on the road."""
    s = street(TWO_LANES, 250.0, 125.0)
    s.road.limit_speed(URBAN_LIMIT, s.middle, 10.0)
    return Case(
        "FreeRoad",
        s.road,
        [Task(Motion(s.right, 30.0, 12.0), Goal(60, 60))],
        [],
        (Tag.URBAN, Tag.PARALLEL_LANES, Tag.SPEED_LIMIT),
        "Two empty straight lanes, speed limit 50 km/h, start at 12 m/s.",
        "time only: step 60",
        "Keep the lane and the speed.",
    )


def follow() -> Case:
    """A slower car drives ahead."""
    s = street(TWO_WAY, 280.0, 90.0)
    example = Motion(s.right, 30.0, 15.0, (Phase(4.0, -1.5),))
    zone = Zone(s.right, 120.0, 30.0)
    return Case(
        "Follow",
        s.road,
        [Task(example, Goal(70, 80, zone, velocity=Range(7.0, 11.0)))],
        [Actor(Motion(s.right, 70.0, 9.0)), Actor(Motion(s.left, 40.0, 10.0))],
        (Tag.URBAN, Tag.LANE_FOLLOWING, Tag.ONCOMING_TRAFFIC),
        "Start at 15 m/s, 40 m behind a car that drives 9 m/s; one oncoming car.",
        "rectangle in the lane, 7 to 11 m/s, steps 70 to 80",
        "Slow down smoothly to 9 m/s and follow at a safe distance.",
    )


def hard_brake() -> Case:
    """The leader brakes to a stop with 8 m/s^2."""
    s = street(TWO_WAY, 200.0)
    example = Motion(s.right, 30.0, 15.0, (Phase(0.3), Phase(3.0, -5.0)))
    leader = Motion(s.right, 50.0, 14.4, (Phase(0.5), Phase(1.8, -8.0)))
    return Case(
        "HardBrake",
        s.road,
        [Task(example, Goal(50, 60))],
        [Actor(leader), Actor(Motion(s.left, 60.0, 12.0))],
        (Tag.URBAN, Tag.CRITICAL, Tag.EMERGENCY_BRAKING, Tag.ONCOMING_TRAFFIC),
        "20 m behind a car that brakes from 14.4 m/s to a stop with 8 m/s^2; oncoming car.",
        "time only: steps 50 to 60",
        "Brake at once (about 4 to 5 m/s^2 suffice) and stop behind the leader.",
    )


def cut_in() -> Case:
    """A slower car moves into the own lane."""
    s = street(TWO_LANES, 260.0, 90.0)
    example = Motion(s.right, 30.0, 14.0, (Phase(0.5), Phase(2.0, -2.0)))
    cutter = Motion(s.left, 44.0, 11.0, shifts=(Shift(1.0, 3.0, -LANE_WIDTH),))
    return Case(
        "CutIn",
        s.road,
        [Task(example, Goal(60, 80, Zone(s.right, 107.5, 35.0)))],
        [Actor(cutter), Actor(Motion(s.left, 15.0, 14.0))],
        (Tag.URBAN, Tag.CUT_IN, Tag.PARALLEL_LANES),
        "A car with 11 m/s, 14 m ahead on the left lane, cuts in from 1 s to 4 s.",
        "rectangle in the own lane, steps 60 to 80",
        "Brake early from 14 m/s to below 11 m/s and let the car in.",
    )


def stop_in_goal() -> Case:
    """Stop in a goal rectangle behind a stopping car."""
    s = street(TWO_WAY, 200.0)
    example = Motion(s.right, 25.0, 10.0, (Phase(1.5), Phase(7.0, -10.0 / 7.0)))
    leader = Motion(s.right, 50.0, 8.0, (Phase(2.0), Phase(5.4, -1.5)))
    goal = Goal(60, 100, Zone(s.right, 75.0, 8.0), velocity=Range(0.0, 0.3))
    return Case(
        "StopInGoal",
        s.road,
        [Task(example, goal)],
        [Actor(leader), Actor(Motion(s.left, 30.0, 9.0))],
        (Tag.URBAN, Tag.COMFORT, Tag.LANE_FOLLOWING, Tag.ONCOMING_TRAFFIC),
        "The car ahead stops 12 m beyond the goal rectangle; one oncoming car.",
        "rectangle of 8 m, 0 to 0.3 m/s, steps 60 to 100",
        "Come to a gentle stop inside the rectangle, not before and not beyond.",
    )


def time_only() -> Case:
    """The goal is exactly one step, two slow cars are ahead."""
    s = street(TWO_WAY, 200.0)
    example = Motion(s.right, 30.0, 12.0, (Phase(2.0, -3.0),))
    slow = [Actor(Motion(s.right, station, 6.0)) for station in (50.0, 62.0)]
    return Case(
        "TimeOnly",
        s.road,
        [Task(example, Goal(33, 33))],
        slow,
        (Tag.URBAN, Tag.LANE_FOLLOWING),
        "Two cars with 6 m/s ahead, the first one 20 m away; start at 12 m/s.",
        "time only: exactly step 33",
        "Brake behind the slow cars and end the plan exactly at step 33.",
    )


def lane_change() -> Case:
    """The goal lanelet is on the left, where a car drives alongside."""
    s = street(TWO_LANES, 260.0, 70.0)
    phases = (Phase(2.0, -1.5), Phase(2.0), Phase(2.0, 1.0))
    example = Motion(s.right, 30.0, 12.0, phases, (Shift(2.5, 3.5, LANE_WIDTH),))
    return Case(
        "LaneChange",
        s.road,
        [Task(example, Goal(60, 70, lanelets=(s.lanelets[1][1],)))],
        [Actor(Motion(s.left, 35.0, 12.0))],
        (Tag.URBAN, Tag.LANE_CHANGE, Tag.PARALLEL_LANES),
        "A car with the same speed of 12 m/s drives alongside on the left lane.",
        "second lanelet of the left lane, steps 60 to 70",
        "Fall behind the car (or pass it) and change to the left lane in time.",
    )


def parked_car() -> Case:
    """A parked car covers the right half of the own lane."""
    s = street(TWO_LANES, 260.0)
    shifts = (Shift(1.0, 2.5, 2.0), Shift(5.5, 2.5, -2.0))
    parked = Motion(s.right, 75.0, 0.0, d=-0.8)
    return Case(
        "ParkedCar",
        s.road,
        [
            Task(
                Motion(s.right, 30.0, 10.0, shifts=shifts),
                Goal(80, 110, Zone(s.right, 125.0, 40.0)),
            )
        ],
        [
            Actor(parked, kind=ObstacleType.PARKED_VEHICLE, static=True),
            Actor(Motion(s.left, 35.0, 14.0)),
            Actor(Motion(s.left, 5.0, 10.0)),
        ],
        (Tag.URBAN, Tag.EVASIVE, Tag.PARALLEL_LANES),
        "A parked car blocks the right half of the lane; one car passes on the left, one follows.",
        "rectangle in the own lane 30 to 70 m beyond the parked car, steps 80 to 110",
        "Let the passing car go, drive around the parked car, return to the lane.",
    )


def bicycle() -> Case:
    """A slow bicycle has to be overtaken."""
    s = street(TWO_LANES, 270.0)
    shifts = (Shift(1.2, 3.0, 3.0), Shift(6.5, 3.0, -3.0))
    example = Motion(s.right, 30.0, 11.0, shifts=shifts)
    rider = Motion(s.right, 60.0, 4.0, d=-0.85)
    return Case(
        "Bicycle",
        s.road,
        [Task(example, Goal(80, 120, Zone(s.right, 135.0, 40.0)))],
        [Actor(rider, BICYCLE, ObstacleType.BICYCLE), Actor(Motion(s.left, 30.0, 14.5))],
        (Tag.URBAN, Tag.EVASIVE, Tag.PARALLEL_LANES),
        "A bicycle with 4 m/s on the right side of the lane; a car passes on the left lane.",
        "rectangle in the own lane ahead of the bicycle, steps 80 to 120",
        "Overtake the bicycle with a wide side gap and return to the right lane.",
    )


def standing_start() -> Case:
    """Standing in a queue that begins to move."""
    s = street(TWO_WAY, 220.0)
    example = Motion(s.right, 30.0, 0.0, (Phase(3.5), Phase(4.0, 1.5)))
    queue = [
        Actor(Motion(s.right, station, 0.0, (Phase(delay), Phase(5.0, 1.6))))
        for station, delay in ((37.5, 2.5), (45.0, 1.5), (52.5, 0.5))
    ]
    goal = Goal(90, 120, Zone(s.right, 75.0, 40.0), velocity=Range(3.0, 9.0))
    return Case(
        "StandingStart",
        s.road,
        [Task(example, goal)],
        queue,
        (Tag.URBAN, Tag.TRAFFIC_JAM, Tag.LANE_FOLLOWING),
        "Start at 0 m/s behind three cars that set off one after the other.",
        "rectangle in the lane, 3 to 9 m/s, steps 90 to 120",
        "Wait until the car ahead moves, then follow it without a jerk.",
    )


def static_block() -> Case:
    """An obstacle covers the whole road."""
    s = street(TWO_LANES, 200.0)
    example = Motion(s.right, 25.0, 12.0, (Phase(1.0), Phase(4.0, -3.0)))
    block = Actor(
        Motion(s.middle, 90.0, 0.0),
        Size(2.0, 2 * LANE_WIDTH),
        ObstacleType.CONSTRUCTION_ZONE,
        static=True,
    )
    other = Motion(s.left, 40.0, 10.0, (Phase(1.0), Phase(5.0, -2.0)))
    return Case(
        "StaticBlock",
        s.road,
        [Task(example, Goal(80, 80))],
        [block, Actor(other)],
        (Tag.URBAN, Tag.CRITICAL, Tag.PARALLEL_LANES),
        "A construction zone closes both lanes 65 m ahead; a car on the left lane stops, too.",
        "time only: step 80",
        "Stop before the construction zone and stay there.",
    )


def parallel_egos() -> Case:
    """Two planning problems on neighbouring lanes."""
    s = street(TWO_LANES, 280.0, 90.0)
    tasks = [
        Task(Motion(s.right, 30.0, 12.0), Goal(60, 75, Zone(s.right, 112.5, 35.0))),
        Task(Motion(s.left, 24.0, 14.0), Goal(60, 75, Zone(s.left, 122.5, 35.0))),
    ]
    return Case(
        "ParallelEgos",
        s.road,
        tasks,
        [Actor(Motion(s.right, 60.0, 11.0)), Actor(Motion(s.left, 75.0, 13.0))],
        (Tag.URBAN, Tag.LANE_FOLLOWING, Tag.PARALLEL_LANES),
        "Two planning problems on neighbouring lanes, each behind a slightly slower car.",
        "one rectangle per problem in its own lane, steps 60 to 75",
        "Solve both problems; each one keeps its lane and follows its leader.",
    )


def straight_cases() -> list[Case]:
    """All scenarios of this module."""
    return [
        free_road(),
        follow(),
        hard_brake(),
        cut_in(),
        stop_in_goal(),
        time_only(),
        lane_change(),
        parked_car(),
        bicycle(),
        standing_start(),
        static_block(),
        parallel_egos(),
    ]
