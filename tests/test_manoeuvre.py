"""Manoeuvres: steered labels against the vehicle's model, clearance, and narrow places."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_ocp import (
    DT,
    Track,
    forecast_of,
    frame_of,
    occupancy_of,
    road_of,
    state_at,
    straight,
)

from mpcplan.config import Config
from mpcplan.observation import Box, Observation, Snapshot
from mpcplan.planner import Planner
from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.goal import GoalWindow
from mpcplan.road.road import Road
from mpcplan.scenario import load
from mpcplan.seed.candidates import Effort, find_seeds
from mpcplan.seed.clearance import Boxes, Clearance, kept_standing, on_road, overlaps, standing
from mpcplan.seed.manoeuvre import FASTER, MANOEUVRE, manoeuvre, manoeuvre_seeds
from mpcplan.seed.paths import FrenetPose, frenet_pose
from mpcplan.seed.steered import advance, returning, start
from mpcplan.seed.track import track
from mpcplan.task import task_of
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import input_violations, simulate
from mpcplan.verify.drivability import separation

FOLDER = Path(__file__).resolve().parents[1] / "scenarios"
BEND = 20.0  # m, where the bend begins
RADIUS = 8.0  # m
QUARTER = RADIUS * np.pi / 2 + 4.0  # m, of the bend, in and out of it
NOSE = Track(BEND + 10.0, -1.2, 0.0, turn=2.0)  # it stands across the middle of the bend
STEPS = 120


def bend(s: Array) -> Array:
    """A left turn by about 90 degrees, its curvature growing and shrinking over 4 m."""
    return np.interp(s, BEND + np.array([0.0, 4.0, QUARTER - 4.0, QUARTER]), [0, 1, 1, 0]) / RADIUS


def junction(left: float = 5.0) -> Road:
    """A left turn with room on its inside, and a goal behind it."""
    goal = GoalWindow(0, STEPS, (BEND + QUARTER + 4.0, 60.0), (-1.75, 1.75), None, None)
    return road_of(frame_of(bend, 70.0), goal, left=left)


# -- steered labels -------------------------------------------------------------------------------


@pytest.mark.parametrize("curvature", [straight, bend])
@pytest.mark.parametrize("rate", [-0.2, 0.0, 0.25])
def test_labels_follow_the_model_on_any_reference(curvature, rate):
    """1 m at a time against the model at 2 m/s, where 1 m is five time steps."""
    frame, v = frame_of(curvature, 70.0), 2.0
    state = state_at(frame, BEND - 2.0, d=0.4, v=v, mu=0.1)
    labels = start(FrenetPose(BEND - 2.0, 0.4, 0.1, float(state[State.DELTA])))
    inputs = np.tile([0.0, rate * v], (15, 1))
    driven = simulate(state, inputs, DT).states
    for metre in range(1, 4):
        for _ in range(2):
            labels = advance(frame, labels, np.array([rate]), 0.5)
        x, y, psi = (float(value[0]) for value in labels.poses(frame))
        there = driven[5 * metre]
        assert (x, y) == pytest.approx(there[[State.X, State.Y]], abs=0.02)
        assert psi == pytest.approx(there[State.PSI], abs=0.01)
        assert labels.delta[0] == pytest.approx(there[State.DELTA])


def test_steering_is_limited_but_need_not_jump_back_into_the_limits():
    frame = frame_of(straight, 70.0)
    beyond = start(FrenetPose(10.0, 0.0, 0.0, 0.9))
    after = advance(frame, beyond, np.array([0.6]), 1.0)
    assert after.delta[0] == 0.9
    assert advance(frame, start(FrenetPose(10, 0, 0, 0.8)), np.array([0.6]), 1.0).delta[0] < 0.9


@pytest.mark.parametrize("curvature", [straight, bend])
def test_the_feedback_returns_to_the_reference(curvature):
    frame = frame_of(curvature, 70.0)
    labels = start(FrenetPose(5.0, 1.0, -0.1, 0.0))
    for _ in range(100):
        rate = returning(frame, labels, 0.2, 0.5)
        assert abs(rate[0]) <= 0.2
        labels = advance(frame, labels, rate, 0.5)
    assert labels.s[0] == pytest.approx(55.0, abs=3.0)
    assert labels.d[0] == pytest.approx(0.0, abs=0.05)
    assert labels.mu[0] == pytest.approx(0.0, abs=0.02)


# -- clearance ------------------------------------------------------------------------------------


@settings(deadline=None)
@given(x=st.floats(-6, 6), y=st.floats(-6, 6), psi=st.floats(-3.2, 3.2), turn=st.floats(-3.2, 3.2))
def test_overlaps_are_those_of_verification(x, y, psi, turn):
    states = np.zeros((1, len(State)))
    states[0, [State.X, State.Y, State.PSI]] = x, y, psi
    box = np.zeros((1, 1, len(Box)))
    box[0, 0, [Box.PSI, Box.LENGTH, Box.WIDTH]] = turn, 4.5, 1.8
    gap = float(separation(states, box)[0, 0])
    one = Boxes(*(np.array([value]) for value in (0.0, 0.0, turn, 4.5, 1.8)))
    hit = overlaps(tuple(np.array([value]) for value in (x, y, psi)), one)
    if abs(gap) > 1e-9:
        assert hit[0, 0] == (gap < 0)


def test_who_stands_for_a_while_is_where_it_stands_then():
    frame = frame_of(straight, 100.0)
    window = occupancy_of(
        frame, 60, Track(30.0, 0.0, 0.0), Track(40.0, 0.0, 6.0, braking=3.0), Track(50.0, 0.0, 9.0)
    )
    boxes = standing(window)
    assert boxes.x == pytest.approx([30.0, 40.0 + 6.0**2 / (2 * 3.0)], abs=0.1)
    window.v[:, 10:] = 9.0  # all drive off soon
    assert not len(standing(window).x)
    assert len(standing(window.window(0, 3)).x) == 1  # the end of time is near


def test_who_stands_at_present_may_be_taken_to_go_on_standing():
    frame = frame_of(straight, 100.0)
    window = occupancy_of(frame, 60, Track(30.0, 0.0, 0.0), Track(50.0, 0.0, 9.0))
    window.v[0, 5:], window.x[0, 5:] = 3.0, 31.0  # the first one sets off soon
    kept = kept_standing(window)
    assert (kept.v[0] == 0.0).all()
    assert kept.x[0] == pytest.approx(30.0)
    assert np.array_equal(kept.x[1], window.x[1])
    assert window.x[0, 10] == 31.0  # the given ones are left alone


def test_gaps_that_are_short_already_may_stay_so():
    area = shapely.box(-20.0, -10.0, 20.0, 10.0)
    beside = Boxes(*(np.array([value]) for value in (1.5, 1.9, 0.0, 4.5, 1.8)))
    at = [np.array([value]) for value in (0.0, 0.0, 0.0)]
    assert overlaps(at, beside.grown(np.array([0.3]))).all()
    assert not overlaps(at, beside).any()
    narrow = Clearance(area, beside, 0.3, at)
    assert narrow.of_boxes(at).all()
    assert not narrow.of_boxes([at[0], at[1] + 0.3, at[2]]).any()
    far = [at[0] - 10.0, at[1], at[2]]
    assert not Clearance(area, beside, 0.3, far).of_boxes(at).any()


def test_the_body_must_be_on_the_road():
    area = shapely.box(-20.0, -1.0, 20.0, 1.0)
    at = [np.zeros(2), np.array([0.1, 0.2]), np.zeros(2)]
    assert on_road(at, area, 0.0).tolist() == [True, False]
    assert on_road(at, area, 0.1).tolist() == [False, False]


# -- narrow places --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def nose() -> Occupancy:
    """Somebody who stands across the bend."""
    return occupancy_of(junction().frame, STEPS, NOSE)


def test_only_a_manoeuvre_leads_past_who_stands_across_the_bend(nose):
    road = junction()
    state = state_at(road.frame, BEND - 1.0, v=0.5)
    others, _ = find_seeds(road, state, 0.0, 0, nose, Config(), DT, Effort.ALWAYS)
    assert not any(seed.reaches_goal for seed in others)
    (seed,), report = manoeuvre_seeds(road, state, 0.0, 0, nose, Config(), DT)
    assert seed.reaches_goal
    assert seed.source == report.source == MANOEUVRE
    assert (report.candidates, report.accepted, report.reaching_goal) == (1, 1, 1)
    driven = track(seed, state, DT)
    boxes = forecast_of(road.frame, STEPS, NOSE).at(driven.steps)
    assert separation(driven.states, boxes).min() > 0
    poses = driven.states[:, State.X], driven.states[:, State.Y], driven.states[:, State.PSI]
    assert on_road(poses, road.area, 0.0).all()
    assert max(excess.max() for excess in input_violations(driven).values()) < 1e-9


@pytest.mark.parametrize(
    ("v", "wall", "enabled", "sought"),
    [(2.0, 10.0, True, True), (8.0, 10.0, True, False), (2.0, 10.0, False, False),
     (2.0, None, True, False)],
)  # fmt: skip
def test_a_manoeuvre_is_sought_at_low_speed_where_nothing_leads_to_the_goal(
    v, wall, enabled, sought
):
    name = "FreeRoad" if wall is None else "SBend"  # the goal of the former is a time alone
    loaded = load(FOLDER / f"ZAM_{name}-1_1_T-1.xml")
    predict = {"kind": "constant_input", "horizon": 10.0, "hope": ()}  # the wall stays
    config = Config.model_validate({"predict": predict, "seed": {"manoeuvre": enabled}})
    problem = loaded.problems[0]
    state = problem.start.copy()
    state[State.V] = v
    boxes = np.zeros((0, len(Box)))
    if wall is not None:
        heading = np.array([np.cos(state[State.PSI]), np.sin(state[State.PSI])])
        x, y = state[[State.X, State.Y]] + wall * heading
        boxes = np.array([[x, y, state[State.PSI], 0.0, 2.0, 60.0]])
    seen = Observation(0, state, 0.0, (Snapshot(0, tuple(range(7, 7 + len(boxes))), boxes),))
    plan = Planner(task_of(loaded, problem), config).plan(seen)
    reaches = plan.trace["chosen"]["reaches_goal"]
    assert (MANOEUVRE in plan.trace["seeds"]) == sought
    assert not (sought and reaches)


def test_there_is_no_manoeuvre_through_a_wall():
    road = junction()
    pose = frenet_pose(road, state_at(road.frame, BEND - 1.0, v=0.5))
    wall = replace(NOSE, length=20.0)
    shut = occupancy_of(road.frame, STEPS, wall)
    assert manoeuvre(road, pose, 80, standing(shut), Config()) is None


def test_a_manoeuvre_begins_at_the_present_pose_and_keeps_the_limits(nose):
    road = junction()
    config = Config()
    pose = frenet_pose(road, state_at(road.frame, BEND - 1.0, d=0.2, v=0.5, mu=0.05))
    found = manoeuvre(road, pose, 80, standing(nose), config)
    assert found is not None
    assert found.s.shape == (1, 80)
    begin = (found.s[0, 0], found.d[0, 0], found.mu[0, 0], found.delta[0, 0])
    assert begin == pytest.approx((pose.s, pose.d, pose.mu, pose.delta))
    assert np.abs(found.delta).max() < CAR.delta_max
    assert np.abs(found.kappa - np.tan(found.delta) / CAR.wheelbase).max() == 0.0
    most = FASTER * config.seed.manoeuvre_rate
    assert np.abs(np.diff(found.delta)).max() <= most * found.spacing + 1e-12
    again = manoeuvre(road, pose, 80, standing(nose), config)
    assert np.array_equal(again.d, found.d)
