"""Quartic and quintic polynomials with given boundary values, all at once as arrays.

p(t) = sum_i c_i t^i. The quintic meets position, velocity and acceleration at both ends and is the
jerk-optimal connection (Takahashi et al. 1989; Werling et al. 2010, eq. 2); the quartic leaves the
end position free.
"""

import numpy as np

from mpcplan.trajectory import Array

Value = Array | float


def quintic(x0: Value, v0: Value, a0: Value, x1: Value, v1: Value, a1: Value, t1: Value) -> Array:
    """(..., 6) coefficients with p(0), p'(0), p''(0) and p(t1), p'(t1), p''(t1) as given."""
    x0, v0, a0, x1, v1, a1, t1 = np.broadcast_arrays(x0, v0, a0, x1, v1, a1, t1)
    dx = x1 - (x0 + v0 * t1 + a0 * t1**2 / 2)
    dv = v1 - (v0 + a0 * t1)
    da = a1 - a0
    c3 = (10 * dx - 4 * dv * t1 + da * t1**2 / 2) / t1**3
    c4 = (-15 * dx + 7 * dv * t1 - da * t1**2) / t1**4
    c5 = (6 * dx - 3 * dv * t1 + da * t1**2 / 2) / t1**5
    return np.stack([x0, v0, a0 / 2, c3, c4, c5], axis=-1)


def quartic(x0: Value, v0: Value, a0: Value, v1: Value, a1: Value, t1: Value) -> Array:
    """(..., 6) coefficients (the last 0) with p(0), p'(0), p''(0), p'(t1), p''(t1) as given."""
    x0, v0, a0, v1, a1, t1 = np.broadcast_arrays(x0, v0, a0, v1, a1, t1)
    dv = v1 - (v0 + a0 * t1)
    da = a1 - a0
    c3 = (3 * dv - da * t1) / (3 * t1**2)
    c4 = (da * t1 - 2 * dv) / (4 * t1**3)
    return np.stack([x0, v0, a0 / 2, c3, c4, np.zeros_like(c4)], axis=-1)


def evaluate(c: Array, t: Array) -> tuple[Array, Array, Array]:
    """p, p', p'' of polynomials (..., 6) at times (..., k) that broadcast with (..., 1)."""
    c = c[..., None, :]
    p = c[..., 0] + t * (
        c[..., 1] + t * (c[..., 2] + t * (c[..., 3] + t * (c[..., 4] + t * c[..., 5])))
    )
    v = c[..., 1] + t * (
        2 * c[..., 2] + t * (3 * c[..., 3] + t * (4 * c[..., 4] + t * 5 * c[..., 5]))
    )
    a = 2 * c[..., 2] + t * (6 * c[..., 3] + t * (12 * c[..., 4] + t * 20 * c[..., 5]))
    return p, v, a
