"""The cost of a trajectory as it is driven: TR1 up to its end, and what it lacks of the goal.

    J = dt sum_k  w_J j_k^2 + w_SR w_k^2 + w_D exp(-c (gap_k - r)) + w_LC e_k^2 + w_v over_k^2
                + w_T late_k^2 + w_H [s_k < s_clear]
                (+ what broken rules cost, see mpcplan.seed.rules)

with gap_k the distance of the centres to the nearest obstacle ahead whose centre lies within 2.8 m
laterally at step k, as the evaluator counts it, e_k the offset of the body's centre from its lane,
over_k what is driven above the speed limit, late_k what lacks of a position that is due, and
s_clear where all crossings are behind (:mod:`mpcplan.seed.crossing`). All
options of a planning cycle are compared by this one number, wherever they come from.

The evaluated jerk is not that of the inputs: positions along the lane are smoothed by a filter of
Savitzky and Golay (Analytical Chemistry 36, 1964) and differentiated three times. Where the others'
motion is known, so that a plan is likely to be driven to its end, j_k is computed in the same way.

Else it is that of the inputs. In the refinement it is that too, but for both edges of a drive where
motion is known (:mod:`mpcplan.refine.problem`). One-sided differences there see the first two
positions half a step apart: of a constant acceleration a they leave 1/4, 1/4 and 1/8 of a / dt as
jerk in three steps, together 3/8 of a / dt in one. At the start this takes the place of the jump
from the acceleration before, which no position shows.
"""

import numpy as np
from scipy.signal import savgol_filter

from mpcplan.config import Config
from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.road import Road
from mpcplan.seed.crossing import last_crossing
from mpcplan.seed.goal_fit import miss_distance
from mpcplan.seed.rules import states_cost
from mpcplan.seed.seed import Stage
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

EDGE = 3 / 8  # of the acceleration at either end of a drive is seen as a jerk of one step
WINDOW, ORDER = 13, 3  # of the evaluator's filter: below so many time steps, and its degree
SHORTEST = 5  # time steps, a filter with a shorter window is not applied
LEAST_SHARE = 1.5  # a trajectory has this many times as many states as the filter's window


def trajectory_cost(
    road: Road, states: Array, first_step: int, reaches_goal: bool, occupancy: Occupancy,
    config: Config, dt: float, known: bool = False,
) -> float:  # fmt: skip
    """Cost of (n + 1, 6) Frenet states (columns :class:`Stage`) from a time step on.

    ``known``: the others' motion is, and the jerk is that which will be evaluated.
    """
    cost, after = config.cost, states[1:]
    if known:
        jerk = evaluated_jerk(states, dt, first_step == road.first_step, reaches_goal)[1:]
    else:
        jerk = np.diff(states[:, Stage.A]) / dt
    steering = np.diff(states[:, Stage.DELTA]) / dt
    centre_s = after[:, Stage.S] + CAR.rear_to_centre * np.cos(after[:, Stage.MU])
    centre_d = after[:, Stage.D] + CAR.rear_to_centre * np.sin(after[:, Stage.MU])
    gap = gap_ahead(centre_s, centre_d, occupancy.window(first_step + 1, len(after)), config)
    offset = road.limits.lane_offset(road.frame, after[:, Stage.S], centre_d)
    limit = np.interp(after[:, Stage.S], road.frame.s, road.limits.posted)
    over = np.maximum(after[:, Stage.V] - np.maximum(limit, 0.1), 0.0)
    rate = cost.jerk * jerk**2 + cost.steering_rate * steering**2 + cost.lane * offset**2
    rate = rate + cost.distance * np.exp(-cost.distance_decay * (gap - cost.distance_offset))
    due = road.due(first_step, len(after), cost.reserve)[1:]
    late = np.maximum(due - after[:, Stage.S], 0.0)
    rate = rate + config.refine.speeding * over**2 + cost.late * late**2
    if cost.haste:
        way = states[:, Stage.S], states[:, Stage.D]
        clear = last_crossing(occupancy, first_step, float(way[0][0]), way)
        rate = rate + cost.haste * (after[:, Stage.S] < clear)
    total = dt * float(rate.sum())
    total += states_cost(road, states, first_step, occupancy, config, dt)
    if reaches_goal or not len(after):
        return total
    miss = miss_distance(road, centre_s[-1:], centre_d[-1:], after[-1:, Stage.V])
    return total + config.seed.goal_missed + config.seed.goal_distance * float(miss[0])


def evaluated_jerk(states: Array, dt: float, begins: bool, ends: bool) -> Array:
    """(n + 1,) longitudinal jerk [m/s^3] of Frenet states as the evaluator computes it.

    Args:
        states: (n + 1, 6) columns :class:`Stage`.
        dt: time step [s].
        begins: whether the drive begins with them; else it came as the first state goes on.
        ends: whether it ends with them; else it goes on as the last state does.
    """
    s = states[:, Stage.S] + CAR.rear_to_centre * np.cos(states[:, Stage.MU])
    t = dt * np.arange(1, WINDOW + 1)

    def going_on(row: int, time: Array) -> Array:
        v, a = states[row, Stage.V], states[row, Stage.A]
        along: Array = s[row] + v * time + a * time**2 / 2
        return along

    before = np.empty(0) if begins else going_on(0, -t[::-1])
    after = np.empty(0) if ends else going_on(-1, t)
    whole = np.concatenate([before, s, after])
    if len(whole) < ORDER + 1:
        return np.zeros(len(states))
    window = min(int(len(whole) / LEAST_SHARE), WINDOW)
    window -= window % 2 + 1  # an odd one, and 11 of 13: as the evaluator has it
    if window >= SHORTEST:
        whole = savgol_filter(whole, window, ORDER)
    for _ in range(3):
        whole = np.gradient(whole, dt)
    jerk: Array = whole[len(before) : len(before) + len(s)]
    return jerk


def gap_ahead(s: Array, d: Array, window: Occupancy, config: Config) -> Array:
    """(n,) distance [m] from the centre to the nearest counted centre ahead, inf for none."""
    with np.errstate(invalid="ignore"):
        gap = window.s - s
        counts = (np.abs(window.d - d) < config.cost.distance_lateral) & (gap > 0)
    return np.where(counts, gap, np.inf).min(axis=0, initial=np.inf)
