"""The fail-safe tail: braking to a standstill, along the lane from the end of a plan, or along
the plan's own path from a state within it."""

import numpy as np

from mpcplan.road.road import Road
from mpcplan.seed.paths import frenet_pose
from mpcplan.seed.seed import Stage
from mpcplan.seed.track import frenet_inputs, frenet_states
from mpcplan.trajectory import Array, State, Trajectory
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import simulate

STANDSTILL = 0.2  # s, the tail goes on this long at rest
RETURN = 15.0  # m, over which the heading error is steered out,
MIN_RETURN = 2.0  # m, or over half of the braking way, but not less than this
MAX_STEPS = 150


def braking_tail(road: Road, state: Array, step: int, deceleration: float, dt: float) -> Trajectory:
    """Braking to rest from a rear-axle state at a constant deceleration, along the reference."""
    speeds, way = _braking(float(state[State.V]), deceleration, dt)
    count = len(speeds) - 1
    pose = frenet_pose(road, state)
    fade = np.maximum(1.0 - way / max(min(RETURN, way[-1] / 2), MIN_RETURN), 0.0) ** 2
    target = np.zeros((count + 1, len(Stage)))
    target[:, Stage.S] = pose.s + way
    target[:, Stage.D] = pose.d + np.concatenate(
        [[0.0], np.cumsum(np.diff(way) * np.sin(pose.mu * (fade[1:] + fade[:-1]) / 2))]
    )
    target[:, Stage.MU] = pose.mu * fade
    target[:, Stage.V] = speeds
    kappa = road.frame.curvature(target[:, Stage.S])
    target[:, Stage.DELTA] = np.arctan(
        CAR.wheelbase * kappa / np.maximum(1.0 - kappa * target[:, Stage.D], 0.2)
    )
    inputs = frenet_inputs(road.frame, target, state, dt)
    return simulate(state, inputs, dt, step)


def braking_along(
    road: Road, plan: Trajectory, step: int, deceleration: float, dt: float
) -> Trajectory | None:
    """Braking to rest at a constant deceleration along the path of a plan, from a time step on.

    None where the plan ends before the standstill.
    """
    onward = plan.since(step)
    speeds, way = _braking(float(onward.states[0, State.V]), deceleration, dt)
    planned = onward.states[:, State.V]
    arc = np.concatenate([[0.0], np.cumsum((planned[1:] + planned[:-1]) / 2 * dt)])
    if arc[-1] < way[-1]:
        return None
    path = frenet_states(road.frame, onward, 0.0)
    target = np.column_stack([np.interp(way, arc, column) for column in path.T])
    target[:, Stage.V] = speeds
    inputs = frenet_inputs(road.frame, target, onward.states[0], dt)
    return simulate(onward.states[0], inputs, dt, step)


def _braking(v: float, deceleration: float, dt: float) -> tuple[Array, Array]:
    """Speeds [m/s] and way [m] at every time step of a stop, and of a short stand."""
    v = max(v, 0.0)
    count = min(int(np.ceil(v / (deceleration * dt))) + round(STANDSTILL / dt), MAX_STEPS)
    speeds = np.maximum(v - deceleration * dt * np.arange(count + 1), 0.0)
    return speeds, np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) / 2 * dt)])
