"""The refinement: derivatives, rows, analytic and independent optima, symmetry, failures."""

from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import casadi as ca
import made
import numpy as np
import pytest
import reference_ocp as ref
from commonroad.common.util import Interval
from commonroad.geometry.shape import Rectangle
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_ocp import (
    CAR_FRONT,
    DT,
    Reference,
    Track,
    frame_of,
    occupancy_of,
    road_of,
    state_at,
    straight,
    straight_across,
)

from mpcplan.config import Config
from mpcplan.predict.occupancy import Occupancy, occupancy
from mpcplan.refine.backends import Answer
from mpcplan.refine.compiled import compiled, functions
from mpcplan.refine.corridor import SPARE, YIELDED, build_corridor, different_asides
from mpcplan.refine.layout import INPUT_SCALE, STATE_SCALE
from mpcplan.refine.problem import SLACK_CURVATURE, Point, Problem
from mpcplan.refine.qp import QpSolver
from mpcplan.refine.reading import Iterate
from mpcplan.refine.refine import refine
from mpcplan.refine.sqp import Merit, SqpResult, solve
from mpcplan.refine.stage import CURVATURE, N_GIVEN, SLACK_OF_ROW, Given
from mpcplan.refine.stage import Point as BodyPoint
from mpcplan.road.goal import GoalWindow, is_reached
from mpcplan.road.road import Road, build_roads
from mpcplan.rules.predicates import safe_distance
from mpcplan.scenario import load
from mpcplan.seed.candidates import Effort, find_seeds
from mpcplan.seed.cost import evaluated_jerk
from mpcplan.seed.crossing import last_crossing
from mpcplan.seed.lattice import lattice
from mpcplan.seed.paths import BODY_POINTS, frenet_pose
from mpcplan.seed.seed import Seed, Stage
from mpcplan.solvers.record import TO_GOAL, record_problems
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT, simulate

ROOT = Path(__file__).resolve().parents[1]
EPS = 1e-6


def window(
    step: int,
    s: tuple[float, float] | None = None,
    d: tuple[float, float] | None = None,
    v: tuple[float, float] | None = None,
) -> GoalWindow:
    """A goal at exactly one time step."""
    return GoalWindow(step, step, s, d, v, None)


def with_refine(config: Config, **changes: object) -> Config:
    """A configuration with other parameters of the refinement."""
    return config.model_copy(update={"refine": config.refine.model_copy(update=changes)})


def with_cost(config: Config, **changes: object) -> Config:
    """A configuration with other weights."""
    return config.model_copy(update={"cost": config.cost.model_copy(update=changes)})


ACCURATE = with_refine(
    Config(), fresh_iterations=60, fresh_backend="piqp", gain=0.0, tolerance=1e-5
)


@pytest.mark.parametrize(
    ("size", "turn", "x", "y"),
    [((6, 1.2), 0.8, 50, 2.2), ((6, 1.2), -0.8, 50, 2.2), ((10, 1.0), 0.3, 45, 1.75)],
)
def test_seeds_that_reach_a_goal_at_an_angle_reach_it_refined(tmp_path, size, turn, x, y):
    """One rectangle in (s, d) is no such region: the refinement would end beside it."""
    goal = made.goal(Rectangle(*size, made.at(x, y), turn), end=40)
    goal.time_step = Interval(40, 40)
    start = made.state(10, made.LANE / 2, 10)
    loaded = load(made.write(tmp_path, made.problem(9, start, goal), obstacles=[]))
    problem, config, reaching = loaded.problems[0], Config(), 0
    for road in build_roads(loaded.scenario, problem.planning_problem, config.road):
        nobody = occupancy_of(road.frame, 60)
        seeds, _ = find_seeds(road, problem.start, 0.0, 0, nobody, config, DT, Effort.IF_NEEDED)
        for seed in seeds:
            if seed.reaches_goal:
                plan = refine(seed, problem.start, 0.0, nobody, config, DT, True).trajectory
                assert is_reached(problem.planning_problem, plan.states[-1], plan.last_step)
                reaching += 1
    assert reaching >= 2


def keeping_seed(road: Road, state: Array, n: int, a: float = 0.0) -> Seed:
    """A seed that goes on along the path at constant acceleration from a state on it."""
    pose = frenet_pose(road, state)
    t = DT * np.arange(n + 1)
    states = np.zeros((n + 1, len(Stage)))
    states[:, Stage.V] = np.maximum(state[3] + a * t, 0.0)
    way = np.concatenate([[0.0], np.cumsum((states[1:, Stage.V] + states[:-1, Stage.V]) / 2 * DT)])
    states[:, Stage.S], states[:, Stage.D] = pose.s + way, pose.d
    kappa = road.frame.curvature(states[:, Stage.S])
    states[:, Stage.DELTA] = np.arctan(FORD_ESCORT.wheelbase * kappa / (1 - kappa * pose.d))
    states[1:, Stage.A] = a
    return Seed(road, 0, states, 0.0, bool(road.goals[0].s), "test", "keeps its lane")


def problem_of(
    seed: Seed, state: Array, occupancy: Occupancy, goal: GoalWindow | None, config: Config
) -> Problem:
    """The problem over the whole seed, from a state with no acceleration before."""
    pose = frenet_pose(seed.road, state)
    x0 = np.array([pose.s, pose.d, pose.mu, state[3], pose.delta, 0.0])
    corridor = build_corridor(seed, occupancy, config)
    return Problem(seed, corridor, x0, goal, len(seed.states) - 1, config, DT)


def sine(s: Array) -> Array:
    """A winding road."""
    return 0.03 * np.sin(s / 15)


def busy_problem(goal: bool = True, n: int = 12) -> Problem:
    """A problem whose every kind of row counts: traffic ahead and beside, curves, goal."""
    frame = frame_of(sine, 150.0)
    window_ = window(n, s=(30.0, 45.0), d=(-0.6, 0.6), v=(5.0, 12.0)) if goal else window(n)
    road = road_of(frame, window_)
    state = state_at(frame, 20.0, d=0.2, v=9.0, mu=0.05)
    occupancy = occupancy_of(
        frame, 60, Track(40.0, 0.3, 6.0), Track(22.0, 3.2, 9.0, turn=0.2), Track(8.0, 0.0, 8.0)
    )
    seed = keeping_seed(road, state, n)
    return problem_of(seed, state, occupancy, window_ if goal else None, Config())


def around(problem: Problem, seed: int, size: float = 1.0) -> Iterate:
    """An iterate near the seed, moved at random by typical sizes."""
    rng = np.random.default_rng(seed)
    start = problem.initial()
    x = start.x + size * rng.normal(size=start.x.shape) * STATE_SCALE
    u = start.u + size * rng.normal(size=start.u.shape) * INPUT_SCALE
    x[:, Stage.V] = np.maximum(x[:, Stage.V], 0.5)
    return Iterate(x, u)


def moved(problem: Problem, z: Iterate, p: Array) -> Iterate:
    """The iterate after a step of all variables but the first state, which is given."""
    x = z.x.copy()
    x[1:] += p[problem.layout.x]
    return Iterate(x, z.u + p[problem.layout.u])


def ends(problem: Problem, point: Point, p: Array) -> list[Point]:
    """The points after a step and after its opposite, with what was read off at the one between."""
    return [problem.at(moved(problem, point.z, sign * p), point.reading) for sign in (1, -1)]


def stepped(x: Array, u: Array, kappa: Array) -> tuple[Array, Array]:
    """(n, 6) states after one step, and (n, 6, 8) derivatives by state and input.

    ``kappa``: (n, 3) curvature, its slope, and the arc length from which it counts.
    """
    n, par = len(x), np.zeros((len(x), N_GIVEN))
    par[:, CURVATURE] = kappa
    made, after = compiled(Config(), DT, n), np.zeros_like(x)
    defect, nonzeros = made.values(x, u, after, par)[0], made.model(x, u, after, par)[1]
    jacobian = np.zeros((n, len(Stage), len(Stage) + 2))
    rows, columns = functions(Config(), DT).dynamics
    jacobian[:, rows, columns] = nonzeros
    return -defect, jacobian


# -- model ----------------------------------------------------------------------------------------

parameters = st.tuples(st.floats(-0.06, 0.06), st.floats(-0.005, 0.005))


@settings(max_examples=50, deadline=None)
@given(
    d=st.floats(-3, 3), mu=st.floats(-0.5, 0.5), v=st.floats(0.1, 30), delta=st.floats(-0.5, 0.5),
    a=st.floats(-8, 5), j=st.floats(-20, 20), w=st.floats(-0.4, 0.4), kappa=parameters,
)  # fmt: skip
def test_jacobians_are_the_finite_differences(d, mu, v, delta, a, j, w, kappa):
    z = np.array([7.0, d, mu, v, delta, a, j, w])
    par = np.array([[*kappa, 7.0]])
    jacobian = stepped(z[None, :6], z[None, 6:], par)[1]
    for column in range(8):
        up, down = z.copy(), z.copy()
        up[column] += EPS
        down[column] -= EPS
        difference = [stepped(y[None, :6], y[None, 6:], par)[0][0] for y in (up, down)]
        numeric = (difference[0] - difference[1]) / (2 * EPS)
        assert jacobian[0, :, column] == pytest.approx(numeric, abs=2e-6, rel=1e-6)


@pytest.mark.parametrize(("curvature", "tolerance"), [(straight, 1e-4), (sine, 1e-2)])
def test_the_model_is_the_vehicle_seen_along_the_path(curvature, tolerance):
    """Driven by the same inputs for 3 s, the KS model projected onto the path agrees."""
    frame = frame_of(curvature, 120.0)
    road = road_of(frame)
    problem = problem_of(
        keeping_seed(road, state_at(frame, 20.0, v=12.0), 30), state_at(frame, 20.0, v=12.0),
        occupancy_of(frame, 40), None, Config(),
    )  # fmt: skip
    rng = np.random.default_rng(1)
    u = np.column_stack([rng.uniform(-3, 3, 30), 0.03 * np.cos(np.arange(30) * 2 * np.pi / 15)])
    u[:, 1] += np.diff(problem.seed.states[:, Stage.DELTA]) / DT
    x = [problem.x0]
    for k in range(30):
        pair = np.array([x[-1], x[-1]])
        x.append(stepped(pair[:1], u[k : k + 1], problem.read.curvatures(pair))[0][0])
    x = np.array(x)
    driven = simulate(state_at(frame, 20.0, v=12.0), np.column_stack([x[1:, Stage.A], u[:, 1]]), DT)
    s, d = frame.to_frenet(driven.states[:, :2])
    assert np.abs(x[:, Stage.S] - s).max() < tolerance
    assert np.abs(x[:, Stage.D] - d).max() < tolerance
    assert 0.1 < np.abs(d).max() < 3.0
    assert x[:, Stage.V] == pytest.approx(driven.states[:, 3])
    assert x[:, Stage.MU] == pytest.approx(driven.states[:, 4] - frame.heading(s), abs=tolerance)


def test_a_batch_is_its_steps_one_by_one():
    rng = np.random.default_rng(5)
    x, u, par = rng.normal(size=(9, 6)) * 0.1, rng.normal(size=(9, 2)), np.zeros((9, 3))
    together, jacobians = stepped(x, u, par)
    for k in range(9):
        alone, jacobian = stepped(x[k : k + 1], u[k : k + 1], par[k : k + 1])
        assert together[k] == pytest.approx(alone[0])
        assert jacobians[k] == pytest.approx(jacobian[0])


# -- cost and rows --------------------------------------------------------------------------------


@pytest.mark.parametrize("goal", [True, False])
@pytest.mark.parametrize("number", range(3))
def test_gradient_is_the_finite_difference_of_the_objective(goal, number):
    problem = busy_problem(goal)
    point = problem.at(around(problem, number, 0.3))
    gradient = problem.quadratic(point).gradient
    for column in np.concatenate([problem.layout.x.ravel(), problem.layout.u.ravel()]):
        p = np.zeros(problem.layout.n_vars)
        p[column] = EPS
        up, down = (end.objective for end in ends(problem, point, p))
        numeric = (up - down) / (2 * EPS)
        assert gradient[column] == pytest.approx(numeric, abs=1e-5, rel=1e-4)


def test_gradient_of_the_slacks_is_that_of_the_penalty():
    problem = busy_problem()
    point = problem.at(around(problem, 4, 2.0))
    slacks, lay = point.slacks, problem.layout
    assert (slacks > 0).any()
    model = problem.quadratic(point)
    assert model.gradient[lay.slacks] == pytest.approx(problem.weights)
    curvature = lay.h.matrix(model.hessian).diagonal()[lay.slacks]
    assert curvature == pytest.approx(SLACK_CURVATURE, abs=1e-4)
    whole = problem.weights @ slacks + SLACK_CURVATURE / 2 * slacks @ slacks
    assert point.penalty == pytest.approx(whole)


def test_closeness_grows_towards_the_leader_and_ends_at_contact():
    frame = frame_of(straight, 200.0)
    road, state = road_of(frame, window(10)), state_at(frame, 30.0, v=0.0)
    occupancy = occupancy_of(frame, 30, Track(60.0, 0.0, 0.0))
    problem = problem_of(keeping_seed(road, state, 10), state, occupancy, None, Config())
    z = problem.initial()
    costs = []
    for s in (0.0, 10.0, 20.0):
        x = z.x.copy()
        x[1:, Stage.S] = 30.0 + s
        costs.append(problem.at(Iterate(x, z.u)).tr1)
    gap = 60.0 - 30.0 - ref.CAR["b"] - Config().cost.distance_offset
    assert costs[0] == pytest.approx(8 * np.exp(-0.2 * gap))
    assert costs[1:] == pytest.approx([costs[0] * np.exp(2.0), costs[0] * np.exp(4.0)])


def predicted_slacks(problem: Problem, point: Point, p: Array) -> Array:
    """Smallest slacks after a step of the other variables, by the quadratic model's rows."""
    model, lay = problem.quadratic(point), problem.layout
    p = p.copy()
    p[lay.slacks] = 0.0
    excess = lay.a.matrix(model.matrix) @ p - model.high
    soft = excess[lay.soft].reshape(problem.n, -1)
    need = np.zeros((problem.n, 3))
    for row, slack in enumerate(SLACK_OF_ROW):
        if slack is not None:
            need[:, slack] = np.maximum(need[:, slack], soft[:, row])
    return np.append(need.ravel(), max(excess[lay.at_goal].max(), 0.0))


@pytest.mark.parametrize("number", range(4))
def test_rows_predict_the_slacks_to_second_order(number):
    """All soft rows and their Jacobians at once: a small step's slacks against the true ones."""
    problem = busy_problem()
    start = problem.initial()
    start.x[:, Stage.MU] = 0.0
    rng = np.random.default_rng(number)
    z = Iterate(start.x + 0.0, start.u)
    z.x[1:, Stage.S] += 8.0  # into the leader's gap, past the goal's edge
    z.x[1:, Stage.DELTA] += 0.2
    point, scales = problem.at(z), problem.layout.columns
    assert (point.slacks > 0).sum() > 5
    p = rng.normal(size=problem.layout.n_vars) * scales
    p[problem.layout.x[:, Stage.MU]] *= 0.2
    errors = []
    for size in (1e-3, 1e-4):
        true = problem.at(moved(problem, z, size * p)).slacks
        errors.append(np.abs(predicted_slacks(problem, point, size * p) - true).max() / size)
    assert errors[1] < 2e-2 * np.abs(scales).max()
    assert errors[1] < 0.5 * errors[0] or errors[1] < 1e-3


@pytest.mark.parametrize("number", range(2))
def test_dynamics_rows_are_the_finite_differences_of_the_defects(number):
    problem = busy_problem()
    z, lay = around(problem, number, 0.2), problem.layout
    z.x[0] = problem.x0
    point = problem.at(z)
    model, rows = problem.quadratic(point), lay.dynamics
    assert np.array_equal(model.low[rows], model.high[rows])
    assert model.low[rows] == pytest.approx(point.defects.ravel())
    p = np.random.default_rng(9).normal(size=lay.n_vars) * lay.columns
    p[lay.slacks] = 0.0
    up, down = (end.defects.ravel() for end in ends(problem, point, EPS * p))
    along = (lay.a.matrix(model.matrix) @ p)[rows]
    assert -along == pytest.approx((up - down) / (2 * EPS), abs=1e-5)


def test_the_hessian_is_positive_semidefinite_and_matches_the_convex_terms():
    problem = busy_problem(goal=False)
    point, lay = problem.at(problem.initial()), problem.layout
    upper = lay.h.matrix(problem.quadratic(point).hessian).toarray()
    assert np.array_equal(upper, np.triu(upper))
    whole = upper + np.triu(upper, 1).T
    assert np.linalg.eigvalsh(whole).min() >= 0
    for column in (lay.u[3, 0], lay.u[3, 1], lay.x[4, Stage.S], lay.x[4, Stage.D]):
        p = np.zeros(lay.n_vars)
        p[column] = 1e-3
        up, down = (end.objective for end in ends(problem, point, p))
        second = (up - 2 * point.objective + down) / 1e-6
        assert whole[column, column] == pytest.approx(second, rel=1e-2, abs=2e-5)


@pytest.mark.parametrize(
    ("leader", "kept"),
    [
        (Track(60.0, 0.3, 2.0), True),  # slower: 5 m and more of braking way
        (Track(60.0, 3.2, 2.0), False),  # in the next lane
        (Track(60.0, 0.3, 2.0, np.pi / 2), False),  # across
    ],
)
def test_where_the_rule_counts_the_refinement_keeps_the_safe_distance(leader, kept):
    """As far as the seed does: its gap shrinks from 34 m by 8 m/s."""
    frame = frame_of(straight, 150.0)
    road = road_of(frame, window(30))
    state = state_at(frame, 20.0, v=10.0)
    seed = keeping_seed(road, state, 30)
    around, config = occupancy_of(frame, 60, leader), Config()
    ruled = config.model_copy(update={"cost": config.cost.model_copy(update={"safe_distance": 1})})
    free, bound = (build_corridor(seed, around, c).s_max for c in (config, ruled))
    rules = config.rules
    safe = safe_distance(
        10.0 * np.ones(31), leader.v, rules.braking_ego, rules.braking_others, rules.reaction
    )
    if not kept:
        assert np.array_equal(free, bound)
        return
    low = around.window(0, 31).s_low[0]
    gap = low - CAR_FRONT - seed.states[:, Stage.S]
    assert (gap > safe + 0.1).all()
    assert bound == pytest.approx(low - CAR_FRONT - safe - SPARE)
    assert (free > bound + 3.0).all()


def test_a_seed_in_haste_keeps_its_time_until_the_crossing_is_behind():
    """Somebody crosses from the right; after that, and without haste, the refinement is free."""
    frame = frame_of(straight, 150.0)
    road = road_of(frame, window(30))
    state = state_at(frame, 20.0, v=10.0)
    seed = keeping_seed(road, state, 30)
    around = occupancy(straight_across(frame, 40.0, -30.0, 8.0, np.pi / 2), frame)
    config = Config()
    hurried = config.model_copy(update={"cost": config.cost.model_copy(update={"haste": 1.0})})
    free, timed = (build_corridor(seed, around, c).s_min for c in (config, hurried))
    before = seed.states[:, Stage.S] < last_crossing(around, 0, 20.0)
    assert 5 < before.sum() < len(before) - 5
    assert np.all(timed[before] == seed.states[before, Stage.S] - YIELDED)
    assert np.array_equal(timed[~before], free[~before])
    assert np.all(free < 0)


def test_who_is_just_aside_counts_as_ahead_only_by_the_wider_distance():
    """TR1 counts centres within 2.8 m; one at 2.9 m is told apart, one at 1 m or at 5 m is not."""
    frame = frame_of(straight, 200.0)
    road, state, config = road_of(frame, window(10)), state_at(frame, 30.0, v=5.0), Config()
    seed = keeping_seed(road, state, 10)
    for d, asides in ((2.9, [0.3, 0.0]), (1.0, [0.3]), (5.0, [0.3])):
        occupancy = occupancy_of(frame, 30, Track(60.0, d, 5.0))
        assert different_asides(seed, occupancy, config) == asides
        counted = [np.isfinite(build_corridor(seed, occupancy, config, a).lead[1:]) for a in asides]
        assert counted[0].all() == (d < 3.1) and counted[0].any() == (d < 3.1)
        assert len(asides) == 1 or not counted[1].any()


# -- optima ---------------------------------------------------------------------------------------


def analytic_jerks(n: int, v: float, distance: float, speed: float) -> Array:
    """Jerks of least sum of squares that cover a distance and end at a speed, from a = 0."""
    a = DT * np.tril(np.ones((n, n)))  # a_k after jerks j_0..j_{k-1}
    speeds = DT * np.tril(np.ones((n, n))) @ a
    before = np.vstack([np.zeros(n), speeds[:-1]])
    way = (DT * before + DT**2 / 2 * a).sum(axis=0)
    rows = np.array([way, speeds[-1]])
    target = np.array([distance - v * n * DT, speed - v])
    return rows.T @ np.linalg.solve(rows @ rows.T, target)


@pytest.mark.parametrize(
    ("distance", "speed", "n"), [(40.0, 10.0, 40), (30.0, 4.0, 40), (44.0, 14.0, 35)]
)
def test_least_jerk_to_a_position_and_speed_is_the_analytic_optimum(distance, speed, n):
    """With jerk alone in the cost a free straight road leaves a linear quadratic problem."""
    config = with_cost(ACCURATE, jerk=1.0, distance=0.0, lane=0.0, steering_rate=1.0, edges=False)
    frame = frame_of(straight, 200.0)
    state = state_at(frame, 20.0, v=10.0)
    end = 20.0 + distance + FORD_ESCORT.rear_to_centre
    goal = window(n, s=(end, end), v=(speed, speed))
    seed = keeping_seed(road_of(frame, goal), state, n)
    problem = problem_of(seed, state, occupancy_of(frame, n), goal, config)
    result = solve(problem, config.refine)
    expected = analytic_jerks(n, 10.0, distance, speed)
    assert result.status == "converged"
    assert problem.at(result.z).objective == pytest.approx(DT * expected @ expected, rel=2e-3)
    assert result.z.u[:, 0] == pytest.approx(expected, abs=0.02 * np.abs(expected).max() + 1e-3)
    assert np.abs(result.z.x[:, Stage.D]).max() < 1e-4


@pytest.mark.parametrize("n", [33, 60, 100])
def test_the_refinement_ranks_jerks_as_the_evaluator_does(n):
    """Over drives whose acceleration is a random polyline; the inputs' own jerk does not."""
    config = with_cost(ACCURATE, jerk=1.0, distance=0.0, lane=0.0, steering_rate=0.0)
    frame, rng = frame_of(straight, 900.0), np.random.default_rng(n)
    state = state_at(frame, 20.0, v=10.0)
    seed = keeping_seed(road_of(frame, window(n)), state, n)
    problem = problem_of(seed, state, occupancy_of(frame, n), window(n), config)
    evaluated, modelled, driven = [], [], []
    for _ in range(100):
        knots = 2 * rng.normal(size=rng.integers(2, 6))
        x, u = problem.initial().x, np.zeros((n, 2))
        x[1:, Stage.A] = np.interp(np.linspace(0, 1, n), np.linspace(0, 1, len(knots)), knots)
        x[:, Stage.V] = 10.0 + DT * np.cumsum(x[:, Stage.A])
        x[1:, Stage.S] = x[0, Stage.S] + DT * np.cumsum((x[1:, Stage.V] + x[:-1, Stage.V]) / 2)
        u[:, 0] = np.diff(x[:, Stage.A]) / DT
        evaluated.append((evaluated_jerk(x, DT, True, True) ** 2).sum())
        modelled.append(problem.at(Iterate(x, u)).tr1)
        driven.append((u[:, 0] ** 2).sum())
    assert np.corrcoef(evaluated, modelled)[0, 1] > 0.95
    assert np.corrcoef(evaluated, driven)[0, 1] < 0.8


def test_a_drive_sets_in_with_the_acceleration_that_it_needs():
    """At the drive's start a jump is not seen: less than the least jerk from no acceleration, and
    the first step's jerk is far above all others; later in a drive it is not."""
    config = with_cost(ACCURATE, jerk=1.0, distance=0.0, lane=0.0, steering_rate=1.0)
    frame, n = frame_of(straight, 200.0), 40
    state = state_at(frame, 20.0, v=10.0)
    end = 20.0 + 46.0 + FORD_ESCORT.rear_to_centre
    goal = window(n, s=(end, end))
    jumps = []
    for first_step in (0, 3):
        road = replace(road_of(frame, goal), first_step=-first_step)
        seed = keeping_seed(road, state, n)
        problem = problem_of(seed, state, occupancy_of(frame, n), goal, config)
        result = solve(problem, config.refine)
        assert result.status == "converged"
        jerk = np.abs(result.z.u[:, 0])
        jumps.append(jerk[0] / jerk[1:].max())
    assert jumps[0] > 3.0 and jumps[1] < 1.2


def test_the_analytic_optimum_is_the_known_polynomial():
    """int j^2 dt from rest to rest over T, with the end's acceleration free: 60 s^2 / T^5 ..."""
    n, distance = 400, 10.0
    j = analytic_jerks(n, 0.0, distance, 0.0)
    t_end = n * DT
    # s(t) with a(0) = 0, v(0) = v(T) = 0 and j(T) = 0 (free acceleration): solved by hand
    c = np.linalg.solve(
        np.array([
            [t_end**3, t_end**4, t_end**5],
            [3 * t_end**2, 4 * t_end**3, 5 * t_end**4],
            [6.0, 24 * t_end, 60 * t_end**2],
        ]),
        [distance, 0.0, 0.0],
    )  # fmt: skip
    t = DT * (np.arange(n) + 0.5)
    polynomial = 6 * c[0] + 24 * c[1] * t + 60 * c[2] * t**2
    assert j == pytest.approx(polynomial, abs=0.02 * np.abs(polynomial).max())


@dataclass(frozen=True)
class Case:
    """A situation that both formulations solve; ``body`` asks for the road's and others' sides."""

    goal: GoalWindow
    start: dict
    tracks: tuple[Track, ...] = ()
    curve: tuple[float, float, float] = (0.0, 0.0, 1.0)  # kappa, where, over what length
    changes: dict = field(default_factory=dict)

    def curvature(self, s, exp=np.exp):
        """A bend that sets in smoothly; for arrays and for CasADi."""
        return self.curve[0] / (1 + exp(-(s - self.curve[1]) / self.curve[2]))


CASES = {
    "leader": Case(window(40), {"s": 30.0, "v": 14.0}, (Track(60, 0, 9.0),)),
    "braking leader": Case(window(40), {"s": 30.0, "v": 14.0}, (Track(65, 0, 10.0, braking=5.0),)),
    "bend": Case(window(40), {"s": 20.0, "v": 13.0, "d": 0.4, "mu": 0.02}, curve=(0.03, 45.0, 4.0)),
    "stop in goal": Case(
        window(50, s=(62.0, 64.0), d=(-0.5, 0.5), v=(0.0, 0.3)), {"s": 30.0, "v": 10.0}
    ),
    "lane change": Case(
        window(40, s=(75.0, 90.0), d=(3.2, 3.8), v=(10.0, 14.0)), {"s": 30.0, "v": 12.0}
    ),
    "parked car": Case(
        window(45, s=(80.0, 95.0), d=(-0.5, 0.5)), {"s": 30.0, "v": 12.0}, (Track(62, -1.9, 0.0),)
    ),
}


@cache
def both(name: str, accurate: bool) -> tuple[Problem, SqpResult, ref.Optimum]:
    """The planner's solution of a case, and the reference's."""
    case, config = CASES[name], ACCURATE if accurate else Config()
    frame = frame_of(case.curvature, 300.0)
    road, state = road_of(frame, case.goal), state_at(frame, **case.start)
    occupancy = occupancy_of(frame, case.goal.last + 60, *case.tracks)
    seed = lattice(road, state, 0.0, 0, occupancy, config, DT).seeds[0]
    assert len(seed.states) == case.goal.last + 1
    goal = case.goal if case.goal.s else None
    problem = problem_of(seed, state, occupancy, goal, config)
    result = solve(problem, config.refine)
    return problem, result, reference_of(problem, case, result)


def reference_of(problem: Problem, case: Case, result: SqpResult) -> ref.Optimum:
    """The reference's optimum with the numbers of a problem."""
    n, corridor = problem.n, problem.corridor.steps(1, problem.n + 1)
    assert (corridor.slant[:, :2] == 0).all()  # no half-planes: the reference has none
    body = None
    if case.curve[0] == 0.0:
        half = ref.CAR["width"] / 2
        low = np.maximum(-1.75, corridor.d_min - half)
        body = low, np.minimum(5.25, corridor.d_max + half)
    numbers = Reference(
        problem.x0, n, lambda s: case.curvature(s, ca.exp), problem.lane,
        corridor.lead, corridor.s_min, corridor.s_max, body, BODY_POINTS, problem.lateral_limit,
        problem.goal, problem.terminal,
        problem.seed.states[n], problem.speed_limit, problem.config,
    )  # fmt: skip
    return ref.solve(numbers, result.z.x, result.z.u)


@pytest.mark.parametrize("name", CASES)
def test_the_independent_reference_finds_the_same_optimum(name):
    """Compared: objective plus penalties of ours, solved accurately, against IPOPT's cost."""
    problem, result, optimum = both(name, True)
    assert result.cost_after == pytest.approx(optimum.cost, rel=0.01, abs=2e-3)
    assert np.abs(problem.at(result.z).defects).max() < 1e-5
    assert problem.at(result.z).slacks.max() < 2e-3


@pytest.mark.parametrize("name", CASES)
def test_default_settings_come_within_a_hundredth_of_the_optimum(name):
    """The same with the default numbers of iterations and tolerances."""
    _, result, optimum = both(name, False)
    assert result.cost_after == pytest.approx(optimum.cost, rel=0.01, abs=2e-3)


@pytest.mark.parametrize("name", CASES)
def test_kkt_residuals_are_small_at_the_solution(name):
    problem, result, _ = both(name, True)
    assert result.status == "converged"
    assert result.iterations > 0 and result.qp_iterations >= 0
    assert result.kkt.stationarity < 2e-2
    assert result.kkt.defect < 1e-6
    assert result.kkt.bounds < 1e-6
    assert result.kkt.complementarity < 1e-3
    assert result.cost_after <= result.cost_before + problem.at(problem.initial()).penalty


@pytest.mark.parametrize("name", CASES)
def test_the_merit_is_least_at_the_optimum(name):
    """With the weights that the multipliers ask for the penalty is exact (Nocedal and Wright,
    theorem 17.3): nothing near the solution has a smaller merit."""
    problem, result, _ = both(name, True)
    point = problem.at(result.z)
    qp = QpSolver(problem.layout, "piqp", 100, 1e-4)
    merit = Merit(problem.layout)
    merit.weigh(qp.solve(problem.quadratic(point)).y)
    random, least = np.random.default_rng(3), merit(point)
    for size in (0.3, 0.03):
        for _ in range(50):
            dx = size * STATE_SCALE * random.normal(size=point.z.x.shape)
            du = size * np.array(INPUT_SCALE) * random.normal(size=point.z.u.shape)
            dx[0] = 0.0
            near = Iterate(point.z.x + dx, point.z.u + du)
            assert merit(problem.at(near, point.reading)) > least


def test_weights_of_the_merit_never_fall():
    problem, _, _ = both("lane change", True)
    lay, merit, point = problem.layout, Merit(problem.layout), problem.at(problem.initial())
    large = np.zeros(lay.n_rows)
    large[lay.dynamics] = 3.0
    large[lay.hard] = 0.5
    merit.weigh(large)
    value = merit(point)
    merit.weigh(0.1 * large)
    assert merit(point) == value
    merit.weigh(2.0 * large)
    assert merit(point) > value


def test_full_steps_are_taken_where_the_model_is_good():
    """Weights far above the multipliers refused good steps here for small defects: the cost went
    down by half its way to the optimum at every iteration, and ended above it at the limit."""
    problems = record_problems(ROOT / "scenarios" / "ZAM_Bicycle-1_1_T-1.xml", Config())
    whole_way = [p.problem for p in problems if p.kind == TO_GOAL and p.problem.n >= 80]
    assert whole_way
    for problem in whole_way[:2]:
        result = solve(problem, Config().refine)
        assert result.status == "converged"
        assert result.iterations < 8


@pytest.mark.parametrize("name", ["bend", "lane change", "parked car"])
def test_a_mirrored_road_gives_the_mirrored_solution(name):
    case, solved = CASES[name], []
    for side in (1.0, -1.0):
        start = {**case.start, "d": side * case.start.get("d", 0.0)}
        start["mu"] = side * case.start.get("mu", 0.0)
        tracks = tuple(replace(track, d=side * track.d) for track in case.tracks)
        d = case.goal.d and tuple(sorted(side * value for value in case.goal.d))
        mirrored = replace(
            case, goal=replace(case.goal, d=d), start=start, tracks=tracks,
            curve=(side * case.curve[0], *case.curve[1:]),
        )  # fmt: skip
        solved.append(_solved_on_symmetric_road(mirrored, side))
    mirror = np.array([1.0, -1.0, -1.0, 1.0, -1.0, 1.0])
    assert solved[1].z.x == pytest.approx(mirror * solved[0].z.x, abs=2e-3)
    assert solved[1].cost_after == pytest.approx(solved[0].cost_after, rel=1e-4, abs=1e-6)


def _solved_on_symmetric_road(case: Case, side: float) -> SqpResult:
    """The solution from a seed that is made by hand, so that it mirrors exactly."""
    frame = frame_of(case.curvature, 300.0)
    road, state = road_of(frame, case.goal, right=-5.25, left=5.25), state_at(frame, **case.start)
    n = case.goal.last
    seed = keeping_seed(road, state, n)
    bump = 2.4 * side * np.sin(np.linspace(0, np.pi, n + 1)) ** 2 if case.tracks else 0.0
    end = (sum(case.goal.d) / 2 if case.goal.d else 0.0) - seed.states[:, Stage.D]
    share = np.linspace(0, 1, n + 1) ** 2 * (3 - 2 * np.linspace(0, 1, n + 1))
    seed.states[:, Stage.D] += end * share + bump
    seed.states[1:, Stage.MU] = np.diff(seed.states[:, Stage.D]) / np.diff(seed.states[:, Stage.S])
    occupancy = occupancy_of(frame, n + 5, *case.tracks)
    goal = case.goal if case.goal.s else None
    return solve(problem_of(seed, state, occupancy, goal, ACCURATE), ACCURATE.refine)


# -- feasibility and failure ----------------------------------------------------------------------


def blocked_problem(gap: float) -> tuple[Problem, Config]:
    """Fast towards a standing car: no deceleration stops in time where the gap is short."""
    config = Config()
    frame = frame_of(straight, 200.0)
    state = state_at(frame, 30.0, v=20.0)
    occupancy = occupancy_of(frame, 40, Track(30.0 + gap + 5.0, 0.0, 0.0, width=9.0))
    seed = keeping_seed(road_of(frame, window(30)), state, 30, a=-8.0)
    return problem_of(seed, state, occupancy, None, config), config


def test_an_infeasible_problem_ends_with_slacks_and_finite_values():
    problem, config = blocked_problem(gap=6.0)
    result = solve(problem, config.refine)
    assert np.isfinite(result.z.x).all() and np.isfinite(result.z.u).all()
    assert problem.at(result.z).slacks.max() > 0.1
    assert result.cost_after < result.cost_before
    assert np.isfinite(list(result.kkt.as_dict().values())).all()


def test_a_feasible_problem_ends_without_slacks():
    problem, config = blocked_problem(gap=45.0)
    result = solve(problem, config.refine)
    assert problem.at(result.z).slacks.max() < 1e-3


def refined(n: int = 30, config: Config | None = None, fresh: bool = True):
    """A lane-keeping seed beside its lane's centre, behind a leader, refined."""
    frame = frame_of(sine, 200.0)
    state = state_at(frame, 20.0, d=0.3, v=11.0)
    seed = keeping_seed(road_of(frame, window(n)), state, n)
    occupancy = occupancy_of(frame, n + 5, Track(50.0, 0.0, 9.0))
    return seed, state, refine(seed, state, 0.0, occupancy, config or Config(), DT, fresh)


def test_refining_lowers_the_cost_and_gives_what_the_vehicle_drives():
    seed, state, result = refined()
    assert result is not None and result.result.cost_after < result.result.cost_before
    again = simulate(state, result.trajectory.inputs, DT)
    assert np.array_equal(again.states, result.trajectory.states)
    frenet = np.column_stack(seed.road.frame.to_frenet(result.trajectory.states[:, :2]))
    assert result.result.z.x[:, [Stage.S, Stage.D]] == pytest.approx(frenet, abs=1e-2)
    assert result.result.tr1[1] < result.result.tr1[0]


def test_refining_twice_gives_the_same_bits():
    first, second = refined()[2], refined()[2]
    assert np.array_equal(first.trajectory.states, second.trajectory.states)
    assert first.result.as_dict() == second.result.as_dict()


def test_a_seed_that_is_too_short_is_left_alone():
    assert refined(n=1)[2] is None


@pytest.mark.parametrize(("fresh", "steps"), [(True, 50), (False, 30)])
def test_the_horizon_of_fresh_and_later_plans(fresh, steps):
    _, _, result = refined(n=50, fresh=fresh)
    assert len(result.trajectory.inputs) == len(result.result.z.u) == steps


def failing(*_: object) -> Answer:
    """What the solver says when it has nothing."""
    return Answer(np.zeros(1), np.zeros(1), "failed", 0)


def test_a_failed_subproblem_leaves_the_seed_and_says_so(monkeypatch):
    monkeypatch.setattr(QpSolver, "solve", failing)
    seed, _, result = refined()
    assert result is not None and result.result.status == "subproblem failed: failed"
    assert result.result.cost_after == result.result.cost_before
    assert result.result.z.x[1:] == pytest.approx(seed.states[1:])


@pytest.mark.parametrize(
    ("status", "p", "usable"),
    [
        ("solved", 0.0, True),
        ("solved inaccurate", 0.0, True),
        ("primal infeasible", 0.0, False),
        ("solved", np.nan, False),
        ("failed", 0.0, False),
    ],
)
def test_which_answers_are_used(status, p, usable):
    assert Answer(np.array([p]), np.zeros(1), status, 1).usable is usable


# -- reading --------------------------------------------------------------------------------------


def problem_beside(right: Array, d: float) -> Problem:
    """Keeping an offset d on a straight road with a right edge of its own."""
    frame = frame_of(straight, 120.0)
    road = road_of(frame)
    road = replace(road, limits=replace(road.limits, right=right))
    state = state_at(frame, 50.0, d=d, v=10.0)
    return problem_of(keeping_seed(road, state, 20), state, occupancy_of(frame, 30), None, Config())


def low_of(problem: Problem, name: BodyPoint) -> Array:
    """A parameter of the body's points."""
    reading = problem.read(problem.initial())
    return reading.par[:, len(Given) :].reshape(problem.n, -1, len(BodyPoint))[..., name]


@pytest.mark.parametrize("far", [True, False])
def test_a_corner_far_beside_the_body_is_no_slope(far):
    """The right edge jumps from -9 m to -3 m: nothing in the way of a body in the middle of the
    lane, whatever the line along the jump says; for a body near -3 m the line counts."""
    right = np.where(frame_of(straight, 120.0).s < 59.9, -9.0, -3.0)
    problem = problem_beside(right, 0.0 if far else -2.0)
    slope, low = low_of(problem, BodyPoint.LOW_SLOPE), low_of(problem, BodyPoint.LOW)
    assert (np.abs(slope).max() < 1e-9) if far else (slope.max() > 6.0)
    half = ref.CAR["width"] / 2
    at = problem.initial().x[1:, Stage.S, None] + np.array(BODY_POINTS)
    around = np.abs(at - 60.0) < 1.0
    assert around.any() and (~around).any()
    if far:
        assert low[around] == pytest.approx(-3.0 + half)  # the strictest around, and level
        assert low[at < 55.0] == pytest.approx(-9.0 + half)


def test_tables_are_read_again_only_where_the_iterate_moved():
    problem = busy_problem()
    start = problem.at(problem.initial())
    for moved_by, again in ((0.01, False), (0.2, True)):
        x = start.z.x.copy()
        x[5, Stage.S] += moved_by
        point = problem.at(Iterate(x, start.z.u), start.reading)
        found = problem.again(point)
        assert (found is not point) == again
        assert (found.reading is not start.reading) == again
        fresh = problem.at(point.z)
        assert found.cost == pytest.approx(fresh.cost, rel=1e-3)
