"""Seeds: polynomials, paths, speed profiles, blocked cells, lattice, search and tracking."""

from itertools import product

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_ocp import (
    CAR_FRONT,
    DT,
    Track,
    forecast_of,
    frame_of,
    occupancy_of,
    road_of,
    state_at,
    straight,
    straight_across,
    straight_road,
)

from mpcplan.config import Config, SeedConfig
from mpcplan.observation import Box, Forecast, box_corners
from mpcplan.predict.occupancy import Occupancy, occupancy
from mpcplan.road.goal import GoalWindow
from mpcplan.road.road import Road
from mpcplan.seed.blocked import block
from mpcplan.seed.candidates import Effort, find_seeds
from mpcplan.seed.cost import EDGE, evaluated_jerk, trajectory_cost
from mpcplan.seed.crossing import last_crossing
from mpcplan.seed.lattice import lattice
from mpcplan.seed.paths import Paths, frenet_pose, sample_paths
from mpcplan.seed.polynomials import evaluate, quartic, quintic
from mpcplan.seed.profiles import Arrival, Motion, Profiles, sample_profiles
from mpcplan.seed.search import as_seed, search
from mpcplan.seed.seed import Seed, Stage
from mpcplan.seed.track import track
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import FORD_ESCORT, centres, input_violations, rectangles, simulate
from mpcplan.verify.drivability import separation

numbers = st.floats(-20, 20)
durations = st.floats(0.5, 8)
B = FORD_ESCORT.rear_to_centre


# -- polynomials ----------------------------------------------------------------------------------


@given(start=st.tuples(numbers, numbers, numbers), end=st.tuples(numbers, numbers, numbers),
       t1=durations)  # fmt: skip
def test_quintic_meets_both_ends(start, end, t1):
    c = quintic(*(np.array([x]) for x in (*start, *end, t1)))
    values = np.array(evaluate(c, np.array([[0.0, t1]])))[:, 0]
    assert values[:, 0] == pytest.approx(start, abs=1e-9)
    assert values[:, 1] == pytest.approx(end, abs=1e-6)


@given(start=st.tuples(numbers, numbers, numbers), v1=numbers, a1=numbers, t1=durations)
def test_quartic_meets_its_start_and_its_final_speed(start, v1, a1, t1):
    c = quartic(*(np.array([x]) for x in (*start, v1, a1, t1)))
    values = np.array(evaluate(c, np.array([[0.0, t1]])))[:, 0]
    assert values[:, 0] == pytest.approx(start, abs=1e-9)
    assert values[1:, 1] == pytest.approx((v1, a1), abs=1e-6)


def squared_jerk(positions: Array, t: Array) -> float:
    """Integral of the squared third derivative of sampled positions."""
    jerk = np.diff(positions, 3) / (t[1] - t[0]) ** 3
    return float((jerk**2).sum() * (t[1] - t[0]))


def test_the_quintic_is_jerk_optimal():
    """Any change that keeps both ends costs more."""
    t = np.linspace(0.0, 3.0, 301)
    c = quintic(*(np.array([x]) for x in (0.0, 10.0, 1.0, 25.0, 6.0, 0.0, 3.0)))
    best = evaluate(c, t[None])[0][0]
    for size, waves in product((-0.3, 0.3), (1, 2)):
        bump = size * (t / 3) ** 3 * (1 - t / 3) ** 3 * np.cos(waves * t)
        assert squared_jerk(best + bump, t) > squared_jerk(best, t)


def test_evaluated_derivatives_are_those_of_the_position():
    rng = np.random.default_rng(2)
    c, t = rng.normal(size=(4, 6)), np.linspace(0, 2, 2001)
    p, v, a = evaluate(c, t[None])
    assert np.gradient(p, t, axis=1)[:, 1:-1] == pytest.approx(v[:, 1:-1], abs=1e-3)
    assert np.gradient(v, t, axis=1)[:, 1:-1] == pytest.approx(a[:, 1:-1], abs=1e-2)


# -- paths ----------------------------------------------------------------------------------------


def sine(s: Array) -> Array:
    """A winding road."""
    return 0.02 * np.sin(s / 20)


def nobody(steps: int = 60) -> Occupancy:
    """An empty road."""
    return occupancy_of(frame_of(straight, 50.0), steps)


def paths_on(road: Road, state: Array, reach: float = 60.0, *, window: Occupancy | None = None,
             config: SeedConfig | None = None) -> Paths:  # fmt: skip
    """All candidate paths from a state."""
    pose = frenet_pose(road, state)
    return sample_paths(road, pose, reach, window or nobody(), config or SeedConfig())


@pytest.mark.parametrize("curvature", [straight, sine])
def test_heading_and_curvature_of_paths_are_those_of_the_drawn_curve(curvature):
    road = road_of(frame_of(curvature, 150.0))
    paths = paths_on(road, state_at(road.frame, 30.0, d=0.4, mu=0.06))
    for s, d, mu, kappa in zip(paths.s, paths.d, paths.mu, paths.kappa, strict=True):
        kept = s < s[-1] - paths.spacing  # the last sample is repeated where a path is shorter
        s, d, mu, kappa = s[kept], d[kept], mu[kept], kappa[kept]
        points = road.frame.to_cartesian(s, d)
        step = np.diff(points, axis=0)
        assert np.hypot(*step.T) == pytest.approx(paths.spacing, abs=2e-3)
        heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
        middle = (road.frame.heading(s) + mu)[1:] / 2 + (road.frame.heading(s) + mu)[:-1] / 2
        assert heading == pytest.approx(middle, abs=5e-3)
        numeric = np.diff(heading) / paths.spacing
        assert numeric[1:-1] == pytest.approx(kappa[2:-2], abs=6e-3)


def test_steering_belongs_to_the_curvature():
    road = road_of(frame_of(sine, 150.0))
    paths = paths_on(road, state_at(road.frame, 30.0))
    assert np.tan(paths.delta) / FORD_ESCORT.wheelbase == pytest.approx(paths.kappa)
    slope = (paths.delta[:, 2:] - paths.delta[:, :-2]) / (2 * paths.spacing)
    assert paths.delta_slope[:, 1:-1] == pytest.approx(slope, abs=1e-9)


@pytest.mark.parametrize(("d", "mu", "delta"), [(0.0, 0.0, 0.0), (0.8, -0.1, 0.03), (-0.5, 0.2, 0)])
def test_paths_begin_at_the_pose_and_end_at_their_targets(d, mu, delta):
    road = road_of(frame_of(sine, 150.0))
    state = state_at(road.frame, 30.0, d=d, mu=mu)
    state[State.DELTA] = delta
    paths = paths_on(road, state, reach=110.0)  # where the moves that begin last have ended
    assert paths.s[:, 0] == pytest.approx(30.0, abs=1e-6)
    assert paths.d[:, 0] == pytest.approx(d, abs=1e-6)
    assert paths.mu[:, 0] == pytest.approx(mu, abs=1e-3)
    assert paths.delta[:, 0] == pytest.approx(delta, abs=1e-3)
    assert paths.d[:, -1] == pytest.approx(paths.target)
    assert paths.mu[:, -1] == pytest.approx(0.0, abs=1e-9)


def test_targets_are_offsets_lanes_and_the_goal():
    goal = GoalWindow(40, 40, (90.0, 110.0), (6.0, 7.0), None, None)
    targets = paths_on(straight_road(goal), state_at(straight_road().frame, 30.0)).target
    assert set(np.round(targets, 2)) == {-0.6, 0.0, 0.6, 3.5, 6.5}
    assert targets[0] == 0.0  # lane keeping comes first


def test_paths_lead_around_a_slow_obstacle_and_back():
    road = straight_road()
    window = occupancy_of(road.frame, 60, Track(60.0, -1.0, 0.0))
    paths = paths_on(road, state_at(road.frame, 30.0), 90.0, window=window)
    beside = np.abs(paths.s - 60.0) < 4.0
    clear = paths.d > -1.0 + 0.9 + FORD_ESCORT.width / 2
    around = np.array([clear[p, beside[p]].all() for p in range(len(paths.s))])
    back = np.abs(paths.d[:, -1]) < 1e-6
    assert (around & back).any()
    fast = occupancy_of(road.frame, 60, Track(60.0, -1.0, 9.0))
    fewer = paths_on(road, state_at(road.frame, 30.0), 90.0, window=fast)
    assert len(fewer.s) < len(paths.s)


@pytest.mark.parametrize(("stands", "more"), [(10, 4), (50, 0)])
def test_who_is_going_to_stand_in_the_way_is_passed_where_it_will(stands, more):
    """At first it drives; 1.5 s of the 6 s that are seen is long enough to be in the way."""
    road = straight_road()
    moving = Track(60.0, -1.0, 9.0)

    window = occupancy_of(road.frame, 60, moving)
    window.v[:, stands:] = 0.0
    free = paths_on(road, state_at(road.frame, 30.0), 90.0)
    paths = paths_on(road, state_at(road.frame, 30.0), 90.0, window=window)
    assert paths.passing.sum() in ({3, 4} if more else {0})
    assert len(paths.s) - len(free.s) == paths.passing.sum()
    at = float(window.s[0, stands])
    for p in np.flatnonzero(paths.passing):
        d = np.interp(at, paths.s[p], paths.d[p])
        assert not -1.0 - 0.9 - 0.8 < d < -1.0 + 0.9 + 0.8


def test_road_excess_measures_how_far_the_body_sticks_out():
    road = straight_road(left=1.75, right=-1.75)
    config = SeedConfig(offsets=(0.0, 0.5, 1.2), lengths=(15.0,))
    paths = paths_on(road, state_at(road.frame, 30.0), config=config)
    ends = {round(float(t), 2): float(e) for t, e in zip(paths.target, paths.road_excess[:, -1],
                                                        strict=True)}  # fmt: skip
    assert ends[0.0] == 0.0
    assert ends[0.5] < 0.05
    assert 1.2 + 0.837 - 1.75 <= ends[1.2] < 0.6  # more in between, when it is turned
    assert (np.diff(paths.road_excess, axis=1) >= 0).all()


# -- profiles -------------------------------------------------------------------------------------

T = DT * np.arange(61)


def profiles_of(motion: Motion, arrivals: list[Arrival], leaders: list[tuple]) -> Profiles:
    """All speed profiles over 6 s."""
    rows = np.array(leaders, float).reshape(-1, 3)
    return sample_profiles(motion, arrivals, rows, T, 20.0, SeedConfig())


@pytest.mark.parametrize("motion", [Motion(12.0, 0.0), Motion(0.0, 0.0), Motion(8.0, -2.0)])
def test_profiles_begin_with_the_motion(motion):
    arrivals = [Arrival(5.0, (40.0, 50.0), (4.0, 8.0))]
    profiles = profiles_of(motion, arrivals, [(2.0, 30.0, 7.0)])
    assert profiles.sigma[:, 0] == pytest.approx(0.0)
    assert profiles.v[:, 0] == pytest.approx(motion.v)
    assert profiles.a[:, 0] == pytest.approx(motion.a)


def test_speeds_and_accelerations_are_derivatives():
    arrivals = [Arrival(5.0, (40.0, 50.0), (4.0, 8.0))]
    profiles = profiles_of(Motion(10.0, 0.5), arrivals, [(2.0, 30.0, 7.0)])
    way = np.diff(profiles.sigma, axis=1)
    mean = DT / 2 * (profiles.v[:, 1:] + profiles.v[:, :-1])
    # a profile's corner lies within one step; nowhere else may way and speed disagree
    error = np.abs(way - mean) / (1.0 + np.abs(profiles.a[:, 1:]))
    assert np.quantile(error, 0.95) < 5e-3
    assert error.max() < 0.2


def test_keeping_profiles_hold_the_sampled_speeds():
    ends = profiles_of(Motion(10.0, 0.0), [], []).v[:, -1]
    for v in np.linspace(0.0, 18.0, 9):
        assert np.abs(ends - v).min() < 1e-9


def test_stopping_profiles_stand_at_their_distances():
    profiles = profiles_of(Motion(10.0, 0.0), [], [])
    standing = (np.abs(profiles.v[:, -1]) < 1e-9) & (np.abs(profiles.a[:, -1]) < 1e-9)
    distances = profiles.sigma[standing, -1]
    assert distances.min() < 15.0 and distances.max() > 30.0


def test_arriving_profiles_meet_the_window_at_its_time():
    arrival = Arrival(5.0, (40.0, 50.0), (4.0, 8.0))
    profiles = profiles_of(Motion(10.0, 0.0), [arrival], [])
    sigma, v = profiles.sigma[:, 50], profiles.v[:, 50]
    for position, speed in product((40.0, 45.0, 50.0), (4.0, 6.0, 8.0)):
        assert (np.hypot(sigma - position, v - speed) < 1e-6).any()


def test_following_profiles_end_behind_the_leader_at_its_speed():
    profiles = profiles_of(Motion(10.0, 0.0), [], [(3.0, 50.0, 7.0)])
    for gap in SeedConfig().follow_gaps:
        error = np.hypot(profiles.sigma[:, 30] - (50.0 - gap), profiles.v[:, 30] - 7.0)
        assert error.min() < 1e-6


# -- blocked cells --------------------------------------------------------------------------------


def bodies(s: Array, d: Array, mu: Array) -> Array:
    """Polygons of the body in the (s, d) plane."""
    states = np.column_stack([s, d, np.zeros_like(s), np.zeros_like(s), mu])
    return shapely.polygons(rectangles(states))


@pytest.mark.parametrize("seed", range(12))
def test_every_overlap_of_bodies_is_blocked_and_open_space_is_not(seed):
    """On a straight road (s, d) is the plane: the grid against polygons, cell by cell."""
    rng = np.random.default_rng(seed)
    road = straight_road()
    lowest, highest = [45, -3, -8, -3.2, 1, 0.6], [85, 6, 8, 3.2, 9, 2.5]
    tracks = [Track(*rng.uniform(lowest, highest)) for _ in range(3)]
    forecast = forecast_of(road.frame, 8, *tracks)
    paths = paths_on(road, state_at(road.frame, 30.0, d=0.3, mu=0.15))
    config = SeedConfig()
    blocked = block(occupancy(forecast, road.frame), paths, config, Config().cost).owner >= 0
    boxes = shapely.polygons(box_corners(forecast.boxes))
    checked = 0
    for p in range(0, len(paths.s), 3):
        body = bodies(paths.s[p], paths.d[p], paths.mu[p])
        for k in range(0, 9, 2):
            gap = shapely.distance(body[:, None], boxes[None, :, k]).min(axis=1)
            overlap = shapely.intersects(body[:, None], boxes[None, :, k]).any(axis=1)
            assert blocked[p, k, overlap].all()
            assert not blocked[p, k, gap > 1.5].any()
            checked += overlap.sum()
    assert checked > 0


@pytest.mark.parametrize("turn", [0.0, 0.5, 1.6])
def test_long_obstacles_in_a_bend_are_seen_whole(turn):
    """A long vehicle's side in a bend, between its corners, blocks as its corners do."""
    frame = frame_of(lambda s: np.full_like(s, 1 / 25), 60.0)
    road = road_of(frame, right=-6.0, left=6.0)
    forecast = forecast_of(frame, 2, Track(30.0, -2.0, 0.0, turn, 12.0, 2.5))
    config = SeedConfig(offsets=(0.0, 0.6), lengths=(15.0,))
    paths = paths_on(road, state_at(frame, 5.0), 40.0, config=config)
    blocked = block(occupancy(forecast, frame), paths, config, Config().cost).owner >= 0
    truck = shapely.polygons(box_corners(forecast.boxes[0, 0]))
    for p in range(len(paths.s)):
        xy = frame.to_cartesian(paths.s[p], paths.d[p])
        psi = frame.heading(paths.s[p]) + paths.mu[p]
        states = np.column_stack([xy, np.zeros(len(xy)), np.zeros(len(xy)), psi])
        overlap = shapely.intersects(shapely.polygons(rectangles(states)), truck)
        assert blocked[p, 0, overlap].all()


@pytest.mark.parametrize("seed", range(12))
def test_in_a_bend_turned_bodies_block_just_where_they_come_near(seed):
    """Against polygons in the plane: a junction's turn, others at any angle to it."""
    rng = np.random.default_rng(seed)
    frame = frame_of(lambda s: np.clip((s - 10) / 10, 0, 1) / 8 * (s < 25), 60.0)
    road = road_of(frame, right=-6.0, left=6.0)
    other = Track(rng.uniform(12, 24), rng.uniform(-4, 3), 0.0, rng.uniform(0.5, 2.6))
    forecast = forecast_of(frame, 1, other)
    config = SeedConfig(offsets=(0.0, 0.6), lengths=(15.0,))
    paths = paths_on(road, state_at(frame, 4.0), 30.0, config=config)
    blocked = block(occupancy(forecast, frame), paths, config, Config().cost).owner >= 0
    body = shapely.polygons(box_corners(forecast.boxes[0, 0]))
    margin = np.hypot(config.margin_lon, config.margin_lat)
    for p in range(len(paths.s)):
        xy = frame.to_cartesian(paths.s[p], paths.d[p])
        psi = frame.heading(paths.s[p]) + paths.mu[p]
        states = np.column_stack([xy, np.zeros(len(xy)), np.zeros(len(xy)), psi])
        gap = shapely.distance(shapely.polygons(rectangles(states)), body)
        assert blocked[p, 0, gap == 0].all()
        bent = np.abs(paths.swing[p]) > 0.02
        assert not blocked[p, 0, bent & (gap > margin)].any()


def crossing(s: float, d: float, v: float, turn: float) -> Occupancy:
    """Somebody who drives straight on at an angle [rad] to the straight road, for 6 s."""
    frame = straight_road().frame
    return occupancy(straight_across(frame, s, d, v, turn), frame)


RIGHT, LEFT = np.pi / 2, -np.pi / 2


@pytest.mark.parametrize(
    ("other", "there"),
    [
        ((60.0, 0.0, 5.0, 0.0), False),  # a leader
        ((60.0, -20.0, 8.0, RIGHT), True),  # from the right, straight across
        ((60.0, 20.0, 8.0, LEFT), True),
        ((10.0, -20.0, 8.0, RIGHT), False),  # behind
        ((60.0, -20.0, 0.5, RIGHT), False),  # will not come so far
        ((60.0, -0.5, 8.0, RIGHT), False),  # is on the path already
        ((60.0, -4.0, 8.0, 0.15), False),  # changes lanes
    ],
)
def test_a_crossing_is_ahead_where_others_will_enter_the_path_at_an_angle(other, there):
    clear = last_crossing(crossing(*other), 0, 30.0)
    assert np.isfinite(clear) == there
    if there:
        assert clear == pytest.approx(60.0 + 0.9 + FORD_ESCORT.rear, abs=0.2)


def test_owners_are_rows_of_the_occupancy():
    road = straight_road()
    window = occupancy_of(road.frame, 3, Track(50.0, 0.0, 0.0), Track(75.0, 0.0, 0.0))
    paths = paths_on(road, state_at(road.frame, 30.0))
    grid = block(window, paths, SeedConfig(), Config().cost)
    s = paths.s[0]
    assert set(grid.owner[0, 2, np.abs(s + B - 50.0) < 4.0]) == {0}
    assert set(grid.owner[0, 2, np.abs(s + B - 75.0) < 4.0]) == {1}
    assert set(grid.owner[0, 2, s < 40.0]) == {-1}


@pytest.mark.parametrize("seed", range(4))
def test_lead_is_the_nearest_counted_centre_ahead(seed):
    rng = np.random.default_rng(seed)
    road = straight_road()
    tracks = [Track(rng.uniform(20, 95), rng.uniform(-4, 5), rng.uniform(0, 9)) for _ in range(4)]
    window = occupancy_of(road.frame, 6, *tracks)
    paths = paths_on(road, state_at(road.frame, 30.0))
    lead = block(window, paths, SeedConfig(), Config().cost).lead[0]  # lane keeping: d = 0
    for k, n in product((0, 3, 6), range(0, paths.s.shape[1], 7)):
        centre = paths.s[0, n] + B
        ahead = window.s[:, k] - centre
        # within a sample of the path a leader may count as ahead or as passed
        near = (np.abs(ahead) < 0.6).any() or (np.abs(np.abs(window.d[:, k]) - 2.8) < 0.35).any()
        counted = ahead[(ahead > 0) & (np.abs(window.d[:, k]) < 2.8)]
        if not near:
            assert lead[k, n] == pytest.approx(counted.min(initial=np.inf), abs=1e-6)


# -- lattice --------------------------------------------------------------------------------------


def configured(**changes: dict) -> Config:
    """A configuration with other parameters of sections."""
    config = Config()
    sections = {
        name: getattr(config, name).model_copy(update=values) for name, values in changes.items()
    }
    return config.model_copy(update=sections)


def lattice_seeds(config: Config, *tracks: Track, speed: float = 40.0, curvature=straight,
                  goal: GoalWindow | None = None, v: float = 10.0) -> list[Seed]:  # fmt: skip
    """Ten distinct candidates of a lattice over four seconds."""
    frame = frame_of(curvature, 250.0)
    road = road_of(frame, goal or GoalWindow(40, 40, None, None, None, None), speed=speed)
    state = state_at(frame, 30.0, d=0.2, v=v)
    window = occupancy_of(frame, 60, *tracks)
    return lattice(road, state, 0.5, 0, window, config, DT).seeds


WITHOUT_PENALTIES = {"slack_cost": 0.0, "finalists": 10}
PARTS = ["jerk", "steering_rate", "distance", "lane", "speeding"]


def direct_cost(seed: Seed, part: str, window: Occupancy, speed: float) -> float:
    """One part of a candidate's cost, step by step."""
    x, total, cost = seed.states, 0.0, Config().cost
    for k in range(len(x)):
        centre_s = x[k, Stage.S] + B * np.cos(x[k, Stage.MU])
        centre_d = x[k, Stage.D] + B * np.sin(x[k, Stage.MU])
        if part == "jerk" and k:
            total += DT * cost.jerk * ((x[k, Stage.A] - x[k - 1, Stage.A]) / DT) ** 2
        if part == "steering_rate" and k:
            total += DT * cost.steering_rate * (np.diff(x[k - 1 : k + 1, Stage.DELTA])[0] / DT) ** 2
        if part == "lane" and k:
            total += DT * cost.lane * centre_d**2
        if part == "speeding" and k:
            total += DT * Config().refine.speeding * max(x[k, Stage.V] - speed, 0.0) ** 2
        if part == "distance" and k:
            ahead = window.s[:, k] - centre_s
            ahead = ahead[(ahead > 0) & (np.abs(window.d[:, k] - centre_d) < cost.distance_lateral)]
            if len(ahead):
                gap = ahead.min() - cost.distance_offset
                total += DT * cost.distance * np.exp(-cost.distance_decay * gap)
    return total


@pytest.mark.parametrize("part", PARTS)
def test_each_part_of_the_cost_is_that_of_a_direct_loop(part):
    """All weights but one are zero; looked-up values come from samples 0.5 m apart."""
    zero = {name: 0.0 for name in ("jerk", "steering_rate", "distance", "lane") if name != part}
    config = configured(cost=zero, seed=WITHOUT_PENALTIES)
    speed = 8.0 if part == "speeding" else 40.0
    track_ = Track(55.0, 0.0, 8.0)
    seeds = lattice_seeds(config, track_, speed=speed, curvature=sine)
    window = occupancy_of(frame_of(sine, 250.0), 60, track_)
    assert len(seeds) >= 5
    for seed in seeds:
        expected = direct_cost(seed, part, window, speed)
        if part != "speeding":
            expected += direct_cost(seed, "speeding", window, speed)
        assert seed.cost == pytest.approx(expected, rel=0.1, abs=0.02)


def test_in_haste_each_second_before_the_last_crossing_costs():
    """It crosses at 40 m: some candidates go before it, some after."""
    hurried = configured(cost={"haste": 1.5}, seed=WITHOUT_PENALTIES)
    calm = configured(seed=WITHOUT_PENALTIES)
    window = crossing(60.0, -20.0, 10.0, RIGHT)
    road = straight_road(GoalWindow(40, 60, (65.0, 200.0), None, None, None))
    state = state_at(road.frame, 30.0, v=10.0)
    clear, most_waiting = last_crossing(window, 0, 30.0), []
    for config in (hurried, calm):
        seeds = lattice(road, state, 0.0, 0, window, config, DT).seeds
        assert len(seeds) > 3
        waiting = [DT * float((seed.states[1:, Stage.S] < clear).sum()) for seed in seeds]
        most_waiting.append(waiting[0])
        for seed, seconds in zip(seeds, waiting, strict=True):
            costs = [
                trajectory_cost(seed.road, seed.states, 0, True, window, c, DT)
                for c in (hurried, calm)
            ]
            assert costs[0] - costs[1] == pytest.approx(1.5 * seconds)
    assert most_waiting[0] < most_waiting[1]


def test_seeds_come_cheapest_first_and_differ():
    seeds = lattice_seeds(configured(seed={"finalists": 6, "delays": ()}), Track(60.0, 0.0, 7.0))
    costs = [seed.cost for seed in seeds]
    assert len(seeds) == 6 and costs == sorted(costs)
    for i, a in enumerate(seeds):
        for b in seeds[:i]:
            n = min(len(a.states), len(b.states))
            gap = np.abs(a.states[:n, :2] - b.states[:n, :2]).max(axis=0)
            assert gap[0] > 4.0 or gap[1] > 0.8


@pytest.mark.parametrize(
    ("goal", "v_end"),
    [
        (GoalWindow(35, 45, (62.0, 72.0), (-0.5, 0.5), (6.0, 9.0), None), (6.0, 9.0)),
        (GoalWindow(40, 40, (50.0, 56.0), (-0.5, 0.5), (0.0, 0.5), None), (0.0, 0.5)),
        (GoalWindow(40, 50, (70.0, 90.0), (3.2, 3.8), None, None), (0.0, 20.0)),
    ],
)
def test_seeds_that_reach_the_goal_end_in_its_window(goal, v_end):
    seeds = lattice_seeds(Config(), goal=goal)
    assert seeds and seeds[0].reaches_goal
    last = seeds[0].states[-1]
    assert goal.first <= len(seeds[0].states) - 1 <= goal.last
    assert goal.s[0] - 0.3 <= last[Stage.S] + B * np.cos(last[Stage.MU]) <= goal.s[1] + 0.3
    assert goal.d[0] - 0.05 <= last[Stage.D] + B * np.sin(last[Stage.MU]) <= goal.d[1] + 0.05
    assert v_end[0] - 0.01 <= last[Stage.V] <= v_end[1] + 0.01


@pytest.mark.parametrize(("v", "length"), [(4.0, 15.0), (18.0, 40.0)])
def test_the_search_takes_paths_that_can_be_driven_at_the_present_speed(v, length):
    """From one lane to the next within 15 m: not at 18 m/s."""
    frame = frame_of(straight, 250.0)
    road = road_of(frame, GoalWindow(40, 40, (52.0, 200.0), (-1.0, 1.0), None, None))
    state, config = state_at(frame, 30.0, d=3.5, v=v), configured(seed={"shortest": False})
    seeds, reports = find_seeds(
        road, state, 0.0, 0, occupancy_of(frame, 60), config, DT, Effort.ALWAYS
    )
    found = [seed for seed in seeds if seed.source == "search" and seed.states[-1, 0] > 45.0]
    for seed in found:
        s, d = seed.states[:, Stage.S], seed.states[:, Stage.D]
        half = np.interp(-1.75, -d, s) - 30.0  # where it is half way over
        assert half == pytest.approx(length / 2, abs=0.15 * length)
    searched = next(report for report in reports if report.source == "search")
    assert len(found) == searched.accepted == searched.candidates == 3


def test_rejections_name_constraint_obstacle_and_count():
    frame = frame_of(straight, 250.0)
    road = road_of(frame, GoalWindow(30, 30, (75.0, 95.0), (-0.5, 0.5), None, None), left=1.75)
    wall = Track(60.0, 0.0, 0.0, width=5.0)
    grid = lattice(
        road, state_at(frame, 30.0, v=15.0), 0.0, 0, occupancy_of(frame, 40, wall), Config(), DT
    )
    report = grid.report
    assert report.reaching_goal == 0 and report.accepted < report.candidates
    collision = report.rejected["collision"]
    assert collision.obstacle == 10 and 10 < collision.step <= 30
    assert 0 < collision.count <= report.candidates
    assert collision.smallest_violation > 0
    assert {"reversing", "acceleration"} & set(report.rejected)


def test_seeds_touch_nobody():
    tracks = (Track(55.0, 0.0, 6.0), Track(35.0, 3.5, 11.0), Track(75.0, 3.5, 5.0))
    boxes = forecast_of(frame_of(straight, 250.0), 60, *tracks).boxes
    for seed in lattice_seeds(configured(seed={"finalists": 8}), *tracks):
        x = seed.states
        flat = np.column_stack([x[:, :2], np.zeros(len(x)), np.zeros(len(x)), x[:, Stage.MU]])
        assert separation(flat, boxes[:, : len(x)]).min() > 0.0


# -- search ---------------------------------------------------------------------------------------


def gates(frame, steps: int, *gates_: tuple[float, float, float]) -> Occupancy:
    """Barriers (s, opens, closes [s]) across the road, there except while they are open."""
    boxes = np.full((len(gates_), steps + 1, len(Box)), np.nan)
    for row, (s, opens, closes) in zip(boxes, gates_, strict=True):
        row[:] = 0.0
        row[:, [Box.X, Box.LENGTH, Box.WIDTH]] = s, 0.5, 14.0
        t = DT * np.arange(steps + 1)
        row[(t >= opens) & (t <= closes)] = np.nan
    return occupancy(Forecast(0, tuple(range(10, 10 + len(gates_))), boxes), frame)


GATES = ((50.0, 1.2, 2.6), (64.0, 4.4, 5.6), (72.0, 5.0, 6.4), (86.0, 7.2, 8.6))


def test_the_search_finds_a_way_through_gates_that_the_lattice_misses():
    goal = GoalWindow(85, 90, (88.0, 110.0), (-0.5, 0.5), None, None)
    road = straight_road(goal)
    state = state_at(road.frame, 30.0, v=9.0)
    window = gates(road.frame, 100, *GATES)
    seeds, reports = find_seeds(road, state, 0.0, 0, window, Config(), DT, Effort.ALWAYS)
    told = {report.source: report for report in reports}
    assert told["lattice"].reaching_goal == 0
    assert told["search"].reaching_goal >= 1
    best = seeds[0]
    assert best.reaches_goal and best.source == "search"
    front = best.states[:, Stage.S] + CAR_FRONT
    for s, opens, closes in GATES:
        inside = (front > s - 0.25) & (best.states[:, Stage.S] - 0.64 < s + 0.25)
        times = DT * np.flatnonzero(inside)
        assert opens - 0.01 <= times.min() and times.max() <= closes + 0.01


def test_the_search_leads_around_who_stands_in_the_way_where_nothing_else_leads_on():
    """Gates further on, and before them a car that stands across the lane."""
    goal = GoalWindow(110, 120, (126.0, 160.0), (-0.5, 0.5), None, None)
    road = straight_road(goal)
    state = state_at(road.frame, 30.0, v=9.0)
    later = [(s + 36.0, opens + 3.2, closes + 3.2) for s, opens, closes in GATES]
    free = gates(road.frame, 130, *later)
    stood = gates(road.frame, 130, *later, (55.0, 99.0, 99.0))
    for values in (stood.d, stood.d_low, stood.d_high):
        values[-1] -= 7.0 + 0.2  # its left side lies 0.2 m to the right of the lane's centre
    for values in (stood.x, stood.y):
        values[-1] = values[-1, 0]
    stood.y[-1] -= 7.2
    seeds, reports = find_seeds(road, state, 0.0, 0, stood, Config(), DT, Effort.ALWAYS)
    told = {report.source: report for report in reports}
    assert told["lattice"].reaching_goal == told["search"].reaching_goal == 0
    assert told["search around"].reaching_goal >= 1
    s, d = (seeds[0].states[:, column] for column in (Stage.S, Stage.D))
    assert seeds[0].reaches_goal and np.interp(55.0, s, d) > -0.2 + 0.8
    reports = find_seeds(road, state, 0.0, 0, free, Config(), DT, Effort.ALWAYS)[1]
    assert "search around" not in {report.source for report in reports}


def test_effort_says_when_the_search_runs():
    road = straight_road(GoalWindow(40, 40, None, None, None, None))
    state = state_at(road.frame, 30.0, v=9.0)
    arguments = (road, state, 0.0, 0, nobody(), Config(), DT)

    def sources(effort: Effort) -> set[str]:
        return {report.source for report in find_seeds(*arguments, effort)[1]}

    assert sources(Effort.NEVER) == sources(Effort.IF_NEEDED) == {"lattice"}
    assert "search" in sources(Effort.ALWAYS)


Pair = tuple[float, float]


def brute_force(
    actions: tuple[float, ...], moves: int, v0: float, goal_v: Pair, goal_s: Pair, jerk: float
) -> tuple[float, tuple] | None:
    """The cheapest sequence of accelerations, each held for three steps, on a free road."""
    best = None
    for chosen in product(actions, repeat=moves):
        s, v, before, cost = 0.0, v0, 0.0, 0.0
        for a in chosen:
            cost += jerk * (a - before) ** 2 / (3 * DT)
            before = a
            for _ in range(3):
                after = max(v + a * DT, 0.0)
                s, v = s + (v + after) / 2 * DT, after
        if goal_s[0] <= s <= goal_s[1] and goal_v[0] <= v <= goal_v[1]:
            best = min(best or (np.inf, ()), (cost, chosen))
    return best


@pytest.mark.parametrize(
    ("goal_s", "goal_v"),
    [((14.0, 15.0), (7.0, 8.5)), ((9.0, 11.0), (0.0, 6.0)), ((17.0, 21.0), (9.0, 14.0))],
)
def test_the_search_is_optimal_on_a_tiny_problem(goal_s, goal_v):
    """Four actions over five moves: all 1024 sequences against the search."""
    actions = (-6.0, -2.0, 0.0, 3.0)
    ahead = (30.0 + B + goal_s[0], 30.0 + B + goal_s[1])
    road = straight_road(GoalWindow(15, 15, ahead, (-0.5, 0.5), goal_v, None))
    state = state_at(road.frame, 30.0, v=10.0)
    config = configured(
        cost={"jerk": 1.0, "distance": 0.0, "lane": 0.0, "steering_rate": 0.0},
        seed={"search_actions": actions, "search_labels": 100000},
    )
    paths = paths_on(road, state, config=config.seed)
    grid = block(nobody().window(0, 16), paths, config.seed, config.cost)
    found = search(road, paths, grid, 0, 10.0, 0.0, 0, config, DT)
    expected = brute_force(actions, 5, 10.0, goal_v, goal_s, 1.0)
    assert found is not None and expected is not None
    a, v, cost, reaches = found
    assert reaches and cost == pytest.approx(expected[0], rel=0.15, abs=1e-9)
    assert a == pytest.approx(np.diff(v) / DT)
    seed = as_seed(road, paths, 0, 0.0, found, "search", 0, DT)
    assert goal_s[0] - 0.3 <= seed.states[-1, Stage.S] - 30.0 <= goal_s[1] + 0.3
    assert len(seed.states) == 16


def test_a_search_without_a_way_answers_nothing():
    road = straight_road(GoalWindow(15, 15, None, None, None, None))
    state = state_at(road.frame, 30.0, v=20.0)
    window = occupancy_of(road.frame, 20, Track(38.0, 0.0, 0.0, width=14.0))
    paths = paths_on(road, state)
    grid = block(window.window(0, 16), paths, SeedConfig(), Config().cost)
    assert search(road, paths, grid, 0, 20.0, 0.0, 0, Config(), DT) is None


# -- cost -----------------------------------------------------------------------------------------


def along_a_straight(a: Array, v0: float = 10.0) -> Array:
    """Frenet states with accelerations (n,) held over the steps."""
    states = np.zeros((len(a) + 1, len(Stage)))
    states[1:, Stage.A] = a
    states[:, Stage.V] = v0 + np.concatenate([[0.0], np.cumsum(a * DT)])
    v = states[:, Stage.V]
    states[1:, Stage.S] = np.cumsum((v[1:] + v[:-1]) / 2 * DT)
    return states


def test_the_evaluated_jerk_of_constant_jerk_is_that():
    jerk = evaluated_jerk(along_a_straight(0.5 * DT * np.arange(60)), DT, True, True)
    assert jerk[8:-8] == pytest.approx(0.5, abs=0.01)


def test_a_part_of_a_drive_that_goes_on_as_it_was_has_no_evaluated_jerk():
    """Also at its first and last state."""
    states = along_a_straight(np.full(20, 1.5))
    states[0, Stage.A] = 1.5
    assert evaluated_jerk(states, DT, False, False) == pytest.approx(0.0, abs=1e-8)


def test_where_a_drive_begins_and_ends_its_acceleration_counts_as_jerk():
    """One-sided differences: a / (4 dt) at the two outer states."""
    jerk = evaluated_jerk(along_a_straight(np.full(40, 1.5)), DT, True, True)
    assert np.abs(jerk[[0, 1, -2, -1]]) == pytest.approx(1.5 / (4 * DT))
    assert jerk[3:-3] == pytest.approx(0.0, abs=1e-8)


@given(a=st.floats(-6, 6), n=st.integers(20, 90))
def test_at_its_edges_a_drive_costs_three_eighths_of_its_acceleration(a, n):
    """What the refinement assumes, exact where the acceleration is constant."""
    jerk = evaluated_jerk(along_a_straight(np.full(n, a)), DT, True, True)
    assert DT * (jerk**2).sum() == pytest.approx(2 * DT * (EDGE * a / DT) ** 2, abs=1e-6)


def test_the_evaluator_smooths_a_jolt():
    """A step of the acceleration costs a fraction of its own jerk."""
    jerk = evaluated_jerk(along_a_straight(np.repeat([0.0, 1.0], 30)), DT, True, False)[3:-3]
    assert DT * (jerk**2).sum() < 0.2 * DT * (1.0 / DT) ** 2
    assert DT * jerk.sum() == pytest.approx(1.0, rel=0.05)


def test_a_part_of_a_drive_that_sets_in_with_another_acceleration_has_jerk():
    states = along_a_straight(np.full(30, 2.0))
    assert np.abs(evaluated_jerk(states, DT, False, False)).max() > 1.0


def test_very_short_drives_have_no_evaluated_jerk():
    assert evaluated_jerk(along_a_straight(np.ones(1)), DT, True, True) == pytest.approx([0, 0])


# -- tracking -------------------------------------------------------------------------------------


def lane_seed(road: Road, n: int, v: float, d: float) -> Seed:
    """Constant speed at an offset of the lane."""
    states = np.zeros((n + 1, len(Stage)))
    states[:, Stage.V], states[:, Stage.D] = v, d
    kappa = road.frame.curvature(30.0 + v * DT * np.arange(n + 1))
    states[:, Stage.S] = 30.0 + np.concatenate([[0.0], np.cumsum(v * DT / (1 - kappa[:-1] * d))])
    kappa = road.frame.curvature(states[:, Stage.S])
    states[:, Stage.DELTA] = np.arctan(FORD_ESCORT.wheelbase * kappa / (1 - kappa * d))
    return Seed(road, 7, states, 0.0, False, "test", "")


@pytest.mark.parametrize("v", [2.0, 8.0, 15.0])
@pytest.mark.parametrize("d", [0.0, 0.5])
def test_tracking_holds_the_path(v, d):
    road = road_of(frame_of(sine, 250.0))
    seed = lane_seed(road, 60, v, d)
    driven = track(seed, state_at(road.frame, 30.0, d=d, v=v), DT)
    s, offset = road.frame.to_frenet(driven.states[:, :2])
    assert offset == pytest.approx(seed.states[:, Stage.D], abs=0.06)
    assert s == pytest.approx(seed.states[:, Stage.S], abs=0.1)
    assert driven.first_step == 7 and len(driven) == 61


def test_tracking_converges_to_the_path():
    road = straight_road()
    seed = lane_seed(road, 80, 10.0, 0.0)
    seed.states[0, Stage.D] = 0.6  # the seed begins where the vehicle is
    driven = track(seed, state_at(road.frame, 30.0, d=0.6, v=10.0), DT)
    offset = np.abs(driven.states[:, State.Y])
    assert offset[20] < 0.45 and offset[50] < 0.1 and offset[80] < 0.02
    assert driven.states[:, State.Y].min() > -0.1  # no overshoot worth speaking of


@settings(max_examples=25, deadline=None)
@given(v=st.floats(0.0, 20.0), d=st.floats(-1.5, 1.5), mu=st.floats(-0.3, 0.3))
def test_what_is_tracked_is_driven_within_the_limits(v, d, mu):
    road = straight_road()
    seed = lane_seed(road, 30, v, 0.0)
    state = state_at(road.frame, 30.0, d=d, v=v, mu=mu)
    seed.states[0, [Stage.D, Stage.MU]] = d, mu
    driven = track(seed, state, DT)
    assert np.array_equal(simulate(state, driven.inputs, DT).states, driven.states)
    assert max(excess.max() for excess in input_violations(driven).values()) < 1e-9


def test_tracking_a_part_ends_early():
    road = straight_road()
    driven = track(lane_seed(road, 30, 8.0, 0.0), state_at(road.frame, 30.0, v=8.0), DT, steps=12)
    assert len(driven.inputs) == 12
    assert centres(driven.states)[-1, 0] == pytest.approx(30.0 + B + 8.0 * 1.2, abs=1e-6)
