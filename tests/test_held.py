"""How those who stand answer a plan: nobody drives into a body that is before him."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from reference_ocp import straight_road

from mpcplan.config import Config
from mpcplan.config.files import load_config
from mpcplan.observation import Box, Forecast
from mpcplan.trajectory import Trajectory
from mpcplan.vehicle import FORD_ESCORT, simulate
from mpcplan.verify.drivability import separation
from mpcplan.verify.guard import Guard
from mpcplan.verify.held import CREEPS, HARDEST, held

DT, COUNT = 0.1, 80
SIZE = (4.5, 1.8)  # m
ACROSS = 6.0  # m, before the centre of who stands the plan crosses his way


def guessed(*starts: tuple[float, float], a: float = 2.0, v: float = 0.0) -> Forecast:
    """Cars along x from (x, time at which it begins to accelerate [s])."""
    t = DT * np.arange(COUNT + 1)
    boxes = np.zeros((len(starts), COUNT + 1, len(Box)))
    for row, (x, begin) in enumerate(starts):
        later = np.maximum(t - begin, 0.0)
        boxes[row, :, Box.X] = x + v * t + a * later**2 / 2
        boxes[row, :, Box.V] = v + a * later
    boxes[..., Box.LENGTH], boxes[..., Box.WIDTH] = SIZE
    return Forecast(0, tuple(range(1, len(starts) + 1)), boxes)


def crossing_plan(y: float, v: float, stops: float | None = None) -> Trajectory:
    """From (ACROSS, y) to the north; ``stops``: time [s] from which it brakes to a standstill."""
    a = np.zeros(COUNT)
    if stops is not None:
        count = math.ceil(v / (3.0 * DT))
        a[round(stops / DT) :][:count] = -v / (count * DT)
    state = [ACROSS, y, 0.0, v, math.pi / 2]
    return simulate(state, np.column_stack([a, np.zeros(COUNT)]), DT)


def way(forecast: Forecast, row: int = 0) -> np.ndarray:
    """How far a row has come [m]."""
    return forecast.boxes[row, :, Box.X] - forecast.boxes[row, 0, Box.X]


def gap(plan: Trajectory, forecast: Forecast, row: int = 0) -> float:
    """The smallest one between a plan and a row [m]."""
    return float(separation(plan.states, forecast.at(plan.steps)[row : row + 1]).min())


def test_who_stands_lets_pass_who_is_before_him_first():
    guess, plan = guessed((0.0, 1.0)), crossing_plan(-6.0, 2.0)
    assert gap(plan, guess) < 0
    answer = held(guess, plan)
    assert gap(plan, answer) > 0.0
    assert way(answer)[-1] > 20  # he has gone on since
    assert way(answer)[-1] < way(guess)[-1]


def test_who_is_gone_before_answers_nothing():
    guess = guessed((0.0, 0.0))
    assert held(guess, crossing_plan(-25.0, 3.0)) is guess


def test_who_is_not_in_the_way_holds_nobody_up():
    guess = guessed((0.0, 0.0))
    aside = simulate([ACROSS, 4.0, 0, 3, 0], np.zeros((COUNT, 2)), DT)  # along a lane beside
    assert held(guess, aside) is guess


def test_who_stops_in_the_way_holds_up_for_ever():
    guess, plan = guessed((0.0, 1.0)), crossing_plan(-6.0, 2.0, stops=1.5)
    answer = held(guess, plan)
    assert gap(plan, answer) > 0.0
    assert answer.boxes[0, -1, Box.V] == pytest.approx(0.0, abs=1e-6)
    assert way(answer)[-1] == pytest.approx(ACROSS - 0.8 - SIZE[0] / 2 - 0.5, abs=0.3)


def test_who_stands_behind_is_as_late():
    guess, plan = guessed((0.0, 1.0), (-6.0, 1.4)), crossing_plan(-6.0, 2.0, stops=1.5)
    answer = held(guess, plan)
    apart = answer.boxes[0, :, Box.X] - answer.boxes[1, :, Box.X]
    assert apart.min() > SIZE[0] and way(guess, 1)[-1] - way(answer, 1)[-1] > 20


def test_who_stands_elsewhere_is_not_late():
    guess = guessed((0.0, 1.0), (-40.0, 1.0))
    answer = held(guess, crossing_plan(-6.0, 2.0, stops=1.5))
    assert np.array_equal(answer.boxes[1], guess.boxes[1])


@pytest.mark.parametrize("v", [0.0, CREEPS - 0.1, CREEPS + 0.1])
def test_only_who_is_slow_answers(v):
    guess = guessed((0.0, 1.0), v=v)
    assert (held(guess, crossing_plan(-6.0, 2.0)) is guess) is (v > CREEPS)


def test_what_is_known_is_no_answer():
    guess = guessed((0.0, 1.0))
    known = Forecast(0, guess.ids, guess.boxes, exact=True)
    assert held(known, crossing_plan(-6.0, 2.0)) is known


def test_other_hypotheses_end_as_soon_as_before():
    guess = guessed((0.0, 1.0))
    guess.boxes[0, 31:] = np.nan
    answer = held(guess, crossing_plan(-6.0, 2.0))
    assert np.isfinite(answer.boxes[0, :31]).all() and np.isnan(answer.boxes[0, 31:]).all()
    whole = held(guessed((0.0, 1.0)), crossing_plan(-6.0, 2.0))
    assert answer.boxes[0, :20] == pytest.approx(whole.boxes[0, :20])


@settings(deadline=None)
@given(
    y=st.floats(-12, -3), v=st.floats(0.5, 6), begin=st.floats(0, 4), slow=st.floats(0, 1.9),
    stops=st.none() | st.floats(0.1, 5),
)  # fmt: skip
def test_an_answer_is_never_ahead_of_the_guess_and_brakes_as_one_can(y, v, begin, slow, stops):
    guess = guessed((0.0, begin), v=slow)
    plan = crossing_plan(y, v, stops)
    answer = held(guess, plan)
    assert np.array_equal(answer.boxes[:, 0], guess.boxes[:, 0])
    assert (way(answer) <= way(guess) + 1e-9).all()
    steps = np.diff(way(answer))
    assert steps.min() > -1e-9
    assert np.diff(steps).min() / DT**2 > -HARDEST - 0.5


@settings(deadline=None)
@given(
    y=st.floats(-9, -3), v=st.floats(0.5, 6), spare=st.floats(0, 3),
    stops=st.none() | st.floats(0.1, 5),
)  # fmt: skip
def test_who_is_before_him_when_he_sets_off_is_not_touched(y, v, spare, stops):
    plan = crossing_plan(y, v, stops)
    before = plan.states[:, 1] + FORD_ESCORT.front > -SIZE[1] / 2
    assume(before.any())
    guess = guessed((0.0, DT * float(before.argmax()) + spare))
    assert gap(plan, held(guess, plan)) > 0.0


def test_verification_counts_on_the_answer_only_if_asked_to():
    guess = guessed((50.0, 1.0))
    plan = simulate([50.0 + ACROSS, -6.0, 0, 2, math.pi / 2], np.zeros((40, 2)), DT)
    road = replace(straight_road(), area=straight_road().area.buffer(60))
    asked = load_config(overrides=["verify.held=true"])
    for config, ok in ((Config.model_validate({"verify": {"held": False}}), False), (asked, True)):
        guard = Guard(config, DT)
        assert guard.verify(plan, road, guess, 0).ok is ok
        assert (guard.answer(guess, plan) is guess) is not ok
