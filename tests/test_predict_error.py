"""Displacement errors: what is compared with what, and what the summary says of it."""

import numpy as np
import pytest
from made_lanes import CAR, DT, straight_road

from mpcplan.config import PredictConfig
from mpcplan.observation import Box, Forecast, Observation, Snapshot, as_forecast
from mpcplan.predict.constant_input import ConstantInput
from mpcplan.predict.error import ErrorRow, ErrorSummary, displacement_errors, summary
from mpcplan.predict.lane_follow import LaneFollow
from mpcplan.predict.recorded import Recorded
from mpcplan.trajectory import Trajectory

UNKNOWN = [pytest.approx(np.nan, nan_ok=True)] * 2  # spreads where nobody is predicted to move
FIRST = 7  # time step at which the run begins


def run(steps: int, *speeds: float, a: float = 0.0, kinds: tuple[str, ...] = ()) -> list[Snapshot]:
    """Vehicles 1, 2, ... side by side along x, all with an acceleration [m/s^2]."""
    snapshots = []
    for k in range(steps):
        t = k * DT
        boxes = [
            [v * t + a * t * t / 2, 10.0 * i, 0, v + a * t, *CAR] for i, v in enumerate(speeds)
        ]
        ids = tuple(range(1, len(speeds) + 1))
        snapshots.append(Snapshot(FIRST + k, ids, np.array(boxes, float).reshape(-1, 6), kinds))
    return snapshots


def ego(steps: int, v: float = 8.0, a: float = 0.0) -> Trajectory:
    """An ego vehicle along x, 50 m to the side."""
    t = DT * np.arange(steps)
    zero = np.zeros(steps)
    states = np.column_stack([v * t + a * t * t / 2, zero - 50, zero, v + a * t, zero])
    return Trajectory(FIRST, states, np.tile([a, 0.0], (steps - 1, 1)), DT)


class StandsStill:
    """Predicts that nobody moves, and keeps what it was given."""

    def __init__(self) -> None:
        self.given: list[Observation] = []

    def __call__(self, observation: Observation) -> Forecast:
        """The present boxes for five seconds."""
        self.given.append(observation)
        now = observation.now
        return Forecast(now.step, now.ids, np.repeat(now.boxes[:, None], 51, axis=1))


def test_an_exact_prediction_has_no_error():
    snapshots = run(60, 9.0, 4.0, a=0.5)
    rows = displacement_errors(Recorded(as_forecast(snapshots)), snapshots, ego(60), DT)
    assert len(rows) > 20 and max(row.distance for row in rows) < 1e-9


def test_the_error_is_the_distance_of_the_centres():
    """Nobody moves, it says: after t seconds the error is v t."""
    rows = displacement_errors(StandsStill(), run(41, 9.0, 4.0), ego(41), DT, every=10)
    expected = []
    for begin in (0, 10, 20, 30):
        for v in (9.0, 4.0):
            expected += [("unknown", s, v * s) for s in (1.0, 2.0, 3.0) if begin + 10 * s <= 40]
    found = sorted(tuple(row)[:3] for row in rows)
    assert [row[:2] for row in found] == [row[:2] for row in sorted(expected)]
    assert [row[2] for row in found] == pytest.approx([row[2] for row in sorted(expected)])


def test_constant_input_misses_what_changes():
    """From the second box on it knows the acceleration; from the first it does not: a t^2 / 2."""
    rows = displacement_errors(
        ConstantInput(PredictConfig(), DT), run(41, 9.0, a=1.0), ego(41), DT, every=100
    )
    assert [row.distance for row in rows] == pytest.approx([0.5, 2.0, 4.5])


def test_the_observation_is_that_of_the_closed_loop():
    asked = StandsStill()
    displacement_errors(asked, run(60, 9.0), ego(60, 8.0, 0.5), DT, every=20)
    assert [o.step for o in asked.given] == [FIRST, FIRST + 20, FIRST + 40]
    assert [len(o.others) for o in asked.given] == [1, 11, 11]
    assert [o.acceleration for o in asked.given] == [0.0, 0.5, 0.5]
    assert asked.given[1].others[0].step == FIRST + 10
    assert asked.given[1].state == pytest.approx(ego(60, 8.0, 0.5).states[20])


def test_who_is_gone_or_left_out_is_not_counted():
    snapshots = run(41, 9.0, 4.0)
    gone = [
        s if s.step < FIRST + 15 else Snapshot(s.step, s.ids[:1], s.boxes[:1]) for s in snapshots
    ]
    rows = displacement_errors(StandsStill(), gone, ego(41), DT, every=100)
    assert sorted(row.seconds for row in rows) == [1.0, 1.0, 2.0, 3.0]

    def leaves_out(observation: Observation) -> Forecast:
        forecast = StandsStill()(observation)
        forecast.boxes[1, 1:] = np.nan
        return forecast

    rows = displacement_errors(leaves_out, snapshots, ego(41), DT, every=100)
    assert [row.distance for row in rows] == pytest.approx([9.0, 18.0, 27.0])


def test_of_several_hypotheses_the_first_counts():
    def two(observation: Observation) -> Forecast:
        one = StandsStill()(observation)
        far = one.boxes + 100.0
        return Forecast(one.first_step, (*one.ids, *one.ids), np.concatenate([one.boxes, far]))

    rows = displacement_errors(two, run(41, 9.0), ego(41), DT, every=100)
    assert [row.distance for row in rows] == pytest.approx([9.0, 18.0, 27.0])


@pytest.mark.parametrize("snapshots", [[], run(41), run(8, 5.0)], ids=["none", "empty", "short"])
def test_no_run_no_errors(snapshots):
    assert displacement_errors(StandsStill(), snapshots, ego(41), DT) == []


def test_on_a_lane_lane_follow_is_better_than_constant_input():
    """A car that has braked for a moment and then goes on."""
    snapshots, x, v = [], 0.0, 15.0
    for k in range(80):
        box = np.array([[x, 0, 0, v, *CAR]])
        snapshots.append(Snapshot(FIRST + k, (1,), box, ("car",)))
        a = -3.0 if k < 10 else 2.0
        x, v = x + v * DT + a * DT * DT / 2, v + a * DT
    config = PredictConfig(leave_out_followers=False)
    errors = [
        displacement_errors(predictor, snapshots, ego(80), DT)
        for predictor in (LaneFollow(straight_road(), config, DT), ConstantInput(config, DT))
    ]
    mean = [np.mean([row.distance for row in rows if row.seconds == 3.0]) for rows in errors]
    assert len(errors[0]) == len(errors[1]) and mean[0] < mean[1]


def test_the_spread_is_the_error_along_the_way_over_the_predicted_way():
    """At 9 m/s and 1 m/s^2 constant_input, which knows no acceleration yet, is t^2 / 2 behind after
    9 t; who drives 0.3 m/s has hardly any way in three seconds, and no spread."""
    rows = displacement_errors(
        ConstantInput(PredictConfig(), DT), run(41, 9.0, 0.3, a=1.0), ego(41), DT, every=100
    )
    spread = {row.seconds: row.spread for row in rows if np.isfinite(row.spread)}
    assert spread == pytest.approx({t: t**2 / 2 / (9 * t) for t in (1.0, 2.0, 3.0)})
    assert sum(np.isnan(row.spread) for row in rows) == 3


def test_an_error_to_the_side_is_no_spread():
    def aside(observation: Observation) -> Forecast:
        known = Recorded(as_forecast(run(60, 9.0)))(observation)
        boxes = known.boxes.copy()
        boxes[:, 1:, Box.Y] += 2.0
        return Forecast(known.first_step, known.ids, boxes)

    rows = displacement_errors(aside, run(60, 9.0), ego(60), DT, every=20)
    assert rows and [row.distance for row in rows] == pytest.approx([2.0] * len(rows))
    assert [row.spread for row in rows] == pytest.approx([0.0] * len(rows), abs=1e-12)


def test_the_summary_by_kind_and_time():
    rows = [ErrorRow("car", 1.0, d, d / 10) for d in (1.0, 2.0, 6.0)]
    rows += [ErrorRow("bus", 1.0, 4.0), ErrorRow("car", 2.0, 5.0)]
    assert summary(rows) == [
        ErrorSummary("car", 1.0, 3, 3.0, 2.0, pytest.approx(5.6), 0.2, pytest.approx(0.52)),
        ErrorSummary("car", 2.0, 1, 5.0, 5.0, 5.0, *UNKNOWN),
        ErrorSummary("bus", 1.0, 1, 4.0, 4.0, 4.0, *UNKNOWN),
        ErrorSummary("all", 1.0, 4, 3.25, 3.0, pytest.approx(5.7), 0.2, pytest.approx(0.52)),
        ErrorSummary("all", 2.0, 1, 5.0, 5.0, 5.0, *UNKNOWN),
    ]
    assert summary([]) == []


def test_kinds_are_those_of_the_snapshot():
    snapshots = run(30, 9.0, 4.0, kinds=("bicycle", "truck"))
    rows = displacement_errors(StandsStill(), snapshots, ego(30), DT, every=100)
    by_kind = {(row.kind, row.seconds): row.distance for row in rows}
    assert by_kind["bicycle", 1.0] == pytest.approx(9.0)
    assert by_kind["truck", 2.0] == pytest.approx(8.0)
    assert snapshots[0].boxes[0, Box.V] == 9.0
