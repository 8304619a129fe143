"""Where others see a vehicle's body that SUMO drives: without leaps.

Recorded bodies may be beside the middle of the lane and turned. SUMO would leave them beside it for
ever, would have them block the lane beside, and would turn them within one step. So SUMO has the
vehicle in the middle, and its body is shown beside it, from where it moves over gently. The same
serves where a vehicle leaps in SUMO, at kinks of the net and in lane changes within junctions.
"""

import math
from collections.abc import Sequence

from mpcplan.trajectory import Array

LEAP = 0.3  # m, by which a front may move farther than its speed takes it
TWIST = 0.15  # rad, by which a body may turn in a step
OVER = 0.15  # part of the way ahead by which a body may move over
OVER_TIME = 2.0  # s, time constant of moving over
TURNING = 0.5  # s, time constant of turning


class Shown:
    """One body: how far it is shown off where SUMO has it, and by how much turned."""

    def __init__(self) -> None:
        self._off_x = self._off_y = self._turn = 0.0
        self._last = (0.0, 0.0, 0.0)
        self._new = True  # at the first step SUMO turns from where it was put to its own heading

    def begin(self, off: Array, psi: float, front: Array, sumo_psi: float) -> None:
        """Starts with the front (2,) [m] and the heading [rad] of SUMO's vehicle, and the body's
        front off by (2,) [m] and its heading."""
        self._off_x, self._off_y = float(off[0]), float(off[1])
        self._last = float(front[0]), float(front[1]), sumo_psi
        self._turn = math.remainder(psi - sumo_psi, 2 * math.pi)

    def step(self, box: Sequence[float], dt: float) -> tuple[float, ...]:
        """(6,) box shown, given SUMO's, one time step [s] after the last."""
        x, y, psi, v, length, width = box
        front_x = x + length / 2 * math.cos(psi)
        front_y = y + length / 2 * math.sin(psi)
        self._take_up_leap(front_x, front_y, psi, v * dt)
        self._decay(v, dt)
        shown = math.remainder(psi + self._turn, 2 * math.pi)
        centre_x = front_x + self._off_x - length / 2 * math.cos(shown)
        centre_y = front_y + self._off_y - length / 2 * math.sin(shown)
        return centre_x, centre_y, shown, v, length, width

    def _take_up_leap(self, x: float, y: float, psi: float, way: float) -> None:
        """Adds to what is off what SUMO's vehicle did that its motion does not explain."""
        last_x, last_y, last_psi = self._last
        self._last = x, y, psi
        turned = math.remainder(psi - last_psi, 2 * math.pi)
        moved = math.hypot(x - last_x, y - last_y)
        if moved > way + LEAP:
            self._off_x -= (x - last_x) * (1 - way / moved)
            self._off_y -= (y - last_y) * (1 - way / moved)
        explained = 0.0 if self._new else math.copysign(min(abs(turned), TWIST), turned)
        self._turn = math.remainder(self._turn - (turned - explained), 2 * math.pi)
        self._new = False

    def _decay(self, v: float, dt: float) -> None:
        """Moves the body nearer to SUMO's vehicle, sideways no faster than vehicles can."""
        self._turn *= math.exp(-dt / TURNING)
        off = math.hypot(self._off_x, self._off_y)
        if off > 0:
            left = 1.0 - min(dt / OVER_TIME, OVER * v * dt / off)
            self._off_x, self._off_y = left * self._off_x, left * self._off_y
