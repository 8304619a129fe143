"""The naive planners: pure pursuit, the intelligent driver model, and what they drive."""

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from commonroad.common.solution import CommonRoadSolutionWriter
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcplan.baselines.constant_velocity import ConstantVelocity
from mpcplan.baselines.idm import (
    IdmParameters,
    IdmPurePursuit,
    desired_speeds,
    idm_acceleration,
    leader_of,
)
from mpcplan.baselines.pursuit import steering_rate, within_limits
from mpcplan.config import Config
from mpcplan.observation import Observation, Snapshot
from mpcplan.road.frame import Frame
from mpcplan.road.road import Road, build_roads
from mpcplan.scenario import load
from mpcplan.simulate.foreign import load_planner
from mpcplan.simulate.loop import drive
from mpcplan.simulate.run import Run
from mpcplan.task import task_of
from mpcplan.trajectory import Array, Input, State, Trajectory
from mpcplan.vehicle import FORD_ESCORT, input_violations, simulate, step
from mpcplan.verify.drivability import check_kinematics, separation

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "scenarios"
INTERACTIVE = [FOLDER / "interactive", ROOT.parent / "shared" / "scenarios" / "interactive"]
DT = 0.1
DRIVER = IdmParameters()


@cache
def driven(name: str, planner: str) -> Run:
    """A bundled scenario driven by a shipped baseline."""
    (path,) = FOLDER.glob(f"*ZAM_{name}-1_1_T-1.xml")
    return drive(load(path), planner=load_planner(planner))


@cache
def road(name: str) -> Road:
    """The road of a bundled scenario."""
    loaded = load(FOLDER / f"ZAM_{name}-1_1_T-1.xml")
    task = task_of(loaded, loaded.problems[0])
    return build_roads(task.road_map, task.problem.planning_problem, Config().road)[0]


def gap(run: Run) -> float:
    """Least separation from anybody [m]."""
    least = math.inf
    for ride in run.drives:
        for state, others in zip(ride.trajectory.states, ride.others, strict=True):
            gaps = separation(state[None], others.boxes[:, None])
            least = min(least, float(gaps.min(initial=math.inf)))
    return least


# -- pure pursuit ---------------------------------------------------------------------------------


def straight(length: float = 600.0) -> Frame:
    """A path along x."""
    s = np.arange(0.0, length, 0.5)
    return Frame(s, np.column_stack([s, np.zeros_like(s)]))


def circle(radius: float, length: float = 600.0) -> Frame:
    """A left turn that begins at the origin along x."""
    s = np.arange(0.0, length, 0.5)
    turn = s / radius
    return Frame(s, radius * np.column_stack([np.sin(turn), 1 - np.cos(turn)]))


def pursued(path: Frame, state: tuple[float, ...], steps: int) -> Array:
    """States driven at constant speed."""
    states = [state]
    for _ in range(steps):
        states.append(step(states[-1], 0.0, steering_rate(path, states[-1], DT), DT))
    return np.array(states)


@pytest.mark.parametrize("v", [2.0, 8.0, 15.0, 30.0])
@pytest.mark.parametrize(("y", "psi"), [(2.0, 0.0), (-1.0, 0.2), (0.5, -0.3), (3.5, 0.0)])
def test_pure_pursuit_comes_to_the_line_and_stays(v, y, psi):
    states = pursued(straight(1000.0), (5.0, y, 0.0, v, psi), 300)
    late = states[len(states) // 2 :]
    assert np.abs(late[:, State.Y]).max() < 0.05 and np.abs(late[:, State.PSI]).max() < 0.01
    overshoot = -np.sign(y) * states[:, State.Y]
    assert psi != 0.0 or overshoot.max() < 0.15 * abs(y)


@pytest.mark.parametrize(("radius", "v"), [(15.0, 5.0), (40.0, 10.0), (150.0, 20.0)])
def test_pure_pursuit_holds_a_bend(radius, v):
    path = circle(radius, 2 * math.pi * radius * 0.9)
    states = pursued(path, (1.0, 0.0, 0.0, v, 0.0), round(0.8 * path.length / (v * DT)))
    _, d = path.to_frenet(states[:, [State.X, State.Y]])
    assert np.abs(d).max() < 0.6  # the bend begins at once, the steering angle does not
    assert np.abs(d[len(d) // 2 :]).max() < 0.1


def test_pure_pursuit_is_the_same_to_either_side():
    left = pursued(straight(), (5.0, 1.5, 0.02, 9.0, 0.1), 80)
    right = pursued(straight(), (5.0, -1.5, -0.02, 9.0, -0.1), 80)
    right[:, [State.Y, State.DELTA, State.PSI]] *= -1
    assert np.allclose(left, right, atol=1e-9)


def test_pure_pursuit_steers_as_coulter_says():
    """On the circle already, with the angle of that circle: nothing is left to steer."""
    path = circle(50.0)
    angle = math.atan(FORD_ESCORT.wheelbase / 50.0)
    (x, y), psi = path.to_cartesian(np.array(20.0), np.array(0.0)), 20.0 / 50.0
    assert abs(steering_rate(path, (x, y, angle, 8.0, psi), DT)) < 1e-3


@given(
    v=st.floats(0.0, 45.0), delta=st.floats(-0.5, 0.5), a=st.floats(-20.0, 20.0),
    w=st.floats(-0.4, 0.4),
)  # fmt: skip
@settings(max_examples=200, deadline=None)
def test_inputs_stay_within_the_vehicles_limits(v, delta, a, w):
    lateral = v**2 / FORD_ESCORT.wheelbase * math.tan(abs(delta) + 0.04)
    if lateral > 0.95 * FORD_ESCORT.a_max:
        return  # no acceleration makes up for this
    state = (0.0, 0.0, delta, v, 0.0)
    given_a = within_limits(a, w, state, DT)
    assert abs(given_a) <= abs(a) or v + a * DT < 0
    after = simulate(state, np.array([[given_a, w]]), DT)
    excess = {name: e.max() for name, e in input_violations(after).items()}
    assert max(excess.values()) <= 1e-9, excess


# -- the intelligent driver model -----------------------------------------------------------------


def test_idm_on_a_free_road():
    assert idm_acceleration(0.0, 15.0, math.inf, 0.0, DRIVER) == DRIVER.a_max
    assert idm_acceleration(15.0, 15.0, math.inf, 0.0, DRIVER) == 0.0
    assert idm_acceleration(18.0, 15.0, math.inf, 0.0, DRIVER) < 0.0


@pytest.mark.parametrize("v", [0.0, 3.0, 8.0, 12.0])
def test_idm_rests_at_its_equilibrium_gap(v):
    """g = (g0 + v T) / sqrt(1 - (v / v0)^4) at the leader's speed (Treiber 2000, Eq. 6)."""
    v0 = 14.0
    rest = (DRIVER.gap + v * DRIVER.headway) / math.sqrt(1 - (v / v0) ** 4)
    assert idm_acceleration(v, v0, rest, 0.0, DRIVER) == pytest.approx(0.0, abs=1e-12)
    assert idm_acceleration(v, v0, rest - 0.5, 0.0, DRIVER) < 0.0
    assert idm_acceleration(v, v0, rest + 0.5, 0.0, DRIVER) > 0.0


def test_idm_brakes_as_hard_as_it_must_and_may():
    kinematic = 10.0**2 / (2 * 20.0)  # m/s^2, to stop from 10 m/s within 20 m
    assert idm_acceleration(10.0, 14.0, 20.0, 10.0, DRIVER) < -kinematic
    for near in (1.0, 0.0, -3.0):
        assert idm_acceleration(10.0, 14.0, near, 10.0, DRIVER) == -DRIVER.hard
    assert idm_acceleration(10.0, 14.0, 20.0, -9.0, DRIVER) > -DRIVER.b


@given(lead=st.floats(0.0, 14.0), v=st.floats(0.0, 15.0), room=st.floats(1.0, 40.0))
@settings(max_examples=60, deadline=None)
def test_idm_never_hits_a_steady_leader(lead, v, room):
    """From any gap at which braking could still help, in steps of 0.1 s."""
    gap = room + max(v - lead, 0.0) ** 2 / (2 * 0.8 * DRIVER.hard) + 0.3 * v
    for _ in range(600):
        a = max(idm_acceleration(v, 15.0, gap, v - lead, DRIVER), -v / DT)
        gap += (lead - v) * DT - a * DT**2 / 2
        v += a * DT
        assert gap > 0.0


def test_desired_speeds_fall_gently_before_a_bend():
    tight = road("TightCurve")
    speeds = desired_speeds(tight, 14.0, DRIVER)
    bend = np.sqrt(DRIVER.lateral / np.maximum(np.abs(tight.frame.kappa), 1e-6))
    assert (speeds <= bend + 1e-9).all() and (speeds <= tight.limits.posted + 1e-9).all()
    fall = -np.diff(speeds**2) / 2 / np.diff(tight.frame.s)
    assert fall.max() == pytest.approx(DRIVER.b_bend, rel=1e-6)
    assert speeds.min() == pytest.approx(bend.min()) and speeds.min() < 7.0 < speeds.max()
    assert desired_speeds(tight, 30.0, DRIVER).max() >= speeds.max()


# -- the leader -----------------------------------------------------------------------------------


def seen(own: tuple[float, float], *cars: tuple[float, float, float, float]) -> Observation:
    """The vehicle at (s, d) of the free road, cars at (s, d, turn against the road, speed)."""
    frame = road("FreeRoad").frame

    def pose(s: float, d: float) -> tuple[float, float, float]:
        x, y = frame.to_cartesian(np.array(s), np.array(d))
        return float(x), float(y), float(frame.heading(np.array(s)))

    x, y, psi = pose(*own)
    rows = []
    for s, d, turn, v in cars:
        there = pose(s, d)
        rows.append([there[0], there[1], there[2] + turn, v, 4.5, 1.8])
    boxes = np.array(rows).reshape(-1, 6)
    others = Snapshot(0, tuple(range(len(rows))), boxes)
    return Observation(0, np.array([x, y, 0.0, 10.0, psi]), 0.0, (others,))


@pytest.mark.parametrize(
    ("own", "cars", "expected"),
    [
        ((30, 0), [], None),
        ((30, 0), [(60, 0, 0, 8)], (57.75, 8)),
        ((30, 0), [(90, 0, 0, 5), (60, 0.5, 0, 8)], (57.75, 8)),
        ((30, 0), [(60, 3.5, 0, 8)], None),
        ((30, 0), [(60, -3.5, 0, 8)], None),
        ((30, 0), [(60, 1.9, 0, 8)], (57.75, 8)),
        ((30, 0), [(20, 0, 0, 15)], None),
        ((30, 0), [(60, 0, math.pi, 8)], (57.75, -8)),
        ((30, 0), [(60, 1, math.pi / 2, 8)], (59.1, 0)),
        ((30, -3.5), [(60, -3.5, 0, 8)], (57.75, 8)),
        ((30, -3.5), [(50, 0, 0, 6), (60, -3.5, 0, 8)], (47.75, 6)),
    ],
    ids=["nobody", "ahead", "nearest", "left", "right", "reaches in", "behind", "oncoming",
         "crossing", "before a lane change", "on the lane to come"],
)  # fmt: skip
def test_the_leader_is_the_nearest_in_the_corridor(own, cars, expected):
    leader = leader_of(seen(own, *cars), road("FreeRoad"), DRIVER.side)
    if expected is None:
        assert leader is None
    else:
        assert leader == pytest.approx(expected, abs=1e-2)


# -- what they drive ------------------------------------------------------------------------------

ALL = sorted(p.stem.split("ZAM_")[1].split("-")[0] for p in FOLDER.glob("*.xml"))
FOLLOWING = ["Follow", "HardBrake", "TimeOnly", "StaticBlock", "StopInGoal", "StandingStart",
             "ParallelEgos", "CutIn"]  # fmt: skip


@pytest.mark.parametrize("name", FOLLOWING)
def test_idm_keeps_its_distance(name):
    run = driven(name, "idm")
    assert gap(run) > 1.0 and not any(ride.collided for ride in run.drives)
    assert name == "StopInGoal" or run.solved, run.cause
    for ride in run.drives:
        assert check_kinematics(ride.trajectory, 1e-9).ok
        assert ride.trajectory.inputs[:, Input.A].min() >= -DRIVER.hard - 1e-9


def test_idm_stops_behind_what_stands():
    (ride,) = driven("StopInGoal", "idm").drives
    assert ride.trajectory.states[-1, State.V] < 0.5
    assert gap(driven("StopInGoal", "idm")) == pytest.approx(DRIVER.gap, abs=0.7)


def test_constant_velocity_keeps_speed_and_lane():
    run = driven("FreeRoad", "constant_velocity")
    states = run.drives[0].trajectory.states
    assert run.solved and np.ptp(states[:, State.V]) < 1e-9
    _, d = road("FreeRoad").frame.to_frenet(states[:, [State.X, State.Y]])
    assert np.abs(d).max() < 0.05


def test_constant_velocity_hits_whoever_is_slower():
    run = driven("Follow", "constant_velocity")
    assert run.drives[0].collided and run.cause.startswith("collided at step")


@pytest.mark.parametrize("planner", ["constant_velocity", "idm"])
def test_a_bend_is_driven_in_the_lane(planner):
    run = driven("SBend", planner)
    assert run.solved
    bend = road("SBend").frame
    _, d = bend.to_frenet(run.drives[0].trajectory.states[:, [State.X, State.Y]])
    assert np.abs(d).max() < 0.4


@pytest.mark.parametrize("planner", ["constant_velocity", "idm"])
def test_same_input_same_bytes(planner):
    path = FOLDER / "ZAM_Oncoming-1_1_T-1.xml"
    runs = [drive(load(path), planner=load_planner(planner)) for _ in range(2)]
    first, second = (CommonRoadSolutionWriter(run.solution()).dump() for run in runs)
    assert first == second and runs[0].solved


@pytest.mark.parametrize("make", [ConstantVelocity, IdmPurePursuit])
@pytest.mark.parametrize("v", [0.0, 0.3, 14.0, 44.0])
def test_any_start_gives_a_drivable_plan(make, v):
    loaded = load(FOLDER / "ZAM_TightCurve-1_1_T-1.xml")
    planner = make(task_of(loaded, loaded.problems[0]), Config())
    state = loaded.problems[0].start.copy()
    state[State.V], state[State.Y] = v, state[State.Y] + 1.0
    states = planner.plan(Observation(0, state, 0.0, (Snapshot(0, (), np.empty((0, 6))),)))
    inputs = np.diff(states[:, [State.V, State.DELTA]], axis=0) / DT
    assert np.array_equal(states[0], state)
    assert check_kinematics(Trajectory(0, states, inputs, DT), 1e-6).ok


@pytest.mark.slow
@pytest.mark.parametrize("planner", ["constant_velocity", "idm"])
@pytest.mark.parametrize("name", ALL)
def test_every_bundled_scenario_is_driven_to_an_end(name, planner):
    run = driven(name, planner)
    for ride in run.drives:
        assert ride.reached_step is not None or ride.cause.startswith(("collided", "the goal was"))
        assert check_kinematics(ride.trajectory, 1e-9).ok and len(ride.cycles) > 3


@pytest.mark.slow
@pytest.mark.parametrize("planner", ["constant_velocity", "idm"])
def test_interactive_traffic_is_driven_to_an_end(planner):
    folders = [path for root in INTERACTIVE for path in sorted(root.glob("*/")) if path.is_dir()]
    if not folders:
        pytest.skip("no interactive scenarios here")
    (ride,) = drive(load(folders[0]), planner=load_planner(planner)).drives
    assert ride.reached_step is not None or ride.cause.startswith(("collided", "the goal was"))
    assert len(ride.cycles) > 3
