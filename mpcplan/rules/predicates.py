"""The predicates of the rules as real numbers: positive (or 0) where one holds, by how much.

Bodies are given in the Frenet frame of a path (:class:`Bodies`), lanes as strips along it
(:mod:`mpcplan.road.strips`). Every function works on many ego trajectories and all others at once:
arrays run over (n, o, k), trajectories by others by time steps. Who is not there, or drives another
way (oncoming, crossing), is on no lane: the predicates about him are -inf, and no rule applies.

Source: Maierhofer et al. 2020 (see :mod:`mpcplan.rules`), section IV and table II.
"""

from dataclasses import dataclass, fields

import numpy as np

from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.strips import TURN_MAX, Strips
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR


@dataclass(frozen=True, eq=False)
class Bodies:
    """Vehicles along a path (all arrays (r, k) of r vehicles at k time steps; NaN: not there).

    Attributes:
        s, d: centre [m].
        rear, front: least and largest arc length [m].
        right, left: least and largest offset [m].
        v: speed along the path [m/s].
        turn: heading relative to the path [rad].
        length: of the body [m].
    """

    s: Array
    d: Array
    rear: Array
    front: Array
    right: Array
    left: Array
    v: Array
    turn: Array
    length: Array

    def pick(self, rows: Array | slice) -> "Bodies":
        """Some of the vehicles."""
        return Bodies(*(getattr(self, f.name)[rows] for f in fields(self)))


def other_bodies(around: Occupancy) -> Bodies:
    """The others (o, k) as they are projected onto the path."""
    return Bodies(
        around.s, around.d, around.s_low, around.s_high, around.d_low, around.d_high, around.v,
        around.turn, around.length,
    )  # fmt: skip


def ego_bodies(s: Array, d: Array, mu: Array, v: Array) -> Bodies:
    """The ego vehicle at (n, k) poses of its rear axle: s, d [m], heading to the path [rad]."""
    c, sn = np.abs(np.cos(mu)), np.abs(np.sin(mu))
    reach_s = CAR.length / 2 * c + CAR.width / 2 * sn
    reach_d = CAR.length / 2 * sn + CAR.width / 2 * c
    s, d = s + CAR.rear_to_centre * np.cos(mu), d + CAR.rear_to_centre * np.sin(mu)
    return Bodies(
        s, d, s - reach_s, s + reach_s, d - reach_d, d + reach_d, v * np.cos(mu), mu,
        np.full(s.shape, CAR.length),
    )  # fmt: skip


def occupied(strips: Strips, bodies: Bodies) -> Array:
    """(m, r, k) width [m] by which bodies cover each strip; -inf for those who drive another way.

    ``turn`` counts from -pi to pi, however it was unwrapped.
    """
    turn = np.abs((bodies.turn + np.pi) % (2 * np.pi) - np.pi)
    with np.errstate(invalid="ignore"):
        same_way = turn < TURN_MAX
    return np.where(same_way, strips.overlap(bodies.s, bodies.right, bodies.left), -np.inf)


def in_same_lane(ego: Array, others: Array, strips: Strips, least: float) -> Array:
    """(n, o, k) in_same_lane [m]: how far both reach into the lane that they share most.

    Args:
        ego: (m, n, k) as from :func:`occupied`.
        others: (m, o, k) as from :func:`occupied`.
        strips: the lanes.
        least: a body that reaches less far into a lane [m] is not on it.
    """
    shape = (ego.shape[1], others.shape[1], ego.shape[2])
    shared = np.full(shape, -np.inf)
    for strip in np.flatnonzero(np.isfinite(ego).any(axis=(1, 2))):
        there = others[strips.same[strip]].max(axis=0, initial=-np.inf)
        np.maximum(shared, np.minimum(ego[strip][:, None], there[None]), out=shared)
    return shared - least


def in_several_lanes(others: Array, strips: Strips, least: float) -> Array:
    """(o, k) not single_lane [m]: how far a body reaches into the lesser of two lanes.

    Only neighbours count: lanelets that fork or merge lie on each other without being two lanes.
    """
    shared = np.full(others.shape[1:], -np.inf)
    for a, b in np.argwhere(np.triu(strips.beside)):
        np.maximum(shared, np.minimum(others[a], others[b]), out=shared)
    return shared - least


def in_front_of(ego: Bodies, others: Bodies) -> Array:
    """(n, o, k) in_front_of [m]: the way from the ego vehicle's front to the other's rear."""
    gap = others.rear[None] - ego.front[:, None]
    return np.where(np.isnan(gap), -np.inf, gap)


def cut_in(
    same_lane: Array, several_lanes: Array, ego: Bodies, others: Bodies, least: float
) -> Array:
    """(n, o, k) cut_in [m]: the other shares a lane, is on more than one, and turns to the ego.

    The last as the way by which its front is nearer to the ego vehicle's line than its rear is,
    beyond that at the heading ``least`` [rad]: nobody drives quite straight on.
    """
    side = np.sign(ego.d[:, None] - others.d[None])
    turned = others.length * (np.sin(others.turn) * side - np.sin(least))
    turned = np.where(np.isnan(turned), -np.inf, turned)
    return np.minimum(np.minimum(same_lane, several_lanes[None]), turned)


def safe_distance(
    v_behind: Array, v_ahead: Array | float, braking_behind: float, braking_ahead: float,
    reaction: float,
) -> Array:  # fmt: skip
    """Least gap [m] at which who is behind can still stop behind who is ahead and brakes:

        d_safe = max(0, v_b delta + v_b^2 / (2 a_b) - v_a^2 / (2 a_a))

    Exact where a_a >= a_b (who is ahead brakes at least as hard): then the gap is least at once or
    when both stand. Not below 0: a faster one ahead gives no right to touch it.

    Args:
        v_behind, v_ahead: speeds [m/s], at least 0.
        braking_behind, braking_ahead: decelerations a_b, a_a [m/s^2], positive.
        reaction: time delta [s] after which who is behind begins to brake.
    """
    ways = (v_behind**2 - v_ahead**2 * (braking_behind / braking_ahead)) / (2 * braking_behind)
    safe: Array = np.maximum(v_behind * reaction + ways, 0.0)
    return safe


def keeps_safe_distance(
    front: Array, ego: Bodies, others: Bodies, braking: tuple[float, float], reaction: float
) -> Array:
    """(n, o, k) keeps_safe_distance_prec [m]: what the gap has beyond the safe distance.

    Args:
        front: (n, o, k) the gap, as from :func:`in_front_of`.
        ego: who is behind.
        others: who are ahead.
        braking: decelerations of the ego vehicle and of the others [m/s^2].
        reaction: of the ego vehicle [s].
    """
    v, v_o = np.maximum(ego.v, 0.0)[:, None], np.maximum(np.nan_to_num(others.v), 0.0)[None]
    return front - safe_distance(v, v_o, *braking, reaction)


def slow_leading_vehicle(
    same_lane: Array, front: Array, others: Bodies, speed: Array, slower: float
) -> Array:
    """(n, k) slow_leading_vehicle [m/s]: how much slower than ``slower`` below what is allowed the
    slowest leader is; -inf where nobody leads.

    Args:
        same_lane, front: (n, o, k) as from :func:`in_same_lane` and :func:`in_front_of`.
        others: who may lead.
        speed: (o, k) that is allowed where they are [m/s].
        slower: Delta v of the traffic flow [m/s].
    """
    by = (speed - others.v - slower)[None]
    leads = (same_lane >= 0) & (front >= 0)
    return np.where(leads, by, -np.inf).max(axis=1, initial=-np.inf)


def preserves_traffic_flow(ego: Bodies, speed: Array, slower: float) -> Array:
    """(n, k) preserves_traffic_flow [m/s]: what the ego vehicle is faster than ``slower`` below the
    speed (n, k) that is allowed where it is."""
    return slower - (speed - ego.v)
