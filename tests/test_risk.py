"""When to plan again sooner: bends, closeness, crossings; and that the closed loop does."""

from pathlib import Path

import numpy as np
import pytest
from reference_ocp import Track, forecast_of, frame_of, road_of, state_at, straight, straight_across

from mpcplan.config import Config, RiskConfig
from mpcplan.observation import Forecast, Observation, Snapshot
from mpcplan.predict.occupancy import occupancy
from mpcplan.risk import risks
from mpcplan.road.goal import GoalWindow
from mpcplan.scenario import load
from mpcplan.simulate.loop import drive

FOLDER = Path(__file__).resolve().parents[1] / "scenarios"
FREE = GoalWindow(40, 40, None, None, None, None)


def told(forecast: Forecast, curvature=straight, s: float = 30.0) -> tuple[str, ...]:
    """The risks of a vehicle on a road among others."""
    frame = frame_of(curvature, 200.0)
    snapshot = Snapshot(0, forecast.ids, forecast.boxes[:, 0])
    seen = Observation(0, state_at(frame, s), 0.0, (snapshot,))
    return risks(road_of(frame, FREE), seen, occupancy(forecast, frame), RiskConfig())


def others(*tracks: Track, curvature=straight) -> Forecast:
    """Those who drive along a road."""
    return forecast_of(frame_of(curvature, 200.0), 40, *tracks)


def crossing(s: float) -> Forecast:
    """Somebody from the right who crosses at an arc length."""
    return straight_across(frame_of(straight, 200.0), s, -20.0, 8.0, np.pi / 2)


def bend(s):
    """Straight for 50 m, then a radius of 10 m."""
    return 0.1 * np.clip(s - 50.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("forecast", "curvature", "s", "reason"),
    [
        (others(Track(60.0, 0.0, 8.0)), straight, 30.0, None),
        (others(), bend, 10.0, None),
        (others(), bend, 30.0, "a bend of 10 m"),
        (others(Track(38.0, 0.0, 8.0)), straight, 30.0, "obstacle 10 is 2."),
        (others(Track(80.0, 0.0, 8.0), Track(33.0, 3.0, 8.0)), straight, 30.0, "obstacle 11 is"),
        (crossing(55.0), straight, 30.0, "others will cross within 27 m"),
        (crossing(80.0), straight, 30.0, None),
    ],
)
def test_what_counts_as_risk(forecast, curvature, s, reason):
    found = told(forecast, curvature, s)
    assert len(found) == (reason is not None)
    if reason is not None:
        assert found[0].startswith(reason)


@pytest.mark.parametrize("replan", [0.1, 0.3])
def test_where_there_is_risk_the_next_plan_comes_sooner(replan):
    loaded = load(FOLDER / "ZAM_TightCurve-1_1_T-1.xml")
    config = Config()
    config = config.model_copy(
        update={
            "risk": config.risk.model_copy(update={"replan": replan, "curvature": 0.03}),
            "drive": config.drive.model_copy(update={"steps_max": 60}),
        }
    )
    run = drive(loaded, config)
    cycles = run.drives[0].cycles
    steps = np.diff([cycle.step for cycle in cycles])
    risky = np.array([bool(cycle.plan.trace["risks"]) for cycle in cycles[:-1]])
    assert np.all(steps[~risky] == 3)
    assert np.all(steps[risky] == 1)
    assert risky.any() == (replan < 0.3)
