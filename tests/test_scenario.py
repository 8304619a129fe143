"""Loading of scenarios: local coordinates, repairs, and an error for every broken file."""

import math
import warnings
from pathlib import Path

import made
import numpy as np
import pytest
from commonroad.common.file_reader import CommonRoadFileReader

from mpcplan.errors import InputError
from mpcplan.scenario import load
from mpcplan.trajectory import State
from mpcplan.vehicle import FORD_ESCORT, centres


def broken(path: Path, old: str, new: str, count: int = 1) -> Path:
    """The file with ``old`` replaced by ``new``; the text must occur."""
    text = path.read_text()
    assert old in text, old
    path.write_text(text.replace(old, new, count))
    return path


def in_problem(path: Path, old: str, new: str) -> Path:
    """The file with ``old`` replaced by ``new`` once, within its planning problems."""
    head, tail = path.read_text().split("<planningProblem", 1)
    assert old in tail, old
    path.write_text(f"{head}<planningProblem{tail.replace(old, new, 1)}")
    return path


def exact(field: str, value: str, indent: str = "      ") -> str:
    """The lines of an exact value as commonroad-io writes them."""
    return f"<{field}>\n{indent}  <exact>{value}</exact>\n{indent}</{field}>"


# ---------------------------------------------------------------- what is loaded


def test_two_problems_in_local_coordinates(tmp_path):
    start = made.state(10, 1.75, 10, step=2, yaw_rate=0.3)
    path = made.write(tmp_path, made.problem(7, start), made.problem(3, made.state(60, 5, 4)))
    loaded = load(path)
    assert loaded.id == "ZAM_Straight-1_1_T-1"
    assert loaded.dt == 0.1
    assert loaded.notes == ()
    np.testing.assert_array_equal(loaded.origin, np.round(made.at(10, 1.75)))
    assert [problem.id for problem in loaded.problems] == [7, 3]
    assert [problem.first_step for problem in loaded.problems] == [2, 0]
    assert list(loaded.problem_set.planning_problem_dict) == [7, 3]
    second = centres(loaded.problems[1].start[None])[0]
    np.testing.assert_allclose(second + loaded.origin, made.at(60, 5), atol=1e-6)


def test_start_is_the_rear_axle_and_turns_at_the_yaw_rate(tmp_path):
    start = made.state(10, 1.75, 10, yaw_rate=0.3)
    start.orientation = 0.4
    first = load(made.write(tmp_path, made.problem(1, start))).problems[0]
    x = first.start
    ahead = FORD_ESCORT.rear_to_centre * np.array([math.cos(0.4), math.sin(0.4)])
    centre = first.planning_problem.initial_state.position
    np.testing.assert_allclose(x[[State.X, State.Y]] + ahead, centre, atol=1e-12)
    assert 10 / FORD_ESCORT.wheelbase * math.tan(x[State.DELTA]) == pytest.approx(0.3)
    assert (x[State.V], x[State.PSI]) == (10, 0.4)


@pytest.mark.parametrize(
    ("v", "yaw_rate", "delta"), [(0.0, 0.3, 0.0), (0.05, 0.3, 0.0), (1.0, -9.0, -0.91)]
)
def test_steering_angle_at_standstill_and_at_its_limit(tmp_path, v, yaw_rate, delta):
    start = made.state(10, 1.75, v, yaw_rate=yaw_rate)
    loaded = load(made.write(tmp_path, made.problem(1, start)))
    assert loaded.problems[0].start[State.DELTA] == delta


def test_yaw_rate_is_read_without_an_acceleration(tmp_path):
    path = made.write(tmp_path, made.problem(1, made.state(10, 1.75, 10, yaw_rate=0.3)))
    in_problem(path, exact("acceleration", "0.0"), "")
    assert load(path).problems[0].planning_problem.initial_state.yaw_rate == 0.3


def test_missing_yaw_rate_and_slip_angle_are_zero(tmp_path):
    path = made.write(tmp_path)
    in_problem(path, exact("yawRate", "0.0"), "")
    in_problem(path, exact("slipAngle", "0.0"), "")
    initial = load(path).problems[0].planning_problem.initial_state
    assert (initial.yaw_rate, initial.slip_angle) == (0, 0)


def read_and_translated(path: Path, origin: np.ndarray):
    """The file read and translated by commonroad-io itself."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scenario, problems = CommonRoadFileReader(str(path)).open()
    scenario.remove_obstacle(scenario.environment_obstacle)  # it cannot translate them
    scenario.translate_rotate(-origin, 0.0)
    problems.translate_rotate(-origin, 0.0)
    return scenario, problems


@pytest.fixture
def everything(tmp_path):
    """A file with every kind of obstacle and goal, loaded and read by commonroad-io."""
    path = made.write(
        tmp_path,
        made.problem(100, made.state(10, 1.75, 10), made.rectangle_goal(80)),
        made.lanelet_goal(101, made.state(20, 5, 5)),
        obstacles=made.every_kind_of_obstacle(),
    )
    loaded = load(path)
    return loaded, *read_and_translated(path, loaded.origin)


def test_map_moves_as_commonroad_io_moves_it(everything):
    loaded, scenario, _ = everything
    roads, expected = loaded.scenario.lanelet_network, scenario.lanelet_network
    for lanelet in expected.lanelets:
        ours = roads.find_lanelet_by_id(lanelet.lanelet_id)
        for name in ("left_vertices", "center_vertices", "right_vertices"):
            np.testing.assert_allclose(getattr(ours, name), getattr(lanelet, name), atol=1e-6)
        assert ours.polygon.shapely_object.equals_exact(lanelet.polygon.shapely_object, 1e-6)
    sign = roads.traffic_signs[0].position
    np.testing.assert_allclose(sign, expected.traffic_signs[0].position, atol=1e-6)


def test_lanelets_are_found_in_local_coordinates(everything):
    """commonroad-io's own translation leaves its spatial index in the old coordinates."""
    loaded, scenario, _ = everything
    start = [loaded.problems[0].planning_problem.initial_state.position]
    assert loaded.scenario.lanelet_network.find_lanelet_by_position(start) == [[1]]
    assert scenario.lanelet_network.find_lanelet_by_position(start) == [[]]


@pytest.mark.filterwarnings("ignore:<PhantomObstacle")
def test_obstacles_move_as_commonroad_io_moves_them(everything):
    loaded, scenario, _ = everything
    assert len(loaded.scenario.obstacles) == len(scenario.obstacles) + 1
    for expected in scenario.obstacles:
        ours = loaded.scenario.obstacle_by_id(expected.obstacle_id)
        for step in (0, 1, 40):
            there, here = expected.occupancy_at_time(step), ours.occupancy_at_time(step)
            assert (there is None) == (here is None)
            if there is not None:
                assert_same_shape(here.shape, there.shape)


def assert_same_shape(ours, expected):
    """Equal up to 1 um, shape by shape."""
    pairs = zip(
        getattr(ours, "shapes", [ours]), getattr(expected, "shapes", [expected]), strict=True
    )
    for here, there in pairs:
        # normalised: commonroad-io's translation may reverse the order of a polygon's vertices
        polygons = [shape.shapely_object.normalize() for shape in (here, there)]
        assert polygons[0].equals_exact(polygons[1], 1e-6)


def test_buildings_move(everything):
    """commonroad-io's own translation fails with environment obstacles."""
    building = everything[0].scenario.environment_obstacle[0].obstacle_shape
    np.testing.assert_allclose(building.center, made.at(50, 20) - everything[0].origin)


def test_goals_move_as_commonroad_io_moves_them(everything):
    loaded, _, problems = everything
    for ours in loaded.problems:
        theirs = problems.find_planning_problem_by_id(ours.id)
        goals = ours.planning_problem.goal.state_list
        for here, there in zip(goals, theirs.goal.state_list, strict=True):
            assert_same_shape(here.position, there.position)
            assert here.time_step == there.time_step
    assert loaded.problems[1].planning_problem.goal.lanelets_of_goal_position == {0: [3]}


def test_a_shape_without_centre_lies_at_the_file_s_origin(tmp_path):
    path = made.write(tmp_path, obstacles=made.every_kind_of_obstacle())
    x, y = made.at(120, 5)
    centre = f"<center>\n              <x>{x}</x>\n              <y>{y}</y>"
    broken(path, f"{centre}\n            </center>", "")
    loaded = load(path)
    phantom = loaded.scenario.phantom_obstacle[0].occupancy_at_time(1).shape
    np.testing.assert_allclose(phantom.center, -loaded.origin)


def test_heights_are_ignored(tmp_path):
    path = made.write(tmp_path)
    path.write_text(path.read_text().replace("</y>", "</y><z>12.5</z>"))
    loaded = load(path)
    assert loaded.notes == ("heights (z) are ignored",)
    assert loaded.scenario.lanelet_network.lanelets[0].left_vertices.shape[1] == 2


# ---------------------------------------------------------------- repairs


def test_clashing_incomings_are_renumbered(tmp_path):
    path = broken(made.write(tmp_path), 'incoming id="61"', 'incoming id="1"')
    loaded = load(broken(path, 'isLeftOf ref="61"', 'isLeftOf ref="1"'))
    assert loaded.notes == ("incoming 1 is now 101: its id was taken",)
    first, second = loaded.scenario.lanelet_network.intersections[0].incomings
    assert (first.incoming_id, second.left_of) == (101, 101)


def test_clashing_sign_takes_its_references_along(tmp_path):
    path = broken(made.write(tmp_path), 'trafficSign id="50"', 'trafficSign id="2"')
    loaded = load(broken(path, 'trafficSignRef ref="50"', 'trafficSignRef ref="2"'))
    roads = loaded.scenario.lanelet_network
    assert roads.find_lanelet_by_id(1).traffic_signs == {roads.traffic_signs[0].traffic_sign_id}
    assert loaded.notes == ("trafficSign 2 is now 101: its id was taken",)


def test_clashing_obstacle_is_renumbered(tmp_path):
    path = broken(made.write(tmp_path), 'dynamicObstacle id="30"', 'dynamicObstacle id="4"')
    loaded = load(path)
    assert [obstacle.obstacle_id for obstacle in loaded.scenario.obstacles] == [101]
    assert "dynamicObstacle 4 is now 101" in loaded.notes[0]


def test_problem_keeps_an_id_that_is_also_an_obstacle_s(tmp_path):
    loaded = load(made.write(tmp_path, made.problem(30, made.state(10, 1.75, 10))))
    assert loaded.problems[0].id == 30
    assert loaded.notes == ()


def test_second_sign_of_the_same_id_is_dropped(tmp_path):
    path = made.write(tmp_path)
    text = path.read_text()
    sign = text[text.index("  <trafficSign ") : text.index("</trafficSign>")] + "</trafficSign>\n"
    loaded = load(broken(path, sign, sign + sign))
    assert loaded.notes == ("dropped the second trafficSign 50",)


def test_dangling_references_are_dropped(tmp_path):
    path = broken(made.write(tmp_path), 'successor ref="3"', 'successor ref="99"')
    loaded = load(path)
    assert loaded.scenario.lanelet_network.find_lanelet_by_id(1).successor == []
    assert loaded.notes == ("lanelet 1: dropped successor 99, which does not exist",)


def test_sign_without_lanelet_is_dropped(tmp_path):
    loaded = load(broken(made.write(tmp_path), '<trafficSignRef ref="50"/>', ""))
    assert loaded.notes == ("dropped trafficSign 50, to which no lanelet refers",)


# ---------------------------------------------------------------- errors


def refused(path: Path, *words: str) -> None:
    """Asserts that loading fails with a message that names the file and holds the words."""
    with pytest.raises(InputError) as caught:
        load(path)
    for word in (path.name, *words):
        assert word in str(caught.value)


def test_missing_file_and_folder(tmp_path):
    refused(tmp_path / "nowhere.xml", "no such file")
    refused(tmp_path, "folder")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["broken XML", "no element found"]),
        ("<commonRoad>\n<lanelet>\n</commonRoad>", ["broken XML", "line 3"]),
        ("\x00\x01 protobuf", ["broken XML", "line 1"]),
        ("<net/>", ["not a CommonRoad file", "<net>"]),
        ('<?xml version="1.0" encoding="klingon"?><commonRoad/>', ["broken XML", "encoding"]),
        ('<!DOCTYPE c [<!ENTITY a "b">]><commonRoad>&a;</commonRoad>', ["<!DOCTYPE"]),
        ('<!DOCTYPE c SYSTEM "file:///etc/hostname"><commonRoad/>', ["<!DOCTYPE"]),
    ],
)
def test_no_usable_xml(tmp_path, text, words):
    path = tmp_path / "file.xml"
    path.write_text(text)
    refused(path, *words)


def test_doctype_in_another_encoding(tmp_path):
    path = tmp_path / "file.xml"
    path.write_text('<!DOCTYPE c [<!ENTITY a "b">]><commonRoad>&a;</commonRoad>', "utf-16")
    refused(path, "<!DOCTYPE")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('commonRoadVersion="2020a"', 'commonRoadVersion="2017a"', ["2017a", "2020a"]),
        ('timeStepSize="0.1"', 'timeStepSize="0.2"', ["0.2 s", "expected 0.1 s"]),
        ('timeStepSize="0.1"', 'timeStepSize="fast"', ["timeStepSize", "0.1 s"]),
        ('timeStepSize="0.1"', "", ["timeStepSize"]),
        ('benchmarkID="ZAM_Straight-1_1_T-1"', "", ["benchmarkID"]),
        ("<exact>8.0</exact>", "<exact>nan</exact>", ["dynamicObstacle 30", "'nan'"]),
        ("<length>4.5</length>", "<length>long</length>", ["dynamicObstacle 30", "'long'"]),
        ("<y>5544824.0</y>", "<y>1e999</y>", ["lanelet 1", "1e999"]),
        ("<y>5544824.0</y>", "<y/>", ["lanelet 1", "<y>"]),
        ('lanelet id="2"', 'lanelet id="1"', ["<lanelet>", "the id 1"]),
        ('lanelet id="2"', 'lanelet id="two"', ["<lanelet>", "'two'"]),
        ("<type>car</type>", "<type>ufo</type>", ["ufo"]),
        ("<leftBound>", "<upperBound>", ["broken XML", "mismatched"]),
    ],
)
def test_broken_map_or_obstacle(tmp_path, old, new, words):
    refused(broken(made.write(tmp_path), old, new), *words)


INTERVAL = "<intervalStart>9</intervalStart><intervalEnd>11</intervalEnd>"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<exact>10.0</exact>", "<exact>-1.0</exact>", ["initial velocity is -1 m/s", "45.8"]),
        ("<exact>10.0</exact>", "<exact>50.0</exact>", ["initial velocity is 50 m/s"]),
        ("<exact>10.0</exact>", INTERVAL, ["velocity must be exact", "uncertain"]),
        (exact("velocity", "10.0"), "", ["no velocity"]),
        (exact("orientation", "0.0"), "", ["no orientation"]),
        (exact("time", "0"), "", ["no time"]),
        (exact("time", "0"), exact("time", "0.5"), ["initial time is '0.5'"]),
        ("<point>", "<circle/><pointless>", ["broken XML"]),
        ("<intervalEnd>40</intervalEnd>", "", ["no time interval"]),
        ("<intervalEnd>40</intervalEnd>", "<intervalEnd>4.5</intervalEnd>", ["'4.5'"]),
        ("<intervalStart>30</intervalStart>", "<intervalStart>90</intervalStart>", ["valid"]),
        ("<initialState>", "<initialState/><was>", ["broken XML"]),
    ],
)
def test_broken_problem(tmp_path, old, new, words):
    refused(in_problem(made.write(tmp_path), old, new), *words)


def test_uncertain_position(tmp_path):
    path = made.write(tmp_path)
    in_problem(path, "<point>", "<circle><radius>1</radius><center>")
    refused(in_problem(path, "</point>", "</center></circle>"), "point", "uncertain")


def test_no_problem_and_two_of_the_same_id(tmp_path):
    path = made.write(tmp_path)
    text = path.read_text()
    start = text.index("  <planningProblem")
    one = text[start : text.index("</commonRoad>")]
    refused(broken(path, one, one + one), "<planningProblem>", "the id 100")
    refused(broken(path, one + one, ""), "no planning problem")


def test_no_initial_state_and_no_goal(tmp_path):
    path = made.write(tmp_path)
    path.write_text(path.read_text().replace("goalState>", "ghoulState>"))
    refused(path, "planningProblem 100", "no goal state")
    head, tail = path.read_text().split("<planningProblem")
    path.write_text(f"{head}<planningProblem{tail.replace('initialState', 'finalState')}")
    refused(path, "planningProblem 100", "initial state is missing")


def test_no_lanelet(tmp_path):
    path = made.write(tmp_path)
    text = path.read_text()
    end = text.rindex("</lanelet>") + len("</lanelet>")
    path.write_text(text[: text.index("<lanelet ")] + text[end:])
    refused(path, "no lanelet")


def test_goal_that_ends_before_the_start(tmp_path):
    late = made.problem(9, made.state(10, 1.75, 10, step=41))
    refused(made.write(tmp_path, late), "planningProblem 9", "time step 40", "time step 41")


def test_goal_lanelet_that_does_not_exist(tmp_path):
    path = made.write(tmp_path, made.lanelet_goal(9, made.state(10, 1.75, 10)))
    refused(in_problem(path, 'ref="3"', 'ref="77"'), "planningProblem 9", "goal lanelet 77")


def test_start_off_the_map(tmp_path):
    path = made.write(tmp_path, made.problem(9, made.state(10, -2.5, 10)))
    refused(path, "planningProblem 9", "off the map", "2.50 m")


def test_goal_off_the_map(tmp_path):
    start = made.state(10, 1.75, 10)
    path = made.write(tmp_path, made.problem(9, start, made.rectangle_goal(80, 10)))
    refused(path, "planningProblem 9", "goal lies off the map", "1.50 m")
    one_of_two = made.problem(9, start, made.rectangle_goal(80, 10), made.rectangle_goal(80))
    assert load(made.write(tmp_path, one_of_two)).problems[0].id == 9


def test_loading_hides_no_warnings_of_others(tmp_path):
    path = made.write(tmp_path)
    before = list(warnings.filters)
    load(path)
    assert warnings.filters == before
