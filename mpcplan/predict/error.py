"""How far predictions were off: displacement of the centres against what then happened.

What is guessed wrongly is mostly how fast somebody drives. The spread along the way,

    |e_along| / l,

is the part of the displacement along the predicted heading relative to the way l that was predicted
to be driven: by this part of l a box has to grow at either end to hold what happens
(``predict.spread_along``).
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from mpcplan.observation import Box, Observation, Snapshot, as_forecast
from mpcplan.predict.predictor import Predictor
from mpcplan.trajectory import Array, Input, Trajectory

SECONDS = (1.0, 2.0, 3.0)  # after which predictions are compared
HISTORY = 10  # past snapshots that an observation holds
ALL = "all"  # kinds together, in a summary
SHORTEST = 1.0  # m, of predicted way from which a spread is told


class ErrorRow(NamedTuple):
    """One prediction of one obstacle: its kind, how far ahead [s], how far off it was [m], and its
    spread along the way [1] (NaN where hardly any way was predicted)."""

    kind: str
    seconds: float
    distance: float
    spread: float = float("nan")


class ErrorSummary(NamedTuple):
    """Displacement errors [m] of a kind of obstacle at a time ahead [s], and spreads along the way
    [1] that half and nine in ten predictions stay within (NaN: nobody was predicted to move)."""

    kind: str
    seconds: float
    number: int
    mean: float
    median: float
    p95: float
    spread50: float = float("nan")
    spread90: float = float("nan")


def displacement_errors(
    predictor: Predictor,
    snapshots: Sequence[Snapshot],
    ego: Trajectory,
    dt: float,
    every: int = 5,
    seconds: Sequence[float] = SECONDS,
) -> list[ErrorRow]:
    """The errors of all predictions during a run, of the most likely motion of each obstacle.

    Obstacles that are gone by then, or that the predictor left out, are not counted: a
    :class:`mpcplan.predict.lane_follow.LaneFollow` that is to be measured must not leave out the
    ego vehicle's followers.

    Args:
        predictor: to be measured.
        snapshots: of the whole run, at consecutive time steps.
        ego: what the ego vehicle drove; predictions are made at its time steps.
        dt: time step [s].
        every: a prediction is made every so many time steps.
        seconds: how far ahead it is compared.
    """
    if not snapshots:
        return []
    begin = snapshots[0].step
    seen = as_forecast(snapshots)
    row = {number: i for i, number in enumerate(seen.ids)}
    last = min(begin + len(snapshots) - 1, ego.last_step)
    found: list[ErrorRow] = []
    for step in range(max(begin, ego.first_step), last + 1, every):
        ahead = [
            (s, step + round(s / dt)) for s in seconds if step + round(s / dt) <= seen.last_step
        ]
        if not ahead:
            break
        observation = _observation(snapshots[: step - begin + 1], ego, step)
        now = observation.now
        forecast = predictor(observation)
        first = [forecast.ids.index(number) for number in now.ids]
        then = np.array([k for _, k in ahead])
        true = seen.boxes[[row[number] for number in now.ids]][:, then - begin]
        guess = forecast.at(then)[first]
        gap = guess[..., : Box.PSI] - true[..., : Box.PSI]
        distance = np.hypot(gap[..., Box.X], gap[..., Box.Y])
        spread = _spread(guess, gap, now.boxes)
        found += [
            ErrorRow(
                now.kind_of(now.ids[i]), ahead[k][0], float(distance[i, k]), float(spread[i, k])
            )
            for i, k in np.argwhere(np.isfinite(distance))
        ]
    return found


def _spread(guess: Array, gap: Array, now: Array) -> Array:
    """(n, k) spreads along the way of guessed boxes (n, k, 6) that are (n, k, 2) [m] off, of who is
    at boxes (n, 6) now; the way is taken to be straight."""
    way = np.hypot(*np.moveaxis(guess[..., : Box.PSI] - now[:, None, : Box.PSI], -1, 0))
    psi = guess[..., Box.PSI]
    along = gap[..., Box.X] * np.cos(psi) + gap[..., Box.Y] * np.sin(psi)
    return np.where(way >= SHORTEST, np.abs(along) / np.maximum(way, SHORTEST), np.nan)


def _observation(past: Sequence[Snapshot], ego: Trajectory, step: int) -> Observation:
    """What was seen at a time step; ``past`` ends there."""
    k = step - ego.first_step
    before = float(ego.inputs[k - 1, Input.A]) if k > 0 else 0.0
    return Observation(step, ego.states[k], before, tuple(past[-HISTORY - 1 :]))


def summary(rows: Iterable[ErrorRow]) -> list[ErrorSummary]:
    """Errors by kind and time ahead, and of all kinds together; the most frequent kind first."""
    groups: dict[tuple[str, float], list[ErrorRow]] = {}
    for row in rows:
        for name in (row.kind, ALL):
            groups.setdefault((name, row.seconds), []).append(row)
    total: dict[str, int] = {}
    for (kind, _), found in groups.items():
        total[kind] = total.get(kind, 0) + len(found)
    order = sorted(groups, key=lambda key: (key[0] == ALL, -total[key[0]], *key))
    return [_summary_of(*key, groups[key]) for key in order]


def _summary_of(kind: str, seconds: float, rows: Sequence[ErrorRow]) -> ErrorSummary:
    """The summary of rows of one kind and time ahead."""
    off = np.array([row.distance for row in rows])
    spread = np.array([row.spread for row in rows if np.isfinite(row.spread)])
    half, most = np.percentile(spread, (50, 90)).tolist() if len(spread) else (np.nan, np.nan)
    return ErrorSummary(
        kind, seconds, len(rows), float(off.mean()), float(np.median(off)),
        float(np.percentile(off, 95)), half, most,
    )  # fmt: skip
