"""Traffic rules: predicates, formulas and their monitors, what was driven, what candidates cost."""

import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import fake_run
import made
import numpy as np
import pytest
from commonroad.common.util import Interval
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.scenario.scenario import Scenario, ScenarioID
from commonroad.scenario.state import CustomState, InitialState
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from made_lanes import WIDTH, fork, lane, line, network
from reference_ocp import Track, forecast_of, road_of, straight_road

from mpcplan.bench.cells import rules_cells
from mpcplan.bench.store import empty_row
from mpcplan.bench.table import rules_lines
from mpcplan.cli import solve
from mpcplan.config import Config, RulesConfig
from mpcplan.config.files import load_config
from mpcplan.errors import ConfigError, RoadError
from mpcplan.observation import Box, Forecast, Snapshot
from mpcplan.predict.occupancy import occupancy
from mpcplan.road.goal import GoalWindow
from mpcplan.road.road import with_strips
from mpcplan.road.strips import build_strips
from mpcplan.rules.formulas import monitored, safe_distance_monitor
from mpcplan.rules.judge import judge_rules
from mpcplan.rules.keeping import KEPT, NOT_REGAINED, REGAINED, VIOLATED, keeping
from mpcplan.rules.predicates import ego_bodies, other_bodies, safe_distance
from mpcplan.rules.robustness import Signals, robustness, safe_distance_rule, traffic_flow_rule
from mpcplan.scenario import load
from mpcplan.seed import lattice as lattices
from mpcplan.seed.candidates import Effort, find_seeds
from mpcplan.seed.cost import trajectory_cost
from mpcplan.seed.lattice import lattice
from mpcplan.seed.rules import candidates_cost, seed_cost, states_cost
from mpcplan.seed.seed import Stage
from mpcplan.show import plot_run
from mpcplan.show.rules import RULE_STRIPS
from mpcplan.simulate import rules as rules_of_runs
from mpcplan.trajectory import Trajectory
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import simulate

DT = 0.1
RULES = RulesConfig()
BODY = (4.5, 1.8)  # m, length and width of the others
RECOVERY = round(RULES.recovery / DT)
FRONT = CAR.front + BODY[0] / 2  # m, from the ego's rear axle to a centre, where bodies touch


# ---------------------------------------------------------------- scenes: two lanes along x


class Motion:
    """A rigid motion of the plane: turned by an angle [rad], then moved."""

    def __init__(self, angle: float = 0.0, x: float = 0.0, y: float = 0.0) -> None:
        self.angle, self.offset = angle, np.array([x, y])
        c, s = np.cos(angle), np.sin(angle)
        self.matrix = np.array([[c, -s], [s, c]])

    def points(self, points: np.ndarray) -> np.ndarray:
        """(n, 2) moved points."""
        return points @ self.matrix.T + self.offset

    def boxes(self, boxes: np.ndarray) -> np.ndarray:
        """(..., 6) moved boxes."""
        moved = boxes.copy()
        moved[..., [Box.X, Box.Y]] = self.points(boxes[..., [Box.X, Box.Y]])
        moved[..., Box.PSI] += self.angle
        return moved


STILL = Motion()


def road_map(roads) -> Scenario:
    """A scenario of a network."""
    scenario = Scenario(DT, ScenarioID.from_benchmark_id("ZAM_Lanes-1_1_T-1", "2020a"))
    scenario.add_objects(roads)
    return scenario


def two_lanes(limit: float | None = None, move: Motion = STILL, side: int = 1) -> Scenario:
    """Lanelets 1 along y = 0 and 2 to its left (side 1) or right (-1), with a limit [m/s]."""
    near = move.points(line((-100, 0), (600, 0)))
    far = move.points(line((-100, side * WIDTH), (600, side * WIDTH)))
    first, second = ("left", "right") if side > 0 else ("right", "left")
    limits = {} if limit is None else {1: limit, 2: limit}
    return road_map(
        network(lane(1, near, **{first: 2}), lane(2, far, **{second: 1}), limits=limits)
    )


def driven(v: float, steps: int = 60, x: float = 0.0, move: Motion = STILL) -> Trajectory:
    """The ego vehicle at constant speed along y = 0, its rear axle at x first."""
    at = move.points(np.array([[x, 0.0]]))[0]
    return simulate([*at, 0.0, v, move.angle], np.zeros((steps, 2)), DT)


def boxes_of(x, y, psi, v, steps: int = 60) -> np.ndarray:
    """(steps + 1, 6) boxes of numbers or arrays over time."""
    columns = np.broadcast_arrays(np.zeros(steps + 1), x, y, psi, v, *BODY)
    return np.column_stack(columns[1:])


def ahead(gap: float, v: float, y: float = 0.0, psi: float = 0.0, steps: int = 60) -> np.ndarray:
    """Somebody at constant speed whose rear is a gap ahead of the ego's front at first."""
    t = DT * np.arange(steps + 1)
    return boxes_of(FRONT + gap + v * np.cos(psi) * t, y, psi, v, steps)


def judged(scenario: Scenario, ego: Trajectory, *boxes: np.ndarray, parked=(), config=None):
    """What the rules say of a drive among others."""
    start = InitialState(
        time_step=0, position=ego.states[0, :2].copy(), orientation=float(ego.states[0, 4]),
        velocity=float(ego.states[0, 3]), acceleration=0.0, yaw_rate=0.0, slip_angle=0.0,
    )  # fmt: skip
    goal = GoalRegion([CustomState(time_step=Interval(len(ego), len(ego)))])
    seen = np.array(boxes).reshape(len(boxes), len(ego), len(Box))
    others = Forecast(0, tuple(range(10, 10 + len(boxes))), seen)
    standing = np.array([i in parked for i in range(len(boxes))], bool)
    task = PlanningProblem(1, start, goal)
    return judge_rules(scenario, task, ego, others, standing, config or Config())


def cutting(v: float, gap: float, begin: int, turned: bool = True, side: int = 1) -> np.ndarray:
    """Somebody in the other lane who moves to the ego's lane in 2 s from a time step on."""
    moved = np.clip((np.arange(61) - begin) / 20, 0.0, 1.0)
    y = side * WIDTH * (1 - moved)
    psi = np.where((moved > 0) & (moved < 1), -side * np.arctan2(WIDTH / 2, v), 0.0)
    boxes = ahead(gap, v)
    boxes[:, Box.Y] = y
    boxes[:, Box.PSI] = psi if turned else 0.0
    return boxes


# ---------------------------------------------------------------- the safe distance


def gaps(gap: float, v_b: float, v_a: float, a_b: float, a_a: float, reaction: float):
    """Gap over time while who is ahead brakes at once, and who is behind after a reaction."""
    t = np.linspace(0.0, 40.0, 4001)

    def braked(v: float, a: float, time: np.ndarray) -> np.ndarray:
        time = np.clip(time, 0.0, v / a)
        return v * time - a * time**2 / 2

    behind = v_b * np.minimum(t, reaction) + braked(v_b, a_b, t - reaction)
    return gap + braked(v_a, a_a, t) - behind


speeds = st.floats(0.0, 45.0)


@given(v_b=speeds, v_a=speeds, a_b=st.floats(2, 10), harder=st.floats(1, 1.5),
       reaction=st.floats(0, 2))  # fmt: skip
def test_the_safe_distance_is_just_what_braking_needs(v_b, v_a, a_b, harder, reaction):
    args = (v_b, v_a, a_b, harder * a_b, reaction)
    safe = float(safe_distance(np.array(v_b), *args[1:]))
    assert gaps(safe, *args).min() > -1e-6
    assert gaps(safe - 0.01, *args).min() < 0


def test_the_safe_distance_of_the_papers_parameters():
    d = safe_distance(np.array([30.0, 0.0, 10.0]), np.array([20.0, 0.0, 30.0]), 10.0, 10.5, 0.3)
    assert d == pytest.approx([9.0 + 45.0 - 400 / 21, 0.0, 0.0])


@given(v_b=speeds, v_a=speeds, more=st.floats(0.1, 10))
def test_the_safe_distance_grows_with_what_makes_it_harder(v_b, v_a, more):
    def d(v_b=v_b, v_a=v_a, a_b=8.0, a_a=9.0, reaction=0.5) -> float:
        return float(safe_distance(np.array(v_b), v_a, a_b, a_a, reaction))

    assert d(v_b=v_b + more) >= d() >= d(v_a=v_a + more)
    assert d(reaction=0.5 + more) >= d() and d(a_a=9.0 + more) >= d() >= d(a_b=8.0 + more)


# ---------------------------------------------------------------- formulas and their monitors

values = st.floats(-3, 3) | st.just(-np.inf)
finite = st.floats(-3, 3)


@st.composite
def signals(draw) -> Signals:
    """Random predicates of one drive among two others."""
    k = draw(st.integers(1, 12))
    lane_, front, cut = (draw(arrays(float, (1, 2, k), elements=values)) for _ in range(3))
    distance = draw(arrays(float, (1, 2, k), elements=finite))
    slow = draw(arrays(float, (1, k), elements=values))
    return Signals(lane_, front, cut, distance, slow, draw(arrays(float, (1, k), elements=finite)))


@settings(deadline=None, max_examples=150)
@given(found=signals(), recovery=st.integers(0, 5))
def test_arrays_and_monitors_agree(found, recovery):
    """Both rules, cut-ins and the time after them, from the first sample on."""
    distance, flow = monitored(found, recovery)
    np.testing.assert_array_equal(distance, safe_distance_rule(found, recovery)[0])
    np.testing.assert_array_equal(flow, traffic_flow_rule(found)[0])


@settings(deadline=None, max_examples=60)
@given(found=signals(), recovery=st.integers(0, 5))
def test_who_never_leads_needs_no_monitor(found, recovery):
    """Those are left out of the monitoring: their monitors would say the same."""
    led = replace(found, lane=-np.abs(found.lane) - 1.0)
    names = ("lane", "front", "cut", "distance")
    alone = safe_distance_monitor(recovery).run({n: getattr(led, n)[0, 0] for n in names})
    assert np.isposinf(alone).all() and np.isposinf(monitored(led, recovery)[0]).all()


def test_a_cut_in_gives_grace_from_its_beginning_on_and_only_then():
    k = 12
    cut = np.full(k, -1.0)
    cut[3:8] = 1.0  # it lasts longer than the grace of 2 steps
    one = np.ones((1, 1, k))
    found = Signals(one, one, cut.reshape(1, 1, k), -one, -one[0], one[0])
    grace = np.isposinf(monitored(found, 2)[0][0])
    assert np.flatnonzero(grace).tolist() == [3, 4, 5]


def test_who_is_cutting_in_when_first_seen_has_begun_then():
    one = np.ones((1, 1, 6))
    grace = np.isposinf(monitored(Signals(one, one, one, -one, -one[0], one[0]), 2)[0][0])
    assert np.flatnonzero(grace).tolist() == [0, 1, 2]


def test_rtamt_is_imported_late_and_says_nothing():
    code = (
        "import sys, mpcplan.planner, mpcplan.simulate.rules; early = 'rtamt' in sys.modules;"
        "from mpcplan.rules.formulas import traffic_flow_monitor;"
        "assert traffic_flow_monitor().update({'slow': -1, 'flow': 2}) == 2;"
        "import os; sys.stdout.flush(); sys.stderr.flush(); os._exit(early)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


# ---------------------------------------------------------------- what was driven


def test_nobody_ahead_demands_no_distance():
    found = judged(two_lanes(), driven(10.0))
    assert found.safe_distance.step is None and found.kept == KEPT


@pytest.mark.parametrize(("gap", "kept"), [(8.0, KEPT), (3.0, NOT_REGAINED)])
def test_who_follows_too_closely_violates_the_safe_distance(gap, kept):
    found = judged(two_lanes(), driven(15.0), ahead(gap, 15.0))
    safe = 15 * 0.3 + 15**2 / 20 - 15**2 / 21
    assert found.safe_distance.values == pytest.approx(gap - safe, abs=1e-6)
    assert found.kept == kept


def test_a_distance_that_shrinks_is_violated_in_the_end():
    shrinking = judged(two_lanes(), driven(15.0), ahead(12.0, 13.0))
    assert shrinking.kept == VIOLATED
    assert (shrinking.safe_distance.step, shrinking.safe_distance.first_step) == (60, 0)


def test_a_start_in_violation_is_regained_in_time_or_not():
    def following(v: float) -> str:
        return judged(two_lanes(), driven(15.0), ahead(3.0, v)).kept

    assert following(15.5) == REGAINED  # 2 m short, half a metre more each second, and less to keep
    assert following(15.1) == NOT_REGAINED


@pytest.mark.parametrize("side", [1, -1], ids=["from the left", "from the right"])
def test_who_cuts_in_gives_time_to_fall_back(side):
    scenario, boxes = two_lanes(side=side), cutting(15.0, 3.0, 5, side=side)
    values = judged(scenario, driven(15.0), boxes).safe_distance.values
    bad = np.flatnonzero(values < 0)
    reached = (WIDTH - 0.9 - WIDTH / 2 + RULES.overlap) / (WIDTH / 20)  # steps, for a level body
    assert bad[0] == bad[-1] - (60 - bad[0])  # from then on to the end
    assert 5 + reached - 4 <= bad[0] - RECOVERY - 1 <= 5 + reached  # the turned body reaches sooner


def test_who_slides_over_without_turning_does_not_cut_in():
    values = judged(two_lanes(), driven(15.0), cutting(15.0, 3.0, 5, turned=False))
    assert np.flatnonzero(values.safe_distance.values < 0)[0] < 5 + 20


def test_who_drives_nearly_straight_on_the_line_does_not_cut_in():
    """Half a degree and less is noise; the ego vehicle is in the lane that both share."""
    scenario, ego = two_lanes(), driven(15.0)

    def first(turn: float) -> float:
        boxes = ahead(3.0, 15.0, y=WIDTH / 2)
        boxes[:, Box.PSI] = turn
        return judged(scenario, ego, boxes).safe_distance.values[0]

    assert first(0.0) < 0 and first(-0.009) < 0 and first(0.011) < 0
    assert np.isposinf(first(-0.011))


def test_who_appears_ahead_has_not_cut_in():
    boxes = ahead(3.0, 15.0)
    boxes[:20] = np.nan
    values = judged(two_lanes(), driven(15.0), boxes).safe_distance.values
    assert np.isposinf(values[:20]).all() and (values[20:] < 0).all()


def test_the_other_lane_the_oncoming_and_the_parked_demand_no_distance():
    scenario, ego = two_lanes(), driven(15.0)
    for boxes, parked in (
        (ahead(3.0, 15.0, y=WIDTH), ()),
        (ahead(60.0, 5.0, psi=np.pi), ()),
        (ahead(3.0, 0.0, psi=np.pi / 2), ()),
        (ahead(3.0, 0.0), (0,)),
    ):
        assert judged(scenario, ego, boxes, parked=parked).safe_distance.step is None
    waiting = judged(scenario, ego, ahead(3.0, 0.0)).safe_distance  # it stands, but may drive
    assert waiting.values[0] == pytest.approx(3.0 - 4.5 - 11.25)


def test_the_nearest_is_not_always_who_asks_for_most():
    scenario, ego = two_lanes(), driven(20.0)
    near, far = ahead(20.0, 20.0), ahead(26.0, 0.0, steps=60)
    both = judged(scenario, ego, near, far).safe_distance.values
    apart = [judged(scenario, ego, boxes).safe_distance.values for boxes in (near, far)]
    np.testing.assert_array_equal(both, np.minimum(*apart))
    assert both[0] == apart[1][0] < apart[0][0]


@pytest.mark.parametrize(
    ("others", "kept"),
    [
        ((), False),  # crawling on a free road
        ((ahead(30.0, 10.0),), True),  # behind somebody slow
        ((ahead(30.0, 20.0),), False),  # who is not slow
        ((ahead(30.0, 10.0, y=WIDTH),), False),  # in another lane
        ((ahead(-30.0, 10.0),), False),  # behind
        ((boxes_of(80.0, 0.0, 0.0, 0.0),), True),  # behind a wall
    ],
)
def test_crawling_hinders_the_traffic_unless_somebody_slow_leads(others, kept):
    """30 m/s are allowed, the ego drives 10, and less than 15 would be slow."""
    values = judged(two_lanes(limit=30.0), driven(10.0), *others).traffic_flow.values
    if kept:
        assert np.isposinf(values).all()
    else:
        assert values == pytest.approx(15.0 - 20.0)


def test_what_never_moves_explains_why_one_waits():
    boxes = boxes_of(80.0, 0.0, 0.0, 0.0)
    found = judged(two_lanes(limit=30.0), driven(10.0), boxes, parked=(0,))
    assert found.traffic_flow.step is None and found.safe_distance.step is None


def test_speed_allowed_where_no_sign_stands():
    config = Config(rules=RulesConfig(speed_usual=28.0))
    values = judged(two_lanes(), driven(10.0), config=config).traffic_flow.values
    assert values == pytest.approx(15.0 - 18.0)


@settings(deadline=None, max_examples=20)
@given(angle=st.floats(-3, 3), x=st.floats(-500, 500), y=st.floats(-500, 500))
def test_where_the_scene_lies_does_not_matter(angle, x, y):
    move, boxes = Motion(angle, x, y), (cutting(15.0, 6.0, 5), ahead(20.0, 14.0))
    here = judged(two_lanes(30.0), driven(15.0), *boxes)
    there = judged(
        two_lanes(30.0, move), driven(15.0, move=move), *(move.boxes(b) for b in boxes)
    )  # fmt: skip
    for a, b in (
        (here.safe_distance, there.safe_distance),
        (here.traffic_flow, there.traffic_flow),
    ):
        np.testing.assert_allclose(a.values, b.values, atol=1e-6)
    assert here.kept == there.kept


def test_a_branch_that_is_not_taken_is_another_lane():
    scenario, ego = road_map(fork()), driven(10.0, x=-30.0)
    angle = 1.0  # rad along the bend of 15 m; clear of the lane straight on
    gone = boxes_of(15 * np.sin(angle), 15 * (1 - np.cos(angle)), angle, 0.0)
    onward = boxes_of(40.0, 0.0, 0.0, 0.0)
    assert judged(scenario, ego, gone).safe_distance.step is None
    assert judged(scenario, ego, onward).kept == VIOLATED


def test_no_route_is_told():
    ego = driven(10.0, x=-1000.0)
    with pytest.raises(RoadError, match="no lanelet holds the start"):
        judged(two_lanes(), ego)


@pytest.mark.parametrize(
    ("values_", "word"),
    [
        ([1, 0, 2, np.inf], KEPT),
        ([1, -1, 2, 2], VIOLATED),
        ([-1, -1, 0, 2], REGAINED),
        ([-1, -1, -1, 2], NOT_REGAINED),
        ([-1, 1, 1, -1], NOT_REGAINED),
        ([-1], NOT_REGAINED),
    ],
)
def test_how_a_rule_was_kept(values_, word):
    assert keeping(np.array(values_, float), 2) == word


# ---------------------------------------------------------------- many candidates at once


def test_many_candidates_are_judged_like_each_alone():
    road = with_strips(straight_road(length=600.0), two_lanes(30.0), Config())
    forecast = forecast_of(road.frame, 40, Track(60.0, 0.0, 8.0), Track(30.0, 3.5, 12.0))
    others, parked = other_bodies(occupancy(forecast, road.frame)), np.zeros(2, bool)
    t = DT * np.arange(41)
    v = np.linspace(5.0, 25.0, 9)[:, None] + 0 * t
    s, d = 20.0 + v * t, np.linspace(-0.5, 3.5, 9)[:, None] + 0 * t
    together = robustness(road.strips, ego_bodies(s, d, 0 * s, v), others, parked, RULES, DT)
    for i in range(len(v)):
        rows = (x[i : i + 1] for x in (s, d, 0 * s, v))
        alone = robustness(road.strips, ego_bodies(*rows), others, parked, RULES, DT)
        for many, one in zip(together, alone, strict=True):
            np.testing.assert_array_equal(many[i], one[0])
    assert (together[0] < 0).any() and np.isposinf(together[0]).any()


def following(gap: float, v: float = 15.0):
    """A road with a leader, and Frenet states at a constant gap behind it."""
    road = straight_road(GoalWindow(40, 40, None, None, None, None), length=600.0)
    around = occupancy(forecast_of(road.frame, 40, Track(100.0, 0.0, v)), road.frame)
    s = 100.0 - FRONT - gap + v * DT * np.arange(41)
    states = np.zeros((41, len(Stage)))
    states[:, Stage.S], states[:, Stage.V] = s, v
    return road, around, states


def weighted(distance: float = 0.0, flow: float = 0.0) -> Config:
    """The default configuration with the rules weighed."""
    return load_config(
        overrides=[f"cost.safe_distance={distance}", f"cost.traffic_flow={flow}"]
    )  # fmt: skip


def test_candidates_pay_for_what_they_lack():
    road, around, states = following(3.0)
    assert states_cost(road, states, 0, around, weighted(2.0), DT) == 0.0  # without its lanes
    lanes = with_strips(road, two_lanes(30.0), Config())
    lacking = 15 * 0.3 + 15**2 / 20 - 15**2 / 21 - 3.0
    assert states_cost(lanes, states, 0, around, weighted(2.0), DT) == pytest.approx(
        DT * 40 * 2.0 * lacking, rel=1e-6
    )
    assert states_cost(lanes, states, 0, around, weighted(0.0, 3.0), DT) == pytest.approx(0.0)
    nobody = around.until(-1)
    slow = states.copy()
    slow[:, Stage.V] = 10.0
    assert states_cost(lanes, slow, 0, nobody, weighted(0.0, 3.0), DT) == pytest.approx(
        DT * 40 * 3.0 * 5.0
    )


@pytest.mark.parametrize(("horizon", "steps"), [(1.5, 15), (60.0, 40)])
def test_what_is_asked_of_candidates_ends_with_the_horizon(horizon, steps):
    road, around, states = following(3.0)
    lanes = with_strips(road, two_lanes(30.0), Config())
    cost = {"safe_distance": 2.0, "rules_horizon": horizon}
    config = load_config(overrides=[f"cost.{name}={value}" for name, value in cost.items()])
    whole = states_cost(lanes, states, 0, around, weighted(2.0), DT)
    found = states_cost(lanes, states, 0, around, config, DT)
    assert found == pytest.approx(whole * steps / 40)


def test_plans_keep_the_safe_distance_of_a_vehicle_that_reacts_later():
    road, around, states = following(3.0)
    lanes = with_strips(road, two_lanes(30.0), Config())
    cost = {"safe_distance": 2.0, "rules_delay": 0.3}
    config = load_config(overrides=[f"cost.{name}={value}" for name, value in cost.items()])
    more = states_cost(lanes, states, 0, around, config, DT)
    more -= states_cost(lanes, states, 0, around, weighted(2.0), DT)
    assert more == pytest.approx(DT * 40 * 2.0 * 0.3 * 15.0)


def test_the_lattice_counts_the_same_and_prefers_who_keeps_the_rule():
    road, around, states = following(2.0)
    lanes = with_strips(road, two_lanes(), Config())
    state = np.array([states[0, Stage.S], 0.0, 0.0, 15.0, 0.0])

    def best(config: Config, on=lanes):
        return lattice(on, state, 0.0, 0, around, config, DT).seeds[0]

    free, careful = best(Config()), best(weighted(20.0))
    assert free.cost == best(Config(), road).cost == best(weighted(20.0), road).cost

    def lacks(seed) -> float:
        return states_cost(lanes, seed.states, 0, around, weighted(20.0), DT)

    assert 0 < lacks(careful) < lacks(free)
    alone = best(weighted(20.0), replace(road, strips=None)).cost
    assert careful.cost - alone >= 0.9 * lacks(careful)


@pytest.mark.parametrize("horizon", [1.0, 60.0])
def test_every_candidate_of_the_lattice_pays_for_what_it_drives(monkeypatch, horizon):
    road, around, states = following(2.0)
    lanes, config = with_strips(road, two_lanes(30.0), Config()), weighted(1.0, 0.5)
    cost = config.cost.model_copy(update={"rules_horizon": horizon})
    config = config.model_copy(update={"cost": cost})
    kept = []

    def recorded(*args):
        kept.append((args, candidates_cost(*args)))
        return kept[-1][1]

    monkeypatch.setattr(lattices, "candidates_cost", recorded)
    lattice(lanes, np.array([states[0, Stage.S], 0.0, 0.0, 15.0, 0.0]), 0.0, 0, around, config, DT)
    ((_, paths, profiles, table, accepted, *_), found) = kept[0]
    some = np.argwhere(accepted)[::5]
    expected = [
        seed_cost(lattices._seed(lanes, paths, profiles, table, p, i, 0.0, 0), around, config, DT)
        for p, i in some.tolist()
    ]
    got = found[tuple(some.T)]
    assert len(set(some[:, 0])) > 5 and np.ptp(expected) > min(5.0, horizon)
    np.testing.assert_allclose(
        got, expected, rtol=0.05, atol=0.3
    )  # samples of 0.25 m to either side
    assert (found[~accepted] == 0).all()


def test_options_and_searched_seeds_pay_too():
    road, around, states = following(2.0)
    lanes, config = with_strips(road, two_lanes(), Config()), weighted(20.0)
    lacking = states_cost(lanes, states, 0, around, config, DT)
    costs = [trajectory_cost(on, states, 0, True, around, config, DT) for on in (lanes, road)]
    assert lacking > 0 and costs[0] - costs[1] == pytest.approx(lacking)
    state = np.array([states[0, Stage.S], 0.0, 0.0, 15.0, 0.0])

    def searched(on):
        found, _ = find_seeds(on, state, 0.0, 0, around, config, DT, Effort.ALWAYS)
        return next(seed for seed in found if seed.source == "search")

    dear, cheap = searched(lanes), searched(road)
    np.testing.assert_array_equal(dear.states, cheap.states)
    assert dear.cost - cheap.cost == pytest.approx(seed_cost(dear, around, config, DT)) and (
        dear.cost > cheap.cost
    )


@pytest.mark.parametrize("parked", [(True, False), (False, True)])
def test_who_is_off_all_lanes_is_left_out_with_what_is_known_of_him(parked):
    road, _, states = following(2.0)
    lanes = with_strips(road, two_lanes(), Config())
    forecast = forecast_of(road.frame, 40, Track(100.0, -8.0, 15.0), Track(100.0, 0.0, 15.0))
    others = other_bodies(occupancy(forecast, road.frame))
    ego = ego_bodies(*(states[None, :, c] for c in (Stage.S, Stage.D, Stage.MU, Stage.V)))
    distance, _ = robustness(lanes.strips, ego, others, np.array(parked), RULES, DT)
    assert np.isposinf(distance).all() if parked[1] else (distance < 0).all()


# ---------------------------------------------------------------- reports


def test_a_run_is_judged_by_what_was_there(tmp_path):
    run = fake_run.run(load(made.write(tmp_path)))
    (drive,) = run.drives
    drive.others = tuple(
        Snapshot(int(k), (7,), boxes_of(x[0] + FRONT + 1.0, x[1], 0.0, 10.0, steps=0))
        for k, x in zip(drive.trajectory.steps, drive.trajectory.states, strict=True)
    )
    run.driven, run.notes = True, ()
    cells = rules_cells(run)
    assert cells["R_G1"] < 0 and cells["R_G1_kept"] == NOT_REGAINED
    assert cells["R_G4"] == pytest.approx(15 - 13.9 + drive.trajectory.states[:, 3].min(), abs=0.01)
    found = rules_of_runs.rules_of(run)
    assert cells["R_G1_step"] == found[0].safe_distance.step
    picture = plot_run(run, tmp_path / "rules.png", found)
    *_, distance, flow = picture.axes
    assert (distance.get_ylabel(), flow.get_ylabel()) == RULE_STRIPS
    np.testing.assert_array_equal(distance.lines[0].get_ydata(), found[0].safe_distance.values)
    assert distance.get_ylim()[0] < cells["R_G1"] and distance.get_xlim() == flow.get_xlim()
    assert len(plot_run(run).axes) == len(picture.axes) - 2


def test_a_collision_regains_nothing(tmp_path):
    """Who is touched is beside the ego vehicle, where the rule demands nothing any more."""
    run = fake_run.run(load(made.write(tmp_path)))
    (drive,) = run.drives
    x, y = drive.trajectory.states[0, :2]
    wall = boxes_of(x + FRONT + 1.0, y, 0.0, 0.0, steps=0)
    drive.others = tuple(Snapshot(int(k), (7,), wall) for k in drive.trajectory.steps)
    assert rules_of_runs.rules_of(run)[0].kept == REGAINED
    drive.collided = True
    assert rules_of_runs.rules_of(run)[0].kept == NOT_REGAINED


def test_several_drives_are_as_good_as_the_worst():
    good = judged(two_lanes(), driven(15.0), ahead(8.0, 15.0))
    bad = judged(two_lanes(limit=30.0), driven(10.0))
    worst = rules_of_runs.together((bad, good))
    assert worst.safe_distance is good.safe_distance and worst.kept == KEPT
    assert worst.traffic_flow is bad.traffic_flow


def test_what_goes_wrong_is_a_note_and_nothing_more(monkeypatch, capsys):
    def broken(_):
        raise ValueError("no number")

    monkeypatch.setattr(rules_of_runs, "rules_of", broken)
    run = SimpleNamespace(driven=True, notes=("a repair",))
    assert rules_cells(run) == {"notes": "rules not judged: ValueError: no number"}
    assert solve.rules_told(run) == ((), ["rules     not judged: ValueError: no number"])
    assert "ValueError" in capsys.readouterr().err


def test_nothing_driven_says_nothing():
    run = SimpleNamespace(driven=False, notes=())
    assert rules_cells(run) == {} and solve.rules_told(run) == ((), [])


def test_the_table_tells_starts_in_violation_apart():
    def row(kept: str, distance: float | str, flow: float | str) -> dict:
        return empty_row("ZAM_a-1") | {"R_G1_kept": kept, "R_G1": distance, "R_G4": flow}

    assert rules_lines([row("", "", "")]) == []
    rows = [row(KEPT, "", 2.0), row(KEPT, 4.0, ""), row(VIOLATED, -3.0, -1.0),
            row(REGAINED, -1.0, 1.0), row(NOT_REGAINED, -2.0, 1.0), row("", "", "")]  # fmt: skip
    assert rules_lines(rows) == [
        "R_G1 (safe distance): kept in 2 of 3 (66.7%); violated at the start of 2 others, "
        "regained in 1; lowest robustness: median -1.5, worst -3.0 m",
        "R_G4 (traffic flow): kept in 4 of 5 (80.0%); lowest robustness: median 1.0, "
        "worst -1.0 m/s",
    ]
    none_starts_well = rules_lines([row(REGAINED, -1.0, 1.0)])[0]
    assert none_starts_well.startswith("R_G1 (safe distance): kept in 0 of 0; violated")


@pytest.mark.parametrize(
    "override",
    ["rules.reaction=-1", "rules.braking_ego=0", "rules.recovery=soon", "rules.speed=3",
     "cost.safe_distance=-1"],
)  # fmt: skip
def test_bad_values_name_their_key(override):
    with pytest.raises(ConfigError, match=override.split("=")[0].split(".")[1]):
        load_config(overrides=[override])


def test_strips_hold_what_the_map_says():
    frame = road_of(straight_road(length=300.0).frame).frame
    strips = build_strips(two_lanes(22.0), frame, 5.0, RULES)
    assert strips.limit.tolist() == [22.0, 22.0]
    assert strips.same.tolist() == [[True, False], [False, True]] and strips.beside[0, 1]
    at = np.array([10.0, 299.0, -5.0, np.nan])
    shared = strips.overlap(at, np.array([-1.0] * 4), np.array([1.9] * 4))
    assert shared[:, :2] == pytest.approx(np.array([[2.75, 2.75], [0.15, 0.15]]))
    assert np.isneginf(shared[:, 2:]).all()  # off the path, and not there
