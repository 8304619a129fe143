"""Steering along a path by pure pursuit, and inputs cut to what the vehicle can do.

The rear axle is led on a circle through a point of the path that lies a distance L ahead. With
alpha the angle between the heading and the way to that point,

    kappa = 2 sin(alpha) / L,      delta = arctan(l kappa).

Source: Coulter: Implementation of the pure pursuit path tracking algorithm, CMU-RI-TR-92-01, 1992.
"""

import math
from collections.abc import Sequence

import numpy as np

from mpcplan.road.frame import Frame
from mpcplan.trajectory import State
from mpcplan.vehicle import FORD_ESCORT as CAR

LOOKAHEAD_MIN = 6.0  # m, L at low speed
LOOKAHEAD_TIME = 0.9  # s, L grows by this times the speed
LAG = 0.3  # s, in which the steering angle is to come to the one asked for
SHARE = 0.97  # of the friction circle and the actuators that is used
STEERING_SHARE = 0.9  # of the friction circle that steering may use
SLOW = 1.0  # m/s, below it tyres set no bound on the steering angle


def steering_rate(path: Frame, state: Sequence[float], dt: float) -> float:
    """Steering rate [rad/s] that leads a rear-axle state along a path, within the limits.

    Args:
        path: the path to be driven by the rear axle.
        state: entries :class:`mpcplan.trajectory.State`.
        dt: time step [s].
    """
    return _towards(_steering_angle(path, state), state, dt)


def _steering_angle(path: Frame, state: Sequence[float]) -> float:
    """The steering angle [rad] of the circle to the point ahead on the path."""
    here = np.array([state[State.X], state[State.Y]])
    ahead = max(LOOKAHEAD_MIN, LOOKAHEAD_TIME * state[State.V])
    s, _ = path.to_frenet(here)
    x, y = (path.to_cartesian(s + ahead, np.zeros(())) - here).tolist()
    alpha = math.atan2(y, x) - state[State.PSI]
    return math.atan(CAR.wheelbase * 2 * math.sin(alpha) / math.hypot(x, y))


def _towards(angle: float, state: Sequence[float], dt: float) -> float:
    """Steering rate [rad/s] towards a steering angle that the tyres can bear at this speed."""
    v, delta = state[State.V], state[State.DELTA]
    most = math.atan(CAR.wheelbase * STEERING_SHARE * CAR.a_max / max(v, SLOW) ** 2)
    most = min(most, SHARE * CAR.delta_max)
    aim = min(max(angle, -most), most)
    rate = (aim - delta) / max(LAG, dt)
    return min(max(rate, -SHARE * CAR.v_delta_max), SHARE * CAR.v_delta_max)


def within_limits(a: float, v_delta: float, state: Sequence[float], dt: float) -> float:
    """The acceleration [m/s^2] cut to engine, brakes and friction circle; never into reverse.

    Args:
        a: the acceleration asked for [m/s^2].
        v_delta: steering rate of the same step [rad/s].
        state: entries :class:`mpcplan.trajectory.State`.
        dt: time step [s].
    """
    v, delta = state[State.V], state[State.DELTA]
    fast = max(v, v + a * dt)
    lateral = fast**2 / CAR.wheelbase * math.tan(max(abs(delta), abs(delta + v_delta * dt)))
    grip = math.sqrt(max((SHARE * CAR.a_max) ** 2 - lateral**2, 0.0))
    engine = SHARE * CAR.a_max * min(1.0, CAR.v_switch / max(fast, CAR.v_switch))
    top = min(engine, grip, (CAR.v_max - v) / dt)
    return max(min(a, top), -grip, -v / dt)
