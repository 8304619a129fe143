"""Speeds along the ways ahead: car following by Krauss' model, all vehicles at once.

In every step of duration h a vehicle of speed v drives at

    v' = min(v + a h, v_safe, v_cap(s)),    v_safe = -b tau + sqrt((b tau)^2 + v_l^2 + 2 b g),

at least at v - b_max h and never backwards: a is its acceleration, v_l and g are its leader's speed
and the gap to it less the gap kept when standing, v_cap(s) is the speed from which the limits ahead
can be met, and b the deceleration that it counts on.

Source: Krauss, Microscopic modeling of traffic flow, 1998; it is SUMO's default model. Measured
against SUMO's cars it predicts better than the intelligent driver model.
"""

from dataclasses import dataclass

import numpy as np

from mpcplan.predict.paths import Paths
from mpcplan.trajectory import Array

STEPS = 2  # time steps of the forecast in one step of the model
HARDEST = 9.0  # m/s^2, b_max
FAR = 1e6  # m, where the leader is of who has none
SLOW = 0.1  # m/s, for headways
SHORTEST, LONGEST = 0.2, 1.0  # s, headways


@dataclass(frozen=True, eq=False)
class Movers:
    """Who moves along which way, one row per hypothesis (all arrays (n,) unless said otherwise).

    Attributes:
        path: index of the way.
        s: arc length [m] of the front.
        v: speed [m/s].
        acceleration: (k, n) [m/s^2] while nothing holds it back, for every step of the model.
        deceleration: b [m/s^2].
        headway: tau [s].
        speed: the highest [m/s].
        profile: row of :attr:`Paths.caps`.
        leader: row of the leader; n: none.
        offset: leader's arc length on the own way, less the leader's length and the gap kept
            when standing, less its arc length on its own way [m].
        until: arc length on the leader's way from which it leads no more [m].
        stop: arc length [m] at which the front waits; infinity: nowhere.
        release: time [s] until which it waits.
    """

    path: Array
    s: Array
    v: Array
    acceleration: Array
    deceleration: Array
    headway: Array
    speed: Array
    profile: Array
    leader: Array
    offset: Array
    until: Array
    stop: Array
    release: Array


def drive(paths: Paths, movers: Movers, step: float) -> tuple[Array, Array]:
    """Arc lengths [m] and speeds [m/s], (k + 1, n), at the model's steps of ``step`` [s]."""
    n, b = len(movers.s), movers.deceleration
    count = len(movers.acceleration)
    s, v = np.empty((count + 1, n + 1)), np.empty((count + 1, n + 1))
    s[:, n], v[:, n] = FAR, 0.0
    s[0, :n], v[0, :n] = movers.s, movers.v
    gain, lost = movers.acceleration * step, HARDEST * step
    bt, bb = b * movers.headway, 2 * b
    parting = bool(np.isfinite(movers.until).any())
    stopping = bool(np.isfinite(movers.stop).any())
    limit = paths.limits(movers.path, movers.profile)
    for k in range(count):
        s_k, v_k = s[k, :n], v[k, :n]
        after = np.minimum(np.minimum(v_k + gain[k], movers.speed), limit(s_k + v_k * step))
        s_l = s[k, movers.leader]
        room = s_l + movers.offset - s_k
        if parting:
            room = np.where(s_l > movers.until, FAR, room)
        square = v[k, movers.leader] ** 2 + bb * room
        after = np.minimum(after, np.sqrt(np.maximum(square + bt * bt, 0.0)) - bt)
        if stopping:
            room = np.where(k * step < movers.release, movers.stop - s_k, FAR)
            after = np.minimum(after, np.sqrt(np.maximum(bb * room + bt * bt, 0.0)) - bt)
        after = np.maximum(after, np.maximum(v_k - lost, 0.0))
        v[k + 1, :n] = after
        s[k + 1, :n] = s_k + (v_k + after) * (step / 2)
    return s[:, :n], v[:, :n]


def refined(s: Array, v: Array, step: float) -> tuple[Array, Array]:
    """Arc lengths and speeds at every time step of the forecast: with a middle between any two."""
    fine_s, fine_v = (np.empty((2 * len(x) - 1, x.shape[1])) for x in (s, v))
    fine_s[::2], fine_v[::2] = s, v
    fine_v[1::2] = (v[:-1] + v[1:]) / 2
    fine_s[1::2] = (s[:-1] + s[1:]) / 2 + (v[:-1] - v[1:]) * (step / 8)
    return fine_s, fine_v


def kept_headway(v: Array, v_leader: Array, room: Array, deceleration: Array) -> Array:
    """(n,) the headway tau [s] at which the present speed is the safe one: who follows closely
    goes on doing so.

    Args:
        v: speeds [m/s].
        v_leader: of the leaders [m/s].
        room: gaps to them, less those kept when standing [m].
        deceleration: b [m/s^2].
    """
    b = 2 * deceleration
    exact = (v_leader**2 - v**2 + b * room) / (b * np.maximum(v, SLOW))
    return np.clip(exact, SHORTEST, LONGEST)
