"""Routes that begin in the lane that the ego vehicle has come into: when, when not, and then."""

import json
import math
from dataclasses import replace
from pathlib import Path

import made
import numpy as np
import pytest
from commonroad.common.util import Interval
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad.scenario.obstacle import ObstacleType, StaticObstacle
from commonroad.scenario.state import CustomState
from hypothesis import given, settings
from hypothesis import strategies as st
from made_lanes import crossing, fork, lane, line, network, straight_road, two_lanes

from mpcplan import reassociate
from mpcplan.config import AssociationConfig, Config
from mpcplan.cycle import Cycle
from mpcplan.errors import RoadError
from mpcplan.explain.cycle import cycle_lines
from mpcplan.explain.run import run_lines
from mpcplan.observation import Forecast, Observation
from mpcplan.plan import Clock, Option
from mpcplan.planner import Planner
from mpcplan.reassociate import Reassociation, carried_over, planned_roads
from mpcplan.road.association import Association
from mpcplan.road.frame import Frame
from mpcplan.road.overlap import CentreLines, Overlap
from mpcplan.road.reference import smooth
from mpcplan.road.road import Road
from mpcplan.road.route import Route
from mpcplan.scenario import LoadedScenario, load
from mpcplan.simulate.loop import drive
from mpcplan.simulate.recorded import RecordedTraffic
from mpcplan.simulate.run import Run
from mpcplan.task import task_of
from mpcplan.vehicle import FORD_ESCORT as CAR

CONFIG = AssociationConfig(enabled=True)
NOBODY = Forecast(0, (), np.empty((0, 0, 6)))


# -- complex intersections ------------------------------------------------------------------------


def merge() -> LaneletNetwork:
    """Lanelet 1 along x to the origin and 3 from the right, both onto lanelet 2."""
    return network(
        lane(1, line((-200, 0), (0, 0)), after=(2,)),
        lane(2, line((0, 0), (300, 0)), before=(1, 3)),
        lane(3, line((-100, -40), (0, 0)), after=(2,)),
    )


def lane_end() -> LaneletNetwork:
    """Lanelets 1 and, to its left, 2 along x to the origin, both onto lanelet 3."""
    return network(
        lane(1, line((-200, 0), (0, 0)), after=(3,), left=2),
        lane(2, line((-200, 3.5), (0, 3.5)), after=(3,), right=1),
        lane(3, line((0, 0), (300, 0)), before=(1, 2)),
    )


def along_x(first: float = -90.0, last: float = 190.0) -> Frame:
    """A reference path along x; s = 0 at its beginning."""
    return smooth(line((first, 0), (last, 0), 281), Config().road)


def overlap_at(roads: LaneletNetwork, x: float, *lanes: int, frame: Frame | None = None) -> Overlap:
    """The overlap with a reference path along x, seen from x [m]."""
    return CentreLines(roads).overlap(frame or along_x(), x + 90.0, lanes, CONFIG)


@pytest.mark.parametrize(
    ("roads", "lanes"),
    [(straight_road(), (1,)), (two_lanes(), (1,)), (lane_end(), (1, 3)), (fork(), (1, 2))],
    ids=("one lane", "two lanes", "a lane ends", "fork"),
)
def test_a_road_of_several_lanes_and_its_forks_are_not_complex(roads, lanes):
    for x in (-80.0, -20.0, 0.0, 20.0):
        assert overlap_at(roads, x, *lanes) == Overlap(0, 0.0, math.inf)


def test_a_crossing_is_complex_as_far_as_is_looked():
    found = overlap_at(crossing(), -30.0, 1, 11, 21)
    assert found.count == 1 and found.ahead == pytest.approx(30.0, abs=1.0)
    assert overlap_at(crossing(), -30.0 - CONFIG.look, 1, 11, 21).count == 0
    assert overlap_at(crossing(), 5.0, 1, 11, 21).count == 0  # it lies behind


def test_a_lane_that_comes_in_from_another_road_is_complex():
    found = overlap_at(merge(), -30.0, 1, 2)
    assert found.count == 1 and 20.0 < found.ahead < 30.0
    assert str(found).startswith("1 centre line overlaps on ")


def test_only_lanes_for_cars_count():
    roads = crossing()
    for number in (3, 13, 23):
        roads.find_lanelet_by_id(number).lanelet_type = made.lanelet(1, 0, 0).lanelet_type
    assert overlap_at(roads, -30.0, 1, 11, 21).count == 1
    for number in (3, 13, 23):
        roads.find_lanelet_by_id(number).lanelet_type = {made.LaneletType.CROSSWALK}
    assert overlap_at(roads, -30.0, 1, 11, 21).count == 0


def moved(roads: LaneletNetwork, shift: np.ndarray, angle: float) -> LaneletNetwork:
    """The network turned about the origin by an angle [rad], then moved."""
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s], [s, c]])

    def put(lanelet: Lanelet) -> Lanelet:
        bounds = (lanelet.left_vertices, lanelet.center_vertices, lanelet.right_vertices)
        return Lanelet(
            *(bound @ turn.T + shift for bound in bounds), lanelet.lanelet_id,
            predecessor=lanelet.predecessor, successor=lanelet.successor,
            adjacent_left=lanelet.adj_left,
            adjacent_left_same_direction=lanelet.adj_left_same_direction,
            adjacent_right=lanelet.adj_right,
            adjacent_right_same_direction=lanelet.adj_right_same_direction,
        )  # fmt: skip

    return LaneletNetwork.create_from_lanelet_list([put(one) for one in roads.lanelets])


@settings(max_examples=25, deadline=None)
@given(
    angle=st.floats(-math.pi, math.pi), x=st.floats(-1e3, 1e3), y=st.floats(-1e3, 1e3),
    seen_from=st.sampled_from([-80.0, -40.0, -10.0, 3.0]),
)  # fmt: skip
def test_overlap_does_not_depend_on_where_and_how_the_map_lies(angle, x, y, seen_from):
    roads, c, s = crossing(), math.cos(angle), math.sin(angle)
    shift = np.array([x, y])
    there = Frame(along_x().s, along_x().points @ np.array([[c, s], [-s, c]]) + shift)
    here = overlap_at(roads, seen_from, 1, 11, 21)
    again = overlap_at(moved(roads, shift, angle), seen_from, 1, 11, 21, frame=there)
    assert (again.count, again.ahead) == (here.count, pytest.approx(here.ahead, abs=1.01))


# -- the lane of the ego vehicle ------------------------------------------------------------------


def centred_at(x: float, y: float, psi: float = 0.0) -> np.ndarray:
    """A rear-axle state with the body's centre at (x, y) [m]."""
    back = CAR.rear_to_centre
    return np.array([x - back * math.cos(psi), y - back * math.sin(psi), 0.0, 10.0, psi])


def on(frame: Frame, *lanelets: int) -> Road:
    """A road of a route, of which nothing but the reference matters."""
    return Road(Route(lanelets), frame, None, (), None)  # type: ignore[arg-type]


def judged(roads: LaneletNetwork, road: Road, *ys: float, x: float = -60.0, psi: float = 0.0):
    """The judgements of a drive at 10 m/s with an offset y [m] in every third time step."""
    association = Association(roads, CONFIG, 0.1)
    return [
        association.judge(3 * k, centred_at(x + 3.0 * k, y, psi), road) for k, y in enumerate(ys)
    ]


def test_who_stays_in_its_lane_is_never_associated_anew():
    found = judged(two_lanes(), on(along_x(), 1), *[0.2] * 10)
    assert {one.reason for one in found} == {"in the reference's lane"}
    assert not any(one.due for one in found)


def test_before_a_lane_change_the_routes_begin_in_the_lane_that_the_vehicle_is_in():
    found = judged(two_lanes(), on(along_x(), 2, 1), *[3.5] * 10)  # the reference is on lane 1
    assert {one.reason for one in found} == {"in the lane in which the routes begin"}


def test_another_lane_counts_after_some_time_and_only_once():
    association, road = Association(two_lanes(), CONFIG, 0.1), on(along_x(), 1)
    due = []
    for k in range(12):
        told = association.judge(3 * k, centred_at(-60.0 + 3.0 * k, 3.4), road)
        due.append(told.due)
        if told.due:
            association.begin_in(told.lanelet)
    assert due == [False] * 4 + [True] + [False] * 7  # 1.2 s is the first multiple from 1 s on


def test_who_drives_between_two_lanes_is_in_none_of_them_and_nothing_flickers():
    rng = np.random.default_rng(1)
    ys = 1.75 + rng.uniform(-1.2, 1.2, 60)
    found = judged(two_lanes(), on(along_x(), 1), *ys, x=-80.0)
    assert not any(one.due for one in found)
    assert {one.lanelet for one in found} == {None}
    assert "settled in no lane" in found[0].reason
    slanted = judged(two_lanes(), on(along_x(), 1), *[3.5] * 10, psi=0.2)
    assert not any(one.due for one in slanted)


def test_a_short_visit_does_not_count_and_time_begins_anew():
    found = judged(two_lanes(), on(along_x(), 1), 3.5, 3.5, 3.5, 0.0, 3.5, 3.5, 3.5)
    assert not any(one.due for one in found)
    assert found[-1].reason == "in another lane, lanelet 2, for 0.6 s of 1.0 s"


def with_lane_aside() -> LaneletNetwork:
    """The crossing with another lane beside the way from the west up to it."""
    roads = crossing()
    first = roads.find_lanelet_by_id(1)
    first.adj_left, first.adj_left_same_direction = 4, True
    roads.add_lanelet(lane(4, line((-200, 3.5), (-9, 3.5)), right=1))
    return roads


def test_near_a_complex_intersection_the_association_stays():
    found = judged(with_lane_aside(), on(along_x(), 1, 11, 21), *[3.5] * 12, x=-60.0)
    assert not any(one.due for one in found) and found[-1].overlaps == 1
    assert found[-1].reason.startswith("complex intersection within 2")
    assert "1 centre line overlaps" in found[-1].reason
    far = judged(with_lane_aside(), on(along_x(), 1, 11, 21), *[3.5] * 5, x=-85.0)
    assert far[-1].due and far[-1].overlaps == 0


def test_of_overlapping_lanes_its_own_is_the_vehicles_lane():
    roads = network(
        lane(1, line((-100, 0), (200, 0))), lane(2, line((-100, 0.1), (200, 0.1)))
    )  # fmt: skip
    for y in (0.0, 0.1, 0.3):
        for own in (1, 2):
            found = judged(roads, on(along_x(), own), *[y] * 6)
            assert {one.lanelet for one in found} == {own}


# -- a drive --------------------------------------------------------------------------------------


def overtaking(folder: Path) -> LoadedScenario:
    """A car stands in the lane and another one follows: whoever drives on must change to the left
    lane, and the goal, a time alone, says nothing of a lane."""
    stands = StaticObstacle(
        32, ObstacleType.PARKED_VEHICLE, made.CAR, made.state(60, made.LANE / 2, 0)
    )
    goal = CustomState(time_step=Interval(80, 85))
    problem = made.problem(7, made.state(12, made.LANE / 2, 10), goal)
    follows = made.car(33, 0, made.LANE / 2, 10, steps=90)
    return load(made.write(folder, problem, obstacles=[stands, follows]))


def configured(**association: object) -> Config:
    """The configuration with re-association."""
    on = AssociationConfig(enabled=True, **association)
    return Config().model_copy(update={"association": on})


def cycles_of(trace: dict) -> list[dict]:
    return trace["drives"][0]["cycles"]


@pytest.fixture(scope="module")
def driven(tmp_path_factory) -> Run:
    """A drive around the car that stands."""
    return drive(overtaking(tmp_path_factory.mktemp("made")), configured(settled=0.5))


def test_after_a_lane_change_the_routes_begin_in_the_new_lane_once(driven):
    assert driven.solved
    told = [cycle["association"] for cycle in cycles_of(driven.trace())]
    assert [one["reassociated"] for one in told].count(True) == 1
    at = [one["reassociated"] for one in told].index(True)
    assert told[0] == {
        "lanelet": 1, "reassociated": False, "overlaps": None, "reason": "in the reference's lane",
    }  # fmt: skip
    assert told[at]["lanelet"] in (2, 4)
    assert "the routes are now" in told[at]["reason"] and told[at]["overlaps"] == 0
    assert all(one["reason"] != told[at]["reason"] for one in told[at + 1 :])
    json.dumps(told)


def test_the_drive_is_the_same_each_time(driven, tmp_path):
    again = drive(overtaking(tmp_path), configured(settled=0.5))
    one, two = driven.drives[0].trajectory, again.drives[0].trajectory
    assert one.states.tobytes() == two.states.tobytes()


def test_without_it_the_trace_says_nothing(tmp_path):
    run = drive(overtaking(tmp_path), Config())
    assert {cycle["association"] for cycle in cycles_of(run.trace())} == {None}


def test_explain_tells_it(driven):
    trace = driven.trace()
    (step,) = (c["step"] for c in cycles_of(trace) if c["association"]["reassociated"])
    told = [text for text in run_lines(trace) if text.startswith("lane  ")]
    assert len(told) == 1 and told[0].startswith(f"lane      step {step}: in another lane")
    assert any(
        text.startswith("lane      re-associated: in another lane")
        for text in cycle_lines(trace, step)
    )
    assert "lane      not re-associated: in the reference's lane" in cycle_lines(trace, 0)


# -- the last plan --------------------------------------------------------------------------------


def first_plan(loaded: LoadedScenario) -> Option:
    """The option that a planner takes first."""
    planner = Planner(task_of(loaded, loaded.problems[0]), configured())
    problem = loaded.problems[0]
    now = RecordedTraffic(loaded.scenario).at(problem.first_step)
    planner.plan(Observation(problem.first_step, problem.start, 0.0, (now,)))
    assert planner._last is not None
    return planner._last


def replace_start(loaded: LoadedScenario, y: float) -> PlanningProblem:
    """The planning problem with its start at another y [m] of the made road."""
    problem = loaded.problems[0].planning_problem
    start = made.state(10, y, 10)
    start.position = start.position - loaded.origin
    return PlanningProblem(7, start, problem.goal)


def test_the_last_plan_goes_on_unchanged_in_the_frame_that_it_leaves_least(tmp_path):
    loaded = overtaking(tmp_path)
    last = first_plan(loaded)
    left = replace_start(loaded, y=1.5 * made.LANE)
    roads = planned_roads(loaded.scenario, left, Config(), last.seed.road)
    assert roads[0].area is last.seed.road.area
    carried = carried_over(last, (last.seed.road, *roads), 60)
    assert carried.seed.road is roads[0]  # by then the plan is in the left lane
    assert carried.trajectory is last.trajectory and not carried.settled
    assert carried_over(last, roads, last.trajectory.last_step) is None


def test_a_road_on_which_a_plan_does_not_end_in_the_goal_does_not_hold_it(tmp_path):
    last = first_plan(overtaking(tmp_path))
    late = replace(last.seed.road.goals[0], first=500, last=510)
    elsewhere = replace(last.seed.road, goals=(late,))
    assert last.reaches_goal and carried_over(last, (elsewhere,), 10) is None
    assert carried_over(last, (elsewhere, last.seed.road), 10).seed.road is last.seed.road


def test_the_timetable_goes_on_as_it_was(tmp_path):
    loaded = overtaking(tmp_path)
    last = first_plan(loaded)
    road = last.seed.road
    state = last.trajectory.state_at(60)
    now = RecordedTraffic(loaded.scenario).at(60)
    anew = Reassociation(
        loaded.scenario, loaded.problems[0].planning_problem, configured(settled=0.0)
    )
    cycle = Cycle(Observation(60, state, 0.0, (now,)), NOBODY, Clock(), [], {})
    found = anew.look(cycle, road, last)
    assert found.told.due and found.roads is not None
    assert found.roads[-1] is road and len(found.roads) > 1  # what it offers is not given up
    for new in found.roads:
        assert new.first_step == road.first_step
        before, after = (float(r.frame.to_frenet(state[:2])[0]) - r.start for r in (road, new))
        assert after == pytest.approx(before)


def test_where_no_route_leads_on_the_roads_stay(tmp_path, monkeypatch):
    loaded = overtaking(tmp_path)
    last = first_plan(loaded)
    now = RecordedTraffic(loaded.scenario).at(60)
    anew = Reassociation(
        loaded.scenario, loaded.problems[0].planning_problem, configured(settled=0.0)
    )

    def none(*args: object) -> None:
        raise RoadError("no usable route")

    monkeypatch.setattr(reassociate, "build_roads", none)
    seen = Observation(60, last.trajectory.state_at(60), 0.0, (now,))
    cycle = Cycle(seen, NOBODY, Clock(), [], {})
    found = anew.look(cycle, last.seed.road, last)
    assert found.roads is None and found.last is last and not found.told.due
    assert found.told.reason.endswith("no usable route")
    assert "routes begin" in anew.look(cycle, last.seed.road, last).told.reason  # not tried again
