"""Roads of the bundled scenarios and of roads made by hand: routes, path, limits, goal windows."""

import re
from functools import cache
from pathlib import Path

import made
import numpy as np
import pytest
import shapely
from commonroad.common.util import AngleInterval, Interval
from commonroad.geometry.shape import Circle, Polygon, Rectangle, ShapeGroup
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.scenario.lanelet import LaneletNetwork
from commonroad.scenario.scenario import Scenario, ScenarioID
from commonroad.scenario.state import CustomState, InitialState
from reference_ocp import frame_of, straight

from mpcplan.config import RoadConfig
from mpcplan.errors import RoadError
from mpcplan.road.goal import goal_windows, is_reached, region_of
from mpcplan.road.limits import drivable_area
from mpcplan.road.passable import fault, fault_of
from mpcplan.road.reference import drop_repeated, resample, smooth
from mpcplan.road.road import Road, build_roads
from mpcplan.road.route import find_routes, goal_lanelets, start_lanelets
from mpcplan.scenario import LoadedScenario, load
from mpcplan.vehicle import FORD_ESCORT as CAR

FOLDER = Path(__file__).resolve().parents[1] / "scenarios"
NAMES = [path.stem.split("-1_1")[0] for path in sorted(FOLDER.glob("*.xml"))]
CONFIG = RoadConfig()
MARGIN = CONFIG.margin


@cache
def loaded(name: str) -> LoadedScenario:
    """A bundled scenario by its short name."""
    return load(next(FOLDER.glob(f"*{name}-1_1_T-1.xml")))


@cache
def roads(name: str, problem: int = 0) -> tuple[Road, ...]:
    """The roads of a bundled scenario's planning problem."""
    scenario = loaded(name)
    return build_roads(scenario.scenario, scenario.problems[problem].planning_problem, CONFIG)


def start_of(name: str, road: Road) -> float:
    """Arc length of the start."""
    position = loaded(name).problems[0].planning_problem.initial_state.position
    return float(road.frame.to_frenet(np.asarray(position, float))[0])


# -- routes ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_routes_are_connected_and_lead_from_start_to_goal(name):
    scenario = loaded(name)
    network = scenario.scenario.lanelet_network
    problem = scenario.problems[0].planning_problem
    starts, goals = start_lanelets(network, problem), goal_lanelets(network, problem)
    found = find_routes(network, problem, 3)
    assert 1 <= len(found) <= 3 and len(set(found)) == len(found)
    for route in found:
        assert route.lanelets[0] in starts
        assert not goals or route.lanelets[-1] in goals
        for first, second in zip(route.lanelets, route.lanelets[1:], strict=False):
            lane = network.find_lanelet_by_id(first)
            beside = [
                lane.adj_left if lane.adj_left_same_direction else None,
                lane.adj_right if lane.adj_right_same_direction else None,
            ]
            assert second in [*lane.successor, *beside]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("LaneChange", {(1, 3, 4), (1, 2, 4)}),
        ("Merge", {(5, 6, 2, 3, 4), (5, 6, 7, 3, 4)}),
        ("FreeRoad", {(1, 3)}),
        ("TJunction", {(2, 8, 3)}),
    ],
)
def test_routes_with_their_lane_change_variants(name, expected):
    assert {road.route.lanelets for road in roads(name)} == expected


def test_the_number_of_variants_is_limited():
    scenario = loaded("LaneChange")
    problem = scenario.problems[0].planning_problem
    assert len(find_routes(scenario.scenario.lanelet_network, problem, 1)) == 1


def start_at(position: np.ndarray) -> InitialState:
    """An initial state along x."""
    return InitialState(0, position, 0.0, 9.0, acceleration=0.0, yaw_rate=0.0, slip_angle=0.0)


def problem_on_made_road(*goals: CustomState, start: InitialState | None = None) -> PlanningProblem:
    """A planning problem on the straight road of two lanes."""
    return made.problem(7, start or made.state(10, made.LANE / 2, 10), *goals)


def made_roads(tmp_path: Path, *goals: CustomState, **start: object) -> tuple[Road, ...]:
    """Roads on the straight road of two lanes."""
    scenario = load(made.write(tmp_path, problem_on_made_road(*goals, **start)))
    return build_roads(scenario.scenario, scenario.problems[0].planning_problem, CONFIG)


def test_an_unreachable_goal_says_from_where_to_where(tmp_path):
    start = made.state(150, made.LANE / 2, 10)
    with pytest.raises(RoadError) as caught:
        made_roads(tmp_path, made.rectangle_goal(50), start=start)
    text = str(caught.value)
    assert text.startswith("planning problem 7: no route from lanelets [3] to goal lanelets [1")
    assert "check successors and neighbours" in text


def test_a_goal_behind_on_the_same_lanelet_names_the_route_and_why(tmp_path):
    with pytest.raises(RoadError) as caught:
        made_roads(tmp_path, made.rectangle_goal(20), start=made.state(80, made.LANE / 2, 10))
    text = str(caught.value)
    assert "no usable route" in text and "(1,)" in text
    assert "does not meet the goal region ahead" in text


def test_a_start_without_a_lanelet_is_told():
    problem = loaded("FreeRoad").problems[0].planning_problem
    outside = problem.initial_state.position + np.array([0.0, 500.0])
    state = start_at(outside)
    lost = PlanningProblem(5, state, problem.goal)
    with pytest.raises(RoadError, match="planning problem 5: no lanelet holds the start"):
        find_routes(loaded("FreeRoad").scenario.lanelet_network, lost, 3)


# -- reference path -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_reference_paths_are_continuous_in_heading_and_curvature(name):
    for road in roads(name):
        frame = road.frame
        assert np.diff(frame.s) == pytest.approx(np.full(len(frame.s) - 1, frame.spacing))
        step = np.hypot(*np.diff(frame.points, axis=0).T)
        assert step == pytest.approx(np.full(len(step), frame.spacing), rel=0.01)
        assert np.abs(np.diff(frame.theta)).max() < 0.1
        assert np.abs(np.diff(frame.kappa)).max() < 0.02
        assert np.abs(frame.kappa).max() <= CONFIG.curvature_max


@pytest.mark.parametrize("name", NAMES)
def test_the_start_lies_behind_enough_road(name):
    for road in roads(name):
        s = start_of(name, road)
        assert s >= 10.0
        first = road.goals[0].s[0] if road.goals[0].s else s
        assert road.frame.length > first + 20.0


@pytest.mark.parametrize("name", NAMES)
def test_the_path_lies_on_its_lanes_near_their_centres(name):
    """On the road all along, and at most the inward shift of a bend beside a lane's centre."""
    for road in roads(name):
        start = start_of(name, road)
        inside = (road.frame.s > start) & (road.frame.s < road.limits.end - 5)
        goal_end = road.goals[0].s[1] if road.goals[0].s else start + 60
        here = inside & (road.frame.s < goal_end)
        assert shapely.contains_xy(road.area, road.frame.points[here]).all()
        offset = np.abs(road.limits.lane[here])  # where lanes merge the centre jumps over
        assert np.quantile(offset, 0.9) < 1.0 and offset.max() < 2.0


def test_smoothing_follows_a_straight_polyline():
    line = np.column_stack([np.linspace(0, 80, 33), np.linspace(0, 40, 33)])
    frame = smooth(resample(line, 1.0), CONFIG)
    d = frame.to_frenet(line[2:-2])[1]
    assert np.abs(d).max() < 1e-6
    assert frame.length == pytest.approx(np.hypot(80, 40), abs=0.01)


def test_smoothing_rounds_a_corner_without_cutting_it_much():
    along = np.arange(0.0, 41.0)
    line = np.vstack([np.column_stack([along, 0 * along]),
                      np.column_stack([40 + 0 * along[1:], along[1:]])])  # fmt: skip
    frame = smooth(line, CONFIG)
    assert np.abs(frame.kappa).max() < CONFIG.curvature_max
    assert 0.5 < np.hypot(*(frame.points - [40, 0]).T).min() < 3.5
    assert frame.theta[-1] - frame.theta[0] == pytest.approx(np.pi / 2, abs=0.02)


def test_a_path_of_nearly_nothing_is_refused():
    with pytest.raises(RoadError, match=r"of 3.0 m is too short"):
        smooth(np.column_stack([np.arange(4.0), np.zeros(4)]), CONFIG)


def test_repeated_points_are_dropped():
    line = np.array([[0, 0], [0, 0.001], [1, 0], [1, 0], [2, 0]])
    assert drop_repeated(line).tolist() == [[0, 0], [1, 0], [2, 0]]


def test_resampling_keeps_ends_and_spacing():
    line = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 5.0]])
    points = resample(line, 0.5)
    assert points[0].tolist() == [0, 0] and points[-1].tolist() == [10, 5]
    assert len(points) == 31
    assert resample(line, 1.0, 2.0, 12.0)[[0, -1]].tolist() == [[2, 0], [10, 2]]


# -- limits ---------------------------------------------------------------------------------------

STRAIGHT = [  # scenario, edges seen from the right lane: (right, left) of the lane's centre [m]
    ("FreeRoad", -1.75, 5.25), ("Follow", -1.75, 5.25), ("Bicycle", -1.75, 5.25),
]  # fmt: skip


@pytest.mark.parametrize(("name", "right", "left"), STRAIGHT)
def test_edges_of_straight_roads_are_the_lanes_geometry(name, right, left):
    road = roads(name)[0]
    start = start_of(name, road)
    here = (road.frame.s > start - 5) & (road.frame.s < road.limits.end - 10)
    assert road.limits.right[here] == pytest.approx(right + MARGIN, abs=0.01)
    assert road.limits.left[here] == pytest.approx(left - MARGIN, abs=0.01)
    assert road.limits.lane[here] == pytest.approx(0.0, abs=0.01)


def test_neighbouring_lanes_of_the_same_direction_are_seen_the_oncoming_is_not():
    free, follow = roads("FreeRoad")[0], roads("Follow")[0]
    middle = len(free.frame.s) // 2
    assert free.limits.lane_left[middle] == pytest.approx(3.5, abs=0.01)
    assert np.isnan(free.limits.lane_right[middle])
    assert np.isnan(follow.limits.lane_left[len(follow.frame.s) // 2])


def test_the_target_lane_of_a_lane_change_is_the_reference():
    road = roads("LaneChange")[0]
    middle = len(road.frame.s) // 2
    assert road.limits.lane_right[middle] == pytest.approx(-3.5, abs=0.01)
    assert road.limits.right[middle] == pytest.approx(-5.25 + MARGIN, abs=0.01)


def test_the_road_ends_where_the_map_ends():
    road = roads("FreeRoad")[0]
    network = loaded("FreeRoad").scenario.lanelet_network
    last = network.find_lanelet_by_id(3).center_vertices[-1]
    s, _ = road.frame.to_frenet(np.asarray(last))
    assert road.limits.end <= float(s) + 0.5


@pytest.mark.parametrize("name", ["TightCurve", "SBend", "Roundabout", "TJunction"])
def test_bodies_between_the_edges_are_on_the_road(name):
    """Corners of cross-sections at the edges lie in the drivable area, in bends as well."""
    road = roads(name)[0]
    start, limits = start_of(name, road), road.limits
    here = (road.frame.s > start) & (road.frame.s < (road.goals[0].s or (0, start + 50))[1])
    for edge in (limits.left, limits.right):
        points = road.frame.to_cartesian(road.frame.s[here], edge[here])
        assert shapely.covers(road.area, shapely.points(points)).all()


@pytest.mark.parametrize(("name", "limit"), [("FreeRoad", 50 / 3.6), ("GoalIntervals", 40 / 3.6)])
def test_speed_limits_come_from_the_signs(name, limit):
    road = roads(name)[0]
    start = start_of(name, road)
    here = (road.frame.s > start) & (road.frame.s < road.limits.end - 10)
    assert road.limits.posted[here] == pytest.approx(limit, abs=0.01)
    assert (road.limits.speed <= road.limits.posted + 1e-9).all()


def test_without_signs_the_configured_maximum_holds():
    assert roads("Follow")[0].limits.posted == pytest.approx(CONFIG.speed_max)


def test_the_factor_scales_the_signs():
    scenario = loaded("FreeRoad")
    config = CONFIG.model_copy(update={"speed_limit_factor": 0.8})
    road = build_roads(scenario.scenario, scenario.problems[0].planning_problem, config)[0]
    assert np.median(road.limits.posted) == pytest.approx(0.8 * 50 / 3.6, abs=0.01)


@pytest.mark.parametrize("name", ["TightCurve", "SBend", "Oncoming", "Roundabout"])
def test_curves_limit_the_speed_by_lateral_acceleration(name):
    road = roads(name)[0]
    lateral = road.limits.speed**2 * np.abs(road.frame.kappa)
    assert lateral.max() <= CONFIG.lateral_acceleration + 1e-6
    assert lateral.max() > 0.95 * CONFIG.lateral_acceleration


def test_the_drivable_area_is_free_of_holes_between_lanelets():
    area = drivable_area(loaded("Roundabout").scenario)
    for part in shapely.get_parts(area):
        for hole in shapely.get_rings(part)[1:]:
            assert shapely.area(shapely.polygons(hole)) > 1.0


@pytest.mark.parametrize("name", NAMES)
def test_the_start_is_on_the_road(name):
    scenario = loaded(name)
    for problem in scenario.problems:
        state = problem.planning_problem.initial_state
        assert shapely.contains_xy(roads(name)[0].area, *state.position)


# -- goal windows ---------------------------------------------------------------------------------

FRAME = frame_of(straight, 200.0)


def problem_of(*goals: CustomState) -> PlanningProblem:
    """A planning problem along x, starting at (20, 0)."""
    return PlanningProblem(3, start_at(np.array([20.0, 0.0])), GoalRegion(list(goals)))


def window_of(**values: object):
    """The window of one goal state."""
    values.setdefault("time_step", Interval(30, 50))
    return goal_windows(problem_of(CustomState(**values)), FRAME, 20.0, 50)[0]


def test_a_rectangle_is_an_interval_of_s_and_d():
    window = window_of(position=Rectangle(20.0, 3.0, np.array([80.0, 0.5])))
    assert (window.first, window.last) == (30, 50)
    assert window.s == pytest.approx((70.0, 90.0), abs=0.7)
    assert window.d == pytest.approx((-1.0, 2.0), abs=0.4)
    assert window.v is None and window.psi is None


def test_windows_lie_inside_their_regions():
    region = Rectangle(12.0, 3.0, np.array([80.0, 1.0]), 0.3)
    window = window_of(position=region)
    middle = (sum(window.s) / 2, sum(window.d) / 2)
    assert shapely.contains_xy(region.shapely_object, *middle)
    across = np.linspace(*window.d, 9)
    for s in window.s:
        assert shapely.contains_xy(region.shapely_object, np.full(9, s), across).any()


def test_a_goal_with_time_alone_has_no_place():
    window = window_of(time_step=Interval(33, 33))
    assert (window.first, window.last, window.s, window.d) == (33, 33, None, None)


def test_intervals_of_speed_and_heading_are_kept():
    window = window_of(velocity=Interval(3.0, 5.0), orientation=AngleInterval(-0.2, 0.3))
    assert window.v == (3.0, 5.0) and window.psi == pytest.approx((-0.2, 0.3))


def test_groups_are_united_and_the_longest_stretch_taken():
    parts = [Rectangle(4.0, 3.0, np.array([60.0, 0.0])), Rectangle(10.0, 3.0, np.array([80.0, 0]))]
    window = window_of(position=ShapeGroup(parts))
    assert window.s == pytest.approx((75.0, 85.0), abs=0.7)


def test_circles_are_regions():
    window = window_of(position=Circle(5.0, np.array([70.0, 0.0])))
    assert window.s == pytest.approx((65.0, 75.0), abs=0.7)
    assert max(map(abs, window.d)) <= 5.0


def test_what_is_passed_already_is_no_goal():
    goal = CustomState(time_step=Interval(0, 9), position=Rectangle(5, 3, np.array([12.0, 0.0])))
    assert goal_windows(problem_of(goal), FRAME, 20.0, 50) == ()


def test_a_goal_beside_the_path_has_its_offset():
    window = window_of(position=Rectangle(20.0, 2.0, np.array([80.0, 4.1])))
    assert 3.1 <= window.d[0] < window.d[1] <= 5.1


@pytest.mark.parametrize("edge", [1.75, 2.0, 1.8])
def test_goal_window_of_the_neighbouring_lane_is_as_long_as_the_region(edge):
    """A region that begins at a multiple of the sampling: rounding must not break it up."""
    turned = np.array([80.0, edge + 1.75])
    window = window_of(position=Rectangle(40.0, 3.5, turned, 1e-9))
    assert window.s == pytest.approx((60.0, 100.0), abs=0.7)


def test_goal_window_of_the_neighbouring_lane_in_bundled_scenarios():
    """The same goal region is as long from the neighbouring lane as from its own."""
    for name in ("ParkedCar", "Bicycle", "CutIn"):
        windows = [road.goals[0].s for road in roads(name)]
        lengths = [high - low for low, high in windows]
        assert lengths == pytest.approx([lengths[0]] * len(lengths), abs=1.5), name


def test_several_goal_states_give_several_windows():
    goals = [
        CustomState(time_step=Interval(10, 20), position=Rectangle(5, 3, np.array([60.0, 0.0]))),
        CustomState(time_step=Interval(30, 40), velocity=Interval(0, 1)),
    ]
    windows = goal_windows(problem_of(*goals), FRAME, 20.0, 50)
    assert [(w.first, w.last) for w in windows] == [(10, 20), (30, 40)]


def test_a_lanelet_goal_reaches_over_the_lanelet(tmp_path):
    start = made.state(10, made.LANE / 2, 10)
    scenario = load(made.write(tmp_path, made.lanelet_goal(5, start)))
    road = build_roads(scenario.scenario, scenario.problems[0].planning_problem, CONFIG)[0]
    at = float(road.frame.to_frenet(np.array([0.0, 0.0]))[0])
    start_x = at - 10.0  # arc length of x = 0: the origin is at the start, x = 10
    assert road.goals[0].s[0] == pytest.approx(start_x + 100.0, abs=1.5)
    assert road.goals[0].d[0] < -1.0 and road.goals[0].d[1] > 1.0


# -- reaching -------------------------------------------------------------------------------------

GOAL = CustomState(
    time_step=Interval(30, 50), position=Rectangle(10.0, 3.0, np.array([80.0, 0.0])),
    velocity=Interval(5.0, 8.0), orientation=AngleInterval(-0.1, 0.1),
)  # fmt: skip


@pytest.mark.parametrize(
    ("x", "y", "v", "psi", "step", "reached"),
    [
        (78.5, 0.0, 6.0, 0.0, 40, True),
        (73.6, 0.0, 6.0, 0.0, 40, True),  # the centre, 1.51 m ahead of the axle, is inside
        (73.4, 0.0, 6.0, 0.0, 40, False),
        (84.0, 0.0, 6.0, 0.0, 40, False),
        (78.5, 2.0, 6.0, 0.0, 40, False),
        (78.5, 0.0, 9.0, 0.0, 40, False),
        (78.5, 0.0, 6.0, 0.2, 40, False),
        (78.5, 0.0, 6.0, 0.0, 29, False),
        (78.5, 0.0, 6.0, 0.0, 51, False),
        (78.5, 0.0, 6.0, 0.0, 50, True),
    ],
)
def test_reaching_is_judged_at_the_centre(x, y, v, psi, step, reached):
    assert is_reached(problem_of(GOAL), np.array([x, y, 0.0, v, psi]), step) is reached


def test_one_of_several_goal_states_suffices():
    either = problem_of(GOAL, CustomState(time_step=Interval(60, 70)))
    assert is_reached(either, np.array([0.0, 0.0, 0.0, 1.0, 0.0]), 65)
    assert not is_reached(either, np.array([0.0, 0.0, 0.0, 1.0, 0.0]), 55)


def test_a_goal_of_lanelets_that_cross_themselves_has_an_area() -> None:
    bow = Polygon(np.array([[0.0, 0.0], [4.0, 2.0], [4.0, 0.0], [0.0, 2.0], [0.0, 0.0]]))
    beside = Polygon(np.array([[1.0, 0.0], [9.0, 0.0], [9.0, 2.0], [1.0, 2.0]]))
    area = region_of(ShapeGroup([bow, beside])).area
    assert area == pytest.approx(17.5)  # 16, and what reaches beyond of the left triangle


@pytest.mark.parametrize("turn", [-0.8, 0.0, 0.3, 1.5])
def test_the_region_is_known_as_it_is_along_a_bend(turn):
    frame = frame_of(lambda s: np.full_like(s, 0.02), 120.0)
    shape = Rectangle(7.0, 2.0, frame.to_cartesian(np.array(60.0), np.array(1.5)), turn)
    state = CustomState(time_step=Interval(9, 9), position=shape)
    window = goal_windows(problem_of(state), frame, 20.0, 50)[0]
    s, d = np.meshgrid(np.linspace(50, 70, 161), np.linspace(-6, 7, 131))
    held = window.holds(s, d)
    points = shapely.points(frame.to_cartesian(s, d))
    depth = np.where(shapely.contains(shape.shapely_object, points), 1, -1) * shapely.distance(
        points, shape.shapely_object.exterior
    )
    assert not held[depth < -1e-3].any()
    assert held[depth > 0.2].all()
    assert held.any()


@pytest.mark.parametrize("turn", [-0.8, 0.3])
def test_the_window_around_a_centre_holds_it_and_nothing_beside_the_region(turn):
    shape = Rectangle(7.0, 2.0, np.array([60.0, 1.5]), turn)
    window = window_of(position=shape)
    for along in (-3.0, 0.0, 3.0):  # on the region's axis, as far as near its ends
        centre = shape.center + along * np.array([np.cos(turn), np.sin(turn)])
        near = window.around(*centre)
        assert near.s[0] - 0.1 <= centre[0] <= near.s[1] + 0.1
        assert near.d[0] - 0.1 <= centre[1] <= near.d[1] + 0.1
        s, d = np.meshgrid(np.linspace(*near.s, 9), np.linspace(*near.d, 9))
        inside = shapely.buffer(shape.shapely_object, 1e-3)
        assert shapely.contains_xy(inside, s, d).all()
        assert (near.s[1] - near.s[0]) * (near.d[1] - near.d[0]) > 0.5
    assert window.around(60.0, 9.0) is window


# -- whether there is a solution at all ------------------------------------------------------------


def road_with_gap(gap: float) -> Scenario:
    """Two lanelets after each other, the second one ``gap`` metres further on."""
    scenario = Scenario(0.1, ScenarioID.from_benchmark_id("ZAM_Gap-1_1_T-1", "2020a"))
    lanelets = [
        made.lanelet(1, 0.0, 0.0, successor=[3]),
        made.lanelet(3, made.LENGTH + gap, 0.0, predecessor=[1]),
    ]
    scenario.add_objects(LaneletNetwork.create_from_lanelet_list(lanelets))
    return scenario


def from_to(start: InitialState, x: float) -> PlanningProblem:
    """A problem with its goal around x [m]."""
    return made.problem(4, start, made.rectangle_goal(x))


def test_a_road_that_is_cut_has_no_solution_and_says_where():
    start = made.state(10, made.LANE / 2, 10)
    said = fault(road_with_gap(0.5), from_to(start, 150))
    assert "no solution" in said and "cut" in said
    x, y = (float(v) for v in re.findall(r"[xy] (-?[\d.]+) m", said))
    assert (x, y) == pytest.approx(made.at(made.LENGTH + 0.25, made.LANE / 2), abs=1.5)
    assert fault(road_with_gap(0.5), from_to(start, 60)) == ""  # before the cut
    assert fault(road_with_gap(0.0), from_to(start, 150)) == ""
    assert fault(road_with_gap(0.5), made.problem(4, start, made.goal())) == ""  # time alone


def test_a_start_off_the_road_has_no_solution():
    said = fault(road_with_gap(0.0), from_to(made.state(10, 0.5, 10), 60))
    assert "no solution" in said and "start is off the road by 1." in said


@pytest.mark.parametrize("name", NAMES)
def test_bundled_scenarios_have_solutions(name):
    assert fault_of(loaded(name)) == ""


# -- timetable ------------------------------------------------------------------------------------


def test_the_timetable_leads_evenly_from_the_start_to_the_goal(tmp_path):
    scenario = load(
        made.write(tmp_path, made.problem(1, made.state(10, 2, 10), made.rectangle_goal(60)))
    )
    road = build_roads(scenario.scenario, scenario.problems[0].planning_problem, CONFIG)[0]
    due = road.due(0, 40, 0.25)  # the last step is 40
    assert due[0] == pytest.approx(road.start)
    assert np.diff(due[:31]) == pytest.approx((due[30] - due[0]) / 30)
    low = road.goals[0].s[0] - CAR.rear_to_centre
    assert due[30:] == pytest.approx(low)
    later = road.due(12, 28, 0.25)
    assert later == pytest.approx(due[12:])  # who falls behind is not given more time


def test_nothing_is_due_so_early_that_the_least_speed_leads_past_the_goal(tmp_path):
    goal = made.rectangle_goal(60)
    goal.velocity = Interval(12, 15)
    scenario = load(made.write(tmp_path, made.problem(1, made.state(10, 2, 14), goal)))
    road = build_roads(scenario.scenario, scenario.problems[0].planning_problem, CONFIG)[0]
    due, low = road.due(0, 40, 0.5), road.goals[0].s[0] - CAR.rear_to_centre
    first = road.goals[0].first
    assert due[20] <= low - 12 * 0.1 * (first - 20) + 1e-9  # else it would be there: half the time
    assert due[first:] == pytest.approx(low)
    assert (np.diff(due) >= 0).all()


def test_nothing_is_due_without_a_position_or_a_reserve(tmp_path):
    for goals, share in (([made.goal()], 0.25), ([made.rectangle_goal(60)], 0.0)):
        scenario = load(made.write(tmp_path, made.problem(1, made.state(10, 2, 10), *goals)))
        road = build_roads(scenario.scenario, scenario.problems[0].planning_problem, CONFIG)[0]
        assert np.isneginf(road.due(0, 40, share)).all()
