"""Interactive scenarios: SUMO drives the others, who start as described here.

Stations in m, speeds in m/s, times in s. `Actor` motions are recorded for a few seconds only; they
tell where everybody starts and which way he turns.
"""

from __future__ import annotations

from commonroad.scenario.obstacle import ObstacleType
from commonroad.scenario.scenario import Tag

from .crossing import EAST, NORTH, SOUTH, WEST, crossing
from .frame import MAP_TURN
from .junctions import on_ramp, roundabout, t_junction
from .model import BICYCLE, TRUCK, Actor, Case, Goal, Range, Size, Task, Zone
from .motion import Motion, Phase, Shift
from .paths import Path
from .roads import LANE_WIDTH, TWO_LANES, TWO_WAY
from .straight_cases import URBAN_LIMIT, street

LORRY = Size(10.0, 2.5)
MOTORCYCLE = Size(2.2, 0.8)


def cars(path: Path, speed: float, *stations: float) -> list[Actor]:
    """Cars in a row."""
    return [Actor(Motion(path, station, speed)) for station in stations]


def truck(path: Path, speed: float, station: float) -> Actor:
    """A truck."""
    return Actor(Motion(path, station, speed), TRUCK, ObstacleType.TRUCK)


def bicycle(path: Path, speed: float, station: float, d: float = 0.0) -> Actor:
    """A bicycle, `d` to the left of the lane's middle."""
    return Actor(Motion(path, station, speed, d=d), BICYCLE, ObstacleType.BICYCLE)


def slow_traffic() -> Case:
    """The leader has to brake for a truck behind a bicycle."""
    s = street(TWO_WAY, 300.0, 110.0)
    s.road.limit_speed(URBAN_LIMIT, s.middle, 10.0)
    example = Motion(s.right, 40.0, 13.0, (Phase(0.5), Phase(3.0, -3.0)))
    return Case(
        "SlowTraffic",
        s.road,
        [Task(example, Goal(33, 33))],
        [
            *cars(s.right, 13.0, 66.0),
            truck(s.right, 4.5, 100.0),
            bicycle(s.right, 4.5, 112.0),
            *cars(s.left, 12.0, 60.0, 120.0),
        ],
        (Tag.URBAN, Tag.LANE_FOLLOWING, Tag.ONCOMING_TRAFFIC, Tag.SPEED_LIMIT),
        "26 m behind a car with the same speed of 13 m/s, which has to brake for a truck that "
        "cannot pass a bicycle; two oncoming cars.",
        "time only: exactly step 33",
        "Brake with the car ahead, gently and in time.",
        record_steps=20,
    )


def dense_merge() -> Case:
    """On-ramp into a row of cars and a truck."""
    layout = on_ramp()
    phases = (Phase(3.0, 0.3),)
    example = Motion(layout.ramp, 30.0, 17.0, phases, (Shift(4.0, 3.5, LANE_WIDTH),))
    return Case(
        "DenseMerge",
        layout.road,
        [Task(example, Goal(119, 120, lanelets=(layout.goal,)))],
        [
            *cars(layout.main, 18.0, 172.0, 144.0, 116.0),
            truck(layout.main, 18.0, 80.0),
            *cars(layout.main, 18.0, 52.0, 26.0),
        ],
        (Tag.HIGHWAY, Tag.MERGING_LANES, Tag.SLIP_ROAD),
        "On-ramp with an acceleration lane of 90 m plus taper; on the main lane five cars and a "
        "truck with 18 m/s, about 1.3 s apart.",
        "main lanelet beyond the end of the ramp, steps 119 to 120",
        "Choose a gap, match its speed and merge; those behind make room.",
        record_steps=20,
    )


def left_turn() -> Case:
    """Left turn at a crossing, with crossing and oncoming traffic."""
    layout = crossing()
    example = Motion(layout.route(SOUTH, WEST), 55.0, 9.0, (Phase(2.5, -1.6), Phase(4.0, 0.3)))
    return Case(
        "LeftTurn",
        layout.road,
        [Task(example, Goal(149, 150, lanelets=(layout.exits[WEST],)))],
        [
            *cars(layout.route(NORTH, SOUTH), 9.0, 62.0, 44.0),
            *cars(layout.route(EAST, WEST), 9.0, 62.0),
            *cars(layout.route(EAST, NORTH), 9.0, 40.0),
            *cars(layout.route(WEST, EAST), 9.0, 76.0, 56.0),
        ],
        (Tag.URBAN, Tag.INTERSECTION, Tag.TURN_LEFT, Tag.ONCOMING_TRAFFIC),
        "Left turn at a crossing without lights, from the road that has to give way; two cars "
        "from the left, two from the right, two oncoming ones that wait opposite.",
        "lanelet of the western arm, steps 149 to 150",
        "Slow down, let the crossing and the oncoming cars pass, turn without blocking anybody.",
        record_steps=80,
    )


def dense_lane_change() -> Case:
    """The goal lanelet lies beyond a dense row of cars."""
    s = street(TWO_LANES, 420.0, 110.0)
    s.road.limit_speed(URBAN_LIMIT, s.middle, 10.0)
    example = Motion(s.right, 30.0, 11.0, shifts=(Shift(3.0, 4.0, LANE_WIDTH),))
    return Case(
        "DenseLaneChange",
        s.road,
        [Task(example, Goal(99, 100, lanelets=(s.lanelets[1][1],), velocity=Range(6.0, 14.0)))],
        [
            *cars(s.left, 11.0, 5.0, 22.0, 40.0, 57.0, 76.0),
            truck(s.right, 9.0, 70.0),
            *cars(s.right, 11.0, 8.0),
        ],
        (Tag.URBAN, Tag.LANE_CHANGE, Tag.PARALLEL_LANES, Tag.SPEED_LIMIT),
        "Five cars with 11 m/s on the left lane, 13 m apart; a truck ahead on the own lane.",
        "second lanelet of the left lane, 6 to 14 m/s, steps 99 to 100",
        "Find a gap, open it by a steady approach, and change before the time is over.",
        record_steps=20,
    )


def bicycles() -> Case:
    """Bicycles on the own lane, which others overtake, too."""
    s = street(TWO_LANES, 440.0, 180.0)
    s.road.limit_speed(URBAN_LIMIT, s.middle, 10.0)
    shifts = (Shift(1.5, 3.5, LANE_WIDTH), Shift(10.0, 3.5, -LANE_WIDTH))
    example = Motion(s.right, 30.0, 12.0, shifts=shifts)
    return Case(
        "Bicycles",
        s.road,
        [Task(example, Goal(149, 150, lanelets=(s.lanelets[1][0],)))],
        [
            bicycle(s.right, 4.5, 68.0, d=-0.6),
            bicycle(s.right, 5.0, 108.0, d=-0.6),
            *cars(s.left, 12.5, 4.0, 50.0),
        ],
        (Tag.URBAN, Tag.LANE_CHANGE, Tag.PARALLEL_LANES, Tag.SPEED_LIMIT),
        "Two bicycles with 4.5 and 5 m/s ahead on the right lane; two cars pass on the left lane.",
        "second lanelet of the right lane, steps 149 to 150",
        "Change to the left lane in time, pass the bicycles with a wide gap, return.",
        record_steps=20,
    )


def busy_roundabout() -> Case:
    """Roundabout with traffic from every arm."""
    layout = roundabout()
    south, east, north, west = range(4)
    example = Motion(layout.route(south, north), 72.0, 8.0, (Phase(2.0, -1.0),))
    return Case(
        "BusyRoundabout",
        layout.road,
        [Task(example, Goal(164, 165, lanelets=(layout.exits[north],)))],
        [
            *cars(layout.route(west, east), 7.0, 104.0, 76.0),
            *cars(layout.route(north, south), 7.0, 70.0),
            *cars(layout.route(east, west), 7.0, 60.0),
            *cars(layout.route(south, east), 8.0, 50.0),
        ],
        (Tag.URBAN, Tag.ROUNDABOUT, Tag.INTERSECTION),
        "Single-lane roundabout; two cars from the west cross the own entry, further ones come "
        "from the north and the east, one follows.",
        "lanelet of the northern exit, steps 164 to 165",
        "Let the circulating cars pass, enter, leave at the second exit.",
        record_steps=100,
    )


def side_street() -> Case:
    """Right turn from a side street into a main road on which more and more appear."""
    layout = t_junction()
    phases = (Phase(2.0, -1.5), Phase(2.0), Phase(3.0, 1.0))
    example = Motion(layout.south_to_east, 22.0, 7.0, phases)
    return Case(
        "SideStreet",
        layout.road,
        [Task(example, Goal(119, 120, lanelets=(layout.east,)))],
        [
            *cars(layout.west_to_east, 10.0, 116.0),
            Actor(Motion(layout.west_to_east, 80.0, 10.0), LORRY, ObstacleType.TRUCK),
            *cars(layout.east_to_west, 10.0, 90.0),
            *cars(layout.south_to_east, 6.0, 10.0),
            Actor(Motion(layout.west_to_east, 35.0, 10.0), first_step=10),
            Actor(Motion(layout.west_to_east, -15.0, 10.0), first_step=30),
            Actor(Motion(layout.east_to_west, 60.0, 10.0), MOTORCYCLE, ObstacleType.MOTORCYCLE),
        ],
        (Tag.URBAN, Tag.INTERSECTION, Tag.TURN_RIGHT),
        "Right turn from a side street; a car and a truck come from the left, two more appear "
        "there after 1 s and 3 s, one car follows.",
        "lanelet of the eastern arm, steps 119 to 120",
        "Wait for the truck, turn into a gap and speed up before the next one comes close.",
        record_steps=60,
    )


def roadworks() -> Case:
    """The own lane is closed, the other one is busy."""
    s = street(TWO_LANES, 360.0)
    s.road.limit_speed(URBAN_LIMIT, s.middle, 10.0)
    phases = (Phase(3.0, -1.5), Phase(4.0), Phase(3.0, 1.0))
    example = Motion(s.right, 30.0, 11.0, phases, (Shift(3.5, 3.0, LANE_WIDTH),))
    site = Motion(s.right, 125.0, 0.0)
    goal = Goal(
        120,
        130,
        Zone(s.left, 150.0, 40.0),
        velocity=Range(3.0, 14.0),
        orientation=Range(-0.15, 0.15),
    )
    return Case(
        "Roadworks",
        s.road,
        [Task(example, goal)],
        [
            Actor(site, Size(12.0, 2.6), ObstacleType.CONSTRUCTION_ZONE, static=True),
            *cars(s.left, 11.0, 10.0, 34.0, 64.0),
            *cars(s.right, 11.0, 52.0),
        ],
        (Tag.URBAN, Tag.EVASIVE, Tag.PARALLEL_LANES, Tag.SPEED_LIMIT),
        "Roadworks close the own lane after 90 m; three cars on the left lane, one ahead that "
        "has to change lanes, too.",
        f"rectangle beside and beyond the roadworks, 3 to 14 m/s, orientation {MAP_TURN} +- 0.15 "
        "rad, steps 120 to 130",
        "Change lanes one after the other with those beside.",
        record_steps=20,
    )


def interactive_cases() -> list[Case]:
    """All scenarios of this module."""
    return [
        slow_traffic(),
        dense_merge(),
        left_turn(),
        dense_lane_change(),
        bicycles(),
        busy_roundabout(),
        side_street(),
        roadworks(),
    ]
