"""The smallest planner that keeps its lane: the example of ``docs/planners.md``."""

import numpy as np

from mpcplan.baselines.pursuit import steering_rate
from mpcplan.config import Config
from mpcplan.observation import Observation
from mpcplan.road.road import build_roads
from mpcplan.task import Task
from mpcplan.trajectory import Array
from mpcplan.vehicle import step

STEPS = 30  # time steps planned


class ConstantVelocity:
    """Drives on along the route at the speed it has, whoever is in the way."""

    def __init__(self, task: Task, config: Config) -> None:
        """Finds the road to the goal; raises RoadError where there is none."""
        roads = build_roads(task.road_map, task.problem.planning_problem, config.road)
        self.path, self.dt = roads[0].frame, task.dt

    def plan(self, observation: Observation) -> Array:
        """(STEPS + 1, 5) states at constant speed, steered by pure pursuit."""
        states = [observation.state.tolist()]
        for _ in range(STEPS):
            v_delta = steering_rate(self.path, states[-1], self.dt)
            states.append(step(states[-1], 0.0, v_delta, self.dt))
        return np.array(states)
