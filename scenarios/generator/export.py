"""Write a case as CommonRoad 2020a XML with reproducible bytes."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path as FilePath

import numpy as np
from commonroad.common.file_writer import CommonRoadFileWriter, OverwriteExistingFile
from commonroad.common.util import AngleInterval, Interval
from commonroad.geometry.shape import Rectangle, ShapeGroup
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem, PlanningProblemSet
from commonroad.prediction.prediction import TrajectoryPrediction
from commonroad.scenario.lanelet import LaneletNetwork
from commonroad.scenario.obstacle import DynamicObstacle, StaticObstacle
from commonroad.scenario.scenario import Location, Scenario, ScenarioID
from commonroad.scenario.state import CustomState, ExtendedPMState, InitialState
from commonroad.scenario.trajectory import Trajectory
from lxml import etree

from .frame import MAP_TURN, turned_points, turned_pose
from .model import Actor, Case, Goal, Task
from .motion import TIME_STEP, Pose

FILE_DATE = "2025-01-01"  # fixed, so that the files can be reproduced
AUTHOR = "mpcplan"
SOURCE = "hand-made scenario"
DECIMALS = 6  # of all numbers except lanelet coordinates
OBSTACLE_ID_BASE = 1000  # obstacles have the ids 1001, 1002, ...
PROBLEM_ID_BASE = 2000  # planning problems have the ids 2001, 2002, ...
ONE_LINE_ELEMENTS = ("point", "state", "initialState", "goalState", "shape")


def short(value: float) -> float:
    """Number as it is stored in the file (without negative zero)."""
    return round(float(value), DECIMALS) + 0.0


def _position(pose: Pose) -> np.ndarray:
    return np.array([short(pose.x), short(pose.y)])


def _initial_state(pose: Pose, ego: bool, step: int = 0) -> InitialState:
    """First state; the acceleration is stored for recorded traffic only."""
    state = InitialState(
        time_step=step,
        position=_position(pose),
        orientation=short(pose.orientation),
        velocity=short(pose.velocity),
        yaw_rate=short(pose.yaw_rate),
        slip_angle=0.0,
    )
    if not ego:
        state.acceleration = short(pose.acceleration)
    return state


def _recorded_state(pose: Pose, step: int) -> ExtendedPMState:
    return ExtendedPMState(
        time_step=step,
        position=_position(pose),
        velocity=short(pose.velocity),
        orientation=short(pose.orientation),
        acceleration=short(pose.acceleration),
    )


def _obstacle(actor: Actor, number: int, last_step: int) -> StaticObstacle | DynamicObstacle:
    shape = Rectangle(*actor.size)
    first = actor.first_step
    poses = [turned_pose(actor.motion.pose(step)) for step in range(first, last_step + 1)]
    start = _initial_state(poses[0], ego=False, step=first)
    obstacle_id = OBSTACLE_ID_BASE + number
    if actor.static:
        return StaticObstacle(obstacle_id, actor.kind, shape, start)
    states = [_recorded_state(pose, step) for step, pose in enumerate(poses[1:], start=first + 1)]
    prediction = TrajectoryPrediction(Trajectory(first + 1, states), shape)
    return DynamicObstacle(obstacle_id, actor.kind, shape, start, prediction)


def _goal_region(goal: Goal, network: LaneletNetwork) -> GoalRegion:
    """Goal in the form the CommonRoad reader produces from the file."""
    conditions = {"time_step": Interval(goal.first, goal.last)}
    lanelets = None
    if goal.zone is not None:
        path, s, length, width = goal.zone
        centre = np.array([short(c) for c in turned_points(path.point(s))])
        heading = short(path.heading(s) + MAP_TURN)
        conditions["position"] = Rectangle(length, width, centre, heading)
    elif goal.lanelets:
        shapes = [network.find_lanelet_by_id(i).polygon for i in goal.lanelets]
        conditions["position"] = ShapeGroup(shapes)
        lanelets = {0: list(goal.lanelets)}
    if goal.orientation is not None:
        limits = (short(limit + MAP_TURN) for limit in goal.orientation)
        conditions["orientation"] = AngleInterval(*limits)
    if goal.velocity is not None:
        conditions["velocity"] = Interval(*map(short, goal.velocity))
    return GoalRegion([CustomState(**conditions)], lanelets)


def _planning_problem(task: Task, number: int, network: LaneletNetwork) -> PlanningProblem:
    start = _initial_state(turned_pose(task.example.pose(0)), ego=True)
    return PlanningProblem(PROBLEM_ID_BASE + number, start, _goal_region(task.goal, network))


def build(case: Case) -> tuple[Scenario, PlanningProblemSet]:
    """CommonRoad objects of a case."""
    scenario = Scenario(TIME_STEP, ScenarioID.from_benchmark_id(case.benchmark_id, "2020a"))
    network = case.road.network()
    scenario.add_objects(network)
    for number, actor in enumerate(case.actors, start=1):
        scenario.add_objects(_obstacle(actor, number, case.last_step))
    problems = [_planning_problem(t, i, network) for i, t in enumerate(case.tasks, start=1)]
    return scenario, PlanningProblemSet(problems)


def write(case: Case, folder: FilePath) -> FilePath:
    """Write the XML file of a case into `folder`; returns its path."""
    scenario, problems = build(case)
    target = folder / f"{case.benchmark_id}.xml"
    writer = CommonRoadFileWriter(
        scenario, problems, AUTHOR, AUTHOR, SOURCE, case.tags, Location(), DECIMALS
    )
    with contextlib.redirect_stdout(io.StringIO()):  # the writer reports overwritten files
        writer.write_to_file(str(target), OverwriteExistingFile.ALWAYS)
    _tidy(target)
    return target


def _tidy(target: FilePath) -> None:
    """Set the fixed date and put each point, state and shape on a single line."""
    parser = etree.XMLParser(remove_blank_text=True)
    root = etree.parse(str(target), parser).getroot()
    root.set("date", FILE_DATE)
    etree.indent(root)
    for element in root.iter(*ONE_LINE_ELEMENTS):
        if len(element):
            element.text = None
        for child in element.iterdescendants():
            child.tail = None
            if len(child):
                child.text = None
    content = etree.tostring(root, xml_declaration=True, encoding="utf-8")
    target.write_bytes(content + b"\n")
