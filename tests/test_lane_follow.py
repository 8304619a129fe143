"""Prediction along the lanes: ways, car following, right of way, and what it may not know."""

import inspect
import math

import numpy as np
import pytest
from commonroad.scenario.intersection import Intersection, IntersectionIncomingElement
from commonroad.scenario.lanelet import LaneletNetwork
from hypothesis import given, settings
from hypothesis import strategies as st
from made_lanes import (
    ASIDE,
    CAR,
    DT,
    WIDTH,
    arc,
    crossing,
    fork,
    lane,
    line,
    moving,
    network,
    seen,
    straight_road,
    two_lanes,
)

from mpcplan.config import PredictConfig
from mpcplan.observation import Box, Forecast, Observation, Snapshot, box_corners
from mpcplan.predict.following import Movers, drive, kept_headway
from mpcplan.predict.hypotheses import hypotheses, place_weights
from mpcplan.predict.kinds import CAR as CAR_KIND
from mpcplan.predict.lane_follow import LaneFollow
from mpcplan.predict.lanes import Lanes
from mpcplan.predict.paths import FREE, Paths
from mpcplan.predict.right_of_way import Rule, conflicts

PLAIN = {"spread_along": 0.0}
USUAL = CAR_KIND.acceleration * 0.75  # m/s^2, mean of an imperfect driver
REAR_TO_CENTRE = 1.50876  # m


def predicted(roads, observation: Observation, **changes) -> Forecast:
    """The forecast on a map."""
    return LaneFollow(roads, PredictConfig(**{**PLAIN, **changes}), DT)(observation)


def column(forecast: Forecast, row: int, *columns: Box) -> np.ndarray:
    """Columns of a row of boxes."""
    return forecast.boxes[row][:, list(columns)].squeeze()


# -- along a lane -------------------------------------------------------------------------------


def test_the_forecast_begins_with_the_present_boxes():
    observation = seen(moving(0, 0.3, 0.05, 12), moving(60, 0, 0, 3))
    forecast = predicted(straight_road(), observation)
    assert (forecast.first_step, forecast.ids) == (40, (1, 2))
    assert forecast.boxes.shape == (2, 81, 6)
    assert np.array_equal(forecast.boxes[:, 0], observation.now.boxes)
    assert not forecast.exact and np.isfinite(forecast.boxes).all()


@pytest.mark.parametrize("horizon", [0.5, 2.0, 3.1, 8.0])
def test_the_horizon_is_the_forecasts_length(horizon):
    forecast = predicted(straight_road(), seen(moving(0, 0, 0, 9)), lane_horizon=horizon)
    assert forecast.last_step - forecast.first_step == round(horizon / DT)


def test_straight_on_at_its_highest_speed():
    """A bicycle at the speed that bicycles have at most: a straight line at constant speed."""
    forecast = predicted(straight_road(), seen(moving(0, 0, 0, 6.94), kinds=["bicycle"]))
    t = DT * np.arange(81)
    assert column(forecast, 0, Box.X) == pytest.approx(6.94 * t)
    assert column(forecast, 0, Box.Y) == pytest.approx(np.zeros(81), abs=1e-9)
    assert column(forecast, 0, Box.V) == pytest.approx(np.full(81, 6.94))
    assert column(forecast, 0, Box.PSI) == pytest.approx(np.zeros(81), abs=1e-9)


def test_a_free_car_comes_to_the_usual_acceleration():
    v = column(predicted(straight_road(), seen(moving(0, 0, 0, 10))), 0, Box.V)
    rate = np.diff(v) / DT
    assert rate[0] == pytest.approx(0.0, abs=0.1) and (np.diff(rate) > -1e-9).all()
    assert rate[-1] == pytest.approx(USUAL, rel=0.1)


@pytest.mark.parametrize("a", [1.5, -2.0])
def test_an_observed_acceleration_goes_on_and_fades(a):
    v = column(predicted(straight_road(), seen(moving(0, 0, 0, 15, a))), 0, Box.V)
    t = DT * np.arange(0, 81, 2)
    rate = USUAL + (a - USUAL) * np.exp(-t[:-1] / 3.0)
    assert v[::2] == pytest.approx(15 + np.concatenate([[0], np.cumsum(rate * 2 * DT)]), abs=1e-6)


def test_way_and_speed_agree():
    forecast = predicted(straight_road(), seen(moving(0, 0, 0, 8, 2.0), moving(70, 0, 0, 4)))
    for row in range(2):
        x, v = column(forecast, row, Box.X), column(forecast, row, Box.V)
        assert np.diff(x) == pytest.approx((v[1:] + v[:-1]) / 2 * DT, abs=0.01)


def test_who_stands_for_no_reason_stays():
    forecast = predicted(straight_road(), seen(moving(0, 0, 0, 0)))
    assert (forecast.boxes[0] == forecast.boxes[0, 0]).all()


@pytest.mark.parametrize("limit", [8.0, 13.9])
def test_signs_are_minded(limit):
    roads = network(lane(1, line((-100, 0), (600, 0))), limits={1: limit})
    v = column(predicted(roads, seen(moving(0, 0, 0, 6, 1.0))), 0, Box.V)
    assert v.max() == pytest.approx(limit, abs=1e-3) and v[-1] == pytest.approx(limit, abs=1e-3)


def test_signs_ahead_are_met_by_braking_in_time():
    roads = network(
        lane(1, line((-100, 0), (60, 0)), after=(2,)),
        lane(2, line((60, 0), (600, 0)), before=(1,)),
        limits={2: 5.0},
    )
    x, v = column(predicted(roads, seen(moving(0, 0, 0, 15))), 0, Box.X, Box.V).T
    assert (v[x + CAR[0] / 2 > 61] <= 5.05).all() and v[-1] == pytest.approx(5.0, abs=0.05)
    braking = (v[6:] - v[:-6]) / (6 * DT)
    assert braking.min() > -CAR_KIND.deceleration * 1.1
    assert v[x < 20].min() > 14.0  # not sooner than needed


def test_signs_do_not_count_where_somebody_drives_faster():
    roads = network(lane(1, line((-100, 0), (600, 0))), limits={1: 8.0})
    v = column(predicted(roads, seen(moving(0, 0, 0, 6), moving(60, 0, 0, 14))), 0, Box.V)
    assert v[-1] > 12


def test_turns_in_intersections_are_driven_at_their_speed():
    """SUMO's: sqrt(a length / (turn - 15 deg)) with a lateral acceleration of 5.5 m/s^2."""
    x, y, v = column(
        predicted(crossing(), seen(moving(-8, 0.1, 0.1, 5)), alternative=1.0), 0,
        Box.X, Box.Y, Box.V,
    ).T  # fmt: skip
    assert x[-1] > 50  # straight on
    turning = seen(moving(-2.6, 2.6, math.pi / 4, 5))
    x, y, v = column(predicted(crossing(), turning), 0, Box.X, Box.Y, Box.V).T
    fastest = math.sqrt(5.5 * 9 * math.pi / 2 / (math.pi / 2 - math.radians(15)))
    assert (v[y < 6] <= fastest + 0.01).all() and y[-1] > 50 and v[-1] > fastest + 3


# -- on the ground -------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_bend_is_followed_within_the_lane(side):
    radius = 30.0
    roads = network(lane(1, arc((0, 0), 0.0, radius, side * 2.5)))
    # both bumpers on the circle: the centre lies inside of it
    inside = radius - math.sqrt(radius**2 - (CAR[0] / 2) ** 2)
    near = radius - inside
    x, y = near * math.sin(0.1), side * (radius - near * math.cos(0.1))
    observation = seen(moving(x, y, side * 0.1, 8), kinds=["bicycle"])
    boxes = predicted(roads, observation).boxes[0, :71]
    corners = box_corners(boxes) - np.array([0.0, side * radius])
    assert np.abs(np.hypot(corners[..., 0], corners[..., 1]) - radius).max() < WIDTH / 2
    centre = boxes[:, :2] - np.array([0.0, side * radius])
    assert radius - np.hypot(*centre.T) == pytest.approx(np.full(71, inside), abs=0.03)
    tangent = np.arctan2(centre[:, 1], centre[:, 0]) + side * math.pi / 2
    turned = np.cos(boxes[:, Box.PSI] - tangent)
    assert turned.min() > 0.999


def test_the_offset_fades_at_the_configured_rate():
    for fade in (0.5, 20.0):
        forecast = predicted(straight_road(), seen(moving(0, 0.8, 0, 10)), offset_fade=fade)
        t = DT * np.arange(81)
        assert column(forecast, 0, Box.Y) == pytest.approx(0.8 * np.exp(-t / fade), abs=1e-9)


def test_mirrored_traffic_has_the_mirrored_forecast():
    def at(sign: float) -> Forecast:
        roads = network(
            lane(1, line((-100, 0), (0, 0)), after=(2,)),
            lane(2, arc((0, 0), 0.0, 40.0, sign * 1.5), before=(1,)),
        )
        others = [
            moving(-30, sign * 0.4, sign * 0.03, 9, 0.5),
            moving(-12, 0, 0, 4),
            moving(-50, sign * 8, sign * 0.3, 3),
        ]
        return predicted(roads, seen(*others))

    one, other = at(1.0).boxes, at(-1.0).boxes
    flip = np.ones(6)
    flip[[Box.Y, Box.PSI]] = -1
    assert other * flip == pytest.approx(one, abs=1e-9)


def test_who_drifts_to_the_next_lane_changes_to_it():
    """1.5 m off the own centre and going on to the left: the lane change is completed."""
    forecast = predicted(two_lanes(), seen(moving(0, 1.5, 0.0, 15, side=0.8)))
    y = column(forecast, 0, Box.Y)
    assert y[-1] == pytest.approx(WIDTH, abs=0.1) and (np.diff(y) > -1e-9).all()
    steady = predicted(two_lanes(), seen(moving(0, 0.6, 0.0, 15)))
    assert abs(column(steady, 0, Box.Y)).max() < 0.7


def test_boxes_grow_with_the_way_driven():
    forecast = predicted(straight_road(), seen(moving(0, 0, 0, 10)), spread_along=0.05)
    x, length = column(forecast, 0, Box.X, Box.LENGTH).T
    assert length == pytest.approx(CAR[0] + 0.1 * x)
    assert (column(forecast, 0, Box.WIDTH) == CAR[1]).all()


# -- car following -------------------------------------------------------------------------------


def gaps(forecast: Forecast, follower: int, leader: int) -> np.ndarray:
    """Gaps [m] on a road along x."""
    x = forecast.boxes[:, :, Box.X]
    return x[leader] - x[follower] - CAR[0]


@pytest.mark.parametrize(
    ("gap", "v", "v_leader"), [(15, 15, 2), (40, 25, 0), (8, 10, 6), (1, 4, 4)]
)
def test_nobody_runs_into_a_slow_leader(gap, v, v_leader):
    others = moving(0, 0, 0, v), moving(gap + CAR[0], 0, 0, v_leader)
    forecast = predicted(straight_road(), seen(*others, kinds=["car", "bicycle"]))
    assert gaps(forecast, 0, 1).min() > 0.0


def test_the_ego_vehicle_is_followed_like_any_other():
    """As a leader that follows somebody itself, whatever becomes of its followers in forecasts."""
    ego = np.array([30 - REAR_TO_CENTRE, 0, 0, 6, 0])
    others = moving(0, 0, 0, 14), moving(42, 0, 0, 6)
    behind = predicted(straight_road(), seen(*others, ego=ego), leave_out_followers=False)
    gap = column(behind, 1, Box.X) - column(behind, 0, Box.X)
    assert gap.min() > CAR[0] + 4.298  # the ego vehicle is between them
    alone = predicted(straight_road(), seen(*others), leave_out_followers=False)
    assert column(behind, 0, Box.X)[30] < column(alone, 0, Box.X)[30] - 3


def test_the_ego_vehicle_is_expected_to_drive_on():
    """One that stands where it has the right of way is waited for, or it would never get it."""
    ego = np.array([-20 - REAR_TO_CENTRE, 0, 0, 0, 0])
    waiting = predicted(crossing(), seen(SOUTH, ego=ego)).boxes[0, :, Box.Y]
    alone = predicted(crossing(), seen(SOUTH)).boxes[0, :, Box.Y]
    line = -9 - CAR[0] / 2
    assert alone[35] > line and (waiting[:36] < line).all()
    assert waiting[-1] > waiting[36] + 5  # when the ego vehicle would be through


def free_movers(s: list[float], v: list[float], leaders: list[int], count: int) -> Movers:
    """Cars on one way: gap kept when standing 1 m, lengths 4.5 m, headway 1 s."""
    n = len(s)
    none = np.full(n, np.inf)
    return Movers(
        path=np.zeros(n, int), s=np.array(s), v=np.array(v),
        acceleration=np.where(np.array(leaders) < n, 2.0, 0.0) * np.ones((count, 1)),
        deceleration=np.full(n, 4.5), headway=np.ones(n), speed=np.full(n, 40.0),
        profile=np.full(n, FREE), leader=np.array(leaders), offset=np.full(n, -5.5), until=none,
        stop=none, release=np.zeros(n),
    )  # fmt: skip


@pytest.mark.parametrize("v", [5.0, 12.0, 20.0])
def test_the_equilibrium_gap_is_that_of_krauss(v):
    """g = v tau + the gap kept when standing."""
    paths = Paths(Lanes(straight_road()), 5.5)
    s, speed = drive(paths, free_movers([0.0, 80.0], [v, v], [1, 2], 400), 0.2)
    assert speed[-1] == pytest.approx([v, v], abs=0.01)
    assert s[-1, 1] - 4.5 - s[-1, 0] == pytest.approx(v * 1.0 + 1.0, rel=0.02)


@settings(deadline=None)
@given(
    gap=st.floats(1.1, 80), v=st.floats(0, 35), v_leader=st.floats(0, 35), b=st.floats(2.0, 7.5)
)  # fmt: skip
def test_the_kept_headway_leaves_the_speed_as_it_is(gap, v, v_leader, b):
    """Where it lies within its bounds, the safe speed is the present one."""
    tau = kept_headway(*(np.array([x]) for x in (v, v_leader, gap, b)))[0]
    assert 0.2 <= tau <= 1.0
    if 0.2 < tau < 1.0 and v > 0.1:
        safe = -b * tau + math.sqrt((b * tau) ** 2 + v_leader**2 + 2 * b * gap)
        assert safe == pytest.approx(v, abs=1e-6)


def test_who_stops_at_a_line_goes_on_when_released():
    paths = Paths(Lanes(straight_road()), 5.5)
    movers = free_movers([0.0], [10.0], [1], 100)
    held = Movers(**{
        **vars(movers), "stop": np.array([40.0]), "release": np.array([9.0]),
        "acceleration": np.full((100, 1), 2.0),
    })  # fmt: skip
    s, v = drive(paths, held, 0.2)
    t = 0.2 * np.arange(101)
    assert s[t <= 9.0].max() <= 40.0 + 1e-6 and v[t <= 9.0][-1] < 0.5
    assert s[-1, 0] > 100.0 and (np.diff(v[:, 0]) > -9.0 * 0.2 - 1e-9).all()


def test_a_leader_that_turns_off_leads_no_more():
    """Behind a bicycle that turns at a fork, the straight way is free once it is gone."""
    bend = arc((0, 0), 0.0, 15.0, 1.2)
    turning = moving(bend[8, 0], bend[8, 1], 1.2 * 8 / 30, 3)
    observation = seen(moving(-20, 0, 0, 10), turning, kinds=["car", "bicycle"])
    forecast = predicted(fork(), observation)
    v = column(forecast, 0, Box.V)
    assert v.min() < 8 and v[-1] > 11
    assert forecast.boxes[1, -1, Box.Y] > 20 and abs(forecast.boxes[0, -1, Box.Y]) < 0.1


def test_nobody_brakes_harder_than_brakes_can():
    v = column(predicted(straight_road(), seen(moving(0, 0, 0, 25), moving(12, 0, 0, 0))), 0, Box.V)
    assert np.diff(v).min() / DT == pytest.approx(-9.0, abs=1e-6)


def test_a_ring_is_driven_once():
    """Four quarters of a circle, each followed by the next: who is ahead is near."""
    quarters = []
    for k in range(4):
        angle = k * math.pi / 2
        begin = [20 * math.cos(angle), 20 * math.sin(angle)]
        points = arc(begin, angle + math.pi / 2, 20.0, math.pi / 2)
        quarters.append(lane(k + 1, points, ((k + 1) % 4 + 1,), ((k - 1) % 4 + 1,)))
    roads = network(*quarters)
    paths = Paths(Lanes(roads), 5.5).paths
    assert [path.lanes for path in paths] == [(k, *(j % 4 for j in range(k + 1, k + 4)))
                                             for k in range(4)]  # fmt: skip
    ahead = moving(20 * math.cos(0.6), 20 * math.sin(0.6), 0.6 + math.pi / 2, 0)
    boxes = predicted(roads, seen(moving(20, 0.5, math.pi / 2, 8), ahead)).boxes
    assert boxes[0, -1, Box.V] < 0.1
    assert np.hypot(*(boxes[0, -1, :2] - boxes[1, -1, :2])) > CAR[0]


# -- who is behind the ego vehicle ---------------------------------------------------------------


EGO = np.array([50.0, 0, 0, 10.0, 0])


def left_out(forecast: Forecast) -> list[bool]:
    """Whether the forecast of each row ends with the present."""
    return np.isnan(forecast.boxes[:, 1:, Box.X]).all(axis=1).tolist()


def test_followers_of_the_ego_vehicle_are_left_out():
    others = [moving(30, 0, 0, 10), moving(15, 0, 0, 10), moving(70, 0, 0, 10)]
    forecast = predicted(two_lanes(), seen(*others, ego=EGO))
    assert left_out(forecast) == [True, True, False]
    assert np.isfinite(forecast.boxes[:, 0]).all()
    kept = predicted(two_lanes(), seen(*others, ego=EGO), leave_out_followers=False)
    assert left_out(kept) == [False] * 3


def test_who_cannot_stay_behind_is_not_left_out():
    forecast = predicted(two_lanes(), seen(moving(40, 0, 0, 25), ego=EGO))
    assert left_out(forecast) == [False]


def test_between_lanes_the_ego_vehicle_has_no_followers():
    """It may still go to either: both sides have to be looked at."""
    others = [moving(25, 0, 0, 10), moving(30, WIDTH, 0, 10)]
    between = np.array([50.0, WIDTH / 2, 0, 10, 0])
    assert left_out(predicted(two_lanes(), seen(*others, ego=between))) == [False, False]


def test_who_is_left_out_has_no_other_hypotheses():
    observation = seen(moving(-15, 0, 0, 8), ego=np.array([-5.0, 0, 0, 8, 0]))
    forecast = predicted(fork(turn=0.5), observation)
    assert forecast.ids == (1,) and left_out(forecast) == [True]


def test_who_is_beside_or_merges_is_not_left_out():
    side = predicted(two_lanes(), seen(moving(30, WIDTH, 0, 10), ego=EGO))
    assert left_out(side) == [False]
    from_the_right = moving(4, -9, math.atan2(10, 40), 10)
    seen_both = seen(from_the_right, ego=np.array([20.0, 0, 0, 10, 0]))
    assert left_out(predicted(merging(), seen_both)) == [False]


# -- branches -----------------------------------------------------------------------------------


@settings(deadline=None)
@given(
    x=st.floats(-150, 12), y=st.floats(-1.5, 1.5), psi=st.floats(-0.4, 0.4), v=st.floats(0, 30)
)  # fmt: skip
def test_weights_sum_to_one(x, y, psi, v):
    lanes = Lanes(fork())
    paths = Paths(lanes, 5.5)
    places = lanes.match(np.array([[x, y]]), np.array([psi]))
    velocity = v * np.array([[math.cos(psi), math.sin(psi)]])
    weight = place_weights(places, velocity, paths, 1)
    assert len(weight) and weight.sum() == pytest.approx(1.0)
    found = hypotheses(places, weight, np.array([v]), paths)
    assert found.weight.sum() == pytest.approx(1.0) and (found.weight > 0).all()
    assert (np.diff(found.weight) <= 1e-12).all()
    for ways in paths.of_lane:
        assert sum(paths.paths[p].weight for p in ways) == pytest.approx(1.0)


def test_a_place_counts_on_the_lane_that_follows():
    """Within half a metre of the fork both branches hold a car, and the lane before no more."""
    lanes = Lanes(fork())
    for x in (-0.3, 0.3):
        places = lanes.match(np.array([[x, 0.0]]), np.zeros(1))
        assert [lanes.lanes[i].id for i in places.lane] == [2, 3]
    assert [lanes.lanes[i].id for i in lanes.match(np.array([[-9.0, 0]]), np.zeros(1)).lane] == [1]


def test_where_branches_begin_their_probabilities_decide():
    lanes = Lanes(fork(turn=0.9))
    paths = Paths(lanes, 5.5)
    places = lanes.match(np.array([[0.0, 0.0]]), np.zeros(1))
    weight = place_weights(places, np.zeros((1, 2)), paths, 1)
    assert weight[0] / weight[1] == pytest.approx(math.exp(0.9 / 0.6), rel=0.1)


def test_the_straighter_way_is_the_likelier_one():
    forecast = predicted(fork(turn=0.5), seen(moving(-15, 0, 0, 8)))
    assert forecast.ids == (1, 1)
    assert forecast.boxes[0, -1, Box.Y] == pytest.approx(0.0, abs=1e-6)
    assert forecast.boxes[1, 30, Box.Y] > 1.0


def test_other_branches_end_sooner_and_only_where_they_matter():
    observation = seen(moving(-15, 0, 0, 8))
    forecast = predicted(fork(turn=0.5), observation, alternative_horizon=2.5)
    other = forecast.boxes[1, :, Box.X]
    assert np.isfinite(other[:26]).all() and np.isnan(other[26:]).all()
    assert predicted(fork(turn=0.5), observation, alternative=0.5).ids == (1,)
    assert predicted(fork(turn=0.5), seen(moving(-90, 0, 0, 8))).ids == (1,)


def test_once_in_a_branch_the_other_one_is_out():
    bend = arc((0, 0), 0.0, 15.0, 1.2)
    turning = moving(bend[15, 0], bend[15, 1], 1.2 * 15 / 30, 5)
    forecast = predicted(fork(), seen(turning))
    assert forecast.ids == (1,) and forecast.boxes[0, -1, Box.Y] > 20


# -- right of way --------------------------------------------------------------------------------


def rules(roads) -> dict[tuple[int, int], Rule]:
    """The rules by the ids of both lanelets."""
    lanes = Lanes(roads)
    ids = [known.id for known in lanes.lanes]
    found = conflicts(roads, lanes)
    return {(ids[a], ids[c.other]): c.rule for a, some in found.items() for c in some}


def test_rules_of_an_intersection():
    known = rules(crossing())
    assert known[13, 11] is Rule.YIELD and known[11, 13] is Rule.GO  # side road, main road
    assert known[13, 12] is Rule.YIELD and known[12, 13] is Rule.GO
    assert known[14, 12] is Rule.YIELD and known[12, 14] is Rule.GO  # left turn, oncoming
    assert known[13, 14] is Rule.YIELD and known[14, 13] is Rule.GO  # they end together
    assert (11, 14) not in known and (11, 12) not in known


def test_without_an_intersection_who_comes_first_goes_first():
    assert {*rules(crossing(known=False)).values()} == {Rule.FIRST_COME}


def test_the_right_goes_first_among_equals():
    """Two one-way roads cross: both are the main road, and neither comes from ahead."""
    roads = network(
        lane(1, line((-100, 0), (-8, 0)), after=(11,)),
        lane(11, line((-8, 0), (8, 0)), before=(1,)),
        lane(2, line((0, -100), (0, -8)), after=(12,)),
        lane(12, line((0, -8), (0, 8)), before=(2,)),
    )
    roads.add_intersection(Intersection(50, [
        IntersectionIncomingElement(51, {1}, set(), {11}, set()),
        IntersectionIncomingElement(52, {2}, set(), {12}, set()),
    ]))  # fmt: skip
    known = rules(roads)
    assert known[11, 12] is Rule.YIELD and known[12, 11] is Rule.GO


WEST = moving(-40, 0, 0, 10)
SOUTH = moving(0, -35, math.pi / 2, 9)


def test_who_has_to_yield_waits_until_the_other_is_gone():
    forecast = predicted(crossing(), seen(WEST, SOUTH), alternative=1.0)
    x, y = forecast.boxes[0, :, Box.X], forecast.boxes[1, :, Box.Y]
    passing = np.abs(x) < 5
    assert passing.any() and (y[passing] < -9 - CAR[0] / 2).all()
    alone = predicted(crossing(), seen(SOUTH), alternative=1.0)
    assert alone.boxes[0, -1, Box.Y] > y[-1] + 10
    assert y[-1] > 0  # it has gone on since
    first = predicted(crossing(), seen(WEST), alternative=1.0)
    assert forecast.boxes[0] == pytest.approx(first.boxes[0])  # the main road does not care


def test_the_ego_vehicle_is_given_way():
    ego = np.array([-40 - REAR_TO_CENTRE, 0, 0, 10, 0])
    forecast = predicted(crossing(), seen(SOUTH, ego=ego))
    at = ego[0] + 10 * DT * np.arange(81)  # or a little further: it may speed up
    assert (forecast.boxes[0, (at > -5) & (at < 0), Box.Y] < -9 - CAR[0] / 2).all()


def test_who_cannot_stop_any_more_goes_on():
    near = moving(0, -16, math.pi / 2, 14)
    both, alone = (
        predicted(crossing(), seen(near, *other), alternative=1.0)
        for other in ([moving(-16, 0, 0, 10)], [])
    )
    assert both.boxes[0] == pytest.approx(alone.boxes[0])


def test_where_no_rule_is_known_the_later_one_waits():
    roads = crossing(known=False)
    later = moving(-46, 0, 0, 10)
    forecast = predicted(roads, seen(later, SOUTH), alternative=1.0)
    alone = predicted(roads, seen(SOUTH), alternative=1.0)
    assert forecast.boxes[1] == pytest.approx(alone.boxes[0])
    free = predicted(roads, seen(later), alternative=1.0).boxes[0, :, Box.X]
    x, y = forecast.boxes[0, :, Box.X], forecast.boxes[1, :, Box.Y]
    there = np.abs(y) < 4
    assert (np.abs(free[there]) < 6).any() and (x[there] < -3 - CAR[0] / 2).all()
    assert x[-1] > 0


STANDING = moving(-1.0 - CAR[0] / 2, 0, 0, 0)  # with its nose 1 m before the road from the south


def test_who_stands_before_a_crossing_waits_for_who_comes():
    roads = crossing(known=False)
    forecast = predicted(roads, seen(STANDING, moving(0, -13, math.pi / 2, 9)), alternative=1.0)
    x, y = forecast.boxes[0, :, Box.X], forecast.boxes[1, :, Box.Y]
    coming = y < CAR[0] / 2
    assert coming.any() and x[coming] == pytest.approx(x[0])
    assert x[-1] > x[0] + 5  # it has gone on since


def test_who_stands_beyond_a_crossing_does_not_wait_for_who_comes_there():
    roads = crossing(known=False)
    beyond, leader = moving(3.0, 0, 0, 0), moving(60, 0, 0, 15)
    forecast = predicted(roads, seen(beyond, leader, moving(0, -13, math.pi / 2, 9)))
    alone = predicted(roads, seen(beyond, leader))
    assert forecast.boxes[0] == pytest.approx(alone.boxes[0])


def merging() -> LaneletNetwork:
    """Lanelets 1, straight on, and 2, from the right, become 3 at x = 40 m."""
    return network(
        lane(1, line((-100, 0), (40, 0)), after=(3,)),
        lane(2, np.vstack([line((-100, -30), (0, -10)), line((0, -10), (40, 0))[1:]]), after=(3,)),
        lane(3, line((40, 0), (400, 0)), before=(1, 2)),
    )


def test_who_stands_before_a_merge_goes_when_the_other_is_ahead():
    waits = moving(25.0, 0, 0, 0)
    slope = math.atan2(10, 40)
    comes = moving(10.0, -7.5, slope, 5)
    forecast = predicted(merging(), seen(waits, comes), alternative=1.0)
    x, ahead = forecast.boxes[0, :, Box.X], forecast.boxes[1, :, Box.X]
    sets_off = int((x > x[0] + 0.1).argmax())
    assert sets_off > 10
    assert ahead[sets_off] < 40.0  # it has not come to the merge yet
    apart = np.hypot(*(forecast.boxes[0, :, :2] - forecast.boxes[1, :, :2]).T)
    assert apart[sets_off:].min() > CAR[0]


# -- off the lanes, few, many, new ---------------------------------------------------------------


@pytest.mark.parametrize(
    "other", [moving(0, 40, 0.7, 6), moving(0, 0, math.pi, 6)], ids=["beside", "against"]
)
def test_off_the_lanes_they_go_straight_on(other):
    boxes = predicted(straight_road(), seen(other)).boxes[0]
    x, y, psi, v = boxes[0, :4]
    t = DT * np.arange(81)
    assert boxes[:, Box.X] == pytest.approx(x + v * math.cos(psi) * t)
    assert boxes[:, Box.Y] == pytest.approx(y + v * math.sin(psi) * t)


def test_off_the_lanes_acceleration_fades():
    v = predicted(straight_road(), seen(moving(0, 40, 0.7, 6, -2.0))).boxes[0, :, Box.V]
    t = DT * np.arange(81)
    assert v == pytest.approx(6 - 2 * (1 - np.exp(-t)), abs=1e-6)


def test_off_the_lanes_yaw_rates_fade():
    """w t of the past goes on as w (1 - exp(-t)); who stands does not turn at all."""
    w, t = 0.3, DT * np.arange(81)
    for v, turned in ((6.0, w * (1 - np.exp(-t))), (0.0, 0.0 * t)):
        other = seen(lambda s, v=v: [0, 40, 1 + w * s, v, *CAR])
        boxes = predicted(straight_road(), other).boxes[0]
        assert boxes[:, Box.PSI] == pytest.approx(1 + turned, abs=1e-9)
        heading = (boxes[1:, Box.PSI] + boxes[:-1, Box.PSI]) / 2
        assert np.diff(boxes[:, Box.X]) == pytest.approx(v * DT * np.cos(heading), abs=1e-3)


@pytest.mark.parametrize("kind", ["pedestrian", "parkedVehicle"])
def test_who_is_no_driver_follows_no_lane(kind):
    forecast = predicted(straight_road(), seen(moving(0, 1.0, 0.9, 1.2), kinds=[kind]))
    assert np.ptp(forecast.boxes[0, :, Box.PSI]) < 1e-9 and forecast.boxes[0, -1, Box.Y] > 8


def test_the_far_away_go_straight_on():
    roads = fork()
    ego = np.array([-200.0, 0, 0, 5, 0])
    forecast = predicted(roads, seen(moving(-10, 0, 0.1, 8), ego=ego), reach=100.0)
    assert np.ptp(forecast.boxes[0, :, Box.PSI]) < 1e-9 and forecast.ids == (1,)


def test_nobody_is_predicted_where_nobody_is():
    for ego in (ASIDE, EGO):
        forecast = predicted(straight_road(), seen(ego=ego))
        assert forecast.ids == () and forecast.boxes.shape == (0, 81, 6)


def test_a_newcomer_is_predicted_from_one_box():
    before = seen(moving(50, 0, 0, 10)).others
    now = Snapshot(
        41, (1, 7), np.array([[51.0, 0, 0, 10, *CAR], [0, 0, 0, 12, *CAR]]), ("car",) * 2
    )
    forecast = predicted(straight_road(), Observation(41, ASIDE, 0.0, (*before, now)))
    assert forecast.ids == (1, 7)
    v = forecast.boxes[1, :, Box.V]
    assert v[2] == pytest.approx(12, abs=0.1) and np.isfinite(forecast.boxes).all()


def test_who_vanished_is_not_predicted():
    seen_before = seen(moving(50, 0, 0, 10), moving(80, 0, 0, 10)).others
    now = Snapshot(41, (2,), np.array([[81.0, 0, 0, 10, *CAR]]), ("car",))
    forecast = predicted(straight_road(), Observation(41, ASIDE, 0.0, (*seen_before, now)))
    assert forecast.ids == (2,)


def test_kinds_may_be_unknown():
    observation = seen(moving(0, 0, 0, 10), kinds=[])
    as_car = predicted(straight_road(), seen(moving(0, 0, 0, 10)))
    assert np.array_equal(predicted(straight_road(), observation).boxes, as_car.boxes)


# -- what it may know ----------------------------------------------------------------------------


def busy() -> Observation:
    """Traffic at the crossing."""
    others = [WEST, SOUTH, moving(60, 6, math.pi, 8, -1.0), moving(-70, 0.3, 0.02, 13)]
    return seen(*others, moving(30, 40, 1.0, 3), ego=np.array([-90.0, 0, 0, 9, 0]))


def test_only_map_configuration_and_time_step_are_known():
    known = list(inspect.signature(LaneFollow.__init__).parameters)
    assert known == ["self", "network", "config", "dt"]


def test_the_same_observation_has_the_same_forecast():
    observation = busy()
    one, other = (LaneFollow(crossing(), PredictConfig(), DT) for _ in range(2))
    first = one(observation)
    assert one(observation) is first
    one(seen(WEST))  # what was seen in between leaves nothing behind
    for again in (one(observation), other(observation)):
        assert again.ids == first.ids
        assert again.boxes.tobytes() == first.boxes.tobytes()


def test_the_order_of_the_map_does_not_matter():
    lanelets = crossing(known=False).lanelets
    forecasts = [
        LaneFollow(network(*order), PredictConfig(), DT)(busy())
        for order in (lanelets, lanelets[::-1])
    ]
    assert forecasts[0].ids == forecasts[1].ids
    assert forecasts[0].boxes.tobytes() == forecasts[1].boxes.tobytes()


def test_where_the_map_lies_does_not_matter():
    """Moved by some hundred metres: the same motion up to rounding."""
    shift = np.array([431.0, -277.0])
    roads = network(*(
        lane(known.lanelet_id, known.center_vertices + shift, known.successor, known.predecessor)
        for known in crossing(known=False).lanelets
    ))  # fmt: skip
    here, there = busy(), busy()
    for snapshot in there.others:
        snapshot.boxes[:, :2] += shift
    there.state[:2] += shift
    one, other = predicted(crossing(known=False), here), predicted(roads, there)
    assert one.ids == other.ids
    moved = one.boxes.copy()
    moved[..., :2] += shift
    assert other.boxes == pytest.approx(moved, abs=1e-6, nan_ok=True)
