"""How far one has to go to have all crossings behind: those of others who will enter the path.

Guesses of the others' motion are worth less the further ahead they lie. Whoever has to pass where
others are about to cross had better do so soon: each second until then costs ``cost.haste``.
"""

import numpy as np

from mpcplan.predict.occupancy import Occupancy
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

ASLANT = 0.3  # rad, who enters the path at a larger angle crosses it, or turns into it


def last_crossing(
    occupancy: Occupancy, step: int, s: float, path: tuple[Array, Array] | None = None
) -> float:
    """Arc length [m] at which the rear axle has the last crossing behind; -inf where none is ahead.

    Args:
        occupancy: the others along the reference.
        step: present time step.
        s: present arc length of the rear axle [m].
        path: arc lengths and offsets of the path [m]; None: the reference.
    """
    window = occupancy
    if step != occupancy.first_step:  # else all of it is to come, and nothing need be copied
        left = occupancy.s.shape[1] - step + occupancy.first_step
        window = occupancy.window(step, max(left, 1))
    half = CAR.width / 2
    d = 0.0 if path is None else np.interp(window.s, *path)
    with np.errstate(invalid="ignore"):
        on_path = (window.d_low < d + half) & (window.d_high > d - half)
        slanted = on_path & (np.abs(np.sin(window.turn)) > np.sin(ASLANT))
        slanted &= window.s_low > s + CAR.front
    enters = ~on_path[:, 0] & slanted.any(axis=1)
    reach = np.where(slanted[enters], window.s_high[enters], -np.inf)
    return float(reach.max(initial=-np.inf)) + CAR.rear
