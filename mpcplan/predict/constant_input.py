"""Prediction by constant acceleration and yaw rate (2024 competition report).

    x += v cos(th) dt,  y += v sin(th) dt,  v += a dt,  th += w dt,

with a and w fitted to the latest boxes of each vehicle by least squares. Braking ends at rest.
"""

import numpy as np

from mpcplan.config import PredictConfig
from mpcplan.observation import Box, Forecast, Observation, Snapshot
from mpcplan.trajectory import Array


class ConstantInput:
    """Predicts every vehicle with the acceleration and yaw rate that it has shown lately."""

    def __init__(self, config: PredictConfig, dt: float) -> None:
        self._config, self._dt = config, dt

    def __call__(self, observation: Observation) -> Forecast:
        """Forecast over the configured horizon, from the present boxes."""
        now = observation.now
        rates = [self._rates(observation.others, i) for i in now.ids]
        a, w = np.array(rates, float).reshape(-1, 2).T
        steps = round(self._config.horizon / self._dt)
        boxes = np.empty((len(now.ids), steps + 1, len(Box)))
        boxes[:, 0] = now.boxes
        for k in range(steps):
            boxes[:, k + 1] = _advance(boxes[:, k], a, w, self._dt)
        return Forecast(observation.step, now.ids, boxes)

    def _rates(self, others: tuple[Snapshot, ...], obstacle: int) -> tuple[float, float]:
        """Acceleration [m/s^2] and yaw rate [rad/s] over the latest consecutive boxes."""
        history: list[Array] = []
        for snapshot in reversed(others[-self._config.history :]):
            box = snapshot.box_of(obstacle)
            if box is None:
                break
            history.insert(0, box)
        if len(history) < 2:
            return 0.0, 0.0
        t = self._dt * np.arange(len(history))
        rows = np.array(history)
        slope_v = np.polyfit(t, rows[:, Box.V], 1)[0]
        slope_psi = np.polyfit(t, np.unwrap(rows[:, Box.PSI]), 1)[0]
        return float(slope_v), float(slope_psi)


def _advance(boxes: Array, a: Array, w: Array, dt: float) -> Array:
    """One step of the prediction for all vehicles."""
    after = boxes.copy()
    v, psi = boxes[:, Box.V], boxes[:, Box.PSI]
    after[:, Box.X] += v * np.cos(psi) * dt
    after[:, Box.Y] += v * np.sin(psi) * dt
    after[:, Box.V] = np.where(v >= 0, np.maximum(v + a * dt, 0.0), v)
    after[:, Box.PSI] += np.where(np.abs(v) > 0.1, w * dt, 0.0)
    return after
