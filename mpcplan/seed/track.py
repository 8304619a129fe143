"""Drives the kinematic single-track model along a Frenet trajectory.

A sampled candidate is a curve, not a motion of the KS model. This feedback turns it into one: the
speed follows the candidate's, and the steering aims at the curvature

    kappa = kappa_path - e_d / L^2 - 2 e_mu / L,      L = max(L_0, tau v),

(a critically damped return of the lateral error over the length L) within the actuators' limits.
The model is integrated in the Frenet frame beside, so that the errors need no projection.
"""

import math

import numpy as np

from mpcplan.road.frame import Frame
from mpcplan.seed.seed import Seed, Stage
from mpcplan.trajectory import Array, Input, State, Trajectory
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import simulate

RETURN_LENGTH = 4.0  # m
RETURN_TIME = 0.8  # s
ACTUATOR_SHARE = 0.985
STEERING_GRIP = 0.95  # part of the friction circle that steering may use
MIN_STRETCH = 0.1


def track(seed: Seed, state: Array, dt: float, steps: int | None = None) -> Trajectory:
    """The KS model driven along a seed from a rear-axle state, for its first ``steps`` steps."""
    steps = len(seed.states) - 1 if steps is None else min(steps, len(seed.states) - 1)
    inputs = frenet_inputs(seed.road.frame, seed.states[: steps + 1], state, dt)
    return simulate(state, inputs, dt, seed.first_step)


def frenet_states(frame: Frame, trajectory: Trajectory, acceleration: float) -> Array:
    """(n + 1, 6) Frenet states (columns :class:`Stage`) of a trajectory, exactly projected.

    ``acceleration`` [m/s^2] is the one of the step before the first state.
    """
    x = trajectory.states
    s, d = frame.to_frenet(x[:, [State.X, State.Y]])
    turn = x[:, State.PSI] - frame.heading(s)
    mu = (turn + np.pi) % (2 * np.pi) - np.pi
    a = np.concatenate([[acceleration], trajectory.inputs[:, Input.A]])
    return np.column_stack([s, d, mu, x[:, State.V], x[:, State.DELTA], a])


def frenet_inputs(frame: Frame, target: Array, state: Array, dt: float) -> Array:
    """(n, 2) inputs that track (n + 1, 6) Frenet states (columns :class:`Stage`)."""
    s0, d0, mu0 = (float(v) for v in target[0, [Stage.S, Stage.D, Stage.MU]])
    delta, v = float(state[2]), float(state[3])
    x: tuple[float, ...] = (s0, d0, mu0, v, delta)
    curvature = np.interp(target[:, Stage.S], frame.s, frame.kappa).tolist()
    rows = target.tolist()
    inputs = []
    for k in range(len(rows) - 1):
        a, w = _feedback(x, rows[k], rows[k + 1], dt)
        inputs.append((a, w))
        kappa = curvature[k] + (curvature[k + 1] - curvature[k]) / 2
        x = _frenet_step(x, a, w, kappa, dt)
    return np.array(inputs, float).reshape(-1, len(Input))


def _feedback(
    x: tuple[float, ...], now: list[float], after: list[float], dt: float
) -> tuple[float, float]:
    """Acceleration and steering rate towards the next target state."""
    _, d, mu, v, delta = x
    length = max(RETURN_LENGTH, RETURN_TIME * v)
    kappa = math.tan(after[Stage.DELTA]) / CAR.wheelbase
    kappa -= (d - now[Stage.D]) / length**2 + 2 * (mu - now[Stage.MU]) / length
    limit = CAR.v_delta_max * ACTUATOR_SHARE
    most = math.atan(CAR.wheelbase * STEERING_GRIP * CAR.a_max / max(v, 1.0) ** 2)
    most = min(most, CAR.delta_max * ACTUATOR_SHARE)
    aim = min(max(math.atan(CAR.wheelbase * kappa), -most), most)
    w = min(max((aim - delta) / dt, -limit), limit)
    top = CAR.a_max * ACTUATOR_SHARE * min(1.0, CAR.v_switch / max(v, after[Stage.V], 0.1))
    lateral = v * v / CAR.wheelbase * math.tan(max(abs(delta), abs(delta + w * dt)))
    grip = math.sqrt(max((CAR.a_max * ACTUATOR_SHARE) ** 2 - lateral * lateral, 0.0))
    a = (after[Stage.V] - v) / dt
    return max(min(a, top, grip), -grip, -v / dt), w


def _frenet_step(
    x: tuple[float, ...], a: float, w: float, kappa: float, dt: float
) -> tuple[float, ...]:
    """One midpoint step of the KS model in the Frenet frame (for the errors only)."""

    def rates(y: tuple[float, ...]) -> tuple[float, ...]:
        _, d, mu, v, delta = y
        s_rate = v * math.cos(mu) / max(1 - kappa * d, MIN_STRETCH)
        turn = v / CAR.wheelbase * math.tan(delta)
        return s_rate, v * math.sin(mu), turn - kappa * s_rate, a, w

    middle = tuple(value + dt / 2 * rate for value, rate in zip(x, rates(x), strict=True))
    return tuple(value + dt * rate for value, rate in zip(x, rates(middle), strict=True))
