"""What a planner that is not ours answers, checked and turned into what the vehicle drives.

The states are (n, 5) and finite, the first one is the present state, and each next one is where
the KS model is after dt with the inputs

    a = (v_k+1 - v_k) / dt,      v_delta = (delta_k+1 - delta_k) / dt,

all within the vehicle's limits. The vehicle drives the model's own answer to these inputs, so that
no gap of the check enters a result.
"""

from typing import Any

import numpy as np

from mpcplan.errors import PlannerError
from mpcplan.observation import Observation
from mpcplan.trajectory import Array, State, Trajectory
from mpcplan.vehicle import input_violations, simulate, step

SAME_STATE = 1e-4  # m, rad, m/s: the first row is the present state to this
TOLERANCES = {State.X: 0.01, State.Y: 0.01, State.PSI: 0.015}  # m, rad: half the checker's
LIMIT_SLACK = 2e-3  # m/s^2, rad/s, rad, m/s over a limit: what SAME_STATE may do to the inputs
COLUMNS = ", ".join(column.name.lower() for column in State)
UNITS = {
    "acceleration": "m/s^2", "braking": "m/s^2", "friction": "m/s^2", "steering_rate": "rad/s",
    "steering_angle": "rad", "speed": "m/s",
}  # fmt: skip


def as_states(answer: Any) -> Array:
    """(n, 5) states, n > 0; raises PlannerError for anything else."""
    try:
        states = np.array(answer, dtype=float)
    except (TypeError, ValueError) as error:
        raise PlannerError(
            f"plan() returned a {type(answer).__name__} that is no array of numbers; expected "
            f"(n, {len(State)}) states: {COLUMNS}"
        ) from error
    if states.ndim != 2 or states.shape[1] != len(State) or len(states) == 0:
        raise PlannerError(
            f"plan() returned a {type(answer).__name__} of shape {states.shape}; expected "
            f"(n, {len(State)}) states: {COLUMNS}"
        )
    return states


def as_driven(states: Array, observation: Observation, dt: float) -> Trajectory:
    """What the KS model drives with the inputs that states ask for.

    Args:
        states: (n, 5) columns :class:`State`, the first one at the observation's time step.
        observation: the present.
        dt: time step [s].

    Raises:
        PlannerError: not finite, not from the present state on, over a limit, or not where the
            model would be; with time step and quantity.
    """
    first = observation.step
    bad = np.argwhere(~np.isfinite(states))
    if len(bad):
        k, column = bad[0].tolist()
        raise PlannerError(f"{_name(column)} is {states[k, column]} at step {first + k}")
    _check_first(states[0], observation.state)
    if len(states) == 1 and observation.state[State.V] > SAME_STATE:
        raise PlannerError(
            f"only the present state was returned, at {observation.state[State.V]:.3g} m/s; "
            "expected at least two states unless the vehicle stands"
        )
    states = np.vstack([observation.state, states[1:]])
    inputs = np.diff(states[:, [State.V, State.DELTA]], axis=0) / dt
    _check_limits(Trajectory(first, states, inputs, dt))
    _check_steps(states, inputs, dt, first)
    return simulate(observation.state, inputs, dt, first)


def _check_first(given: Array, present: Array) -> None:
    """The first row is the present state (headings modulo a full turn)."""
    off = np.abs(_differences(given, present))
    if off.max() > SAME_STATE:
        column = int(off.argmax())
        raise PlannerError(
            f"the first state must be the present one, observation.state; "
            f"{_name(column)} is {off[column]:.3g} off"
        )


def _check_limits(trajectory: Trajectory) -> None:
    """Inputs and states are within the vehicle's limits; otherwise the first step is told."""
    over = [
        (int(np.argmax(excess > LIMIT_SLACK)), name, excess)
        for name, excess in input_violations(trajectory).items()
        if excess.max(initial=-1.0) > LIMIT_SLACK
    ]
    if over:
        k, name, excess = min(over, key=lambda o: o[0])
        raise PlannerError(
            f"{name.replace('_', ' ')} {excess[k]:.3g} {UNITS[name]} over the limit at step "
            f"{trajectory.first_step + k}"
        )


def _check_steps(states: Array, inputs: Array, dt: float, first: int) -> None:
    """Every state is where the KS model is one step after the state before it."""
    pairs = zip(states[:-1].tolist(), inputs.tolist(), strict=True)
    model = [step(x, a, v_delta, dt) for x, (a, v_delta) in pairs]
    off = np.abs(_differences(states[1:], np.array(model).reshape(-1, len(State))))
    columns = list(TOLERANCES)
    share = off[:, columns] / list(TOLERANCES.values())
    if share.max(initial=0.0) > 1.0:
        k = int(np.argmax(share.max(axis=1) > 1.0))
        column = columns[int(share[k].argmax())]
        unit = "rad" if column == State.PSI else "m"
        raise PlannerError(
            f"{_name(column)} at step {first + k + 1} is {off[k, column]:.3g} {unit} from where "
            f"the kinematic single-track model is after step {first + k} "
            f"(tolerance {TOLERANCES[column]} {unit})"
        )


def _differences(states: Array, others: Array) -> Array:
    """Differences of states, those of headings between -pi and pi."""
    off = states - others
    off[..., State.PSI] = (off[..., State.PSI] + np.pi) % (2 * np.pi) - np.pi
    return off


def _name(column: int) -> str:
    return State(column).name.lower()
