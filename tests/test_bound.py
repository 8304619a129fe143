"""The clairvoyant optimum: enumeration of ways, the solvers of the whole problem, the bound."""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
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
from reference_ocp import straight_road as road_of_goals
from test_refine import ACCURATE, busy_problem, keeping_seed, problem_of, sine, with_refine

from mpcplan.bound.clairvoyant import Clairvoyant
from mpcplan.bound.enumerate import cheapest, ways_on
from mpcplan.config import Config
from mpcplan.predict.occupancy import Occupancy, occupancy
from mpcplan.refine.sqp import solve
from mpcplan.refine.stage import Given, Point, body_offset, body_offset_at, point_at
from mpcplan.refine.whole import PLUGINS, solve_whole
from mpcplan.road.goal import GoalWindow
from mpcplan.scenario import load
from mpcplan.seed.blocked import block
from mpcplan.seed.paths import BODY_POINTS, frenet_pose, sample_paths
from mpcplan.seed.seed import Stage
from mpcplan.seed.ways import Way, find_ways
from mpcplan.simulate.loop import drive
from mpcplan.task import task_of

ROOT = Path(__file__).resolve().parents[1]
LANE_CHANGE = ROOT / "scenarios" / "ZAM_LaneChange-1_1_T-1.xml"
BRIEF = {"refined": 3, "polished": 1, "rounds": 1}  # enough to see that it works


# -- the whole problem ----------------------------------------------------------------------------


@pytest.mark.parametrize("plugin", PLUGINS)
@pytest.mark.parametrize(("goal", "n"), [(True, 12), (False, 30)])
def test_solvers_of_the_whole_problem_agree_with_sqp(plugin, goal, n):
    """Three methods, one optimum."""
    problem = busy_problem(goal, n)
    expected = solve(problem, ACCURATE.refine)
    found = solve_whole(problem, plugin, 500)
    assert found.ok
    point = problem.at(found.z)
    assert point.cost == pytest.approx(expected.cost_after, rel=1e-6)
    assert np.abs(point.defects).max() < 1e-6
    assert point.hard < 1e-6
    assert found.z.x == pytest.approx(expected.z.x, abs=2e-3)


@pytest.mark.parametrize("plugin", PLUGINS)
def test_a_backend_of_the_whole_problem_refines(plugin):
    problem = busy_problem(True, 12)
    config = with_refine(Config(), fresh_backend=plugin)
    result = solve(problem, config.refine)
    assert result.status == "converged"
    assert result.kkt.stationarity < 1e-2 and result.kkt.defect < 1e-6
    assert result.cost_after < result.cost_before


def test_a_solver_that_is_stopped_early_says_so():
    problem = busy_problem(True, 12)
    found = solve_whole(problem, "ipopt", 2)
    assert not found.ok and "Iterations" in found.status
    config = with_refine(Config(), fresh_backend="ipopt", whole_iterations=2)
    assert solve(problem, config.refine).failed


@pytest.mark.parametrize("kappa", [-0.05, -1e-9, 0.0, 1e-4, 0.08])
@pytest.mark.parametrize("ahead", BODY_POINTS)
def test_the_offset_from_a_circle_is_exact(kappa, ahead):
    d, mu = np.array([0.3, -1.2]), np.array([0.2, -0.4])
    x, y = ahead * np.cos(mu), d + ahead * np.sin(mu)
    if abs(kappa) > 1e-6:
        centre = 1 / kappa
        expected = centre - np.sign(kappa) * np.hypot(x, y - centre)
    else:
        expected = y
    assert body_offset_at(d, mu, np.full(2, kappa), ahead) == pytest.approx(expected, abs=1e-6)
    symbolic = [float(body_offset(a, b, kappa, ahead)) for a, b in zip(d, mu, strict=True)]
    assert symbolic == pytest.approx(expected, abs=1e-6)


def test_what_is_read_off_reproduces_the_rows_at_the_iterate():
    """On a winding road the lines and the circle touch the tables where they were read off."""
    frame = frame_of(sine, 150.0)
    road = road_of(frame, GoalWindow(20, 20, None, None, None, None))
    state = state_at(frame, 20.0, d=0.4, v=9.0, mu=0.05)
    problem = problem_of(
        keeping_seed(road, state, 20), state, occupancy_of(frame, 30), None, Config()
    )
    z = problem.initial()
    par = problem.read(z).par
    _, offset, _ = problem.read.project_body(z.x[1:])
    for i, ahead in enumerate(BODY_POINTS):
        bias = par[:, point_at(i, Point.BIAS)]
        circle = body_offset_at(z.x[1:, Stage.D], z.x[1:, Stage.MU], par[:, Given.BEND], ahead)
        assert circle + bias == pytest.approx(offset[:, i], abs=1e-9)
        assert np.abs(bias).max() < 0.05  # the circle alone is near already


# -- ways -----------------------------------------------------------------------------------------


def ways_among(window: Occupancy, goal: GoalWindow, v: float = 10.0, parts: int = 1) -> list[Way]:
    """The ways along the lane of a straight road, from s = 30 m on."""
    road, config = road_of_goals(goal), Config()
    state = state_at(road.frame, 30.0, v=v)
    paths = sample_paths(road, frenet_pose(road, state), 200.0, nobody(), config.seed)
    blocked = block(window.window(0, goal.last + 1), paths, config.seed, config.cost)
    return find_ways(
        road, paths, blocked, window.ids, 0, v, 0.0, 0, config, DT, labels=3000, arrivals=parts
    )


def nobody() -> Occupancy:
    """No traffic."""
    return occupancy_of(frame_of(straight, 300.0), 5)


CROSSING = Track(70.0, 0.0, 0.0, turn=np.pi / 2)


def test_before_and_behind_one_who_crosses_are_two_ways():
    """A car that stands across the lane from step 30 to 60 is passed before or after."""
    goal = GoalWindow(80, 100, (90.0, 130.0), (-1.0, 1.0), None, None)
    frame = road_of_goals(goal).frame
    forecast = forecast_of(frame, 120, CROSSING)
    forecast.boxes[0, :30] = np.nan
    forecast.boxes[0, 60:] = np.nan
    assert np.isfinite(forecast.boxes).any()
    found = ways_among(occupancy(forecast, frame), goal, v=12.0)
    assert {way.ahead for way in found} == {(), (10,)}
    for way in found:
        s = 30.0 + np.concatenate([[0.0], np.cumsum((way.v[1:] + way.v[:-1]) / 2 * DT)])
        passed = s[min(45, len(s) - 1)] > 70.0
        assert passed == bool(way.ahead)


def test_leaders_and_followers_make_no_ways():
    goal = GoalWindow(40, 50, None, None, None, None)
    tracks = Track(60.0, 0.0, 10.0), Track(10.0, 0.0, 8.0)
    found = ways_among(occupancy_of(road_of_goals().frame, 120, *tracks), goal)
    assert len(found) == 1 and found[0].ahead == (11,)


def test_parts_of_the_goals_time_make_ways():
    found = ways_among(nobody(), GoalWindow(40, 79, None, None, None, None), parts=4)
    assert sorted((way.arrival - 40) // 10 for way in found) == [0, 1, 2, 3]


def test_lane_changes_may_begin_later():
    """Among the ways to a lane beside are some that stay in the own lane for a while."""
    goal = GoalWindow(60, 70, (100.0, 180.0), (2.5, 4.5), None, None)
    road = road_of_goals(goal)
    state = state_at(road.frame, 30.0, v=12.0)
    around = occupancy_of(road.frame, 80)
    found = cheapest(ways_on(road, state, 0.0, 0, around, Config(), DT))
    assert all(seed.reaches_goal for seed in found)
    assert any(np.abs(seed.states[20, Stage.D]) < 0.1 for seed in found)
    assert any(np.abs(seed.states[20, Stage.D]) > 1.0 for seed in found)


# -- the bound ------------------------------------------------------------------------------------


def test_the_bound_is_no_dearer_than_the_drive():
    loaded = load(LANE_CHANGE)
    run = drive(loaded)
    config = run.config.model_copy(update={"bound": run.config.bound.model_copy(update=BRIEF)})
    search = Clairvoyant(task_of(loaded, loaded.problems[0]), config)
    alone = search.optimum()
    beside = search.optimum(run.drives[0].trajectory)
    assert beside.cost <= alone.cost + 1e-9
    assert alone.cost <= alone.before
    assert 0 < alone.verified <= alone.refined <= alone.found


def test_the_command_and_the_column(tmp_path):
    brief = [word for key, value in BRIEF.items() for word in ("--set", f"bound.{key}={value}")]
    done = subprocess.run(
        [sys.executable, "-m", "mpcplan", "bound", str(LANE_CHANGE), "--out", str(tmp_path / "b"),
         *brief],
        capture_output=True, text=True, cwd=ROOT, check=True, timeout=300,
    )  # fmt: skip
    assert done.stderr == "" and done.stdout.startswith("ZAM_LaneChange-1_1_T-1: TR1 0.")
    assert (tmp_path / "b" / "solution_KS1:TR1:ZAM_LaneChange-1_1_T-1:2020a.xml").is_file()
    done = subprocess.run(
        [sys.executable, "-m", "mpcplan", "bench", str(LANE_CHANGE), "--bound",
         "--out", str(tmp_path / "r"), *brief],
        capture_output=True, text=True, cwd=ROOT, check=True, timeout=300,
    )  # fmt: skip
    assert "gap to the bound: median" in done.stdout
    with (tmp_path / "r" / "results.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert float(row["gap"]) == pytest.approx(float(row["TR1"]) / float(row["bound"]))
    assert float(row["gap"]) >= 1.0
