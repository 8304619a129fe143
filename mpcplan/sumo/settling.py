"""How a vehicle gets from the state in which it was recorded to SUMO's way of driving.

Recorded vehicles may drive faster than allowed, and closer than SUMO's drivers would: left alone,
they brake as hard as they can at once. Here they slow down and fall back gently.
"""

import libsumo

from mpcplan.sumo.drivers import HEADWAY, Driver

SLOWING = 2.0  # m/s^2, by which who comes in above the speed limit slows down
FALLING_BACK = 0.05  # s/s, by which the headway grows
BACKING = 0.1  # m/s, by which the gap kept when standing grows
_SHORTEST = 0.2  # s, headway
_NEAREST = 0.1  # m, gap when standing
_LEADER = 100.0  # m, at which a leader matters


class Settling:
    """One vehicle's way there, from the step after it came in."""

    def __init__(self, name: str, driver: Driver) -> None:
        self._name, self._driver = name, driver
        self._begun = False
        self._headway, self._gap = HEADWAY, driver.gap_min
        self._fast = True

    def step(self, dt: float) -> None:
        """Before every step that SUMO drives it."""
        if not self._begun:
            self._begin()
        if self._fast:
            self._slow_down(dt)
        if self._headway < HEADWAY or self._gap < self._driver.gap_min:
            self._fall_back(dt)

    def _begin(self) -> None:
        """Takes the gap to the leader as it is, if the vehicle could keep it."""
        self._begun = True
        leader = libsumo.vehicle.getLeader(self._name, _LEADER)
        if not leader or not leader[0]:
            return
        gap = leader[1] + self._driver.gap_min
        self._gap = min(max(gap - _NEAREST, _NEAREST), self._driver.gap_min)
        v, v_leader = (libsumo.vehicle.getSpeed(name) for name in (self._name, leader[0]))
        b = self._driver.decel
        # Krauss' safe speed solved for the headway at which it is the present speed
        longest = (v_leader**2 - v**2 + 2 * b * (gap - self._gap)) / (2 * b * max(v, _NEAREST))
        self._headway = min(max(longest, _SHORTEST), HEADWAY)
        self._fall_back(0.0)

    def _slow_down(self, dt: float) -> None:
        limit = libsumo.lane.getMaxSpeed(libsumo.vehicle.getLaneID(self._name))
        factor = (libsumo.vehicle.getSpeed(self._name) - SLOWING * dt) / limit
        self._fast = factor > 1
        libsumo.vehicle.setSpeedFactor(self._name, max(factor, 1.0))

    def _fall_back(self, dt: float) -> None:
        self._headway = min(self._headway + FALLING_BACK * dt, HEADWAY)
        self._gap = min(self._gap + BACKING * dt, self._driver.gap_min)
        libsumo.vehicle.setTau(self._name, self._headway)
        libsumo.vehicle.setMinGap(self._name, self._gap)
