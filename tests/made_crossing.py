"""An interactive folder made by the tests: a road that goes on through a junction, and another one
that crosses it where SUMO knows of no junction.

      y
      |        2
      |        ^
   ---|--- 1 --+--------> J ---- 3 ---->   x
               |
"""

import math
from pathlib import Path

import made
import numpy as np
from commonroad.common.file_writer import CommonRoadFileWriter, OverwriteExistingFile
from commonroad.geometry.shape import Rectangle, Shape
from commonroad.planning.planning_problem import PlanningProblem, PlanningProblemSet
from commonroad.prediction.prediction import TrajectoryPrediction
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType, StaticObstacle
from commonroad.scenario.scenario import Location, Scenario, ScenarioID
from commonroad.scenario.state import InitialState, KSState
from commonroad.scenario.trajectory import Trajectory

NAME = "ZAM_Crossing-1_1_I-1"
LANE = 3.5  # m, width
LIMIT = 13.9  # m/s
BEGIN, MEET, END = -100.0, 100.0, 200.0  # m: of lane 1, where lane 3 follows it, of lane 3
JUNCTION = 4.0  # m, length of the junction between them
CAR = Rectangle(4.5, 1.8)
EAST, NORTH = 0.0, math.pi / 2


def _lanelet(number: int, begin: tuple, end: tuple, **links: object) -> Lanelet:
    points = np.linspace(begin, end, 11)
    along = (points[-1] - points[0]) / np.hypot(*(points[-1] - points[0]))
    left = LANE / 2 * np.array([-along[1], along[0]])
    return Lanelet(points + left, points, points - left, number, **links)


def network() -> LaneletNetwork:
    """Lanelets 1 -> 3 along x, and 2 along y, across lanelet 1 at the origin."""
    return LaneletNetwork.create_from_lanelet_list(
        [
            _lanelet(1, (BEGIN, 0), (MEET, 0), successor=[3]),
            _lanelet(2, (0, BEGIN), (0, MEET)),
            _lanelet(3, (MEET, 0), (END, 0), predecessor=[1]),
        ]
    )


def net(offset: tuple[float, float] = (0.0, 0.0), length_factor: float = 1.0) -> str:
    """The same as a SUMO net, shifted by its offset [m], lanes said to be longer by a factor."""
    dx, dy = offset

    def lane(name: str, *points: tuple[float, float]) -> str:
        shape = " ".join(f"{x + dx:.2f},{y + dy:.2f}" for x, y in points)
        length = length_factor * math.dist(points[0], points[-1])
        return (
            f'<lane id="{name}_0" index="0" speed="{LIMIT}" length="{length:.2f}" '
            f'width="{LANE}" shape="{shape}"/>'
        )

    def end(name: str, x: float, y: float, incoming: str = "") -> str:
        place = f'x="{x + dx}" y="{y + dy}"'
        return f'<junction id="{name}" type="dead_end" {place} incLanes="{incoming}" intLanes=""/>'

    stop, go = MEET - JUNCTION / 2, MEET + JUNCTION / 2
    return (
        f'<net version="1.9"><location netOffset="{dx:.2f},{dy:.2f}" '
        'convBoundary="0,0,0,0" origBoundary="0,0,0,0" projParameter="!"/>'
        f'<edge id=":J_0" function="internal">{lane(":J_0", (stop, 0), (go, 0))}</edge>'
        f'<edge id="1" from="A" to="J" priority="1">{lane("1", (BEGIN, 0), (stop, 0))}</edge>'
        f'<edge id="2" from="C" to="D" priority="1">{lane("2", (0, BEGIN), (0, MEET))}</edge>'
        f'<edge id="3" from="J" to="B" priority="1">{lane("3", (go, 0), (END, 0))}</edge>'
        f"{end('A', BEGIN, 0)}{end('B', END, 0, '3_0')}{end('C', 0, BEGIN)}"
        f"{end('D', 0, MEET, '2_0')}"
        f'<junction id="J" type="priority" x="{MEET + dx}" y="{dy}" incLanes="1_0" '
        'intLanes=":J_0_0"><request index="0" response="0" foes="0" cont="0"/></junction>'
        '<connection from="1" to="3" fromLane="0" toLane="0" via=":J_0_0" dir="s" state="M"/>'
        '<connection from=":J_0" to="3" fromLane="0" toLane="0" dir="s" state="M"/></net>'
    )


def state(x: float, y: float, psi: float, v: float, step: int = 0) -> InitialState:
    """A state at (x, y) [m], heading psi [rad], at v [m/s]."""
    return InitialState(
        step, np.array([x, y]), psi, velocity=v, acceleration=0.0, yaw_rate=0.0, slip_angle=0.0
    )


def moving(
    number: int,
    start: InitialState,
    steps: int = 1,
    kind: ObstacleType = ObstacleType.CAR,
    shape: Shape = CAR,
) -> DynamicObstacle:
    """An obstacle that is recorded for some steps at constant speed."""
    way = start.velocity * 0.1 * np.array([np.cos(start.orientation), np.sin(start.orientation)])
    states = [
        KSState(
            start.time_step + k, start.position + k * way, velocity=start.velocity,
            orientation=start.orientation, steering_angle=0.0,
        )
        for k in range(1, steps + 1)
    ]  # fmt: skip
    prediction = TrajectoryPrediction(Trajectory(start.time_step + 1, states), shape)
    return DynamicObstacle(number, kind, shape, start, prediction)


def standing(number: int, start: InitialState, shape: Shape = CAR) -> StaticObstacle:
    """An obstacle that stands."""
    return StaticObstacle(number, ObstacleType.PARKED_VEHICLE, shape, start)


def write(
    folder: Path,
    *obstacles: DynamicObstacle | StaticObstacle,
    ego: InitialState | None = None,
    net_text: str = "",
    problem: PlanningProblem | None = None,
) -> Path:
    """Writes the folder; the ego vehicle starts far ahead on lane 3 if nowhere else."""
    folder.mkdir()
    scenario = Scenario(0.1, ScenarioID.from_benchmark_id(NAME, "2020a"))
    scenario.add_objects(network())
    scenario.add_objects(list(obstacles))
    problem = problem or made.problem(1000, ego or state(180, 0, EAST, 10))
    writer = CommonRoadFileWriter(
        scenario, PlanningProblemSet([problem]), "a", "b", "c", set(), Location(), 8
    )
    writer.write_to_file(str(folder / f"{NAME}.cr.xml"), OverwriteExistingFile.ALWAYS)
    (folder / f"{NAME}.net.xml").write_text(net_text or net())
    return folder
