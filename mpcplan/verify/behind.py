"""Who follows the vehicle at the moment at which a plan would be broken off.

A fail-safe tail brakes hard, and a forecast that was made with one motion of the ego vehicle lets
those behind it drive on into it. Who is behind in the vehicle's own way by then, no nearer than the
safe distance, is expected to brake as hard after its reaction time delta:

    gap >= v_f delta + (v_f^2 - v^2) / (2 b),

the safe distance of rule R_G1 (:mod:`mpcplan.rules`) with the same deceleration of both.
"""

import numpy as np

from mpcplan.observation import Box, Forecast
from mpcplan.rules.predicates import safe_distance
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import centres

ALIGNED = 0.5  # rad, within which a vehicle drives the same way


def follows(state: Array, step: int, forecast: Forecast, braking: float, reaction: float) -> Array:
    """(o,) who follows the vehicle at a time step at the safe distance.

    Args:
        state: (5,) of the vehicle then, columns :class:`State`.
        step: the time step.
        forecast: of the others.
        braking: deceleration b of the vehicle and of them [m/s^2].
        reaction: delta [s].
    """
    boxes = forecast.at(np.array([step]))[:, 0]
    psi = float(state[State.PSI])
    to = boxes[:, [Box.X, Box.Y]] - centres(state[None])[0]
    along = to @ np.array([np.cos(psi), np.sin(psi)])
    across = np.abs(to @ np.array([-np.sin(psi), np.cos(psi)]))
    turn = np.abs((boxes[:, Box.PSI] - psi + np.pi) % (2 * np.pi) - np.pi)
    gap = -along - (CAR.length + boxes[:, Box.LENGTH]) / 2
    v, v_f = float(state[State.V]), boxes[:, Box.V]
    safe = safe_distance(v_f, v, braking, braking, reaction)
    found: Array = (turn < ALIGNED) & (across < (CAR.width + boxes[:, Box.WIDTH]) / 2)
    return found & (gap > 0) & (gap >= safe)  # False where there is no box
