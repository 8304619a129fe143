"""The fail-safe tail: braking to a standstill along the lane, from the end of a plan."""

import numpy as np

from mpcplan.road.road import Road
from mpcplan.seed.paths import frenet_pose
from mpcplan.seed.seed import Stage
from mpcplan.seed.track import frenet_inputs
from mpcplan.trajectory import Array, State, Trajectory
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import simulate

STANDSTILL = 0.2  # s, the tail goes on this long at rest
RETURN = 15.0  # m, over which the heading error is steered out,
MIN_RETURN = 2.0  # m, or over half of the braking way, but not less than this
MAX_STEPS = 150


def braking_tail(road: Road, state: Array, step: int, deceleration: float, dt: float) -> Trajectory:
    """Braking to rest from a rear-axle state at a constant deceleration, along the reference."""
    v = float(max(state[State.V], 0.0))
    count = min(int(np.ceil(v / (deceleration * dt))) + round(STANDSTILL / dt), MAX_STEPS)
    speeds = np.maximum(v - deceleration * dt * np.arange(count + 1), 0.0)
    pose = frenet_pose(road, state)
    way = np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) / 2 * dt)])
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
