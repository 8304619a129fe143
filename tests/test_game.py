"""The level-k game: motion, rewards, exact search, levels, beliefs and the decision."""

import math

import numpy as np
import pytest
import shapely
from commonroad.scenario.traffic_light import TrafficLight
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from made_lanes import DT, crossing, moving, seen, straight_road

from mpcplan.config import GameConfig, PredictConfig
from mpcplan.game.actions import ACTIONS, COMMANDS, Action, Command, index_of, sequence, sequences
from mpcplan.game.beliefs import Beliefs, no_beliefs, observed_command, updated
from mpcplan.game.decide import Agent, Order, Zone, decide
from mpcplan.game.levels import Board, solve
from mpcplan.game.player import EGO, Player
from mpcplan.game.relevant import Intersections, ego_player
from mpcplan.game.reward import Meetings, pair_rewards
from mpcplan.game.search import enumerate_all, search, together
from mpcplan.game.tree import grow
from mpcplan.game.way import Place, Pose, Sample, Way
from mpcplan.observation import Box, box_corners
from mpcplan.predict.lanes import Lanes
from mpcplan.predict.paths import Paths

CAP = 10.0  # m/s, of all ways here
HALF = 1.75  # m, half a lane
CAR = (4.5, 1.8)  # m


def game(**changes: object) -> GameConfig:
    """A configuration with three actions of a second each."""
    return GameConfig(**{"actions": 3, "step": 1.0} | changes)


CONFIG = game()
TWO = game(actions=2)
EAST, NORTH = 0.0, math.pi / 2


def way(heading: float = EAST, begin=(-100.0, 0.0), bend: float = 0.0, cap: float = CAP) -> Way:
    """A way of 200 m with a curvature [1/m]; arc length 0 is at its middle."""
    s = np.arange(201.0)
    theta = heading + bend * s
    middle = theta[:-1] + bend / 2
    chord = np.sinc(bend / 2 / math.pi)
    steps = chord * np.column_stack([np.cos(middle), np.sin(middle)])
    points = np.asarray(begin) + np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])
    edges = np.tile([HALF, -HALF, HALF + 2 * HALF, -HALF], (len(s), 1))
    return Way(-100.0, 1.0, np.column_stack([points, theta, np.full(len(s), cap), edges]))


def player(number: int, along: Way, s: float, v: float, d: float = 0.0, mu: float = 0.0) -> Player:
    return Player(number, along, np.array([s, d, mu, v]), *CAR, target=100.0)


NORTHWARD = way(NORTH, (0.0, -100.0))
EASTWARD = way()


def agent(one: Player) -> Agent:
    return Agent(one, Zone((-3.0, 3.0), (-3.0, 3.0)))


# -- actions ------------------------------------------------------------------------------------


def test_the_actions_are_those_of_the_report():
    quarter, half = math.pi / 4, math.pi / 2
    expected = {
        (0, 0), (-1.5, 0), (-3.5, 0), (-5, 0), (1.5, 0), (2.5, 0), (0, quarter), (0, half),
        (0, -quarter), (0, -half), (1.5, quarter), (1.5, -quarter), (-1.5, quarter),
        (-1.5, -quarter),
    }  # fmt: skip
    assert {tuple(row) for row in COMMANDS} == expected
    assert len(COMMANDS) == ACTIONS == 14
    assert tuple(COMMANDS[Action.BRAKE_HARD]) == (-5.0, 0.0)
    assert tuple(COMMANDS[Action.ACCELERATE_RIGHT]) == (1.5, -quarter)


def test_sequences_are_numbered_in_lexicographic_order():
    found = sequences(3)
    assert found.shape == (14**3, 3)
    assert [tuple(row) for row in found] == sorted(tuple(row) for row in found)
    for index in (0, 1, 13, 14, 1000, 14**3 - 1):
        assert sequence(index, 3) == tuple(found[index])
        assert index_of(sequence(index, 3)) == index


# -- motion -------------------------------------------------------------------------------------


@settings(max_examples=30, deadline=None)
@given(
    d=st.floats(-1, 1),
    mu=st.floats(-1, 1),
    # who creeps through 1e-265 m/s turns, and the Euler steps lose that speed in the first of them
    v=st.just(0.0) | st.floats(1e-6, 15),
    leaf=st.integers(0, 14**3 - 1),
)
def test_motion_agrees_with_small_euler_steps(d, mu, v, leaf):
    small, substeps = 1e-4, 5
    config = game(substeps=substeps)
    path = grow(player(1, way(cap=100.0), 0.0, v, d, mu), config).path(leaf)
    x = np.array([0.0, d, mu, v])
    for step, action in enumerate(sequence(leaf, 3)):
        a, w = COMMANDS[action]
        count = round(config.step / small)
        speed = np.maximum(x[Place.V] + a * small * np.arange(count + 1), 0.0)
        turn = x[Place.MU] + np.cumsum(w * small * (speed > 0)) - w * small * (speed[0] > 0)
        moves = small * speed[:-1, None] * np.column_stack([np.cos(turn[:-1]), np.sin(turn[:-1])])
        way_of = x[:2] + np.cumsum(moves, axis=0)
        at = np.arange(1, substeps + 1) * count // substeps
        expected = np.column_stack([way_of[at - 1], turn[at], speed[at]])
        np.testing.assert_allclose(path[step * substeps :][:substeps], expected, atol=0.01)
        x = expected[-1]


def test_who_stands_stays_in_place_when_braking_and_steering():
    tree = grow(player(1, EASTWARD, 0.0, 0.0), CONFIG)
    for action in (Action.MAINTAIN, Action.BRAKE_HARD, Action.SHARP_LEFT, Action.BRAKE_RIGHT):
        leaf = index_of((action,) * 3)
        np.testing.assert_array_equal(tree.path(leaf), np.zeros((12, 4)))
        np.testing.assert_array_equal(tree.first_command(leaf, CONFIG.step), [0.0, 0.0])


def test_nobody_accelerates_beyond_what_the_way_allows():
    accelerate = index_of((Action.ACCELERATE,) * 3)
    path = grow(player(1, EASTWARD, 0.0, 8.0), CONFIG).path(accelerate)
    assert path[:, Place.V].max() == pytest.approx(CAP)
    fast = grow(player(1, EASTWARD, 0.0, 20.0), CONFIG).path(accelerate)
    np.testing.assert_allclose(fast[3::4, Place.V], [15.0, 10.0, 10.0])  # no harder than -5 m/s^2


def test_to_maintain_follows_the_bend():
    bend = 0.05
    along = way(bend=bend)
    board = Board([player(1, along, -50.0, 8.0)], CONFIG)
    pose = board.responses([0], board.best([0], _nobody(), [np.array([0])]))[0].poses
    centre = np.array([-100.0, 1 / bend])  # of the circle that begins at (-100, 0) eastward
    radii = np.hypot(pose[Pose.X] - centre[0], pose[Pose.Y] - centre[1])
    np.testing.assert_allclose(radii, 1 / bend, atol=0.01)


def _nobody() -> Meetings:
    return Meetings(
        np.array([CAR]) / 2, np.zeros((4, 1, 3, 0, 4)), np.zeros((1, 0, 2)), np.zeros((1, 0))
    )


@settings(max_examples=50, deadline=None)
@given(s=st.floats(-90, 90), d=st.floats(-2, 2), mu=st.floats(-1, 1), bend=st.floats(-0.03, 0.03))
def test_places_and_poses_are_inverse(s, d, mu, bend):
    along = way(bend=bend)
    x, y, cos, sin = along.pose(np.array([s, d, mu, 5.0]))
    found = along.place(np.array([x, y]), math.atan2(sin, cos), 5.0)
    np.testing.assert_allclose(found, [s, d, mu, 5.0], atol=0.01)


# -- rewards ------------------------------------------------------------------------------------

POSE = st.tuples(st.floats(-6, 6), st.floats(-6, 6), st.floats(-math.pi, math.pi))


def _polygon(x: float, y: float, psi: float, length: float, width: float) -> shapely.Polygon:
    box = np.zeros(len(Box))
    box[[Box.X, Box.Y, Box.PSI, Box.LENGTH, Box.WIDTH]] = x, y, psi, length, width
    return shapely.Polygon(box_corners(box))


def _pose(x: float, y: float, psi: float) -> np.ndarray:
    return np.array([x, y, math.cos(psi), math.sin(psi)])


@settings(max_examples=200, deadline=None)
@given(one=POSE, other=POSE)
def test_collision_and_safety_zone_are_overlaps_of_rectangles(one, other):
    config = game(substeps=1, collision=100.0, safe_distance=1.0)
    half = np.array([CAR]) / 2
    meetings = Meetings(half, _pose(*other).reshape(4, 1, 1, 1, 1), half[None], np.ones((1, 1)))
    poses = _pose(*one).reshape(4, 1, 1)
    found = pair_rewards(meetings, np.zeros(1, int), np.zeros(1, int), poses, config)[0]
    expected, (length, width) = 0.0, CAR
    for cost, longer, wider in (
        (100.0, config.margin / 2, config.margin / 2),
        (1.0, config.zone_length, config.zone_width),
    ):
        grown = _polygon(*other, length + 2 * longer, width + 2 * wider)
        body = _polygon(*one, length + 2 * longer, width + 2 * wider)
        assume(abs(grown.boundary.distance(body.boundary)) > 1e-9 or grown.overlaps(body))
        expected -= cost * grown.intersects(body)
    assert found == expected


def test_own_rewards_price_the_road_the_lane_and_the_distance():
    v = 4.0  # m/s
    total = Board([player(1, EASTWARD, 0.0, v)], CONFIG).own[0].total

    def of(*actions: Action) -> float:
        return float(total[index_of(actions)])

    stay = (Action.MAINTAIN,) * 3
    assert of(*stay) == -sum(100.0 - v * t for t in (1, 2, 3))
    left = of(Action.LEFT, Action.RIGHT, Action.MAINTAIN)  # onto the lane beside, off no road
    assert of(*stay) - 3 * CONFIG.lane - 3 * v < left < of(*stay) - 3 * CONFIG.lane
    assert of(Action.RIGHT, Action.LEFT, Action.MAINTAIN) < of(*stay) - CONFIG.off_road


# -- search -------------------------------------------------------------------------------------

GAMES = st.integers(0, 2**32 - 1)


def random_players(seed: int, count: int) -> list[Player]:
    """Players near each other on four arms of a crossing, with bends or without."""
    draw = np.random.default_rng(seed)
    found = []
    for number in range(count):
        heading = draw.integers(4) * math.pi / 2
        begin = -100 * np.array([math.cos(heading), math.sin(heading)])
        side = np.array([math.sin(heading), -math.cos(heading)]) * HALF
        along = way(heading, begin + side, draw.choice([0.0, 0.002, -0.002]))
        place = draw.uniform([-30, -0.5, -0.1, 0], [0, 0.5, 0.1, 12])
        found.append(Player(number, along, place, *CAR, target=100.0))
    return found


@settings(max_examples=60, deadline=None)
@given(
    seed=GAMES, count=st.integers(2, 4), actions=st.integers(1, 3), keep=st.sampled_from([1, 2, 5]),
    weights=st.sampled_from([(10000, 1000, 1000, 100, 1), (30, 10, 20, 5, 1), (1, 1, 0, 0, 0)]),
)  # fmt: skip
def test_pruned_is_enumerated(seed, count, actions, keep, weights):
    names = ("collision", "safe_distance", "off_road", "lane", "distance")
    config = game(actions=actions, **dict(zip(names, map(float, weights), strict=True)))
    players = random_players(seed, count)
    board = Board(players, config)
    shape = (4, actions, config.substeps)
    stand = [np.broadcast_to(one.pose[:, None, None], shape) for one in players[1:]]
    others = np.stack(stand, axis=2)
    belief = np.random.default_rng(seed).uniform(0, 1, (1, count - 1))
    meetings = Meetings(board.half[:1], others[:, None], board.half[None, 1:], belief)
    layer = np.repeat(np.arange(actions), ACTIONS ** np.arange(1, actions + 1))

    def terms(who: np.ndarray, rows: np.ndarray) -> np.ndarray:
        poses = board.poses(who, rows)
        return pair_rewards(meetings, who, layer[rows], poses, config)

    keep = min(keep, ACTIONS**actions)
    pruned = together([search(board.own[0], keep)], terms)[0]
    whole = together([enumerate_all(board.own[0], keep)], terms)[0]
    np.testing.assert_array_equal(pruned.index, whole.index)
    np.testing.assert_array_equal(pruned.reward, whole.reward)
    assert pruned.pruned <= ACTIONS**actions - keep


def test_of_equals_the_last_one_is_taken():
    nothing = game(actions=2, collision=0, safe_distance=0, off_road=0, lane=0, distance=0)
    players = random_players(0, 3)
    for found in solve(players, nothing).responses:
        assert [one.index for one in found] == [ACTIONS**2 - 1] * 3
    decision = decide(players[0], [agent(one) for one in players[1:]], no_beliefs(nothing), nothing)
    assert decision.actions == (Action.BRAKE_RIGHT, Action.BRAKE_RIGHT)
    alone = decide(players[0], [], no_beliefs(nothing), nothing)
    assert alone.actions == (Action.BRAKE_RIGHT, Action.BRAKE_RIGHT)


# -- levels -------------------------------------------------------------------------------------


@pytest.mark.parametrize("bend", [0.0, 0.04])
def test_alone_everybody_accelerates_to_the_cap_and_keeps_the_lane(bend):
    one = player(1, way(bend=bend), -50.0, 6.0, d=0.2)
    for response in solve([one], CONFIG).responses[0]:
        assert response.path[-1, Place.V] == pytest.approx(CAP)
        np.testing.assert_allclose(response.path[:, Place.D], 0.2)


def entering(response) -> float:
    """When a front comes to the crossing [s]."""
    front = response.path[:, Place.S] + CAR[0] / 2
    return float(np.argmax(front > -HALF)) if (front > -HALF).any() else math.inf


@pytest.mark.parametrize("v", [6.0, 8.0])
@pytest.mark.parametrize(("one", "two"), [(-16.0, -14.0), (-20.0, -18.0), (-12.0, -12.0)])
def test_at_a_crossing_level_0_goes_level_1_waits_for_it_and_level_2_goes_before_level_1(
    one, two, v
):
    players = [player(EGO, EASTWARD, one, v), player(1, NORTHWARD, two, v)]
    ego, other = solve(players, CONFIG).responses
    for mine, theirs in ((ego, other), (other, ego)):
        assert mine[0].command[Command.A] > 0  # the other one stands where it is: not in the way
        assert mine[1].path[-1, Place.S] < mine[0].path[-1, Place.S]
        assert entering(mine[1]) > entering(theirs[0])  # it goes behind the one that goes
        assert mine[1].reward > -CONFIG.safe_distance
        assert mine[2].index == mine[0].index  # the other one is expected to let it pass


def test_level_0_brakes_behind_who_drives_ahead_for_it_sees_it_standing():
    players = [player(EGO, EASTWARD, -30.0, 8.0), player(1, EASTWARD, -8.0, 8.0)]
    ego, _ = solve(players, CONFIG).responses
    assert ego[0].path[-1, Place.S] < -8.0 - CAR[0]
    assert ego[1].path[-1, Place.S] > -8.0  # it drives on


# -- beliefs ------------------------------------------------------------------------------------

PREDICTED = np.array([[2.5, 0.0], [-3.5, 0.0], [0.0, 0.5]])


@pytest.mark.parametrize(
    ("observed", "nearest"), [([2.0, 0.1], 0), ([-2.0, 0.0], 1), ([0.2, 0.3], 2)]
)
def test_the_nearest_level_gains(observed, nearest):
    before = no_beliefs(CONFIG)
    after = updated(before, {7: PREDICTED}, {7: np.array(observed)}, {7}, 0.2).of(7)
    expected = np.full(3, 1 / 3)
    expected[nearest] += 0.2
    np.testing.assert_allclose(after, expected / 1.2)
    np.testing.assert_allclose(before.of(7), 1 / 3)  # a new value, the old one is as it was


@given(st.lists(st.tuples(st.floats(-6, 6), st.floats(-2, 2)), min_size=1, max_size=20))
def test_beliefs_sum_to_one(seen_actions):
    beliefs = no_beliefs(game(prior=(0.2, 0.9, 0.4)))
    for observed in seen_actions:
        beliefs = updated(beliefs, {3: PREDICTED}, {3: np.array(observed)}, {3}, 0.3)
        assert beliefs.of(3).sum() == pytest.approx(1.0)
        assert (beliefs.of(3) >= 0).all()


def test_what_tells_nothing_changes_nothing():
    before = Beliefs(np.full(3, 1 / 3), {1: np.array([0.7, 0.2, 0.1])})
    same = np.tile(PREDICTED[0], (3, 1))
    after = updated(before, {1: same}, {1: np.zeros(2)}, {1}, 0.5)
    np.testing.assert_allclose(after.of(1), before.of(1))
    two = PREDICTED[[0, 0, 1]]
    after = updated(before, {1: two}, {1: PREDICTED[0]}, {1}, 0.5)
    np.testing.assert_allclose(
        after.of(1), np.array([0.7 * (1 + 5 / 9), 0.2 * (1 + 5 / 9), 0.1]) / 1.5
    )


def test_who_is_gone_is_forgotten_and_who_is_not_seen_in_the_game_is_kept():
    before = Beliefs(
        np.full(3, 1 / 3), {1: np.array([0.7, 0.2, 0.1]), 2: np.array([0.0, 0.5, 0.5])}
    )
    after = updated(before, {}, {}, {2}, 0.2)
    np.testing.assert_array_equal(after.of(2), [0.0, 0.5, 0.5])
    np.testing.assert_allclose(after.of(1), 1 / 3)


def test_in_a_bend_the_observed_yaw_rate_is_relative_to_the_lane():
    along = way(bend=0.05)
    one = player(1, along, -50.0, 8.0)
    np.testing.assert_allclose(observed_command(one, 1.0, 0.05 * 8.0), [1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(observed_command(one, 0.0, 0.05 * 8.0 + 0.3), [0.0, 0.3], atol=1e-9)


@pytest.mark.parametrize("level", [0, 1])
def test_the_belief_finds_the_level_that_an_agent_plays(level):
    config, beliefs = CONFIG, no_beliefs(CONFIG)
    ego, other = player(EGO, EASTWARD, -30.0, 6.0), player(1, NORTHWARD, -28.0, 6.0)
    dt = config.step / config.substeps
    for _ in range(40):
        decision = decide(ego, [agent(other)], beliefs, config)
        after = solve([ego, other], config).responses[1][level].path[0]
        changes = after[[Place.V, Place.MU]] - other.place[[Place.V, Place.MU]]
        beliefs = updated(beliefs, decision.predicted, {1: changes / dt}, {1}, config.learning)
        ego = Player(EGO, EASTWARD, decision.path[1], *CAR, target=100.0)
        other = Player(1, NORTHWARD, after, *CAR, target=100.0)
    assert beliefs.of(1)[level] == beliefs.of(1).max()
    assert beliefs.of(1)[level] > 0.9 or level == 0  # levels 0 and 2 often do the same


# -- decision -----------------------------------------------------------------------------------


def decision_of(players: list[Player], config: GameConfig = CONFIG, beliefs=None):
    others = [agent(one) for one in players[1:]]
    return decide(players[0], others, beliefs or no_beliefs(config), config)


def test_without_others_the_decision_is_the_plain_best():
    ego = player(EGO, EASTWARD, -30.0, 6.0)
    decision = decision_of([ego])
    alone = solve([ego], CONFIG).responses[0][0]
    assert (decision.actions, decision.reward) == (alone.actions, alone.reward)
    assert decision.path.shape == (13, 4)
    np.testing.assert_array_equal(decision.path[0], ego.place)
    np.testing.assert_array_equal(decision.path[1:], alone.path)
    np.testing.assert_allclose(decision.times, 0.25 * np.arange(13))
    assert decision.orders == {}


@settings(max_examples=15, deadline=None)
@given(seed=GAMES)
def test_the_reward_weighs_every_agent_by_the_belief_in_its_levels(seed):
    ego, *others = random_players(seed, 3)
    belief = {1: np.array([0.2, 0.5, 0.3]), 2: np.array([0.6, 0.1, 0.3])}
    decision = decision_of([ego, *others], TWO, Beliefs(np.full(3, 1 / 3), belief))
    board = Board([ego, *others], TWO)
    everything = sequences(2)
    expected = board.own[0].total.copy()
    layers = np.repeat([0, 1], [ACTIONS, ACTIONS**2])
    every = np.arange(len(layers))
    for i, number in enumerate(belief):
        for level, p in enumerate(belief[number]):
            moves = decision.responses[number][level].poses
            meetings = Meetings(
                board.half[:1], moves[:, None, :, None], board.half[None, [i + 1]], np.ones((1, 1))
            )
            poses = board.poses(np.zeros(len(every), int), every)
            terms = pair_rewards(meetings, np.zeros(len(every), int), layers, poses, TWO)
            of_first, of_second = terms[:ACTIONS], terms[ACTIONS:]
            expected += p * (of_first[everything[:, 0]] + of_second)
    assert decision.reward == pytest.approx(expected.max())
    assert expected[index_of(decision.actions)] == pytest.approx(expected.max())


def test_who_is_believed_to_go_is_given_way_and_who_is_believed_to_wait_is_passed():
    players = [player(EGO, EASTWARD, -16.0, 8.0), player(1, NORTHWARD, -15.0, 8.0)]
    goes, waits = (
        decision_of(players, beliefs=Beliefs(np.full(3, 1 / 3), {1: np.array(belief)}))
        for belief in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    )
    assert goes.orders == {1: Order.YIELD}
    assert waits.orders == {1: Order.GO}
    assert waits.actions == (Action.ACCELERATE,) * 3
    assert waits.path[-1, Place.S] > goes.path[-1, Place.S]
    assert waits.reward > goes.reward > -CONFIG.safe_distance


def test_there_is_no_order_with_who_has_left_or_never_comes():
    ego = player(EGO, EASTWARD, -16.0, 8.0)
    assert decision_of([ego, player(1, NORTHWARD, 20.0, 8.0)]).orders == {1: Order.NONE}
    nowhere = Agent(player(1, NORTHWARD, -15.0, 8.0), None)
    assert decide(ego, [nowhere], no_beliefs(CONFIG), CONFIG).orders == {1: Order.NONE}


@settings(max_examples=15, deadline=None)
@given(seed=GAMES, turn=st.floats(-3, 3), dx=st.floats(-100, 100), dy=st.floats(-100, 100))
def test_the_decision_does_not_depend_on_the_frame(seed, turn, dx, dy):
    c, s = math.cos(turn), math.sin(turn)

    def moved(one: Player) -> Player:
        table = one.way.table.copy()
        x, y = table[:, Sample.X], table[:, Sample.Y]
        points = np.column_stack([c * x - s * y + dx, s * x + c * y + dy])
        table[:, [Sample.X, Sample.Y]] = points
        table[:, Sample.HEADING] += turn
        return Player(one.id, Way(-100.0, 1.0, table), one.place, *CAR, target=100.0)

    players = random_players(seed, 4)
    here, there = decision_of(players, TWO), decision_of([moved(one) for one in players], TWO)
    assert here.actions == there.actions
    assert here.reward == there.reward
    np.testing.assert_array_equal(here.path, there.path)


@settings(max_examples=15, deadline=None)
@given(seed=GAMES)
def test_the_decision_does_not_depend_on_the_order_of_the_agents_and_repeats(seed):
    ego, *others = random_players(seed, 4)
    one, other, again = (decision_of([ego, *some], TWO) for some in (others, others[::-1], others))
    assert one.as_dict() == other.as_dict() == again.as_dict()


def test_the_best_sequences_are_told_best_first():
    decision = decision_of(random_players(3, 4))
    rewards = [reward for _, reward in decision.best]
    assert len(decision.best) == CONFIG.told
    assert rewards == sorted(rewards, reverse=True)
    assert decision.best[0] == (decision.actions, decision.reward)
    assert decision.pruned > decision.evaluated > 0


# -- with whom ----------------------------------------------------------------------------------


def relevant(roads, observation, config: GameConfig = CONFIG):
    """With whom the game is played by an ego vehicle that drives along lanelets 1, 11 and 21."""
    lanes = Lanes(roads)
    predict = PredictConfig()
    paths = Paths(lanes, predict.lateral_acceleration)
    known = Intersections(roads, lanes, paths, config, predict, DT)
    along = way(EAST, (-100.0, 0.0))
    ego = ego_player(along, observation.state, 100.0)
    ids = [number for number in (1, 11, 21) if number in lanes.index]
    return known.players(observation, ego, known.along(along, ids))


EGO_STATE = np.array([-30.0, 0.0, 0.0, 8.0, 0.0])  # on lanelet 1


def test_who_crosses_soon_plays():
    northward, far = moving(0, -25, NORTH, 8.0), moving(0, -150, NORTH, 8.0)
    oncoming = moving(60, 6, math.pi, 8.0)
    found = relevant(crossing(), seen(far, oncoming, northward, ego=EGO_STATE))
    assert [one.player.id for one in found.agents] == [3]
    assert found.reasons == ("obstacle 3 can be at the meeting of lanelets 11 and 13 in 1.9 s",)
    one = found.agents[0]
    assert one.zone is not None
    np.testing.assert_allclose(one.zone.own, [-3.0, 3.0], atol=0.01)
    np.testing.assert_allclose(np.diff(one.zone.other), 6.0)
    assert one.zone.other[0] - one.player.place[Place.S] == pytest.approx(25.0 - 3.0, abs=0.01)
    np.testing.assert_allclose(one.player.pose, [0.0, -25.0, 0.0, 1.0], atol=0.01)
    np.testing.assert_allclose(found.observed[3], [0.0, 0.0], atol=1e-6)


def test_the_nearest_in_time_play_and_no_more_than_allowed():
    some = [moving(0, y, NORTH, 8.0) for y in (-46, -16, -36, -26)]
    found = relevant(crossing(), seen(*some, ego=EGO_STATE), game(agents=3))
    assert [one.player.id for one in found.agents] == [2, 4, 3]


def test_an_observed_acceleration_is_told():
    found = relevant(crossing(), seen(moving(0, -25, NORTH, 8.0, a=-2.0), ego=EGO_STATE))
    np.testing.assert_allclose(found.observed[1], [-2.0, 0.0], atol=1e-6)


def test_there_is_no_game_under_traffic_lights():
    roads = crossing()
    roads.add_traffic_light(TrafficLight(500, np.zeros(2)), {1})
    found = relevant(roads, seen(moving(0, -25, NORTH, 8.0), ego=EGO_STATE))
    assert found.agents == ()
    assert "traffic lights" in found.reasons[0]


def test_there_is_no_game_where_no_ways_meet_or_behind_the_meeting():
    other = moving(40, 0.2, 0.0, 8.0)
    assert relevant(straight_road(), seen(other, ego=EGO_STATE)).agents == ()
    passed = np.array([20.0, 0.0, 0.0, 8.0, 0.0])
    found = relevant(crossing(), seen(moving(0, -25, NORTH, 8.0), ego=passed))
    assert found.agents == ()
    assert found.reasons == ("no ways meet within 60 m",)


def test_nobody_plays_who_has_passed():
    found = relevant(crossing(), seen(moving(0, 20, NORTH, 8.0), ego=EGO_STATE))
    assert found.agents == ()
    assert found.reasons[0].startswith("nobody comes to")


def test_a_whole_decision_from_an_observation():
    found = relevant(crossing(), seen(moving(0, -16, NORTH, 8.0), ego=EGO_STATE))
    ego = ego_player(way(), EGO_STATE, 100.0)
    decision = decide(ego, found.agents, no_beliefs(CONFIG), CONFIG)
    assert decision.orders == {1: Order.YIELD}
    assert decision.as_dict()["orders"] == {1: "yield"}
