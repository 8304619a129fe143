"""Robustness of the rules' formulas for many trajectories at once.

The semantics is that of the monitors (:mod:`mpcplan.rules.formulas`): what the rules only ask about
(lanes, order, cut-ins, leaders) is true or false, and what they demand of the ego vehicle gives the
number, so that the robustness of R_G1 is a distance and that of R_G4 a speed. Where nothing is
demanded it is +inf. (Output robustness of interface-aware signal temporal logic: Ferrère, Nickovic,
Donzé, Ito, Kapinski: Interface-aware signal temporal logic, HSCC 2019.)
"""

from dataclasses import dataclass

import numpy as np

from mpcplan.config import RulesConfig
from mpcplan.road.strips import Strips
from mpcplan.rules import predicates
from mpcplan.rules.predicates import Bodies
from mpcplan.trajectory import Array


@dataclass(frozen=True, eq=False)
class Signals:
    """What the formulas are made of, as in :mod:`mpcplan.rules.predicates`.

    Attributes:
        lane, front, cut, distance: (n, o, k) in_same_lane, in_front_of, cut_in,
            keeps_safe_distance_prec [m].
        slow, flow: (n, k) slow_leading_vehicle, preserves_traffic_flow [m/s].
    """

    lane: Array
    front: Array
    cut: Array
    distance: Array
    slow: Array
    flow: Array


def signals(
    strips: Strips, ego: Bodies, others: Bodies, parked: Array, rules: RulesConfig
) -> Signals:
    """All predicates for (n, k) bodies of the ego vehicle and (o, k) of the others.

    ``parked``: (o,) who never moves. R_G1 is about who drives ahead, so that no distance to them is
    demanded; but to wait behind them hinders nobody.
    """
    on, theirs = predicates.occupied(strips, ego), predicates.occupied(strips, others)
    lane = predicates.in_same_lane(on, theirs, strips, rules.overlap)
    several = predicates.in_several_lanes(theirs, strips, rules.overlap)
    front = predicates.in_front_of(ego, others)
    braking = (rules.braking_ego, rules.braking_others)
    distance = predicates.keeps_safe_distance(front, ego, others, braking, rules.reaction)
    distance[:, parked] = np.inf
    allowed = strips.speed_at(others.s, theirs)
    return Signals(
        lane,
        front,
        predicates.cut_in(lane, several, ego, others, rules.cut_in_turn),
        distance,
        predicates.slow_leading_vehicle(lane, front, others, allowed, rules.flow),
        predicates.preserves_traffic_flow(ego, strips.speed_at(ego.s, on), rules.flow),
    )


def once(holds: Array, steps: int) -> Array:
    """(..., k) O_[0, steps]: whether something holds now or did at most ``steps`` ago."""
    total = np.concatenate(
        [np.zeros((*holds.shape[:-1], steps + 1), np.int64), np.cumsum(holds, axis=-1)], axis=-1
    )
    held: Array = total[..., steps + 1 :] > total[..., : holds.shape[-1]]
    return held


def begins(holds: Array) -> Array:
    """(..., k) holds now and not before; before the first sample nothing holds."""
    before = np.concatenate([np.zeros((*holds.shape[:-1], 1), bool), holds[..., :-1]], axis=-1)
    return holds & ~before


def safe_distance_rule(s: Signals, recovery: int) -> Array:
    """(n, o, k) robustness of R_G1 [m] towards each other; +inf where it does not apply.

    ``recovery``: time steps after a cut-in in which the distance may be too short.
    """
    grace = once(begins(s.cut >= 0), recovery)
    return np.where((s.lane >= 0) & (s.front >= 0) & ~grace, s.distance, np.inf)


def traffic_flow_rule(s: Signals) -> Array:
    """(n, k) robustness of R_G4 [m/s]; +inf where it does not apply."""
    return np.where(s.slow >= 0, np.inf, s.flow)


def robustness(
    strips: Strips, ego: Bodies, others: Bodies, parked: Array, rules: RulesConfig, dt: float
) -> tuple[Array, Array]:
    """(n, k) robustness of R_G1 [m], towards all others, and of R_G4 [m/s].

    Args:
        strips: the lanes along the path.
        ego: (n, k) bodies of the ego vehicle.
        others: (o, k) bodies of the others.
        parked: (o,) who never moves.
        rules: the rules' parameters.
        dt: time step [s].
    """
    ever = predicates.occupied(strips, others).max(axis=(0, 2), initial=-np.inf) >= rules.overlap
    found = signals(strips, ego, others.pick(ever), parked[ever], rules)
    distance = safe_distance_rule(found, recovery_steps(rules, dt))
    return distance.min(axis=1, initial=np.inf), traffic_flow_rule(found)


def recovery_steps(rules: RulesConfig, dt: float) -> int:
    """t_c in time steps."""
    return round(rules.recovery / dt)
