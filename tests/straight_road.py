"""A two-lane road with a car parked in the left lane, and solutions that drive along it."""

from pathlib import Path

import numpy as np
from commonroad.common.file_writer import CommonRoadFileWriter, OverwriteExistingFile
from commonroad.common.solution import (
    CommonRoadSolutionWriter,
    CostFunction,
    PlanningProblemSolution,
    Solution,
    VehicleModel,
    VehicleType,
)
from commonroad.common.util import Interval
from commonroad.geometry.shape import Rectangle
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem, PlanningProblemSet
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad.scenario.obstacle import ObstacleType, StaticObstacle
from commonroad.scenario.scenario import Location, Scenario, ScenarioID, Tag
from commonroad.scenario.state import CustomState, InitialState, KSState
from commonroad.scenario.trajectory import Trajectory

SPEED = 10.0  # m/s
WIDTH = 4.0  # m, of a lane
STEPS = 20
PROBLEM, PARKED = 100, 50
ID = "ZAM_Straight-1_1_T-1"


def write_scenario(folder: Path, offset: tuple[float, float] = (0.0, 0.0)) -> Path:
    """The scenario file; the car starts in the middle of the right lane, heading along x."""
    scenario = Scenario(0.1, ScenarioID.from_benchmark_id(ID, "2020a"))
    scenario.add_objects(LaneletNetwork.create_from_lanelet_list(_lanes(np.array(offset))))
    parked = InitialState(
        position=np.array([20.0, WIDTH]) + offset, orientation=0.0, velocity=0.0, time_step=0
    )
    shape = Rectangle(4.5, 1.8)
    scenario.add_objects(StaticObstacle(PARKED, ObstacleType.PARKED_VEHICLE, shape, parked))
    path = folder / f"{ID}.xml"
    CommonRoadFileWriter(
        scenario, PlanningProblemSet([_problem(np.array(offset))]),
        "a", "b", "c", {Tag.SIMULATED}, Location(),
    ).write_to_file(str(path), OverwriteExistingFile.ALWAYS)  # fmt: skip
    return path


def _lanes(offset: np.ndarray) -> list[Lanelet]:
    x = np.arange(-50.0, 151.0, 5.0)

    def line(y: float) -> np.ndarray:
        return np.column_stack([x, np.full_like(x, y)]) + offset

    half = WIDTH / 2
    right = Lanelet(
        line(half), line(0.0), line(-half), 1, adjacent_left=2, adjacent_left_same_direction=True
    )
    left = Lanelet(
        line(3 * half), line(2 * half), line(half), 2,
        adjacent_right=1, adjacent_right_same_direction=True,
    )  # fmt: skip
    return [right, left]


def _problem(offset: np.ndarray) -> PlanningProblem:
    start = InitialState(
        position=offset, orientation=0.0, velocity=SPEED, time_step=0,
        acceleration=0.0, yaw_rate=0.0, slip_angle=0.0,
    )  # fmt: skip
    goal = CustomState(
        time_step=Interval(STEPS, STEPS + 5),
        position=Rectangle(10.0, WIDTH, offset + np.array([SPEED * STEPS * 0.1, 0.0])),
        velocity=Interval(5.0, 15.0),
    )
    return PlanningProblem(PROBLEM, start, GoalRegion([goal]))


def straight(
    steps: int = STEPS, v: float = SPEED, offset: tuple[float, float] = (0.0, 0.0)
) -> list[KSState]:
    """Centre states of the drive straight on at constant speed."""
    return [
        KSState(
            position=np.array([v * 0.1 * k, 0.0]) + offset, steering_angle=0.0, velocity=v,
            orientation=0.0, time_step=k,
        )
        for k in range(steps + 1)
    ]  # fmt: skip


def write_solution(folder: Path, states: list[KSState], problem: int = PROBLEM) -> Path:
    """The solution file of these states."""
    driven = PlanningProblemSolution(
        problem, VehicleModel.KS, VehicleType.FORD_ESCORT, CostFunction.TR1, Trajectory(0, states)
    )
    solution = Solution(ScenarioID.from_benchmark_id(ID, "2020a"), [driven])
    writer = CommonRoadSolutionWriter(solution)
    writer.write_to_file(str(folder), "solution.xml", overwrite=True)
    return folder / "solution.xml"
