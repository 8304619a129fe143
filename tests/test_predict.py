"""Prediction: recorded traffic, constant input, and what neither may know."""

import inspect
import math
from dataclasses import replace
from pathlib import Path

import made
import numpy as np
import pytest
from commonroad.common.file_reader import CommonRoadFileReader
from commonroad.geometry.shape import Rectangle
from commonroad.scenario.obstacle import ObstacleType, StaticObstacle
from reference_ocp import DT, Track, forecast_of, frame_of, occupancy_of, straight

from mpcplan.config import PredictConfig
from mpcplan.errors import InputError
from mpcplan.observation import Box, Forecast, Observation, Snapshot
from mpcplan.predict.constant_input import ConstantInput
from mpcplan.predict.lane_follow import LaneFollow
from mpcplan.predict.lateness import LateEgo
from mpcplan.predict.occupancy import occupancy
from mpcplan.predict.predictor import make_predictor
from mpcplan.predict.recorded import Recorded, record, static_ids
from mpcplan.scenario import load
from mpcplan.simulate.recorded import RecordedTraffic
from mpcplan.task import Task, task_of

FOLDER = Path(__file__).resolve().parents[1] / "scenarios"
PATHS = sorted(FOLDER.glob("*.xml"))
EGO = np.array([0.0, 0.0, 0.0, 10.0, 0.0])


def observed(*snapshots: Snapshot) -> Observation:
    """What a planner sees after these snapshots."""
    return Observation(snapshots[-1].step, EGO, 0.0, snapshots)


def watched(x, y, psi, v, steps: int = 5, number: int = 7) -> Observation:
    """Snapshots of one car at functions of time t = 0, 0.1, ... [s]."""
    snapshots = []
    for k in range(steps):
        t = k * DT
        box = np.array([[x(t), y(t), psi(t), v(t), 4.5, 1.8]])
        snapshots.append(Snapshot(20 + k, (number,), box))
    return observed(*snapshots)


def predicted(observation: Observation, **changes: float) -> Forecast:
    """Constant input's forecast."""
    return ConstantInput(PredictConfig(kind="constant_input", **changes), DT)(observation)


# -- recorded -------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_the_record_is_the_file(path):
    """Position, heading, speed and size of every obstacle at every step, off by the origin."""
    scenario, _ = CommonRoadFileReader(path).open()
    loaded = load(path)
    recorded = record(loaded.scenario)
    assert sorted(recorded.ids) == sorted(o.obstacle_id for o in scenario.obstacles)
    for obstacle in scenario.obstacles:
        boxes = recorded.boxes[recorded.ids.index(obstacle.obstacle_id)]
        for step in (0, 1, 17, recorded.last_step):
            state, box = obstacle.state_at_time(step), boxes[step]
            if state is None:
                assert np.isnan(box).all()
                continue
            assert box[[Box.X, Box.Y]] + loaded.origin == pytest.approx(state.position, abs=1e-6)
            assert box[Box.PSI] == pytest.approx(state.orientation)
            shape = obstacle.obstacle_shape
            assert box[[Box.LENGTH, Box.WIDTH]].tolist() == [shape.length, shape.width]
            if obstacle.obstacle_id not in static_ids(loaded.scenario):
                assert box[Box.V] == pytest.approx(state.velocity)


def test_the_recorded_predictor_answers_the_record_at_every_step():
    scenario = load(FOLDER / "ZAM_CutIn-1_1_T-1.xml").scenario
    predictor, traffic = Recorded(record(scenario)), RecordedTraffic(scenario)
    for step in (0, 30):
        forecast = predictor(observed(traffic.at(step)))
        boxes = forecast.at(np.arange(step, step + 10))
        assert np.array_equal(boxes, record(scenario).boxes[:, step : step + 10])


@pytest.mark.parametrize("dynamic", [[], [made.car(30, 40, 1.75, 8, steps=10)]])
def test_static_obstacles_stay_for_ever(tmp_path, dynamic):
    """Longer than any recording: what stands there stands there."""
    shape = Rectangle(2.0, 7.0)
    wall = StaticObstacle(55, ObstacleType.CONSTRUCTION_ZONE, shape, made.state(60, 3.5, 0))
    scenario = load(made.write(tmp_path, obstacles=[*dynamic, wall])).scenario
    traffic, recorded = RecordedTraffic(scenario), record(scenario)
    for step in (0, 1, 2, 11, 40, 250):
        assert 55 in traffic.at(step).ids
        box = recorded.at(np.array([step]))[recorded.ids.index(55), 0]
        assert box[[Box.LENGTH, Box.WIDTH]].tolist() == [2.0, 7.0]
    around = occupancy(recorded, frame_of(straight, 100.0)).window(200, 20)
    assert np.isfinite(around.s[recorded.ids.index(55)]).all()
    assert 30 not in traffic.at(40).ids


def test_snapshots_hold_those_who_are_there():
    scenario = load(FOLDER / "ZAM_StaticBlock-1_1_T-1.xml").scenario
    recorded, traffic = record(scenario), RecordedTraffic(scenario)
    now = traffic.at(12)
    assert now.step == 12 and set(now.ids) == set(recorded.ids)
    for number in now.ids:
        row = recorded.ids.index(number)
        assert np.array_equal(now.box_of(number), recorded.boxes[row, 12])
    assert now.box_of(-1) is None
    after = traffic.at(recorded.last_step + 500)
    assert set(after.ids) <= set(now.ids)


def test_beyond_the_forecast_nothing_is_known():
    forecast = forecast_of(frame_of(straight, 50.0), 10, Track(20.0, 0.0, 5.0))
    boxes = forecast.at(np.array([-1, 0, 10, 11]))
    assert np.isnan(boxes[0, [0, 3]]).all() and np.isfinite(boxes[0, [1, 2]]).all()
    assert (forecast.first_step, forecast.last_step) == (0, 10)


# -- constant input -------------------------------------------------------------------------------


def zero(_: float) -> float:
    """Nothing."""
    return 0.0


def test_straight_on_at_constant_speed():
    forecast = predicted(watched(lambda t: 5 + 12 * t, zero, zero, lambda t: 12.0))
    t = DT * np.arange(31)
    assert (forecast.first_step, forecast.last_step, forecast.ids) == (24, 54, (7,))
    assert forecast.boxes[0, :, Box.X] == pytest.approx(5 + 12 * 0.4 + 12 * t)
    assert forecast.boxes[0, :, Box.Y] == pytest.approx(0.0, abs=1e-9)
    assert (forecast.boxes[0, :, Box.LENGTH] == 4.5).all()
    assert (forecast.boxes[0, :, Box.WIDTH] == 1.8).all()


def test_braking_ends_at_rest():
    observation = watched(lambda t: 8 * t - 2 * t**2, zero, zero, lambda t: 8.0 - 4 * t)
    boxes = predicted(observation).boxes[0]
    t = DT * np.arange(31)
    speed = np.maximum(6.4 - 4 * t, 0.0)
    assert boxes[:, Box.V] == pytest.approx(speed)
    # Euler's steps with the speed at their beginning, as in the formula
    way = boxes[0, Box.X] + np.concatenate([[0.0], np.cumsum(speed[:-1] * DT)])
    assert boxes[:, Box.X] == pytest.approx(way)
    assert np.ptp(boxes[17:, Box.X]) == pytest.approx(0.0)


def test_acceleration_goes_on():
    boxes = predicted(watched(zero, zero, zero, lambda t: 3 + 2 * t)).boxes[0]
    assert boxes[:, Box.V] == pytest.approx(3.8 + 2 * DT * np.arange(31))


def test_turning_is_a_circle():
    w, v, radius = 0.4, 8.0, 20.0
    observation = watched(
        lambda t: radius * math.sin(w * t), lambda t: radius * (1 - math.cos(w * t)),
        lambda t: w * t, lambda t: v,
    )  # fmt: skip
    boxes = predicted(observation).boxes[0]
    angle = w * (0.4 + DT * np.arange(31))
    assert boxes[:, Box.PSI] == pytest.approx(angle)
    circle = radius * np.column_stack([np.sin(angle), 1 - np.cos(angle)])
    error = np.hypot(*(boxes[:, [Box.X, Box.Y]] - circle).T)
    assert error.max() < v * w * DT / 2 * 3.0 + 1e-6  # Euler's steps fall behind linearly
    x, y = boxes[0, Box.X], boxes[0, Box.Y]
    for k in range(30):
        assert (x, y) == pytest.approx((boxes[k, Box.X], boxes[k, Box.Y]))
        x, y = x + v * math.cos(angle[k]) * DT, y + v * math.sin(angle[k]) * DT


def test_headings_across_pi_do_not_spin():
    observation = watched(
        lambda t: -9 * t, zero, lambda t: (math.pi - 0.02 + 0.2 * t + math.pi) % (2 * math.pi)
        - math.pi, lambda t: 9.0,
    )  # fmt: skip
    psi = np.unwrap(predicted(observation).boxes[0, :, Box.PSI])
    assert np.diff(psi) == pytest.approx(np.full(30, 0.02))


def test_a_standing_car_stays():
    observation = watched(lambda t: 4.0, zero, lambda t: 0.3 * t, zero)
    boxes = predicted(observation).boxes[0]
    assert (boxes == boxes[0]).all()


def test_a_newcomer_goes_straight_on():
    seen = Snapshot(3, (), np.empty((0, 6)))
    now = Snapshot(4, (9,), np.array([[1.0, 2.0, 0.5, 6.0, 4.0, 2.0]]))
    boxes = predicted(observed(seen, now)).boxes[0]
    assert boxes[:, Box.V] == pytest.approx(6.0)
    assert boxes[-1, [Box.X, Box.Y]] == pytest.approx(
        [1 + 18 * math.cos(0.5), 2 + 18 * math.sin(0.5)]
    )


def test_nobody_is_predicted_where_nobody_is():
    forecast = predicted(observed(Snapshot(4, (), np.empty((0, 6)))))
    assert forecast.ids == () and forecast.boxes.shape == (0, 31, 6)


@pytest.mark.parametrize(("history", "expected"), [(2, -6.0), (5, -2.4)])
def test_history_says_how_far_back_is_fitted(history, expected):
    """Constant speed, then one step of braking: the shorter the history, the quicker it shows."""
    observation = watched(zero, zero, zero, lambda t: 10.0 - 6.0 * max(t - 0.3, 0.0))
    boxes = predicted(observation, history=history).boxes[0]
    slope = np.polyfit(DT * np.arange(history), [10.0] * (history - 1) + [9.4], 1)[0]
    assert boxes[1, Box.V] - boxes[0, Box.V] == pytest.approx(slope * DT)
    assert slope == pytest.approx(expected, rel=0.51)


@pytest.mark.parametrize("horizon", [1.0, 3.0, 5.0])
def test_the_horizon_is_the_forecasts_length(horizon):
    forecast = predicted(watched(zero, zero, zero, zero), horizon=horizon)
    assert forecast.last_step - forecast.first_step == round(horizon / DT)


# -- no future ------------------------------------------------------------------------------------


def test_constant_input_never_sees_the_scenario():
    """The predictor is built from configuration and time step alone."""
    assert list(inspect.signature(ConstantInput.__init__).parameters) == ["self", "config", "dt"]


def tasks() -> tuple[Task, Task]:
    """A recorded scenario, and the same with traffic that nobody knows."""
    loaded = load(FOLDER / "ZAM_CutIn-1_1_T-1.xml")
    known = task_of(loaded, loaded.problems[0])
    return known, replace(known, recorded=None)


def test_the_predictor_suits_the_traffic():
    known, unknown = tasks()
    assert isinstance(make_predictor(known, PredictConfig()), Recorded)
    assert isinstance(make_predictor(unknown, PredictConfig()), LaneFollow)
    for task in (known, unknown):
        for kind, made_by in (("constant_input", ConstantInput), ("lane_follow", LaneFollow)):
            assert isinstance(make_predictor(task, PredictConfig(kind=kind)), made_by)


def test_a_record_of_traffic_that_reacts_does_not_exist():
    _, unknown = tasks()
    with pytest.raises(InputError, match=r"predict\.kind is 'recorded'.*choose 'auto'"):
        make_predictor(unknown, PredictConfig(kind="recorded"))


@pytest.mark.parametrize("kind", ["constant_input", "lane_follow"])
def test_guesses_depend_on_the_observation_only(kind):
    """The recorded trajectories may say what they like."""
    loaded = load(FOLDER / "ZAM_CutIn-1_1_T-1.xml")
    config = PredictConfig(kind=kind)
    traffic = RecordedTraffic(loaded.scenario)
    seen = observed(*(traffic.at(step) for step in range(10, 16)))
    before = make_predictor(task_of(loaded, loaded.problems[0]), config)(seen)
    for obstacle in loaded.scenario.dynamic_obstacles:
        for state in obstacle.prediction.trajectory.state_list:
            state.position = state.position + [500.0, -300.0]
    after = make_predictor(task_of(loaded, loaded.problems[0]), config)(seen)
    assert before.ids == after.ids
    assert np.array_equal(before.boxes, after.boxes, equal_nan=True)


def test_an_observation_holds_nothing_after_its_step():
    seen = observed(*(RecordedTraffic(load(PATHS[0]).scenario).at(step) for step in range(5)))
    assert seen.now.step == seen.step == 4
    assert [snapshot.step for snapshot in seen.others] == [0, 1, 2, 3, 4]


# -- occupancy ------------------------------------------------------------------------------------


def test_occupancy_on_a_straight_road_is_the_boxes():
    frame = frame_of(straight, 100.0)
    around = occupancy_of(frame, 10, Track(40.0, 1.0, 5.0), Track(60.0, -2.0, 3.0, turn=math.pi))
    assert around.ids == (10, 11)
    assert around.s[0] == pytest.approx(40 + 0.5 * np.arange(11))
    assert around.d[1] == pytest.approx(-2.0)
    assert (around.s_low[0, 0], around.s_high[0, 0]) == pytest.approx((37.75, 42.25))
    assert (around.d_low[0, 0], around.d_high[0, 0]) == pytest.approx((0.1, 1.9))
    assert around.v[:, 0] == pytest.approx([5.0, -3.0])
    assert np.cos(around.turn[:, 0]) == pytest.approx([1.0, -1.0])


def test_occupancy_windows_are_cut_and_padded():
    around = occupancy_of(frame_of(straight, 100.0), 10, Track(40.0, 0.0, 5.0))
    cut = around.window(8, 5)
    assert (cut.first_step, cut.s.shape) == (8, (1, 5))
    assert cut.s[0, :3] == pytest.approx(around.s[0, 8:])
    assert np.isnan(cut.s[0, 3:]).all() and np.isnan(cut.d_high[0, 3:]).all()


def test_far_away_obstacles_are_left_out():
    frame = frame_of(straight, 100.0)
    far = Forecast(0, (3,), np.tile([5000.0, 0.0, 0.0, 1.0, 4.0, 2.0], (1, 4, 1)))
    assert np.isnan(occupancy(far, frame).s).all()


def bend(s):
    """A left turn of 25 m radius."""
    return 0.0 * s + 1 / 25


def test_occupancy_covers_a_long_vehicle_in_a_bend():
    """Every point of its outline lies within the extents, not its corners alone."""
    frame = frame_of(bend, 60.0)
    forecast = forecast_of(frame, 0, Track(30.0, -2.0, 0.0, length=12.0, width=2.5))
    around = occupancy_of(frame, 0, Track(30.0, -2.0, 0.0, length=12.0, width=2.5))
    x, y, psi = forecast.boxes[0, 0, :3]
    along = np.linspace(-6.0, 6.0, 41)
    for side in (-1.25, 1.25):
        points = np.column_stack([
            x + along * math.cos(psi) - side * math.sin(psi),
            y + along * math.sin(psi) + side * math.cos(psi),
        ])  # fmt: skip
        s, d = frame.to_frenet(points)
        assert around.s_low[0, 0] - 0.02 <= s.min() and s.max() <= around.s_high[0, 0] + 0.02
        assert around.d_low[0, 0] - 0.02 <= d.min() and d.max() <= around.d_high[0, 0] + 0.02


def test_occupancy_until_a_time_step_keeps_those_that_stand():
    boxes = np.repeat([[[30.0, 0, 0, 5, 4, 2]], [[60.0, 0, 0, 0, 4, 2]]], 21, axis=1)
    forecast = Forecast(10, (1, 2), boxes, np.array([False, True]))
    near = occupancy(forecast, frame_of(straight, 100.0)).until(15)
    seen = near.window(10, 30)
    assert np.isfinite(seen.s[0]).tolist() == [True] * 6 + [False] * 24
    assert np.isfinite(seen.s[1]).all()


def test_boxes_for_a_late_ego_vehicle_cover_what_they_cover_a_step_later():
    seen = watched(lambda t: 10 * t, lambda t: 0, lambda t: 0.0, lambda t: 10.0)
    plain = ConstantInput(PredictConfig(), DT)(seen)
    task = Task(None, None, None, DT, None)
    config = PredictConfig(kind="constant_input", lateness=DT)
    predictor = make_predictor(task, config)
    late = predictor(seen)
    assert np.array_equal(late.boxes[:, 0], plain.boxes[:, 0])  # seen, not guessed
    rear, front = (late.boxes[0, 1:, Box.X] + sign * late.boxes[0, 1:, Box.LENGTH] / 2
                   for sign in (-1, 1))  # fmt: skip
    centre, half = plain.boxes[0, :, Box.X], 4.5 / 2
    assert rear == pytest.approx(centre[1:] - half)
    assert front[:-1] == pytest.approx(centre[2:] + half)
    assert late.boxes[0, :, Box.WIDTH] == pytest.approx(1.8)


def test_the_same_forecast_is_extended_once():
    seen = watched(lambda t: 10 * t, lambda t: 0, lambda t: 0.0, lambda t: 10.0)
    known = ConstantInput(PredictConfig(), DT)(seen)
    late = LateEgo(lambda _: known, DT)
    assert late(seen) is late(seen)  # who compares forecasts sees that nothing is new
