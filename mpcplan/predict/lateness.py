"""Forecasts that hold for an ego vehicle that is a little late.

The competition's organisers replay a solution one time step late: at time step k + 1 the others are
where they are at k + 1, and the ego vehicle where it was to be at k. A plan is free of collisions
then too if it keeps off the places that every other one covers from k to k + 1. So its box at k is
extended forwards by the way that it drives in that time.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mpcplan.observation import Box, Forecast, Observation


class LateEgo:
    """A predictor whose boxes cover what they cover a little later too."""

    def __init__(self, predictor: Callable[[Observation], Forecast], lateness: float) -> None:
        """``lateness`` [s] of the ego vehicle."""
        self._predictor, self._lateness = predictor, lateness
        self._last: tuple[Forecast, Forecast] | None = None

    def __call__(self, observation: Observation) -> Forecast:
        """The forecast with extended boxes; the same one for the same forecast."""
        known = self._predictor(observation)
        if self._last is None or self._last[0] is not known:
            self._last = known, extended(known, self._lateness)
        return self._last[1]


def extended(forecast: Forecast, lateness: float) -> Forecast:
    """The forecast with every box but the present one extended by its way in ``lateness`` [s]."""
    boxes = forecast.boxes.copy()
    later = boxes[:, 1:]
    way = later[..., Box.V] * lateness
    later[..., Box.X] += way / 2 * np.cos(later[..., Box.PSI])
    later[..., Box.Y] += way / 2 * np.sin(later[..., Box.PSI])
    later[..., Box.LENGTH] += np.abs(way)
    return replace(forecast, boxes=boxes)
