"""The kinematic single-track model along a reference path, discretised, with its derivatives.

State x = [s, d, mu, v, delta, a] (columns :class:`mpcplan.seed.seed.Stage`), input u = [j, w]: jerk
[m/s^3] and steering rate [rad/s]. Over one step the acceleration is constant,
a_k = a_{k-1} + j_k dt, and so is w_k: the inputs are exactly those that the KS model drives.

    s' = v cos mu / (1 - kappa(s) d),   d' = v sin mu,   mu' = v/l tan delta - kappa(s) s',
    v' = a,   delta' = w,               kappa(s) = kappa_0 + kappa_1 (s - s_0) within a step,

integrated by one classical Runge-Kutta step.
"""

import casadi as ca

from mpcplan.seed.seed import Stage
from mpcplan.vehicle import FORD_ESCORT as CAR

NX, NU = len(Stage), 2


def _rates(x: ca.SX, a: ca.SX, w: ca.SX, par: ca.SX) -> ca.SX:
    s, d, mu, v, delta = (x[i] for i in range(5))
    kappa = par[0] + par[1] * (s - par[2])
    s_rate = v * ca.cos(mu) / (1 - kappa * d)
    return ca.vertcat(
        s_rate, v * ca.sin(mu), v / CAR.wheelbase * ca.tan(delta) - kappa * s_rate, a, w
    )


def one_step(x: ca.SX, u: ca.SX, par: ca.SX, dt: float) -> ca.SX:
    """The state after one step, as an expression; ``par`` holds kappa_0, kappa_1, s_0."""
    a, w = x[Stage.A] + u[0] * dt, u[1]
    y = x[:5]
    k1 = _rates(y, a, w, par)
    k2 = _rates(y + dt / 2 * k1, a, w, par)
    k3 = _rates(y + dt / 2 * k2, a, w, par)
    k4 = _rates(y + dt * k3, a, w, par)
    return ca.vertcat(y + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4), a)
