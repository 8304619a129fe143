"""The kinematic single-track model (KS) of a Ford Escort, CommonRoad vehicle type 1.

State x = [x, y, delta, v, psi] at the rear axle, input u = [a, v_delta], constant over a step:

    x' = v cos psi,  y' = v sin psi,  delta' = v_delta,  v' = a,  psi' = v / l tan delta

under |delta| <= 0.91 rad, |v_delta| <= 0.4 rad/s, 0 <= v <= 45.8 m/s,
-11.5 <= a <= 11.5 min(1, 4.755 / v) m/s^2 and the friction circle a^2 + (v psi')^2 <= 11.5^2.
Source: Althoff, Koschi, Manzinger: CommonRoad (IV 2017), vehicle models 3.0.2, section KS.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mpcplan.trajectory import Array, Input, State, Trajectory


@dataclass(frozen=True)
class Vehicle:
    """Dimensions [m] and limits of the vehicle; the defaults are CommonRoad's type 1."""

    length: float = 4.298
    width: float = 1.674
    wheelbase: float = 2.39268  # l = a + b
    rear_to_centre: float = 1.50876  # b: the rectangle's centre lies b ahead of the rear axle
    delta_max: float = 0.91  # rad
    v_delta_max: float = 0.4  # rad/s
    a_max: float = 11.5  # m/s^2
    v_switch: float = 4.755  # m/s, above it the engine's power limits the acceleration
    v_max: float = 45.8  # m/s

    @property
    def front(self) -> float:
        """Distance from the rear axle to the front bumper [m]."""
        return self.rear_to_centre + self.length / 2

    @property
    def rear(self) -> float:
        """Distance from the rear axle to the rear bumper [m], positive."""
        return self.length / 2 - self.rear_to_centre


FORD_ESCORT = Vehicle()


def acceleration_limit(v: Array | float, vehicle: Vehicle = FORD_ESCORT) -> Array:
    """Upper bound of the acceleration [m/s^2] at speed v [m/s]: a_max min(1, v_switch / v)."""
    fast: Array = np.maximum(np.asarray(v, dtype=float), vehicle.v_switch)
    return vehicle.a_max * vehicle.v_switch / fast


def step(
    x: Sequence[float], a: float, v_delta: float, dt: float, l: float = FORD_ESCORT.wheelbase
) -> tuple[float, float, float, float, float]:
    """One step of the KS model with constant inputs.

    v and delta are integrated exactly; psi, x, y by two classical Runge-Kutta steps of half the
    length, which agrees with the checker's integrator to 1e-5 m (tested).

    Args:
        x: [x, y, delta, v, psi] at the rear axle.
        a: acceleration [m/s^2].
        v_delta: steering rate [rad/s].
        dt: duration [s].
        l: wheelbase [m].

    Returns:
        The state after dt.
    """
    return _runge_kutta(_runge_kutta(x, a, v_delta, dt / 2, l), a, v_delta, dt / 2, l)


def _runge_kutta(
    x: Sequence[float], a: float, v_delta: float, dt: float, l: float
) -> tuple[float, float, float, float, float]:
    """One classical Runge-Kutta step of the KS model."""
    px, py, delta, v, psi = x
    v_half, v_end = v + a * dt / 2, v + a * dt
    d_half, d_end = delta + v_delta * dt / 2, delta + v_delta * dt
    w1 = v / l * math.tan(delta)
    w2 = v_half / l * math.tan(d_half)
    w4 = v_end / l * math.tan(d_end)
    # psi' does not depend on psi: the scheme's second and third stage share w2
    p2, p3, p4 = psi + w1 * dt / 2, psi + w2 * dt / 2, psi + w2 * dt
    middle_x, middle_y = math.cos(p2) + math.cos(p3), math.sin(p2) + math.sin(p3)
    px += dt / 6 * (v * math.cos(psi) + 2 * v_half * middle_x + v_end * math.cos(p4))
    py += dt / 6 * (v * math.sin(psi) + 2 * v_half * middle_y + v_end * math.sin(p4))
    return px, py, d_end, v_end, psi + dt / 6 * (w1 + 4 * w2 + w4)


def simulate(
    x0: Sequence[float] | Array, inputs: Array, dt: float, first_step: int = 0
) -> Trajectory:
    """The KS model driven from x0 by (n, 2) inputs (columns :class:`Input`)."""
    states = np.empty((len(inputs) + 1, len(State)))
    states[0] = x0
    x = tuple(float(value) for value in x0)
    for k, (a, v_delta) in enumerate(inputs.tolist()):
        x = step(x, a, v_delta, dt)
        states[k + 1] = x
    return Trajectory(first_step, states, np.asarray(inputs, dtype=float), dt)


def rectangles(states: Array, vehicle: Vehicle = FORD_ESCORT, margin: float = 0.0) -> Array:
    """(n, 4, 2) corners [m] of the body at (n, 5) states, grown by ``margin`` on every side."""
    forward, back = vehicle.front + margin, -vehicle.rear - margin
    half = vehicle.width / 2 + margin
    body = np.array([[back, -half], [forward, -half], [forward, half], [back, half]])
    c, s = np.cos(states[:, State.PSI]), np.sin(states[:, State.PSI])
    x = states[:, State.X, None] + c[:, None] * body[:, 0] - s[:, None] * body[:, 1]
    y = states[:, State.Y, None] + s[:, None] * body[:, 0] + c[:, None] * body[:, 1]
    return np.stack([x, y], axis=-1)


def centres(states: Array, vehicle: Vehicle = FORD_ESCORT) -> Array:
    """(n, 2) centres [m] of the body at (n, 5) rear-axle states."""
    psi = states[:, State.PSI]
    heading = np.column_stack([np.cos(psi), np.sin(psi)])
    return states[:, [State.X, State.Y]] + vehicle.rear_to_centre * heading


def input_violations(trajectory: Trajectory, vehicle: Vehicle = FORD_ESCORT) -> dict[str, Array]:
    """Signed excess over every limit of the model, per step; a value <= 0 is within the limit.

    Keys: ``acceleration``, ``braking``, ``friction`` [m/s^2], ``steering_rate`` [rad/s],
    ``steering_angle`` [rad], ``speed`` [m/s]. The acceleration limit is taken at the higher speed
    of the step's two ends and the friction circle at both, so that it holds within the step.
    """
    x, u = trajectory.states, trajectory.inputs
    v, delta, a = x[:, State.V], x[:, State.DELTA], u[:, Input.A]
    lateral = v**2 / vehicle.wheelbase * np.tan(delta)
    lateral = np.maximum(np.abs(lateral[:-1]), np.abs(lateral[1:]))
    return {
        "acceleration": a - acceleration_limit(np.maximum(v[:-1], v[1:]), vehicle),
        "braking": -a - vehicle.a_max,
        "friction": np.hypot(a, lateral) - vehicle.a_max,
        "steering_rate": np.abs(u[:, Input.V_DELTA]) - vehicle.v_delta_max,
        "steering_angle": np.abs(delta) - vehicle.delta_max,
        "speed": np.maximum(-v, v - vehicle.v_max),
    }
