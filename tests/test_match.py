"""The level-k game within planning: cycle by cycle, its decision as a seed, in the trace."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from reference_ocp import DT, Track, frame_of, occupancy_of, road_of, state_at, straight

from mpcplan.config import Config
from mpcplan.game.decide import Order
from mpcplan.game.match import Match
from mpcplan.game.way import Place
from mpcplan.observation import Box, Observation, Snapshot
from mpcplan.planner import Planner
from mpcplan.road.goal import GoalWindow
from mpcplan.road.road import Road, build_roads
from mpcplan.scenario import LoadedScenario, load
from mpcplan.seed.candidates import Effort, find_seeds
from mpcplan.seed.lattice import lattice
from mpcplan.seed.level_k import LEVEL_K, accelerations, without_yielding
from mpcplan.seed.search import search
from mpcplan.seed.seed import Stage
from mpcplan.simulate.recorded import RecordedTraffic
from mpcplan.task import task_of

FOLDER = Path(__file__).resolve().parents[1] / "scenarios"
PLAYED = Config().model_copy(
    update={"game": Config().game.model_copy(update={"enabled": True, "step": 1.0})}
)


@pytest.fixture(scope="module")
def turn() -> LoadedScenario:
    """A left turn against oncoming traffic."""
    return load(FOLDER / "interactive" / "ZAM_LeftTurn-1_1_I-1-1")


@pytest.fixture(scope="module")
def road(turn) -> Road:
    """The road to its goal."""
    goal = turn.problems[0].planning_problem
    return build_roads(turn.scenario, goal, Config().road)[0]


def near(turn: LoadedScenario, road: Road, steps: int = 3) -> list[Observation]:
    """Observations while the ego vehicle and somebody oncoming approach the turn."""
    problem = turn.problems[0]
    start = RecordedTraffic(turn.scenario).at(problem.first_step)
    seen, history = [], []
    for k in range(steps):
        boxes = start.boxes.copy()
        way = boxes[:, Box.V] * DT * 3 * k
        boxes[:, Box.X] += way * np.cos(boxes[:, Box.PSI])
        boxes[:, Box.Y] += way * np.sin(boxes[:, Box.PSI])
        history.append(replace(start, step=3 * k, boxes=boxes))
        state = problem.start.copy()
        state[:2] += state[3] * DT * 3 * k * np.array([np.cos(state[4]), np.sin(state[4])])
        seen.append(Observation(3 * k, state, 0.0, tuple(history)))
    return seen


def test_the_game_is_played_at_the_turn_and_beliefs_are_kept(turn, road):
    match = Match(turn.scenario.lanelet_network, PLAYED, DT)
    played = [match.play(seen, road) for seen in near(turn, road)]
    assert all(one.decision is not None for one in played)
    for one in played:
        assert set(one.decision.orders) == set(one.decision.beliefs)
        assert any("meeting of lanelets" in reason for reason in one.reasons)
        json.dumps(one.as_dict())
    first, last = played[0].decision.beliefs, played[-1].decision.beliefs
    assert any(not np.allclose(first[i], last[i]) for i in set(first) & set(last))


def test_without_others_there_is_no_game_and_it_says_so(turn, road):
    match = Match(turn.scenario.lanelet_network, PLAYED, DT)
    seen = near(turn, road, 1)[0]
    alone = replace(seen, others=(Snapshot(0, (), np.empty((0, len(Box)))),))
    played = match.play(alone, road)
    assert played.decision is None and "nobody comes" in played.reasons[0]


def test_the_decision_becomes_a_seed_with_its_accelerations(turn, road):
    seen = near(turn, road, 1)[0]
    decision = Match(turn.scenario.lanelet_network, PLAYED, DT).play(seen, road).decision
    nobody = occupancy_of(road.frame, 60)
    seeds, reports = find_seeds(
        road, seen.state, 0.0, 0, nobody, Config(), DT, Effort.NEVER, decision
    )
    (seed,) = [seed for seed in seeds if seed.source == LEVEL_K]
    held = accelerations(decision, DT)
    assert len(held) == 20  # two actions of a second
    third = held[: len(held) // 3 * 3].reshape(-1, 3).mean(axis=1)
    driven = seed.states[1 : 1 + 3 * len(third) : 3, Stage.A]
    assert driven == pytest.approx(third, abs=1e-9)
    v_end = float(decision.path[-1, Place.V])
    assert np.interp(1.8, DT * np.arange(len(seed.states)), seed.states[:, Stage.V]) == (
        pytest.approx(float(np.interp(1.8, decision.times, decision.path[:, Place.V])), abs=0.05)
    )
    assert v_end >= 0
    assert [report.accepted for report in reports if report.source == LEVEL_K] == [1]
    without = find_seeds(road, seen.state, 0.0, 0, nobody, Config(), DT, Effort.NEVER)[0]
    assert all(seed.source != LEVEL_K for seed in without)


def test_who_goes_second_is_not_in_the_way_and_everybody_else_is(turn, road):
    frame = frame_of(straight, 200.0)
    lane = road_of(frame, GoalWindow(40, 40, None, None, None, None))
    window = occupancy_of(frame, 40, Track(60.0, 0.0, 0.0), Track(90.0, 0.0, 0.0))
    grid = lattice(lane, state_at(frame, 30.0), 0.0, 0, window, Config(), DT)
    seen = near(turn, road, 1)[0]
    decision = Match(turn.scenario.lanelet_network, PLAYED, DT).play(seen, road).decision
    for order, kept in ((Order.GO, {-1, 1}), (Order.YIELD, {-1, 0, 1}), (Order.NONE, {-1, 0, 1})):
        told = replace(decision, orders={window.ids[0]: order})
        assert set(np.unique(without_yielding(grid.blocked, window, told).owner)) == kept


@pytest.mark.parametrize("count", [6, 15])
def test_a_search_that_begins_with_its_own_result_finds_it_again(count):
    frame = frame_of(straight, 250.0)
    lane = road_of(frame, GoalWindow(40, 60, (75.0, 200.0), None, None, None))
    window = occupancy_of(frame, 61, Track(60.0, 0.0, 6.0))
    grid = lattice(lane, state_at(frame, 30.0), 0.0, 0, window, Config(), DT)
    args = (lane, grid.paths, grid.blocked, 0, 10.0, 0.0, 0, Config(), DT)
    free = search(*args)
    held = search(*args, free[0][:count])
    assert held[0] == pytest.approx(free[0]) and held[2] == pytest.approx(free[2])
    slower = search(*args, np.full(count, -6.0))
    assert slower[0][:count] == pytest.approx(np.full(count, -6.0))
    assert slower[2] > free[2]


def test_the_planner_plays_where_it_is_asked_to_and_tells_it(turn):
    problem = turn.problems[0]
    now = RecordedTraffic(turn.scenario).at(problem.first_step)
    seen = Observation(problem.first_step, problem.start, 0.0, (now,))
    task = task_of(turn, problem)
    for config, told in ((PLAYED, True), (Config(), False)):
        plan = Planner(task, config).plan(seen)
        assert (plan.trace["game"] is not None) == told
        assert ("game" in plan.trace["times_ms"]) == told
        json.dumps(plan.trace)
    recorded = load(FOLDER / "ZAM_TJunction-1_1_T-1.xml")
    known = Planner(task_of(recorded, recorded.problems[0]), PLAYED)
    start = RecordedTraffic(recorded.scenario).at(recorded.problems[0].first_step)
    first = Observation(start.step, recorded.problems[0].start, 0.0, (start,))
    assert known.plan(first).trace["game"] is None
