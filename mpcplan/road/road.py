"""The road of one route: reference path, limits and goal in one value."""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.scenario.scenario import Scenario

from mpcplan.config import Config, RoadConfig
from mpcplan.errors import RoadError
from mpcplan.road.frame import Frame
from mpcplan.road.goal import GoalWindow, goal_windows, last_goal_step
from mpcplan.road.limits import Limits, build_limits, drivable_area
from mpcplan.road.reference import build_frame
from mpcplan.road.route import Route, find_routes
from mpcplan.road.strips import Strips, build_strips
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

ACCELERATION = 3.0  # m/s^2, mean acceleration for which the reference is long enough
REACH_MAX = 400.0  # m


@dataclass(frozen=True, eq=False)
class Road:
    """One route with everything that planning along it needs.

    Attributes:
        route: the lanelets.
        frame: the reference path.
        limits: drivable area, lanes and speeds along it.
        goals: windows of the goal states that this route meets (never empty).
        area: the whole drivable area.
        first_step: time step at the start.
        start: arc length of the rear axle at the start [m].
        dt: time step [s].
        strips: its lanes, where what candidates cost for breaking the rules is asked for.
    """

    route: Route
    frame: Frame
    limits: Limits
    goals: tuple[GoalWindow, ...]
    area: shapely.Geometry
    first_step: int = 0
    start: float = 0.0
    dt: float = 0.1
    strips: Strips | None = None

    @property
    def last_step(self) -> int:
        """The last time step at which a goal may be reached."""
        return max(goal.last for goal in self.goals)

    def due(self, step: int, count: int, share: float) -> Array:
        """The timetable: arc lengths that the rear axle should have reached, so that the goal's
        position is not left to the last moment.

        It leads at a constant speed from the start to the goal, where it arrives early: whoever
        falls behind it early depends on everything going well later. A goal that asks for a speed
        leaves no time to wait: nothing is due from where even the lowest speed would lead past it.

        Args:
            step: present time step.
            count: number of time steps looked at.
            share: of the whole time from the start to a goal's last step, kept in reserve.

        Returns:
            (count + 1,) arc lengths [m] at the time steps from ``step`` on; -inf where nothing is
            due, of several goals the nearest.
        """
        steps, due = step + np.arange(count + 1), np.full(count + 1, np.inf)
        for goal in self.goals:
            if share <= 0 or goal.s is None:
                return np.full(count + 1, -np.inf)
            low = goal.s[0] - CAR.rear_to_centre
            duration = max((1 - share) * (goal.last - self.first_step), 1.0)
            passed = np.clip((steps - self.first_step) / duration, 0.0, 1.0)
            due = np.minimum(due, self.start + (low - self.start) * passed)
            if goal.v is not None and goal.v[0] > 0:
                early = goal.v[0] * self.dt * np.maximum(goal.first - steps, 0)
                due = np.minimum(due, low - early)
        return due


def build_roads(
    scenario: Scenario,
    problem: PlanningProblem,
    config: RoadConfig,
    area: shapely.Geometry | None = None,
) -> tuple[Road, ...]:
    """Roads of all routes that meet the goal, the most direct first.

    Args:
        scenario: the map.
        problem: start and goal.
        config: of routes, reference path and limits.
        area: the drivable area, where it is known already.

    Raises:
        RoadError: where there is none (with the reason of each route).
    """
    network = scenario.lanelet_network
    area = drivable_area(scenario) if area is None else area
    start = np.asarray(problem.initial_state.position, float)
    last_step = last_goal_step(problem)
    duration = (last_step - problem.initial_state.time_step) * scenario.dt
    speed = float(problem.initial_state.velocity)
    reach = min(duration * (speed + ACCELERATION * duration / 2) + 10.0, REACH_MAX)
    roads, reasons = [], []
    for route in find_routes(network, problem, config.variants):
        try:
            frame = build_frame(network, route, start, reach, config)
        except RoadError as error:
            reasons.append(f"{route.lanelets}: {error}")
            continue
        begin = float(frame.to_frenet(start)[0])
        goals = goal_windows(problem, frame, begin, last_step)
        if goals:
            limits = build_limits(scenario, area, frame, config)
            first_step = int(problem.initial_state.time_step)
            rear = begin - CAR.rear_to_centre
            roads.append(
                Road(route, frame, limits, goals, area, first_step, rear, float(scenario.dt))
            )
        else:
            reasons.append(f"{route.lanelets}: its path does not meet the goal region ahead")
    if not roads:
        raise RoadError(
            f"planning problem {problem.planning_problem_id}: no usable route; "
            + "; ".join(reasons)
        )
    return tuple(roads)


def with_strips(road: Road, road_map: Scenario, config: Config) -> Road:
    """The road with its lanes, for the rules."""
    lateral = config.road.lateral_acceleration
    return replace(road, strips=build_strips(road_map, road.frame, lateral, config.rules))
