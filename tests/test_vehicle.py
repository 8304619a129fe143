"""The kinematic single-track model: integration, limits and the body's geometry."""

import math

import numpy as np
import pytest
import shapely
from commonroad.common.solution import VehicleType
from commonroad_dc.feasibility.vehicle_dynamics import (
    KinematicSingleTrackDynamics,
    VehicleParameterMapping,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcplan.trajectory import Trajectory
from mpcplan.vehicle import (
    FORD_ESCORT,
    acceleration_limit,
    centres,
    input_violations,
    rectangles,
    simulate,
    step,
)

DT = 0.1
AGREEMENT = 1e-5  # m or rad, with the checker's integrator
OFFICIAL = KinematicSingleTrackDynamics(VehicleType.FORD_ESCORT)

speeds = st.floats(0.0, 40.0)
shares = st.floats(-0.999, 0.999)


def input_within_limits(x: np.ndarray, along: float, across: float) -> tuple[float, float]:
    """Acceleration and steering rate at shares of what the model's limits leave over a step."""
    v, delta = x[3], x[2]
    lateral = v**2 / FORD_ESCORT.wheelbase * math.tan(delta)
    grip = math.sqrt(max(FORD_ESCORT.a_max**2 - lateral**2, 0.0))
    # the limit at the step's end: the checker's integrator cuts the acceleration off above it
    top = min(grip, float(acceleration_limit(v + FORD_ESCORT.a_max * DT)))
    a = along * (top if along > 0 else grip)
    return max(a, -v / DT), across * FORD_ESCORT.v_delta_max


def steering_with_grip(v: float, share: float) -> float:
    """A steering angle at a share of the angle that the friction circle and the axle allow."""
    grip = math.atan(FORD_ESCORT.wheelbase * FORD_ESCORT.a_max / max(v, 1e-3) ** 2)
    return share * min(FORD_ESCORT.delta_max - 0.05, grip)


@settings(max_examples=300, deadline=None)
@given(v=speeds, turn=shares, psi=st.floats(-4.0, 4.0), along=shares, across=shares)
def test_step_agrees_with_the_checkers_integrator(v, turn, psi, along, across):
    x = np.array([3.0, -2.0, steering_with_grip(v, turn), v, psi])
    a, v_delta = input_within_limits(x, along, across)
    official = OFFICIAL.forward_simulation(x, np.array([v_delta, a]), DT)
    assert np.array(step(x, a, v_delta, DT)) == pytest.approx(official, abs=AGREEMENT)


def test_a_long_drive_stays_with_the_checkers_integrator():
    rng = np.random.default_rng(7)
    x = np.array([0.0, 0.0, 0.0, 12.0, 0.3])
    inputs, official = [], [x]
    for along, across in rng.uniform(-0.6, 0.6, (100, 2)):
        a, v_delta = input_within_limits(x, along, across - 0.8 * x[2])
        inputs.append((a, v_delta))
        x = OFFICIAL.forward_simulation(x, np.array([v_delta, a]), DT)
        official.append(x)
    driven = simulate(official[0], np.array(inputs), DT, first_step=4)
    assert (driven.first_step, driven.last_step) == (4, 104)
    assert np.abs(driven.states - np.array(official)).max() < 1e-4


def test_constant_steering_drives_a_circle():
    delta, v = 0.3, 8.0
    radius = FORD_ESCORT.wheelbase / math.tan(delta)
    driven = simulate([0, 0, delta, v, 0], np.zeros((50, 2)), DT)
    phi = v * DT * np.arange(51) / radius
    circle = np.column_stack([radius * np.sin(phi), radius * (1 - np.cos(phi))])
    assert driven.states[:, :2] == pytest.approx(circle, abs=1e-4)
    assert driven.states[:, 4] == pytest.approx(phi, abs=1e-9)


def test_braking_straight_is_the_parabola():
    driven = simulate([5, 1, 0, 10, math.pi / 2], np.tile([-4.0, 0.0], (20, 1)), DT)
    t = DT * np.arange(21)
    assert driven.states[:, 1] == pytest.approx(1 + 10 * t - 2 * t**2)
    assert driven.states[:, 0] == pytest.approx(np.full(21, 5.0))
    assert driven.states[:, 3] == pytest.approx(10 - 4 * t)


def test_parameters_are_those_of_the_checker():
    official = VehicleParameterMapping.from_vehicle_type(VehicleType.FORD_ESCORT)
    car = FORD_ESCORT
    assert (car.length, car.width) == (official.l, official.w)
    assert car.wheelbase == pytest.approx(official.a + official.b)
    assert car.rear_to_centre == pytest.approx(official.b)
    assert car.delta_max == official.steering.max == -official.steering.min
    assert car.v_delta_max == official.steering.v_max == -official.steering.v_min
    longitudinal = official.longitudinal
    assert (car.a_max, car.v_switch) == (longitudinal.a_max, longitudinal.v_switch)
    assert car.v_max == longitudinal.v_max


@pytest.mark.parametrize(
    ("v", "limit"),
    [(0.0, 11.5), (4.755, 11.5), (9.51, 5.75), (47.55, 1.15), (-3.0, 11.5)],
)
def test_acceleration_limit(v, limit):
    assert float(acceleration_limit(v)) == pytest.approx(limit)
    assert acceleration_limit(np.array([v, v])) == pytest.approx([limit, limit])


def drive(v: float, a: float = 0.0, delta: float = 0.0, v_delta: float = 0.0) -> Trajectory:
    """One step of the model."""
    return simulate([0, 0, delta, v, 0], np.array([[a, v_delta]]), DT)


LATERAL_LIMIT = math.atan(FORD_ESCORT.wheelbase * FORD_ESCORT.a_max / 15.0**2)

AT_THE_LIMIT = [
    ("acceleration", drive(2.0, a=11.5)),
    ("acceleration", drive(45.0, a=float(acceleration_limit(45.0 + 0.1214)))),
    ("braking", drive(20.0, a=-11.5)),
    ("friction", drive(15.0, delta=LATERAL_LIMIT)),
    ("steering_rate", drive(5.0, v_delta=-0.4)),
    ("steering_angle", drive(0.5, delta=0.91)),
    ("steering_angle", drive(0.5, delta=-0.87, v_delta=-0.4)),
    ("speed", drive(1.0, a=-10.0)),
    ("speed", drive(45.8)),
]


@pytest.mark.parametrize(("name", "trajectory"), AT_THE_LIMIT)
def test_touching_a_limit_is_no_violation(name, trajectory):
    excess = input_violations(trajectory)
    assert excess[name].max() == pytest.approx(0.0, abs=1e-3)
    assert max(values.max() for values in excess.values()) < 1e-9


OVER_THE_LIMIT = [
    ("acceleration", drive(2.0, a=11.6), 0.1),
    ("acceleration", drive(9.41, a=6.0), None),
    ("braking", drive(20.0, a=-11.6), 0.1),
    ("friction", drive(20.0, delta=0.1), 20.0**2 / 2.39268 * math.tan(0.1) - 11.5),
    ("steering_rate", drive(5.0, v_delta=0.45), 0.05),
    ("steering_angle", drive(0.5, delta=-0.95), 0.04),
    ("speed", drive(0.5, a=-10.0), 0.5),
    ("speed", drive(45.9), 0.1),
]


@pytest.mark.parametrize(("name", "trajectory", "amount"), OVER_THE_LIMIT)
def test_violations_name_limit_and_amount(name, trajectory, amount):
    excess = input_violations(trajectory)
    assert excess[name].max() > 1e-6
    if amount is not None:
        assert excess[name].max() == pytest.approx(amount, abs=1e-9)


def test_friction_is_taken_at_both_ends_of_a_step():
    """The circle holds at the first state and is broken at the second."""
    turning = drive(15.0, delta=LATERAL_LIMIT - 0.01, v_delta=0.4)
    assert input_violations(turning)["friction"][0] > 0.1


@settings(max_examples=60, deadline=None)
@given(v=speeds, turn=shares, along=shares, across=shares)
def test_what_has_no_violation_is_accepted_by_the_checker(v, turn, along, across):
    driven = drive(v, *_arguments(v, turn, along, across))
    if max(values.max() for values in input_violations(driven).values()) > -1e-6:
        return
    a, v_delta = driven.inputs[0]
    assert OFFICIAL.forward_simulation(driven.states[0], np.array([v_delta, a]), DT) is not None


def _arguments(v: float, turn: float, along: float, across: float) -> tuple[float, float, float]:
    delta = steering_with_grip(v, turn)
    a, v_delta = input_within_limits(np.array([0, 0, delta, v, 0]), along, across)
    return 0.9 * a, delta, v_delta


@given(x=st.floats(-50, 50), y=st.floats(-50, 50), psi=st.floats(-7, 7), margin=st.floats(0.0, 2.0))
def test_rectangles_are_the_body_around_its_centre(x, y, psi, margin):
    states = np.array([[x, y, 0.0, 0.0, psi]])
    corners = rectangles(states, margin=margin)[0]
    assert corners.mean(axis=0) == pytest.approx(centres(states)[0], abs=1e-9)
    ahead = np.array([math.cos(psi), math.sin(psi)])
    along, across = (corners - [x, y]) @ ahead, (corners - [x, y]) @ [-ahead[1], ahead[0]]
    front = FORD_ESCORT.rear_to_centre + FORD_ESCORT.length / 2 + margin
    assert along.max() == pytest.approx(front, abs=1e-9)
    assert along.min() == pytest.approx(front - FORD_ESCORT.length - 2 * margin, abs=1e-9)
    assert (across.max(), across.min()) == pytest.approx((0.837 + margin, -0.837 - margin))


def test_rectangle_is_a_simple_polygon_of_the_vehicles_size():
    body = shapely.Polygon(rectangles(np.array([[1.0, 2.0, 0.1, 3.0, 0.7]]))[0])
    assert body.is_valid and body.exterior.is_ccw
    assert body.area == pytest.approx(4.298 * 1.674)


def test_front_and_rear_are_measured_from_the_rear_axle():
    assert FORD_ESCORT.front + FORD_ESCORT.rear == pytest.approx(FORD_ESCORT.length)
    assert FORD_ESCORT.front - FORD_ESCORT.rear == pytest.approx(2 * FORD_ESCORT.rear_to_centre)


# -- trajectories ---------------------------------------------------------------------------------


@pytest.fixture
def ten() -> Trajectory:
    """A drive over time steps 5..15."""
    inputs = np.column_stack([np.linspace(-1, 1, 10), np.linspace(0.1, -0.1, 10)])
    return simulate([0, 0, 0, 10, 0], inputs, DT, first_step=5)


def test_parts_of_a_trajectory_join_to_the_whole(ten):
    whole = ten.until(9).then(ten.since(9))
    assert np.array_equal(whole.states, ten.states)
    assert np.array_equal(whole.inputs, ten.inputs)
    assert (whole.first_step, whole.last_step, len(whole)) == (5, 15, 11)
    assert whole.steps.tolist() == list(range(5, 16))


@pytest.mark.parametrize("outside", [4, 16])
def test_steps_outside_of_a_trajectory_are_refused(ten, outside):
    for method in (ten.state_at, ten.since, ten.until):
        with pytest.raises(IndexError, match=rf"step {outside} outside \[5, 15\]"):
            method(outside)


def test_a_gap_between_parts_is_refused(ten):
    with pytest.raises(ValueError, match="continues at 10, expected 9"):
        ten.until(9).then(ten.since(10))


@pytest.mark.parametrize(("states", "inputs"), [((3, 4), (2, 2)), ((3, 5), (3, 2)), ((3,), (2, 2))])
def test_shapes_that_do_not_fit_are_refused(states, inputs):
    with pytest.raises(ValueError, match="must be"):
        Trajectory(0, np.zeros(states), np.zeros(inputs), DT)
