"""Roads and traffic made by hand, and the refinement's problem formulated a second time.

The reference states the optimal-control problem from its mathematics alone, with CasADi's Opti and
IPOPT: its own integrator (two Runge-Kutta steps per time step instead of one), the curvature as the
closed formula from which the road was made, hard constraints in place of penalties, automatic
second derivatives. What it shares with the planner are the problem's numbers.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
import shapely

from mpcplan.config import Config
from mpcplan.observation import Box, Forecast
from mpcplan.predict.occupancy import Occupancy, occupancy
from mpcplan.refine.reading import GOAL_MARGIN
from mpcplan.road.frame import Frame
from mpcplan.road.goal import GoalWindow
from mpcplan.road.limits import Limits
from mpcplan.road.road import Road
from mpcplan.road.route import Route
from mpcplan.trajectory import Array

FINE = 0.01  # m, integration of a curvature to a path
SPACING = 0.5  # m, of the frame's samples
CAR = {"length": 4.298, "width": 1.674, "wheelbase": 2.39268, "b": 1.50876}
CAR_FRONT, CAR_REAR = CAR["b"] + CAR["length"] / 2, CAR["length"] / 2 - CAR["b"]
DT = 0.1

Curvature = Callable[[Array], Array]


def straight(s: Array) -> Array:
    """No curvature."""
    return 0.0 * s


def frame_of(curvature: Curvature, length: float) -> Frame:
    """The frame of the path with the given curvature kappa(s), from the origin along x."""
    fine = np.arange(0.0, length + FINE / 2, FINE)
    kappa = np.broadcast_to(curvature(fine), fine.shape)
    theta = np.concatenate([[0.0], np.cumsum((kappa[1:] + kappa[:-1]) * FINE / 2)])
    middle = (theta[1:] + theta[:-1]) / 2
    steps = FINE * np.column_stack([np.cos(middle), np.sin(middle)])
    points = np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])
    every = round(SPACING / FINE)
    return Frame(fine[::every], points[::every])


def road_of(
    frame: Frame, *goals: GoalWindow, right: float = -1.75, left: float = 5.25, speed: float = 40.0
) -> Road:
    """A road along a frame: the own lane about d = 0, others 3.5 m beside where there is room."""
    n = len(frame.s)

    def constant(value: float) -> Array:
        return np.full(n, value)

    limits = Limits(
        left=constant(left),
        right=constant(right),
        lane=constant(0.0),
        lane_left=constant(3.5 if left >= 5.25 else np.nan),
        lane_right=constant(-3.5 if right <= -5.25 else np.nan),
        posted=constant(speed),
        speed=constant(speed),
        end=frame.length,
    )
    sides = [frame.to_cartesian(frame.s, np.array(d)) for d in (right, left)]
    area = shapely.Polygon(np.vstack([sides[0], sides[1][::-1]]))
    return Road(
        Route((1,)), frame, limits, goals or (GoalWindow(0, 30, None, None, None, None),), area
    )


def straight_road(*goals: GoalWindow, length: float = 300.0, **limits: float) -> Road:
    """A straight road along x: Frenet and Cartesian coordinates agree."""
    return road_of(frame_of(straight, length), *goals, **limits)


@dataclass(frozen=True)
class Track:
    """Another vehicle: centre (s, d) [m] at step 0, speed [m/s], heading to the path [rad]."""

    s: float
    d: float
    v: float
    turn: float = 0.0
    length: float = 4.5
    width: float = 1.8
    braking: float = 0.0  # m/s^2, from step 0 until it stands


def forecast_of(frame: Frame, steps: int, *tracks: Track) -> Forecast:
    """The boxes of vehicles that drive along a frame, over steps 0..steps; ids from 10 on."""
    t = DT * np.arange(steps + 1)
    boxes = np.empty((len(tracks), steps + 1, len(Box)))
    for row, track in zip(boxes, tracks, strict=True):
        braked = np.minimum(t, track.v / track.braking) if track.braking else t
        s = track.s + track.v * braked - track.braking * braked**2 / 2
        row[:, [Box.X, Box.Y]] = frame.to_cartesian(s, np.array(track.d))
        row[:, Box.PSI] = frame.heading(s) + track.turn
        row[:, Box.V] = track.v - track.braking * braked
        row[:, [Box.LENGTH, Box.WIDTH]] = track.length, track.width
    return Forecast(0, tuple(range(10, 10 + len(tracks))), boxes)


def straight_across(
    frame: Frame, s: float, d: float, v: float, turn: float, steps: int = 60
) -> Forecast:
    """Somebody who drives straight on at an angle [rad] to a straight frame, from (s, d) at a speed
    [m/s]; id 10."""
    t = DT * np.arange(steps + 1)
    boxes = np.empty((1, steps + 1, len(Box)))
    along, aside = s + v * t * np.cos(turn), d + v * t * np.sin(turn)
    boxes[0][:, [Box.X, Box.Y]] = frame.to_cartesian(along, aside)
    boxes[0][:, [Box.PSI, Box.V, Box.LENGTH, Box.WIDTH]] = turn, v, 4.5, 1.8
    return Forecast(0, (10,), boxes)


def occupancy_of(frame: Frame, steps: int, *tracks: Track) -> Occupancy:
    """The same vehicles along the frame."""
    return occupancy(forecast_of(frame, steps, *tracks), frame)


def state_at(frame: Frame, s: float, d: float = 0.0, v: float = 10.0, mu: float = 0.0) -> Array:
    """(5,) rear-axle state at Frenet coordinates, steered along the path."""
    x, y = frame.to_cartesian(np.array(s), np.array(d))
    kappa = float(frame.curvature(np.array(s)))
    delta = np.arctan(CAR["wheelbase"] * kappa / (1.0 - kappa * d))
    return np.array([x, y, delta, v, float(frame.heading(np.array(s))) + mu])


@dataclass(frozen=True)
class Reference:
    """The numbers of one problem; arrays over steps 1..N unless said otherwise.

    Attributes:
        x0: (6,) s, d, mu, v, delta, a at step 0.
        n: steps N.
        curvature: kappa(s), made of CasADi operations.
        lane: offset of the lane's centre that counts [m].
        lead: arc length of the leader's centre, inf where there is none.
        s_min, s_max: bounds of the rear axle.
        body: (low, high) bounds [m] of the body's sides on a straight road, or None: not asked.
        points: places of the body's axis [m ahead of the axle] that the bounds hold for.
        lateral: bound of the lateral acceleration [m/s^2].
        goal: window at step N, or None: then ``terminal`` draws to ``end``.
        speed_limit: where the cost of speeding begins [m/s].
    """

    x0: Array
    n: int
    curvature: Callable[[ca.MX], ca.MX]
    lane: Array
    lead: Array
    s_min: Array
    s_max: Array
    body: tuple[Array, Array] | None
    points: tuple[float, ...]
    lateral: float
    goal: GoalWindow | None
    terminal: Array
    end: Array
    speed_limit: Array
    config: Config = field(default_factory=Config)


@dataclass(frozen=True)
class Optimum:
    """IPOPT's optimum: states (N + 1, 6), inputs (N, 2) and the cost."""

    x: Array
    u: Array
    cost: float


def solve(reference: Reference, x_guess: Array, u_guess: Array) -> Optimum:
    """Solves the problem with IPOPT; raises RuntimeError where it does not converge."""
    opti = ca.Opti()
    x, u = opti.variable(6, reference.n + 1), opti.variable(2, reference.n)
    opti.subject_to(x[:, 0] == reference.x0)
    for k in range(reference.n):
        opti.subject_to(x[:, k + 1] == _advance(x[:, k], u[:, k], reference.curvature))
    opti.minimize(_cost(reference, opti, x, u))
    _bounds(reference, opti, x, u)
    _goal(reference, opti, x[:, -1])
    opti.set_initial(x, x_guess.T)
    opti.set_initial(u, u_guess.T)
    opti.solver(
        "ipopt",
        {"print_time": False, "expand": True},
        {"print_level": 0, "sb": "yes", "max_iter": 500},
    )
    found = opti.solve()
    return Optimum(
        np.asarray(found.value(x)).T, np.asarray(found.value(u)).T, float(found.value(opti.f))
    )


def _advance(x: ca.MX, u: ca.MX, curvature: Callable[[ca.MX], ca.MX]) -> ca.MX:
    """One time step of the KS model along the path, in two Runge-Kutta steps."""
    a, w = x[5] + u[0] * DT, u[1]

    def rates(y: ca.MX) -> ca.MX:
        kappa = curvature(y[0])
        s_rate = y[3] * ca.cos(y[2]) / (1 - kappa * y[1])
        turn = y[3] * ca.tan(y[4]) / CAR["wheelbase"]
        return ca.vertcat(s_rate, y[3] * ca.sin(y[2]), turn - kappa * s_rate, a, w)

    y, h = x[:5], DT / 2
    for _ in range(2):
        k1 = rates(y)
        k2 = rates(y + h / 2 * k1)
        k3 = rates(y + h / 2 * k2)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(y + h * k3))
    return ca.vertcat(y, a)


def _cost(reference: Reference, opti: ca.Opti, x: ca.MX, u: ca.MX) -> ca.MX:
    """The four TR1 terms, speeding, and the distance from the seed's end where there is no goal.

    The drive begins with the problem and, where there is a goal, ends with it: there the jerk is
    that which the evaluator sees.
    """
    cost, total = reference.config.cost, 0
    share = 3 / 8 if cost.edges else 0.0
    if reference.goal is not None:
        total += DT * cost.jerk * (share * x[5, -1] / DT) ** 2
    first = share if cost.edges else 1.0
    speeding = opti.variable(reference.n)
    opti.subject_to(speeding >= 0)
    for k in range(reference.n):
        s, d, mu, v = (x[i, k + 1] for i in range(4))
        jerk = u[0, k] * (first if k == 0 else 1.0)
        rate = cost.jerk * jerk**2 + cost.steering_rate * u[1, k] ** 2
        rate += cost.lane * (d + CAR["b"] * ca.sin(mu) - reference.lane[k]) ** 2
        if np.isfinite(reference.lead[k]):
            gap = reference.lead[k] - s - CAR["b"] - cost.distance_offset
            rate += cost.distance * ca.exp(-cost.distance_decay * gap)
        opti.subject_to(speeding[k] >= v - reference.speed_limit[k])
        total += DT * (rate + reference.config.refine.speeding * speeding[k] ** 2)
    if reference.goal is None:
        total += ca.dot(reference.terminal, (x[:, -1] - reference.end) ** 2)
    return total


def _bounds(reference: Reference, opti: ca.Opti, x: ca.MX, u: ca.MX) -> None:
    """Actuators, friction circle, lateral acceleration, leader, road."""
    share = reference.config.refine.actuator_share
    v, delta, a = x[3, 1:], x[4, 1:], x[5, 1:]
    opti.subject_to(opti.bounded(0, v, 45.8))
    opti.subject_to(opti.bounded(-0.91 * share, delta, 0.91 * share))
    opti.subject_to(opti.bounded(-0.4 * share, u[1, :], 0.4 * share))
    opti.subject_to(opti.bounded(-11.5 * share, a, 11.5 * share))
    opti.subject_to(a * v <= 11.5 * 4.755 * share)
    side = v**2 * ca.tan(delta) / CAR["wheelbase"]
    opti.subject_to(opti.bounded(-reference.lateral, side, reference.lateral))
    opti.subject_to(a**2 + side**2 <= (11.5 * reference.config.refine.friction_share) ** 2)
    opti.subject_to(reference.s_min <= x[0, 1:].T)
    opti.subject_to(reference.s_max >= x[0, 1:].T)
    if reference.body is not None:
        low, high = reference.body
        half = CAR["width"] / 2 * ca.cos(x[2, 1:]).T
        for point in reference.points:
            d = (x[1, 1:] + point * ca.sin(x[2, 1:])).T
            opti.subject_to(d - half >= low)
            opti.subject_to(d + half <= high)


def _goal(reference: Reference, opti: ca.Opti, last: ca.MX) -> None:
    """The goal window's s, d and v, entered by the planner's margin."""
    if reference.goal is None:
        return
    s, d = last[0] + CAR["b"] * ca.cos(last[2]), last[1] + CAR["b"] * ca.sin(last[2])
    for interval, value in (
        (reference.goal.s, s), (reference.goal.d, d), (reference.goal.v, last[3]),
    ):  # fmt: skip
        if interval is not None:
            margin = min(GOAL_MARGIN, (interval[1] - interval[0]) / 2)
            opti.subject_to(opti.bounded(interval[0] + margin, value, interval[1] - margin))
