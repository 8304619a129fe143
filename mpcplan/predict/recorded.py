"""Recorded traffic as its own prediction: exact, for scenarios that come with trajectories."""

from typing import Any

import numpy as np
import shapely
from commonroad.geometry.shape import Circle, Rectangle, Shape
from commonroad.scenario.obstacle import DynamicObstacle, StaticObstacle
from commonroad.scenario.scenario import Scenario
from commonroad.scenario.state import TraceState

from mpcplan.observation import Box, Forecast, Observation
from mpcplan.trajectory import Array

STATIC_STEPS = 1  # a record of static obstacles alone; they are held beyond it


class Recorded:
    """Predicts what the scenario's file says: the recorded boxes at every time step."""

    def __init__(self, recorded: Forecast) -> None:
        self._forecast = recorded

    def __call__(self, observation: Observation) -> Forecast:
        """The whole record; it does not depend on the observation."""
        return self._forecast


def record(scenario: Scenario) -> Forecast:
    """All obstacles' boxes at all time steps as a forecast from step 0 on."""
    dynamic = sorted(scenario.dynamic_obstacles, key=lambda o: o.obstacle_id)
    static = sorted(scenario.static_obstacles, key=lambda o: o.obstacle_id)
    last = max([_last_step(o) for o in dynamic], default=STATIC_STEPS)
    boxes = np.full((len(dynamic) + len(static), last + 1, len(Box)), np.nan)
    for row, obstacle in enumerate(dynamic):
        for state in _states(obstacle):
            boxes[row, state.time_step] = box_of(obstacle.obstacle_shape, state)
    for row, obstacle in enumerate(static, start=len(dynamic)):
        boxes[row] = box_of(obstacle.obstacle_shape, obstacle.initial_state)
    ids = tuple(o.obstacle_id for o in [*dynamic, *static])
    return Forecast(0, ids, boxes, np.arange(len(ids)) >= len(dynamic), exact=True)


def kinds_of(scenario: Scenario) -> dict[int, str]:
    """What each obstacle is, in CommonRoad's words."""
    return {o.obstacle_id: str(o.obstacle_type.value) for o in scenario.obstacles}


def static_ids(scenario: Scenario) -> frozenset[int]:
    """Ids of the obstacles that never move."""
    return frozenset(o.obstacle_id for o in scenario.static_obstacles)


def _states(obstacle: DynamicObstacle) -> list[TraceState]:
    if obstacle.prediction is None:
        return [obstacle.initial_state]
    trajectory = getattr(obstacle.prediction, "trajectory", None)
    return [obstacle.initial_state, *(trajectory.state_list if trajectory is not None else [])]


def _last_step(obstacle: DynamicObstacle | StaticObstacle) -> int:
    return max(int(state.time_step) for state in _states(obstacle))


def box_of(shape: Shape, state: TraceState) -> Array:
    """(6,) box (columns :class:`Box`) of a shape at a state; other shapes by their rectangle."""
    x, y, turn, length, width = _rectangle(shape)
    psi = float(getattr(state, "orientation", 0.0) or 0.0)
    c, s = np.cos(psi), np.sin(psi)
    px, py = (float(v) for v in _centre(state.position))
    speed = float(getattr(state, "velocity", 0.0) or 0.0)
    return np.array([px + c * x - s * y, py + s * x + c * y, psi + turn, speed, length, width])


def _centre(position: Any) -> Array:
    return np.asarray(getattr(position, "center", position), float)


def _rectangle(shape: Shape) -> tuple[float, float, float, float, float]:
    """Centre, orientation, length and width of the rectangle around a shape, in its own frame."""
    if isinstance(shape, Rectangle):
        return (*map(float, shape.center), float(shape.orientation), shape.length, shape.width)
    if isinstance(shape, Circle):
        return (*map(float, shape.center), 0.0, 2 * shape.radius, 2 * shape.radius)
    west, south, east, north = shapely.union_all(
        [part.shapely_object for part in getattr(shape, "shapes", [shape])]
    ).bounds
    return (west + east) / 2, (south + north) / 2, 0.0, east - west, north - south
