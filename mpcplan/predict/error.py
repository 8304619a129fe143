"""How far predictions were off: displacement of the centres against what then happened."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from mpcplan.observation import Box, Observation, Snapshot, as_forecast
from mpcplan.predict.predictor import Predictor
from mpcplan.trajectory import Input, Trajectory

SECONDS = (1.0, 2.0, 3.0)  # after which predictions are compared
HISTORY = 10  # past snapshots that an observation holds
ALL = "all"  # kinds together, in a summary


class ErrorRow(NamedTuple):
    """One prediction of one obstacle: its kind, how far ahead [s], and how far off it was [m]."""

    kind: str
    seconds: float
    distance: float


class ErrorSummary(NamedTuple):
    """Displacement errors [m] of a kind of obstacle at a time ahead [s]."""

    kind: str
    seconds: float
    number: int
    mean: float
    median: float
    p95: float


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
        gap = forecast.at(then)[first][..., : Box.PSI] - true[..., : Box.PSI]
        distance = np.hypot(gap[..., Box.X], gap[..., Box.Y])
        found += [
            ErrorRow(now.kind_of(now.ids[i]), ahead[k][0], float(distance[i, k]))
            for i, k in np.argwhere(np.isfinite(distance))
        ]
    return found


def _observation(past: Sequence[Snapshot], ego: Trajectory, step: int) -> Observation:
    """What was seen at a time step; ``past`` ends there."""
    k = step - ego.first_step
    before = float(ego.inputs[k - 1, Input.A]) if k > 0 else 0.0
    return Observation(step, ego.states[k], before, tuple(past[-HISTORY - 1 :]))


def summary(rows: Iterable[ErrorRow]) -> list[ErrorSummary]:
    """Errors by kind and time ahead, and of all kinds together; the most frequent kind first."""
    groups: dict[tuple[str, float], list[float]] = {}
    for kind, seconds, distance in rows:
        for name in (kind, ALL):
            groups.setdefault((name, seconds), []).append(distance)
    total: dict[str, int] = {}
    for (kind, _), distances in groups.items():
        total[kind] = total.get(kind, 0) + len(distances)
    order = sorted(groups, key=lambda key: (key[0] == ALL, -total[key[0]], *key))
    return [
        ErrorSummary(
            kind, seconds, len(values), float(values.mean()), float(np.median(values)),
            float(np.percentile(values, 95)),
        )
        for kind, seconds in order
        if len(values := np.array(groups[kind, seconds]))
    ]  # fmt: skip
