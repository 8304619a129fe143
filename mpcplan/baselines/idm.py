"""A naive driver: the intelligent driver model for speed, pure pursuit for steering.

With speed v, desired speed v0, and a leader at gap g that is approached at dv,

    a = a_max (1 - (v / v0)^4 - (g* / g)^2),      g* = g0 + max(0, v T + v dv / (2 sqrt(a_max b))).

v0 is the least of the signs' limit, of the speed that the driver likes, and of what bends ahead
allow: at the distance w before a bend that allows u, sqrt(u^2 + 2 b_bend w). The leader is the
nearest box ahead in the corridor between the vehicle and its path; it is taken to hold its speed.
There is no thought of the goal's time, of crossing traffic, or of who is on the lane beside.

Sources: Treiber, Hennecke, Helbing: Congested traffic states in empirical observations and
microscopic simulations, Phys. Rev. E 62, 2000; pure pursuit: :mod:`mpcplan.baselines.pursuit`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mpcplan.baselines.pursuit import steering_rate, within_limits
from mpcplan.config import Config
from mpcplan.observation import Box, Observation, box_outline
from mpcplan.road.road import Road, build_roads
from mpcplan.task import Task
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import step

STEPS = 30  # time steps planned
TOUCHING = 0.1  # m, the least gap that the formula is asked with
EXPONENT = 4  # of v / v0
STRAIGHT = 1e-6  # 1/m, the least curvature that counts
CRAWL = 0.5  # m/s, the least desired speed, so that v / v0 is finite


@dataclass(frozen=True)
class IdmParameters:
    """The driver; defaults after Treiber, Hennecke and Helbing (2000) for cars in towns.

    Attributes:
        a_max: largest acceleration [m/s^2].
        b: comfortable deceleration [m/s^2].
        headway: T, time gap behind a leader [s].
        gap: g0, gap at rest [m].
        speed: desired speed where signs allow it [m/s]; the speed at the start, if that is higher.
        lateral: lateral acceleration in bends [m/s^2].
        b_bend: deceleration towards bends [m/s^2].
        side: room left and right of the body that belongs to the corridor [m].
        hard: largest deceleration [m/s^2].
    """

    a_max: float = 1.5
    b: float = 2.0
    headway: float = 1.5
    gap: float = 2.0
    speed: float = 50 / 3.6
    lateral: float = 2.5
    b_bend: float = 1.0
    side: float = 0.3
    hard: float = 9.0


class Leader(NamedTuple):
    """The vehicle ahead: arc length of its rear end [m] and speed along the path [m/s]."""

    s: float
    v: float


class IdmPurePursuit:
    """Follows the route's reference path and whoever is ahead on it."""

    parameters = IdmParameters()

    def __init__(self, task: Task, config: Config) -> None:
        """Finds the road to the goal; raises RoadError where there is none."""
        goal = task.problem.planning_problem
        self._road = build_roads(task.road_map, goal, config.road)[0]
        self._dt = task.dt
        start = float(task.problem.start[State.V])
        self._speeds = desired_speeds(self._road, start, self.parameters)

    def plan(self, observation: Observation) -> Array:
        """(STEPS + 1, 5) states behind the leader of this moment."""
        leader = leader_of(observation, self._road, self.parameters.side)
        states = [observation.state.tolist()]
        for k in range(STEPS):
            states.append(self._next(states[-1], leader, k * self._dt))
        return np.array(states)

    def _next(self, x: Sequence[float], leader: Leader | None, t: float) -> Sequence[float]:
        """The state after one more time step, ``t`` seconds after the observation."""
        s = float(self._road.frame.to_frenet(np.array([x[State.X], x[State.Y]]))[0])
        v = x[State.V]
        v0 = float(np.interp(s, self._road.frame.s, self._speeds))
        gap, closing = math.inf, 0.0
        if leader is not None:
            gap, closing = leader.s + leader.v * t - s - CAR.front, v - leader.v
        wanted = idm_acceleration(v, v0, gap, closing, self.parameters)
        v_delta = steering_rate(self._road.frame, x, self._dt)
        a = within_limits(wanted, v_delta, x, self._dt)
        return step(x, a, v_delta, self._dt)


def idm_acceleration(
    v: float, v0: float, gap: float, closing: float, parameters: IdmParameters
) -> float:
    """The model's acceleration [m/s^2], at least ``-parameters.hard``.

    Args:
        v: speed [m/s].
        v0: desired speed [m/s].
        gap: to the leader's rear end [m]; infinite: there is none.
        closing: speed at which the leader is approached [m/s].
        parameters: the driver.
    """
    p = parameters
    wished = p.gap + max(0.0, v * p.headway + v * closing / (2 * math.sqrt(p.a_max * p.b)))
    free, near = (v / v0) ** EXPONENT, (wished / max(gap, TOUCHING)) ** 2
    return max(p.a_max * (1 - free - near), -p.hard)


def desired_speeds(road: Road, start: float, parameters: IdmParameters) -> Array:
    """(n,) desired speeds [m/s] at the samples of the road's path, bends ahead included.

    ``start`` is the speed at the beginning [m/s].
    """
    p, frame = parameters, road.frame
    bends = np.sqrt(p.lateral / np.maximum(np.abs(frame.kappa), STRAIGHT))
    local = np.minimum(np.minimum(road.limits.posted, max(p.speed, start)), bends)
    # v^2 falls by 2 b per metre at most: the least over all places ahead of u^2 + 2 b w
    energy = np.maximum(local, CRAWL) ** 2 + 2 * p.b_bend * frame.s
    return np.sqrt(np.minimum.accumulate(energy[::-1])[::-1] - 2 * p.b_bend * frame.s)


def leader_of(observation: Observation, road: Road, side: float) -> Leader | None:
    """The nearest box ahead in the corridor between the vehicle and its path, or None.

    ``side`` is the room [m] left and right of the body that belongs to the corridor.
    """
    boxes, frame = observation.now.boxes, road.frame
    if len(boxes) == 0:
        return None
    s_own, d_own = (float(v) for v in frame.to_frenet(observation.state[[State.X, State.Y]]))
    reach = CAR.width / 2 + side
    s, d = frame.to_frenet(box_outline(boxes))
    inside = (d.max(axis=1) > min(d_own, 0.0) - reach) & (d.min(axis=1) < max(d_own, 0.0) + reach)
    middle, _ = frame.to_frenet(boxes[:, [Box.X, Box.Y]])
    inside &= middle > s_own + CAR.rear_to_centre
    if not inside.any():
        return None
    rear = np.where(inside, s.min(axis=1), np.inf)
    nearest = int(np.argmin(rear))
    turn = boxes[nearest, Box.PSI] - float(frame.heading(middle[nearest]))
    return Leader(float(rear[nearest]), float(boxes[nearest, Box.V] * np.cos(turn)))
