"""The kinematic single-track model along a reference path, discretised, with its derivatives.

State x = [s, d, mu, v, delta, a] (columns :class:`mpcplan.seed.seed.Stage`), input u = [j, w]: jerk
[m/s^3] and steering rate [rad/s]. Over one step the acceleration is constant,
a_k = a_{k-1} + j_k dt, and so is w_k: the inputs are exactly those that the KS model drives.

    s' = v cos mu / (1 - kappa(s) d),   d' = v sin mu,   mu' = v/l tan delta - kappa(s) s',
    v' = a,   delta' = w,               kappa(s) = kappa_0 + kappa_1 (s - s_0) within a step,

integrated by one classical Runge-Kutta step. Derivatives by CasADi's algorithmic differentiation.
"""

from functools import lru_cache

import casadi as ca
import numpy as np

from mpcplan.seed.seed import Stage
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

NX, NU, NPAR = len(Stage), 2, 3


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


@lru_cache(maxsize=4)
def _functions(dt: float) -> tuple[ca.Function, ca.Function]:
    """The step, and the step with its Jacobians, for one stage."""
    x, u, par = ca.SX.sym("x", NX), ca.SX.sym("u", NU), ca.SX.sym("par", NPAR)
    after = one_step(x, u, par, dt)
    step = ca.Function("step", [x, u, par], [after])
    jacobian = ca.jacobian(after, ca.vertcat(x, u))
    return step, ca.Function("linear", [x, u, par], [after, ca.densify(jacobian)])


@lru_cache(maxsize=512)
def _mapped(dt: float, n: int, linear: bool) -> ca.Function:
    return _functions(dt)[int(linear)].map(n)


def propagate(x: Array, u: Array, par: Array, dt: float) -> Array:
    """(n, 6) states after one step from (n, 6) states with (n, 2) inputs and (n, 3) curvatures.

    ``par`` holds kappa_0 [1/m], kappa_1 [1/m^2] and s_0 [m] of every step.
    """
    return np.asarray(_mapped(dt, len(u), False)(x.T, u.T, par.T)).T


def linearise(x: Array, u: Array, par: Array, dt: float) -> tuple[Array, Array]:
    """States after one step, (n, 6), and their Jacobians (n, 6, 8) with respect to (x, u)."""
    n = len(u)
    after, jacobian = _mapped(dt, n, True)(x.T, u.T, par.T)
    blocks = np.asarray(jacobian).reshape(NX, n, NX + NU)
    return np.asarray(after).T, blocks.transpose(1, 0, 2)
