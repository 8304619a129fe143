"""One stage of the refinement's problem as CasADi expressions, for solvers of the whole problem.

The mathematics is that of :mod:`mpcplan.refine.problem`. What comes from tables there (curvature,
edges of the road, the body's projection) enters as parameters that were read off at an iterate, the
edges as lines in s; the solver's caller reads them off again at the solution. A stage has its state
x_k, its inputs [j, w] and its own slacks [sigma_s, sigma_d, sigma_a], so that no row reaches across
stages but for the dynamics.
"""

from enum import IntEnum

import casadi as ca
import numpy as np

from mpcplan.config import Config
from mpcplan.refine.problem import CLOSEST, SLACK_CURVATURE
from mpcplan.seed.paths import BODY_POINTS
from mpcplan.seed.seed import Stage
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR


class Free(IntEnum):
    """A stage's variables beside its state."""

    J = 0
    W = 1
    SLACK_S = 2
    SLACK_D = 3
    SLACK_A = 4


class Given(IntEnum):
    """A stage's parameters but for those of the body's points."""

    KAPPA = 0  # of the path from this stage to the next: kappa + slope (s - from)
    KAPPA_SLOPE = 1
    KAPPA_FROM = 2
    SPEED_LIMIT = 3
    DUE = 4
    LEAD = 5
    LANE = 6
    SLANT_S = 7
    SLANT_D = 8
    AT = 9  # the arc length at which the body's parameters were read off
    BEND = 10  # curvature between axle and front


class Point(IntEnum):
    """Parameters of one point of the body: bias of its offset, edges as lines in s - at."""

    BIAS = 0
    LOW = 1
    LOW_SLOPE = 2
    HIGH = 3
    HIGH_SLOPE = 4


N_GIVEN = len(Given) + len(BODY_POINTS) * len(Point)
N_ROWS = 7 + 2 * len(BODY_POINTS)


def point_at(i: int, name: Point) -> int:
    """Place of a parameter of the body's point i."""
    return len(Given) + i * len(Point) + name


def stage_cost(x: ca.SX, u: ca.SX, par: ca.SX, config: Config, dt: float) -> ca.SX:
    """The cost of a state k >= 1 with its slacks, without that of inputs."""
    cost, refine = config.cost, config.refine
    s, d, mu, v = (x[i] for i in (Stage.S, Stage.D, Stage.MU, Stage.V))
    gap = par[Given.LEAD] - s - CAR.rear_to_centre - cost.distance_offset
    rate = cost.distance * ca.exp(-cost.distance_decay * ca.fmax(gap, CLOSEST))
    rate += cost.lane * (d + CAR.rear_to_centre * ca.sin(mu) - par[Given.LANE]) ** 2
    rate += refine.speeding * ca.fmax(v - par[Given.SPEED_LIMIT], 0.0) ** 2
    rate += cost.late * ca.fmax(par[Given.DUE] - s, 0.0) ** 2
    weights = (refine.penalty_lon, refine.penalty_lat, refine.penalty_acceleration)
    for i, weight in zip((Free.SLACK_S, Free.SLACK_D, Free.SLACK_A), weights, strict=True):
        rate += weight * u[i] + SLACK_CURVATURE / 2 * u[i] ** 2 / dt
    return dt * rate


def input_cost(u: ca.SX, config: Config, dt: float) -> ca.SX:
    """The cost of jerk and steering rate over one step."""
    cost = config.cost
    return dt * (cost.jerk * u[Free.J] ** 2 + cost.steering_rate * u[Free.W] ** 2)


def stage_rows(x: ca.SX, u: ca.SX, par: ca.SX, config: Config) -> ca.SX:
    """(N_ROWS,) rows of a state k >= 1: acceleration limit, friction circle, lateral acceleration
    above and below, s above and below, half-plane, and of every point d below and above."""
    s, d, mu, v, delta, a = (x[i] for i in Stage)
    slack_s, slack_d, slack_a = (u[i] for i in (Free.SLACK_S, Free.SLACK_D, Free.SLACK_A))
    lat = v**2 / CAR.wheelbase * ca.tan(delta)
    s_c, d_c = s + CAR.rear_to_centre * ca.cos(mu), d + CAR.rear_to_centre * ca.sin(mu)
    rows = [
        a * ca.fmax(v, CAR.v_switch) / CAR.v_switch,
        (a**2 + lat**2) / CAR.a_max - slack_a,
        lat - slack_a,
        lat + slack_a,
        s - slack_s,
        s + slack_s,
        par[Given.SLANT_S] * s_c + par[Given.SLANT_D] * d_c - slack_s,
    ]
    for i, ahead in enumerate(BODY_POINTS):
        offset = body_offset(d, mu, par[Given.BEND], ahead) + par[point_at(i, Point.BIAS)]
        for edge, slope, sign in (
            (Point.LOW, Point.LOW_SLOPE, 1.0),
            (Point.HIGH, Point.HIGH_SLOPE, -1.0),
        ):
            line = par[point_at(i, edge)] + par[point_at(i, slope)] * (s - par[Given.AT])
            rows.append(offset - line + sign * slack_d)
    return ca.vertcat(*rows)


def goal_rows(x: ca.SX, slack: ca.SX, turn: ca.SX) -> ca.SX:
    """(8,) the last body's s, d, speed and heading: above, then below.

    Args:
        x: the last state.
        slack: of the goal.
        turn: heading and curvature of the path at an arc length near the last one.
    """
    values = ca.vertcat(
        x[Stage.S] + CAR.rear_to_centre * ca.cos(x[Stage.MU]),
        x[Stage.D] + CAR.rear_to_centre * ca.sin(x[Stage.MU]),
        x[Stage.V],
        turn[0] + turn[1] * (x[Stage.S] - turn[2]) + x[Stage.MU],
    )
    return ca.vertcat(values - slack, values + slack)


def body_offset(d: ca.SX, mu: ca.SX, bend: ca.SX, ahead: float) -> ca.SX:
    """Offset of a point of the body's axis from a path of constant curvature.

    With the axle at (0, d) and the path's centre of curvature at (0, 1 / kappa) it is 1 / kappa
    less the point's distance from that centre, here without the difference of large numbers.
    """
    along, across = ahead * ca.cos(mu), d + ahead * ca.sin(mu)
    far = ca.sqrt((bend * along) ** 2 + (1 - bend * across) ** 2)
    return (2 * across - bend * (along**2 + across**2)) / (1 + far)


def body_offset_at(d: Array, mu: Array, bend: Array, ahead: float) -> Array:
    """The same of arrays."""
    along, across = ahead * np.cos(mu), d + ahead * np.sin(mu)
    far = np.sqrt((bend * along) ** 2 + (1 - bend * across) ** 2)
    offset: Array = (2 * across - bend * (along**2 + across**2)) / (1 + far)
    return offset
