"""The scenario collection: reproducible, readable, consistent and solvable."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from commonroad.common.file_reader import CommonRoadFileReader
from commonroad.common.writer.file_writer_xml import XMLFileWriter
from commonroad.planning.planning_problem import PlanningProblemSet
from commonroad.scenario.obstacle import DynamicObstacle
from commonroad.scenario.scenario import Scenario
from commonroad.scenario.state import CustomState
from commonroad_dc.boundary import construction
from shapely.geometry import Polygon
from shapely.ops import unary_union

FOLDER = Path(__file__).resolve().parents[1] / "scenarios"
sys.path.insert(0, str(FOLDER))

make_scenarios = import_module("make_scenarios")
frame = import_module("generator.frame")
overview = import_module("generator.overview")
model = import_module("generator.model")

CASES = {case.benchmark_id: case for case in make_scenarios.all_cases()}
NAMES = sorted(CASES)
EGO = model.Size(model.EGO_LENGTH, model.EGO_WIDTH)
REQUIRED_COUNT = 18
POSITION_TOLERANCE = 1e-3  # [m]
SPEED_TOLERANCE = 0.05  # between positions and stored speeds [m/s]
COMFORT_LIMIT = 8.0  # acceleration of the example motions [m/s^2]
ROAD_TOLERANCE = 1e-3  # [m]
SPACE_BEFORE = 15.0  # road behind each start [m]
SPACE_BEYOND = 60.0  # road beyond each goal rectangle [m]
AXIS_DISTANCE = 1e-3  # smallest angle between an obstacle and an axis [rad]
BOUNDARY_CODE = """
import os, sys
from commonroad.common.file_reader import CommonRoadFileReader
from commonroad_dc.feasibility import solution_checker
solution_checker._construct_boundary_checker(CommonRoadFileReader(sys.argv[1]).open()[0])
os._exit(0)
"""


@pytest.fixture(scope="module")
def loaded() -> dict[str, tuple[Scenario, PlanningProblemSet]]:
    """All committed files by name."""
    return {name: CommonRoadFileReader(FOLDER / f"{name}.xml").open() for name in NAMES}


def covered_road(scenario: Scenario) -> Polygon:
    """Union of all lanelets, closed over rounding gaps."""
    shapes = [lane.polygon.shapely_object for lane in scenario.lanelet_network.lanelets]
    return unary_union([shape.buffer(ROAD_TOLERANCE) for shape in shapes])


def body(shape: tuple[float, float], state: CustomState) -> Polygon:
    """Area covered by a vehicle of the size `shape` in a state."""
    pose = overview.Pose(*state.position, state.orientation, 0.0, 0.0, 0.0)
    return overview.outline(pose, model.Size(*shape))


def bodies_at(scenario: Scenario, step: int) -> Iterator[Polygon]:
    """Areas of all obstacles at a step."""
    for obstacle in scenario.obstacles:
        rectangle = obstacle.obstacle_shape
        yield body((rectangle.length, rectangle.width), obstacle.state_at_time(step))


def test_generator_reproduces_committed_files(tmp_path: Path) -> None:
    """A fresh process with another hash seed writes exactly the committed bytes."""
    command = [sys.executable, str(FOLDER / "make_scenarios.py"), "--out", str(tmp_path)]
    subprocess.run(command, check=True, env={**os.environ, "PYTHONHASHSEED": "7"})
    committed = {path.name for path in FOLDER.glob("*.xml")} | {"README.md"}
    assert {path.name for path in tmp_path.iterdir()} == committed
    for name in sorted(committed):
        assert (tmp_path / name).read_bytes() == (FOLDER / name).read_bytes(), name


def test_collection_is_complete() -> None:
    """Enough scenarios, with different names."""
    assert len(make_scenarios.all_cases()) == len(CASES) >= REQUIRED_COUNT


@pytest.mark.parametrize("name", NAMES)
def test_file_is_valid(name: str) -> None:
    """The file follows the CommonRoad schema."""
    assert XMLFileWriter.check_validity_of_commonroad_file((FOLDER / f"{name}.xml").read_bytes())


@pytest.mark.parametrize("name", NAMES)
def test_ids_and_initial_states(name: str, loaded: dict) -> None:
    """Ids are unique, the benchmark id is the file name, the start is complete."""
    scenario, problems = loaded[name]
    network = scenario.lanelet_network
    ids = [lane.lanelet_id for lane in network.lanelets]
    ids += [sign.traffic_sign_id for sign in network.traffic_signs]
    ids += [crossing.intersection_id for crossing in network.intersections]
    ids += [inc.incoming_id for crossing in network.intersections for inc in crossing.incomings]
    ids += [obstacle.obstacle_id for obstacle in scenario.obstacles]
    ids += list(problems.planning_problem_dict)
    assert len(ids) == len(set(ids))
    assert str(scenario.scenario_id) == name
    assert scenario.dt == pytest.approx(0.1)
    for problem in problems.planning_problem_dict.values():
        start = problem.initial_state
        assert start.time_step == 0
        assert start.slip_angle == start.yaw_rate == 0.0
        assert not hasattr(start, "steering_angle")


@pytest.mark.parametrize("name", NAMES)
def test_lanelets_fit_together(name: str, loaded: dict) -> None:
    """Successors continue exactly, neighbours share their common bound, references agree."""
    network = loaded[name][0].lanelet_network
    for lane in network.lanelets:
        for other_id in lane.successor:
            other = network.find_lanelet_by_id(other_id)
            assert lane.lanelet_id in other.predecessor
            assert np.array_equal(lane.left_vertices[-1], other.left_vertices[0])
            assert np.array_equal(lane.right_vertices[-1], other.right_vertices[0])
        if lane.adj_left is not None:
            other = network.find_lanelet_by_id(lane.adj_left)
            same = lane.adj_left_same_direction
            shared = other.right_vertices if same else other.left_vertices[::-1]
            assert np.array_equal(lane.left_vertices, shared)
            assert (other.adj_right if same else other.adj_left) == lane.lanelet_id
        assert lane.polygon.shapely_object.is_valid


@pytest.mark.parametrize("name", NAMES)
def test_road_boundary_can_be_constructed(name: str, loaded: dict) -> None:
    """The boundary construction of the drivability checker accepts the road."""
    construction.construct(loaded[name][0], ["section_triangles", "triangulation"])


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_official_boundary_checker_survives(name: str) -> None:
    """The official checker does not crash on the road boundary (in a process of its own)."""
    command = [sys.executable, "-c", BOUNDARY_CODE, str(FOLDER / f"{name}.xml")]
    assert subprocess.run(command, check=False).returncode == 0


@pytest.mark.parametrize("name", NAMES)
def test_no_obstacle_is_parallel_to_an_axis(name: str, loaded: dict) -> None:
    """The official cost evaluator would leave out an obstacle whose orientation is exactly 0."""
    for obstacle in loaded[name][0].obstacles:
        for step in range(CASES[name].last_step + 1):
            heading = obstacle.state_at_time(step).orientation
            assert abs(math.remainder(heading, math.pi / 2)) > AXIS_DISTANCE, step


@pytest.mark.parametrize("name", NAMES)
def test_nothing_overlaps(name: str, loaded: dict) -> None:
    """Obstacles touch neither each other nor a start, stay on the road, cover all steps."""
    scenario, problems = loaded[name]
    road = covered_road(scenario)
    starts = [
        body(EGO, problem.initial_state) for problem in problems.planning_problem_dict.values()
    ]
    assert not any(a.intersects(b) for a, b in combinations([*starts, *bodies_at(scenario, 0)], 2))
    for step in range(CASES[name].last_step + 1):
        bodies = list(bodies_at(scenario, step))
        assert not any(a.intersects(b) for a, b in combinations(bodies, 2)), step
        assert all(road.contains(area.centroid) for area in bodies), step
        if step == 0:
            assert all(road.contains(area) for area in starts)


@pytest.mark.parametrize("name", NAMES)
def test_recorded_speeds_match_positions(name: str, loaded: dict) -> None:
    """Central differences of the positions give the stored speeds and directions."""
    scenario = loaded[name][0]
    for obstacle in scenario.obstacles:
        if not isinstance(obstacle, DynamicObstacle):
            continue
        states = [obstacle.state_at_time(k) for k in range(CASES[name].last_step + 1)]
        positions = np.array([state.position for state in states])
        speeds = np.array([state.velocity for state in states])
        travelled = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        mean_speeds = 0.5 * (speeds[1:] + speeds[:-1])
        assert np.abs(travelled / scenario.dt - mean_speeds).max() < SPEED_TOLERANCE
        headings = np.array([state.orientation for state in states])
        assert np.abs(np.diff(headings)).max() < 0.1
        mean_headings = 0.5 * (headings[1:] + headings[:-1])
        course = np.stack([np.cos(mean_headings), np.sin(mean_headings)], axis=-1)
        along = np.sum(course * np.diff(positions, axis=0), axis=1)
        assert np.abs(along - travelled).max() < POSITION_TOLERANCE


@pytest.mark.parametrize("name", NAMES)
def test_example_motion_solves_problem(name: str, loaded: dict) -> None:
    """The example of each problem is free of collisions, on the road and reaches its goal."""
    scenario, problems = loaded[name]
    road = covered_road(scenario)
    tasks = zip(CASES[name].tasks, problems.planning_problem_dict.values(), strict=True)
    for task, problem in tasks:
        reached = False
        for step in range(task.goal.last + 1):
            pose = frame.turned_pose(task.example.pose(step))
            area = overview.outline(pose, EGO)
            assert not any(area.intersects(other) for other in bodies_at(scenario, step)), step
            assert road.contains(area), step
            lateral = pose.velocity * pose.yaw_rate
            assert np.hypot(pose.acceleration, lateral) < COMFORT_LIMIT
            state = CustomState(
                time_step=step,
                position=np.array([pose.x, pose.y]),
                velocity=pose.velocity,
                orientation=pose.orientation,
            )
            reached = reached or problem.goal.is_reached(state)
        assert reached


@pytest.mark.parametrize("name", NAMES)
def test_road_is_long_enough(name: str) -> None:
    """There is road before each start and beyond each goal rectangle."""
    for task in CASES[name].tasks:
        assert task.example.s >= SPACE_BEFORE
        if task.goal.zone is not None:
            path, station, length, _ = task.goal.zone
            assert path.length - station - length / 2 >= SPACE_BEYOND
        last = task.example.pose(task.goal.last)
        end = task.example.path.point(task.example.path.length)
        assert np.hypot(last.x - end[0], last.y - end[1]) >= SPACE_BEYOND / 2
