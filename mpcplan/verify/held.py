"""How those who stand, or creep, answer a plan: nobody drives into a body that is before him.

A forecast is made before there is a plan. Who is slow at present drives on as he is guessed to, but
no faster than Krauss' model allows (:mod:`mpcplan.predict.following`) with the plan's body as an
obstacle that stands wherever it is in his way at a time step; when it is gone he goes on with what
is left of his guessed way. Who is past the body, but still within reach of where he stood, is taken
to stand as well, which is the worst for a plan behind him. Who stands behind him is as late as he
is. Whether all this leaves room is for verification to say, and whoever does not stop after all is
seen not to: then the plan is broken off.
"""

from dataclasses import replace

import numpy as np

from mpcplan.observation import Box, Forecast
from mpcplan.predict.following import HARDEST
from mpcplan.predict.kinds import CAR
from mpcplan.trajectory import Array, Trajectory
from mpcplan.verify.drivability import separation

CREEPS = 2.0  # m/s, who is slower answers
REACH = 8.0  # m, of his way that must be free,
SPACING = 0.5  # m, looked at where boxes on it are this far apart
GAP = 0.5  # m, kept to the body, less half a spacing,
HEADWAY = 0.2  # s, in this time,
NEAR = 3.0  # m, who will come this near to the place of another one,
CLOSE = 12.0  # m, and is no further away, stands behind him
STILL = 1e-3  # m, no way


def held(forecast: Forecast, plan: Trajectory) -> Forecast:
    """The forecast if a plan is driven; itself where the plan holds nobody up."""
    steps = np.arange(plan.first_step, forecast.last_step + 1)
    if forecast.exact or len(steps) < 2:
        return forecast
    boxes = forecast.at(steps)
    with np.errstate(invalid="ignore"):
        slow = np.abs(boxes[:, 0, Box.V]) < CREEPS
    states = plan.states[np.minimum(steps - plan.first_step, len(plan.states) - 1)]
    late = _late(states, boxes, slow, plan.dt)
    if not late:
        return forecast
    answered = boxes.copy()
    for row, index in late.items():
        answered[row] = _at(boxes[row], index)
        for other in _behind(boxes, row, slow):
            if other not in late:
                answered[other] = _at(boxes[other], index)
    return replace(forecast, first_step=plan.first_step, boxes=answered)


def _late(states: Array, boxes: Array, slow: Array, dt: float) -> dict[int, Array]:
    """Where those come to whom the body at states (n, 5) holds up, as indices (n,) of their guessed
    boxes, by row."""
    way, count = _distance(boxes, boxes[:, :1]), len(states)
    found = {}
    for row in np.flatnonzero(slow & (np.nanmax(way, axis=1, initial=0.0) > SPACING)).tolist():
        until = int(np.isfinite(way[row]).sum())  # other hypotheses end sooner
        taken = _taken(states[:until], boxes[row, :until], way[row, :until])
        if not np.isfinite(taken).any():
            continue
        index = _answer(way[row, :until], taken, dt)
        if (index < np.arange(until)).any():
            more = index[-1] + np.arange(1, count - until + 1)
            found[row] = np.minimum(np.concatenate([index, more]), count - 1)
    return found


def _distance(boxes: Array, places: Array) -> Array:
    """Distances [m] of centres."""
    gap = boxes[..., : Box.PSI] - places[..., : Box.PSI]
    found: Array = np.hypot(gap[..., Box.X], gap[..., Box.Y])
    return found


def _taken(states: Array, boxes: Array, way: Array) -> Array:
    """(n,) the first place [m] of its way at which an obstacle would touch the body, at every time
    step; infinity where the body is not on its way."""
    wanted = np.arange(0.0, min(REACH, float(way[-1])), SPACING)
    at = np.unique(np.searchsorted(way, wanted))
    at = at[at < len(way)]
    ahead = np.repeat(boxes[at][:, None], len(states), axis=1)
    touched = separation(states, ahead) < 0.0
    found: Array = np.where(touched, way[at][:, None], np.inf).min(axis=0)
    return found


def _answer(way: Array, taken: Array, dt: float) -> Array:
    """(n,) the places that an obstacle comes to, as indices of its guessed way, of which some (n,)
    are taken [m]; within reach, who is past the taken place already stands, too."""
    index = np.zeros(len(way))
    p, v, at = 0.0, float(way[1] - way[0]) / dt, 0.0
    for k in range(1, len(way)):
        onward = float(np.interp(at + 1.0, np.arange(len(way)), way))
        wanted, bt = (onward - p) / dt, CAR.deceleration * HEADWAY
        room = max(float(taken[k]) - p - GAP, 0.0) if p < REACH else np.inf
        allowed = np.sqrt(bt**2 + 2 * CAR.deceleration * room) - bt
        after = max(min(wanted, allowed), v - HARDEST * dt, 0.0)
        if after >= wanted:
            p, at = onward, min(at + 1.0, len(way) - 1.0)
        else:
            p = p + after * dt
            last = int(np.searchsorted(way, p + STILL, side="right")) - 1
            span = way[min(last + 1, len(way) - 1)] - way[last]
            at = last + float(np.clip((p - way[last]) / span, 0.0, 1.0)) if span > STILL else last
        v, index[k] = after, at
    return index


def _behind(boxes: Array, row: int, slow: Array) -> list[int]:
    """Those who are slow, and will come to where another one is now."""
    with np.errstate(invalid="ignore"):
        near = _distance(boxes, boxes[row, 0]) < NEAR
        close = _distance(boxes[:, 0], boxes[row, 0]) < CLOSE
    found = slow & close & near.any(axis=1) & ~near[:, 0]
    return np.flatnonzero(found).tolist()


def _at(boxes: Array, index: Array) -> Array:
    """(n, 6) boxes at fractional indices, with the speeds at which these pass."""
    low = np.floor(index).astype(int)
    share = (index - low)[:, None]
    found: Array = (1 - share) * boxes[low] + share * boxes[np.minimum(low + 1, len(boxes) - 1)]
    found[:, Box.V] *= np.diff(index, prepend=index[0] - 1.0)
    found[np.isnan(boxes[:, Box.X])] = np.nan
    return found
