"""Scenarios made by the tests: a straight road of two lanes, far from the origin."""

from pathlib import Path

import numpy as np
from commonroad.common.common_lanelet import LaneletType
from commonroad.common.file_writer import CommonRoadFileWriter, OverwriteExistingFile
from commonroad.common.util import AngleInterval, Interval
from commonroad.geometry.shape import Circle, Rectangle, Shape, ShapeGroup
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem, PlanningProblemSet
from commonroad.prediction.prediction import (
    Occupancy,
    SetBasedPrediction,
    TrajectoryPrediction,
)
from commonroad.scenario.intersection import Intersection, IntersectionIncomingElement
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad.scenario.obstacle import (
    DynamicObstacle,
    EnvironmentObstacle,
    ObstacleType,
    PhantomObstacle,
    StaticObstacle,
)
from commonroad.scenario.scenario import Location, Scenario, ScenarioID
from commonroad.scenario.state import CustomState, InitialState, KSState
from commonroad.scenario.traffic_sign import (
    TrafficSign,
    TrafficSignElement,
    TrafficSignIDZamunda,
)
from commonroad.scenario.trajectory import Trajectory

FAR = np.array([469840.25, 5544820.5])  # m, a UTM position as in published maps
LANE = 3.5  # m, width
LENGTH = 100.0  # m, of each lanelet
CAR = Rectangle(4.5, 1.8)


def at(x: float, y: float) -> np.ndarray:
    """A point of the road's frame [m] in the file's coordinates."""
    return FAR + np.array([x, y])


def lanelet(number: int, start: float, right: float, **links: object) -> Lanelet:
    """A straight lanelet from x = start with its right bound at y = right [m]."""
    x = np.linspace(start, start + LENGTH, 11)
    bounds = [np.column_stack([x, np.full_like(x, right + d)]) + FAR for d in (LANE, LANE / 2, 0)]
    return Lanelet(*bounds, number, lanelet_type={LaneletType.URBAN}, **links)


def network() -> LaneletNetwork:
    """Lanelets 1 -> 3 (right) and 2 -> 4 (left), a speed limit and an intersection."""
    lanelets = [
        lanelet(1, 0, 0, successor=[3], adjacent_left=2, adjacent_left_same_direction=True),
        lanelet(2, 0, LANE, successor=[4], adjacent_right=1, adjacent_right_same_direction=True),
        lanelet(3, LENGTH, 0, predecessor=[1], adjacent_left=4, adjacent_left_same_direction=True),
        lanelet(
            4, LENGTH, LANE, predecessor=[2], adjacent_right=3, adjacent_right_same_direction=True
        ),
    ]
    roads = LaneletNetwork.create_from_lanelet_list(lanelets)
    limit = TrafficSignElement(TrafficSignIDZamunda.MAX_SPEED, ["13.9"])
    roads.add_traffic_sign(TrafficSign(50, [limit], {1}, FAR), {1})
    incomings = [IntersectionIncomingElement(61, {1}, set(), {3}, set())]
    incomings.append(IntersectionIncomingElement(62, {2}, set(), {4}, set(), left_of=61))
    roads.add_intersection(Intersection(60, incomings))
    return roads


def state(x: float, y: float, v: float, step: int = 0, **more: float) -> InitialState:
    """An initial state at (x, y) [m], driving at v [m/s] along x."""
    values: dict[str, float] = {"acceleration": 0.0, "yaw_rate": 0.0, "slip_angle": 0.0, **more}
    return InitialState(time_step=step, position=at(x, y), orientation=0.0, velocity=v, **values)


def car(number: int, x: float, y: float, v: float, steps: int = 40) -> DynamicObstacle:
    """A recorded car driving at constant speed along x."""
    states = [
        KSState(k, at(x + v * 0.1 * k, y), velocity=v, orientation=0.0, steering_angle=0.0)
        for k in range(1, steps + 1)
    ]
    prediction = TrajectoryPrediction(Trajectory(1, states), CAR)
    return DynamicObstacle(number, ObstacleType.CAR, CAR, state(x, y, v), prediction)


def every_kind_of_obstacle() -> list[object]:
    """One obstacle of every role, and every kind of prediction."""
    group = ShapeGroup([Rectangle(2, 2, at(90, 1)), Circle(1.0, at(95, 1))])
    set_based = SetBasedPrediction(1, [Occupancy(1, group)])
    phantom = SetBasedPrediction(1, [Occupancy(1, Rectangle(3, 2, at(120, 5)))])
    return [
        car(30, 40, LANE / 2, 8),
        DynamicObstacle(31, ObstacleType.CAR, CAR, state(90, 1, 5), set_based),
        StaticObstacle(32, ObstacleType.PARKED_VEHICLE, CAR, state(70, 6, 0)),
        PhantomObstacle(33, phantom),
        EnvironmentObstacle(34, ObstacleType.BUILDING, Rectangle(9, 5, at(50, 20))),
    ]


def goal(position: Shape | None = None, end: int = 40, **more: object) -> CustomState:
    """A goal state with a time interval [30, end] and, if given, a position."""
    where = {} if position is None else {"position": position}
    return CustomState(time_step=Interval(min(30, end), end), **where, **more)


def problem(number: int, start: InitialState, *goals: CustomState) -> PlanningProblem:
    """A planning problem; its goal is to drive on for 30 steps if none is given."""
    return PlanningProblem(number, start, GoalRegion(list(goals) or [goal()]))


def rectangle_goal(x: float, y: float = LANE / 2) -> CustomState:
    """A goal rectangle of 10 m x 3 m with its centre at (x, y) [m]."""
    return goal(
        Rectangle(10, 3, at(x, y)),
        orientation=AngleInterval(-0.2, 0.2),
        velocity=Interval(0, 15),
    )


def lanelet_goal(number: int, start: InitialState) -> PlanningProblem:
    """A planning problem with lanelet 3 as its goal."""
    where = network().find_lanelet_by_id(3).polygon
    return PlanningProblem(number, start, GoalRegion([goal(ShapeGroup([where]))], {0: [3]}))


def write(
    folder: Path, *problems: PlanningProblem, obstacles: list | None = None, dt: float = 0.1
) -> Path:
    """Writes the straight road with problems (default: one) and obstacles (default: one car)."""
    scenario = Scenario(dt, ScenarioID.from_benchmark_id("ZAM_Straight-1_1_T-1", "2020a"))
    scenario.add_objects(network())
    for obstacle in [car(30, 40, LANE / 2, 8)] if obstacles is None else obstacles:
        scenario.add_objects(obstacle)
    chosen = list(problems) or [problem(100, state(10, LANE / 2, 10))]
    path = folder / "ZAM_Straight-1_1_T-1.xml"
    writer = CommonRoadFileWriter(
        scenario, PlanningProblemSet(chosen), "a", "b", "c", set(), Location(), 8
    )
    writer.write_to_file(str(path), OverwriteExistingFile.ALWAYS)
    return path
