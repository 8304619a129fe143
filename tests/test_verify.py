"""Verification: every check fails for its own reason, at the right step, naming the obstacle."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_ocp import DT, Track, forecast_of, frame_of, road_of, state_at, straight_road

from mpcplan.config import Config, VerifyConfig
from mpcplan.config.files import load_config
from mpcplan.observation import Box, Forecast, box_corners
from mpcplan.trajectory import Input, State, Trajectory
from mpcplan.vehicle import FORD_ESCORT, input_violations, rectangles, simulate
from mpcplan.verify.drivability import (
    check_collision,
    check_kinematics,
    check_road,
    separation,
    verify,
)
from mpcplan.verify.failsafe import braking_along, braking_tail
from mpcplan.verify.guard import Guard

CONFIG = VerifyConfig()
ROAD = straight_road()
NOBODY = forecast_of(ROAD.frame, 40)


def straight_drive(v: float = 10.0, d: float = 0.0, steps: int = 30, first: int = 0) -> Trajectory:
    """Constant speed along the straight road, from s = 30 m."""
    return simulate([30.0, d, 0.0, v, 0.0], np.zeros((steps, 2)), DT, first)


def changed(trajectory: Trajectory, row: int, column: int, by: float) -> Trajectory:
    """The trajectory with one state moved."""
    states = trajectory.states.copy()
    states[row, column] += by
    return Trajectory(trajectory.first_step, states, trajectory.inputs, trajectory.dt)


def test_a_drivable_plan_passes():
    finding = verify(straight_drive(), NOBODY, ROAD.area, CONFIG)
    assert finding.ok and str(finding) == "passed" and finding.as_dict()["ok"]


@pytest.mark.parametrize(
    ("column", "by", "word"),
    [
        (State.X, 1e-4, "x differs"),
        (State.Y, -1e-5, "y differs"),
        (State.DELTA, 1e-3, "delta differs"),
        (State.V, 0.1, "v differs"),
        (State.PSI, 1e-5, "psi differs"),
    ],
)
def test_a_state_that_does_not_follow_is_named(column, by, word):
    trajectory = changed(straight_drive(first=7), 12, column, by)
    finding = check_kinematics(trajectory, CONFIG.position_tolerance)
    assert (finding.ok, finding.check, finding.step) == (False, "kinematics", 19)
    assert finding.detail.startswith(word)
    assert finding.amount == pytest.approx(abs(by), rel=1e-6)


LIMITS = [
    ("acceleration", 12.0, 6.0, 0.0),
    ("braking", 20.0, -11.6, 0.0),
    ("steering_rate", 5.0, 0.0, 0.41),
]


@pytest.mark.parametrize(("name", "v", "a", "v_delta"), LIMITS)
def test_an_input_over_its_limit_is_named_at_its_step(name, v, a, v_delta):
    inputs = np.zeros((10, 2))
    inputs[6] = a, v_delta
    finding = check_kinematics(simulate([30, 0, 0, v, 0], inputs, DT, 3), 1e-6)
    assert (finding.check, finding.step, finding.detail) == ("kinematics", 9, name)
    assert finding.amount > 0


def test_friction_is_checked():
    driven = simulate([30, 0, 0.15, 20, 0], np.zeros((3, 2)), DT)
    finding = check_kinematics(driven, 1e-6)
    assert (finding.detail, finding.step) == ("friction", 0)
    assert finding.amount == pytest.approx(20**2 / 2.39268 * math.tan(0.15) - 11.5)


@pytest.mark.parametrize(("v", "first"), [(10.0, 0), (15.0, 4)])
def test_a_collision_names_obstacle_and_step(v, first):
    forecast = forecast_of(ROAD.frame, 60, Track(200.0, 0.0, 0.0), Track(55.0, 0.3, 0.0))
    finding = check_collision(straight_drive(v, first=first), forecast, CONFIG.margin)
    # bumper to bumper: 55 - 2.25 - (30 + 3.65776) = 19.09 m, of which the margin is kept
    expected = first + math.ceil((19.09224 - CONFIG.margin) / (v * DT) + 1e-9)
    assert (finding.check, finding.obstacle, finding.step) == ("collision", 11, expected)
    assert finding.amount < CONFIG.margin


def test_the_obstacle_is_met_when_it_is_there_not_before():
    """A car crosses the lane: the plan passes behind it, and hits it two seconds earlier."""
    boxes = np.zeros((1, 41, 6))
    t = DT * np.arange(41)
    boxes[0] = np.column_stack(
        [np.full(41, 50.0), 3.0 * (t - 1.0), np.full(41, np.pi / 2), np.full(41, 3.0),
         np.full(41, 4.5), np.full(41, 1.8)]
    )  # fmt: skip
    crossing = Forecast(0, (10,), boxes)
    late = simulate([20.0, 0, 0, 8.0, 0], np.zeros((30, 2)), DT)
    assert check_collision(late, crossing, 0.05).ok
    early = simulate([38.0, 0, 0, 8.0, 0], np.zeros((30, 2)), DT)
    finding = check_collision(early, crossing, 0.05)
    assert not finding.ok and finding.obstacle == 10 and 5 <= finding.step <= 16


def test_an_obstacle_that_left_is_no_obstacle():
    forecast = forecast_of(ROAD.frame, 60, Track(55.0, 0.0, 0.0))
    boxes = forecast.boxes.copy()
    boxes[:, 15:] = np.nan
    assert check_collision(straight_drive(), Forecast(0, (10,), boxes), 0.05).ok


@pytest.mark.parametrize(("gap", "ok"), [(0.03, True), (0.5, True), (-0.1, False)])
def test_a_close_start_does_not_refuse_every_plan_but_touching_does(gap, ok):
    """Standing behind a standing car, closer than the margin."""
    ahead = Track(30.0 + 3.65776 + gap + 2.25, 0.0, 0.0)
    forecast = forecast_of(ROAD.frame, 40, ahead)
    assert check_collision(straight_drive(0.0), forecast, CONFIG.margin).ok is ok


def test_leaving_the_road_names_step_and_area():
    # the body's right side, 0.837 m out, meets the edge at -1.75 m
    inputs = np.zeros((40, 2))
    inputs[:4, Input.V_DELTA] = -0.1
    driven = simulate([30, 0, 0, 10, 0], inputs, DT, 2)
    finding = check_road(driven, ROAD.area)
    corners = rectangles(driven.states)[..., 1].min(axis=1)
    first = int(np.argmax(corners < -1.75 - 1e-6))
    assert (finding.check, finding.step) == ("road", 2 + first)
    body = shapely.Polygon(rectangles(driven.states)[first])
    assert finding.amount == pytest.approx(body.difference(ROAD.area).area)


def test_the_slightest_departure_from_the_road_counts():
    edge = -1.75 + 0.837
    assert check_road(straight_drive(d=edge + 1e-4), ROAD.area).ok
    drifting = simulate([30, edge + 5e-4, 0, 10, -2e-4], np.zeros((20, 2)), DT)
    finding = check_road(drifting, ROAD.area)
    assert not finding.ok and 0 < finding.amount < 0.02


def test_a_start_off_the_road_may_come_back():
    outside = -1.75 + 0.837 - 0.1
    back = simulate([30, outside, 0, 10, 0.05], np.zeros((20, 2)), DT)
    assert not ROAD.area.covers(shapely.Polygon(rectangles(back.states)[0]))
    assert check_road(back, ROAD.area).ok
    away = simulate([30, outside, 0, 10, -0.05], np.zeros((20, 2)), DT)
    assert not check_road(away, ROAD.area).ok


def test_checks_come_in_order():
    wall = forecast_of(ROAD.frame, 40, Track(50.0, 0.0, 0.0))
    wrong = changed(straight_drive(d=-3.0), 5, State.V, 1.0)
    assert verify(wrong, wall, ROAD.area, CONFIG).check == "kinematics"
    assert verify(straight_drive(), wall, ROAD.area, CONFIG).check == "collision"
    leaving = simulate([30, 0, -0.1, 10, 0], np.zeros((30, 2)), DT)
    assert verify(leaving, NOBODY, ROAD.area, CONFIG).check == "road"


def test_findings_tell_what_they_know():
    wall = forecast_of(ROAD.frame, 40, Track(50.0, 0.0, 0.0))
    finding = verify(straight_drive(), wall, ROAD.area, CONFIG)
    assert str(finding).startswith(f"collision with obstacle 10 at step {finding.step} (gap")
    told = finding.as_dict()
    assert told["obstacle"] == 10 and told["check"] == "collision" and told["unit"] == "m"


# -- separation -----------------------------------------------------------------------------------

angles = st.floats(-4.0, 4.0)


@settings(max_examples=300, deadline=None)
@given(
    x=st.floats(-7, 7), y=st.floats(-7, 7), psi=angles, other=angles,
    length=st.floats(0.4, 12), width=st.floats(0.4, 3),
)  # fmt: skip
def test_separation_is_negative_exactly_where_rectangles_overlap(x, y, psi, other, length, width):
    state = np.array([[1.0, 2.0, 0.0, 0.0, psi]])
    box = np.array([[[1.0 + x, 2.0 + y, other, 0.0, length, width]]])
    gap = float(separation(state, box)[0, 0])
    ego, obstacle = shapely.Polygon(rectangles(state)[0]), shapely.Polygon(box_corners(box)[0, 0])
    area = ego.intersection(obstacle).area
    if abs(gap) > 1e-9:
        assert (gap < 0) == (area > 0)
    assert gap <= ego.distance(obstacle) + 1e-9
    if area == 0:
        assert gap >= ego.distance(obstacle) / math.sqrt(2) - 1e-9


def test_separation_of_parallel_bodies_is_their_gap():
    state = np.array([[0.0, 0.0, 0.0, 0.0, 0.0]])
    for centre, expected in (((10.0, 0.0), 10.0 - 3.65776 - 2.0), ((1.5, 3.0), 3.0 - 0.837 - 1.0)):
        box = np.array([[[*centre, 0.0, 0.0, 4.0, 2.0]]])
        assert separation(state, box)[0, 0] == pytest.approx(expected)


def test_separation_of_an_absent_box_is_unknown():
    state = np.zeros((3, 5))
    boxes = np.full((2, 3, 6), np.nan)
    boxes[1, :, :] = [20, 0, 0, 0, 4, 2]
    gap = separation(state, boxes)
    assert gap.shape == (2, 3)
    assert np.isnan(gap[0]).all() and (gap[1] > 0).all()


# -- fail-safe tail -------------------------------------------------------------------------------


def bend(s):
    """A road that turns left and right."""
    return 0.03 * np.sin(s / 12)


@pytest.mark.parametrize("curvature", [bend, lambda s: 0.0 * s])
@pytest.mark.parametrize("v", [0.0, 3.0, 12.0])
@pytest.mark.parametrize(("d", "mu"), [(0.0, 0.0), (0.4, 0.05), (-0.4, -0.04)])
def test_the_tail_stops_in_its_lane_within_the_limits(curvature, v, d, mu):
    road = road_of(frame_of(curvature, 200.0), left=1.75, right=-1.75)
    state = state_at(road.frame, 40.0, d=d, v=v, mu=mu)
    tail = braking_tail(road, state, 9, 8.0, DT)
    assert tail.first_step == 9
    assert np.array_equal(tail.states[0], state)
    assert tail.states[-1, State.V] == pytest.approx(0.0, abs=1e-9)
    assert (np.diff(tail.states[:, State.V]) <= 1e-9).all()
    assert verify(tail, NOBODY, road.area, CONFIG).ok
    way = np.hypot(*np.diff(tail.states[:, :2], axis=0).T).sum()
    assert way == pytest.approx(v**2 / 16, abs=0.1 * v + 0.1)


def test_the_tail_brakes_as_hard_as_it_is_asked_to():
    state = state_at(ROAD.frame, 40.0, v=12.0)
    ways = []
    for deceleration in (2.0, 4.0, 8.0):
        tail = braking_tail(ROAD, state, 0, deceleration, DT)
        assert tail.inputs[:, Input.A].min() == pytest.approx(-deceleration)
        ways.append(tail.states[-1, State.X])
    assert ways == sorted(ways, reverse=True)


def test_a_fast_tail_in_a_bend_keeps_to_the_friction_circle():
    road = road_of(frame_of(bend, 300.0), left=8.0, right=-8.0)
    tail = braking_tail(road, state_at(road.frame, 37.0, v=17.0), 0, 10.8, DT)
    assert max(excess.max() for excess in input_violations(tail).values()) < 1e-9
    assert tail.states[-1, State.V] < 1.0


@pytest.mark.parametrize("v", [0.0, 5.0, 11.0])
def test_braking_along_a_plan_stays_on_its_path(v):
    road = road_of(frame_of(bend, 300.0), left=1.75, right=-1.75)
    state = state_at(road.frame, 40.0, d=0.3, v=v)
    inputs = np.column_stack([np.full(40, 0.5), 0.1 * np.sin(np.arange(40) / 4)])
    plan = simulate(state, inputs, DT, 7)
    tail = braking_along(road, plan, 12, 8.0, DT)
    assert tail is not None
    assert tail.first_step == 12
    assert np.array_equal(tail.states[0], plan.state_at(12))
    assert tail.states[-1, State.V] == pytest.approx(0.0, abs=1e-9)
    path = shapely.LineString(plan.states[:, :2]) if v else shapely.Point(plan.states[0, :2])
    assert shapely.distance(path, shapely.points(tail.states[:, :2])).max() < 0.05 + 0.2 * (not v)
    assert max(excess.max() for excess in input_violations(tail).values()) < 1e-9


def test_a_plan_that_ends_before_the_standstill_gives_no_braking_along_it():
    assert braking_along(ROAD, straight_drive(v=15.0, steps=5), 2, 8.0, DT) is None


# -- how far a plan is verified -------------------------------------------------------------------


def wall(x: float, from_step: int = 0, exact: bool = False) -> Forecast:
    """Somebody who stands across the road at x [m] from a time step on."""
    boxes = np.tile([x, 0.0, 0.0, 0.0, 2.0, 3.0], (1, 120, 1)).astype(float)
    boxes[:, :from_step] = np.nan
    return Forecast(0, (5,), boxes, exact=exact)


def test_what_is_known_is_verified_to_the_end_and_what_is_guessed_as_far_as_it_is_good():
    guard, plan = Guard(Config(), DT), straight_drive(v=10.0, steps=60)  # from 30 m to 90 m
    far = wall(88.0)
    assert guard.verify(plan, ROAD, far, 0).ok  # 3 s are verified, and braking from there
    known = wall(88.0, exact=True)
    assert guard.verify(plan, ROAD, known, 0).check == "collision"


def test_a_guess_refuses_a_plan_whose_tail_runs_into_somebody():
    guard, plan = Guard(Config(), DT), straight_drive(v=10.0, steps=60)
    braking = 10.0**2 / 2 / Config().verify.braking
    front, half = 3.66, 1.0
    near, free = (30.0 + 30.0 + braking + front + half + gap for gap in (-0.5, 0.5))
    assert guard.verify(plan, ROAD, wall(near), 0).check == "collision"
    assert guard.verify(plan, ROAD, wall(free), 0).ok


def test_a_plan_may_go_on_while_it_can_be_broken_off_at_the_next_cycle():
    guard, plan = Guard(Config(), DT), straight_drive(v=10.0, steps=60)
    later = wall(55.0)  # refuses the plan, but there is room to brake after 0.3 s
    assert not guard.verify(plan, ROAD, later, 0).ok
    assert guard.until_next(plan, ROAD, later, 0).ok
    assert not guard.until_next(plan, ROAD, wall(43.0), 0).ok


@pytest.mark.parametrize(("gap", "ok"), [(0.02, False), (0.5, True)])
@pytest.mark.parametrize("drives_off", [True, False])
def test_who_stands_may_not_have_moved_by_the_next_cycle(gap, ok, drives_off):
    """A plan at 1 m/s behind somebody who stands and is guessed to drive off at once."""
    guard, plan = Guard(Config(), DT), straight_drive(v=1.0, steps=60)
    way = 1.0 * Config().drive.replan + 1.0**2 / 2 / Config().verify.braking
    at = 30.0 + FORD_ESCORT.front + way + gap + 4.5 / 2
    guess = forecast_of(ROAD.frame, 90, Track(at, 0.0, 8.0))
    guess.boxes[:, 0, Box.V] = 0.0 if drives_off else 8.0
    assert guard.verify(plan, ROAD, guess, 0).ok is (ok or not drives_off)
    assert guard.until_next(plan, ROAD, guess, 0).ok is (ok or not drives_off)
    unasked = load_config(overrides=["verify.waiting=false"])
    assert Guard(unasked, DT).verify(plan, ROAD, guess, 0).ok


@pytest.mark.parametrize(
    ("behind", "aside", "v", "ok"),
    [
        (12.0, 0.0, 12.0, True),  # 7.6 m behind; 3.6 m for its reaction, 2.75 m for its speed
        (12.0, 0.0, 13.0, False),  # 3.9 m and 4.3 m
        (12.0, 3.0, 13.0, True),  # in another lane, and passes
        (-9.0, 0.0, 0.0, False),  # it stands ahead, nearer than one can stop
    ],
)
def test_who_follows_when_a_plan_is_broken_off_is_expected_to_stay_behind(behind, aside, v, ok):
    """After 3 s at 10 m/s the tail begins at s = 60 m, where the others drive on as before."""
    guard, plan = Guard(Config(), DT), straight_drive(v=10.0, steps=60)
    s = 60.0 + FORD_ESCORT.rear_to_centre - behind - 3.0 * v
    other = forecast_of(ROAD.frame, 90, Track(s, aside, v))
    assert guard.verify(plan, ROAD, other, 0, trusting=True).ok is ok
    aside_or_ahead = aside > 0 or behind < 0
    assert guard.verify(plan, ROAD, other, 0).ok is (ok and aside_or_ahead)


def test_who_is_behind_counts_until_the_tail_begins():
    guard, plan = Guard(Config(), DT), straight_drive(v=10.0, steps=60)
    rammed = forecast_of(ROAD.frame, 90, Track(20.0, 0.0, 14.0))  # in it within 2 s
    finding = guard.verify(plan, ROAD, rammed, 0, trusting=True)
    assert finding.check == "collision" and finding.step < 30


def test_only_the_tail_may_cut_the_roads_edge_and_only_a_little():
    edge = -1.75 + 0.837  # the body's side is on the road's edge there
    outwards = 0.01 / 48  # rad, 1 cm on the way: 0.02 m^2 at last
    plan = simulate([30, edge + 0.007, 0, 10, -outwards], np.zeros((60, 2)), DT)
    assert verify(plan, NOBODY, ROAD.area, CONFIG).check == "road"
    outside = check_road(plan, ROAD.area).step
    assert 20 < outside < 45
    assert verify(plan.until(45), NOBODY, ROAD.area, CONFIG, tail=outside - 1).ok
    assert not verify(plan.until(45), NOBODY, ROAD.area, CONFIG, tail=outside).ok
    wide = simulate([30, edge + 0.007, 0, 10, -5 * outwards], np.zeros((60, 2)), DT)
    assert not verify(wide, NOBODY, ROAD.area, CONFIG, tail=5).ok
    guard = Guard(Config(), DT)
    assert guard.until_next(plan, ROAD, NOBODY, outside - 8).ok  # it is broken off before the edge
    assert not guard.until_next(plan, ROAD, NOBODY, outside).ok


def test_emergency_braking_is_the_softest_that_is_safe():
    guard, state = Guard(Config(), DT), state_at(ROAD.frame, 30.0, v=10.0)
    hardest = []
    for x in (80.0, 50.0, 43.5):
        tail, finding = guard.emergency(ROAD, state, 0, wall(x))
        assert finding.ok
        hardest.append(tail.inputs[:, Input.A].min())
    assert hardest == sorted(hardest, reverse=True)
    assert len(set(hardest)) == 3
    tail, finding = guard.emergency(ROAD, state, 0, wall(38.0))
    assert not finding.ok
    assert tail.inputs[:, Input.A].min() < -8.0


def test_emergency_braking_is_firm_where_motion_is_known_and_soft_where_it_is_guessed():
    guard, state = Guard(Config(), DT), state_at(ROAD.frame, 30.0, v=10.0)
    firm = guard.emergency(ROAD, state, 0, wall(200.0, exact=True))
    soft = guard.emergency(ROAD, state, 0, wall(200.0))
    assert firm[1].ok and soft[1].ok
    assert firm[0].inputs[1, Input.A] == pytest.approx(-Config().verify.braking, rel=0.05)
    assert soft[0].inputs[1, Input.A] > 0.5 * firm[0].inputs[1, Input.A]


def test_boxes_have_their_columns():
    corners = box_corners(np.array([3.0, 4.0, math.pi / 2, 0.0, 6.0, 2.0]))
    assert sorted(corners.round(9).tolist()) == [[2, 1], [2, 7], [4, 1], [4, 7]]
    assert [column.name for column in Box] == ["X", "Y", "PSI", "V", "LENGTH", "WIDTH"]
