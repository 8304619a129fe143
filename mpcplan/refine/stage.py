"""One step of the refinement's problem as CasADi expressions.

The mathematics is that of :mod:`mpcplan.refine.problem`: the cost of driving the inputs u_{k-1}
into the state x_k, and the rows g(x_k) <= sigma that this state must meet. What comes from tables
along the road (curvature, edges, the body's projection) enters as parameters that were read off at
an iterate (:mod:`mpcplan.refine.reading`), the edges as lines in s. Every row belongs to one step,
so that only the dynamics reach from one to the next.
"""

from enum import IntEnum

import casadi as ca
import numpy as np

from mpcplan.config import Config
from mpcplan.seed.paths import BODY_POINTS
from mpcplan.seed.seed import Stage
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

CLOSEST = -6.0  # m, smallest gap in the closeness term


class Input(IntEnum):
    """The inputs over a step: jerk [m/s^3] and steering rate [rad/s]."""

    J = 0
    W = 1


class Slack(IntEnum):
    """The slacks of a state: in s [m], in d [m], of the accelerations [m/s^2]."""

    S = 0
    D = 1
    A = 2


class Given(IntEnum):
    """A step's parameters but for those of the body's points."""

    KAPPA = 0  # of the path over the step: kappa + slope (s - from)
    KAPPA_SLOPE = 1
    KAPPA_FROM = 2
    SPEED_LIMIT = 3
    DUE = 4
    LEAD = 5
    LANE = 6
    S_MIN = 7
    S_MAX = 8
    SLANT_S = 9
    SLANT_D = 10
    SLANT_MAX = 11
    LATERAL = 12  # largest lateral acceleration
    AT = 13  # the arc length at which the body's parameters were read off
    BEND = 14  # curvature between axle and front
    JERK_SHARE = 15  # of the step's jerk that counts
    END_SHARE = 16  # of the step's acceleration, as a jerk of one step, that counts


class Point(IntEnum):
    """Parameters of one point of the body: bias of its offset, its bounds as lines in s - at."""

    BIAS = 0
    LOW = 1
    LOW_SLOPE = 2
    HIGH = 3
    HIGH_SLOPE = 4


N_GIVEN = len(Given) + len(BODY_POINTS) * len(Point)
LIMIT_ROW = 0  # the acceleration limit has no slack
SLACK_OF_ROW = (
    None, *[Slack.A] * 3, *[Slack.S] * 3, *[Slack.D] * 2 * len(BODY_POINTS)
)  # fmt: skip
N_ROWS = len(SLACK_OF_ROW)
N_GOAL = 8
BOXES = (len(Input) + Stage.DELTA, len(Input) + Stage.V, len(Input) + Stage.A, Input.W)
"""A step's bounded variables among (u, x): steering angle, speed, acceleration, steering rate."""
CURVATURE = [Given.KAPPA, Given.KAPPA_SLOPE, Given.KAPPA_FROM]


def point_at(i: int, name: Point) -> int:
    """Place of a parameter of the body's point i."""
    return len(Given) + i * len(Point) + name


def penalty_weights(config: Config, dt: float) -> tuple[float, float, float]:
    """Weights of a state's slacks; the friction circle is scaled by 1 / a_max, so that its slack
    is an acceleration."""
    r = config.refine
    return dt * r.penalty_lon, dt * r.penalty_lat, dt * r.penalty_acceleration


def residuals(x: ca.SX, u: ca.SX, par: ca.SX, config: Config, dt: float) -> tuple[ca.SX, ca.SX]:
    """What the cost is the sum of squares of, but for the closeness: of TR1, and of the rest."""
    cost, refine = config.cost, config.refine
    offset = x[Stage.D] + CAR.rear_to_centre * ca.sin(x[Stage.MU]) - par[Given.LANE]
    speeding = ca.fmax(x[Stage.V] - par[Given.SPEED_LIMIT], 0.0)
    late = ca.fmax(par[Given.DUE] - x[Stage.S], 0.0)

    def weighted(weight: float, value: ca.SX) -> ca.SX:
        return np.sqrt(dt * weight) * value

    judged = ca.vertcat(
        weighted(cost.jerk, par[Given.JERK_SHARE] * u[Input.J]),
        weighted(cost.jerk, par[Given.END_SHARE] * x[Stage.A] / dt),
        weighted(cost.steering_rate, u[Input.W]),
        weighted(cost.lane, offset),
    )
    return judged, ca.vertcat(weighted(refine.speeding, speeding), weighted(cost.late, late))


def closeness(s: ca.SX, par: ca.SX, config: Config, dt: float) -> ca.SX:
    """The cost of the distance to the obstacle ahead."""
    cost = config.cost
    gap = par[Given.LEAD] - s - CAR.rear_to_centre - cost.distance_offset
    return dt * cost.distance * ca.exp(-cost.distance_decay * ca.fmax(gap, CLOSEST))


def rows(x: ca.SX, par: ca.SX, config: Config) -> ca.SX:
    """(N_ROWS,) values g of a state that meets g <= slack: acceleration limit; friction circle,
    lateral acceleration to either side; s above and below, half-plane; d of every point of the
    body below and above. :data:`SLACK_OF_ROW` tells the slacks."""
    s, d, mu, v, delta, a = (x[i] for i in Stage)
    lateral = v**2 / CAR.wheelbase * ca.tan(delta)
    s_c, d_c = s + CAR.rear_to_centre * ca.cos(mu), d + CAR.rear_to_centre * ca.sin(mu)
    limit = CAR.a_max * config.refine.actuator_share
    circle = CAR.a_max * config.refine.friction_share**2
    values = [
        a * ca.fmax(v, CAR.v_switch) / CAR.v_switch - limit,
        (a**2 + lateral**2) / CAR.a_max - circle,
        lateral - par[Given.LATERAL],
        -lateral - par[Given.LATERAL],
        s - par[Given.S_MAX],
        par[Given.S_MIN] - s,
        par[Given.SLANT_S] * s_c + par[Given.SLANT_D] * d_c - par[Given.SLANT_MAX],
    ]
    moved = s - par[Given.AT]
    for i, ahead in enumerate(BODY_POINTS):
        offset = body_offset(d, mu, par[Given.BEND], ahead) + par[point_at(i, Point.BIAS)]
        low = par[point_at(i, Point.LOW)] + par[point_at(i, Point.LOW_SLOPE)] * moved
        high = par[point_at(i, Point.HIGH)] + par[point_at(i, Point.HIGH_SLOPE)] * moved
        values += [low - offset, offset - high]
    return ca.vertcat(*values)


def slacks_of(g: ca.SX) -> ca.SX:
    """(3,) smallest slacks with which the rows of a state hold."""
    groups = [[i for i, s in enumerate(SLACK_OF_ROW) if s == slack] for slack in Slack]
    return ca.vertcat(*(ca.fmax(ca.mmax(g[group]), 0.0) for group in groups))


def box_bounds(config: Config) -> tuple[Array, Array]:
    """(4,) lower and upper bounds of the variables :data:`BOXES`."""
    high = config.refine.actuator_share * np.array(
        [CAR.delta_max, np.inf, CAR.a_max, CAR.v_delta_max]
    )
    low = -high
    low[1], high[1] = 0.0, CAR.v_max
    return low, high


def hard_excess(x: ca.SX, u: ca.SX, g: ca.SX, config: Config) -> ca.SX:
    """The largest violation of what has no slack: the acceleration limit and the boxes."""
    low, high = (ca.DM(bound) for bound in box_bounds(config))
    value = ca.vertcat(u, x)[list(BOXES)]
    return ca.fmax(ca.mmax(ca.vertcat(g[LIMIT_ROW], value - high, low - value)), 0.0)


def goal_rows(x: ca.SX, bounds: ca.SX, turn: ca.SX) -> ca.SX:
    """(8,) values g <= slack of the last state: s, d, speed and heading of the body above their
    bounds, then below.

    Args:
        x: the last state.
        bounds: (8,) lower bounds, then upper ones.
        turn: (3,) heading and curvature of the path at an arc length near the last one.
    """
    values = ca.vertcat(
        x[Stage.S] + CAR.rear_to_centre * ca.cos(x[Stage.MU]),
        x[Stage.D] + CAR.rear_to_centre * ca.sin(x[Stage.MU]),
        x[Stage.V],
        turn[0] + turn[1] * (x[Stage.S] - turn[2]) + x[Stage.MU],
    )
    return ca.vertcat(values - bounds[4:], bounds[:4] - values)


def body_offset(d: ca.SX, mu: ca.SX, bend: ca.SX, ahead: float) -> ca.SX:
    """Offset of a point of the body's axis from a path of constant curvature.

    With the axle at (0, d) and the path's centre of curvature at (0, 1 / kappa) it is 1 / kappa
    less the point's distance from that centre, here without the difference of large numbers.
    """
    along, across = ahead * ca.cos(mu), d + ahead * ca.sin(mu)
    far = ca.sqrt((bend * along) ** 2 + (1 - bend * across) ** 2)
    return (2 * across - bend * (along**2 + across**2)) / (1 + far)


def body_offset_at(d: Array, mu: Array, bend: Array, ahead: float | Array) -> Array:
    """The same of arrays."""
    along, across = ahead * np.cos(mu), d + ahead * np.sin(mu)
    far = np.sqrt((bend * along) ** 2 + (1 - bend * across) ** 2)
    offset: Array = (2 * across - bend * (along**2 + across**2)) / (1 + far)
    return offset
