"""Routes that begin in the lane that the ego vehicle has come into, and the last plan on them.

The roads are built from the present state to the same goal. The timetable to it goes on as it was,
and so does the last plan: what is left of it is looked at in the Frenet frame of the new road that
it leaves least. Where none of them can hold it, it stays on its own road until it is replaced. The
road driven on so far stays one of the roads, as the last of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.scenario.lanelet import LaneletNetwork
from commonroad.scenario.scenario import Scenario
from commonroad.scenario.state import InitialState

from mpcplan.config import Config
from mpcplan.cycle import Cycle
from mpcplan.errors import RoadError
from mpcplan.observation import Observation
from mpcplan.plan import Option
from mpcplan.road.association import Association, Judgement
from mpcplan.road.goal import last_goal_step
from mpcplan.road.reference import reference_lanes
from mpcplan.road.road import Road, build_roads, with_strips
from mpcplan.trajectory import Array, State, Trajectory
from mpcplan.vehicle import FORD_ESCORT as CAR

GOAL_EDGE = 0.5  # m, windows along the path are sampled and may be this much too short


def planned_roads(
    road_map: Scenario, problem: PlanningProblem, config: Config, before: Road | None = None
) -> tuple[Road, ...]:
    """The roads with all that the configuration asks for.

    Args:
        road_map: the map.
        problem: start and goal.
        config: the configuration.
        before: a road of the same map, of which the drivable area is taken.

    Raises:
        RoadError: where no route leads to the goal.
    """
    area = before.area if before is not None else None
    roads = build_roads(road_map, problem, config.road, area)
    if config.cost.safe_distance > 0 or config.cost.traffic_flow > 0:
        roads = tuple(with_strips(road, road_map, config) for road in roads)
    return roads


@dataclass(frozen=True, eq=False)
class Reassociated:
    """The outcome of one cycle.

    Attributes:
        roads: to plan on from now on; None: those of before.
        last: the last plan, on one of them or on its own road.
        told: for the trace.
    """

    roads: tuple[Road, ...] | None
    last: Option | None
    told: Judgement


class Reassociation:
    """Asks in every cycle where the ego vehicle belongs, and builds the roads anew where due."""

    def __init__(self, road_map: Scenario, problem: PlanningProblem, config: Config) -> None:
        self._map, self._problem, self._config = road_map, problem, config
        network = road_map.lanelet_network
        self._association = Association(network, config.association, float(road_map.dt))

    def look(self, cycle: Cycle, road: Road, last: Option | None) -> Reassociated:
        """The present cycle.

        Args:
            cycle: the present one.
            road: that is driven on.
            last: the last plan.
        """
        seen = cycle.observation
        told = self._association.judge(seen.step, seen.state, road)
        if not told.due:
            return Reassociated(None, last, told)
        self._association.begin_in(told.lanelet)  # whatever comes of it: it is not tried again
        with cycle.clock("road"):
            try:
                roads = self._roads_from(seen, road, told.lanelet)
            except RoadError as error:
                failed = replace(told, due=False, reason=f"{told.reason}: {error}")
                return Reassociated(None, last, failed)
            self._association.begin_in(told.lanelet, roads)
            carried = carried_over(last, roads, seen.step) if last is not None else None
        reason = f"{told.reason}: {_routes(roads)}"
        if last is not None and carried is None:
            reason += "; the last plan stays on its road"
        # from two lanes aside its reference may be the nearer one: what it offers is not given up
        return Reassociated((*roads, road), carried or last, replace(told, reason=reason))

    def _roads_from(self, seen: Observation, before: Road, lanelet: int | None) -> tuple[Road, ...]:
        problem = PlanningProblem(
            self._problem.planning_problem_id, _initial(seen), self._problem.goal
        )
        end = last_goal_step(self._problem)  # a goal without time ends as it would have
        roads = planned_roads(self._map, problem, self._config, before)
        rear = seen.state[[State.X, State.Y]]
        driven = float(before.frame.to_frenet(rear)[0]) - before.start
        here = lanelet_first(self._map.lanelet_network, roads, lanelet)
        return tuple(
            replace(
                road,
                goals=tuple(replace(goal, last=min(goal.last, end)) for goal in road.goals),
                first_step=before.first_step,
                start=float(road.frame.to_frenet(rear)[0]) - driven,
            )
            for road in here
        )


def lanelet_first(
    network: LaneletNetwork, roads: Sequence[Road], lanelet: int | None
) -> list[Road]:
    """The roads, those first whose reference begins in a lanelet; else in the order as they are."""
    return sorted(roads, key=lambda road: reference_lanes(network, road.route)[0] != lanelet)


def _initial(seen: Observation) -> InitialState:
    """The present state as one that a planning problem begins with, at the body's centre."""
    x = seen.state
    psi, speed = float(x[State.PSI]), float(x[State.V])
    ahead = CAR.rear_to_centre * np.array([np.cos(psi), np.sin(psi)])
    return InitialState(
        time_step=seen.step, position=x[[State.X, State.Y]] + ahead, orientation=psi,
        velocity=speed, acceleration=seen.acceleration, slip_angle=0.0,
        yaw_rate=speed / CAR.wheelbase * float(np.tan(x[State.DELTA])),
    )  # fmt: skip


def _routes(roads: Sequence[Road]) -> str:
    routes = ", ".join(" ".join(str(i) for i in road.route.lanelets) for road in roads)
    return f"the routes are now {routes}"


def carried_over(last: Option, roads: Sequence[Road], step: int) -> Option | None:
    """The last plan on the road that what is left of it leaves least, to be refined there anew;
    None where none of them holds it.

    A road holds a plan where its Frenet frame is unique all along, and where a plan that reaches
    the goal ends in one of its goal windows.
    """
    if last.seed is None or step >= last.trajectory.last_step:
        return None
    rest = last.trajectory.since(step)
    aside = [_aside(road, rest, last.reaches_goal) for road in roads]
    best = int(np.argmin(aside))
    if not np.isfinite(aside[best]):
        return None
    return replace(last, seed=replace(last.seed, road=roads[best]), settled=False)


def _aside(road: Road, rest: Trajectory, reaches_goal: bool) -> float:
    """Mean offset [m] of a plan from a road's reference; inf where the road does not hold it."""
    s, d = road.frame.to_frenet(rest.states[:, [State.X, State.Y]])
    low, high = road.frame.domain(s)
    if np.any((d < low) | (d > high)):
        return float("inf")
    if reaches_goal and not _ends_in_goal(road, rest.states[-1], rest.last_step):
        return float("inf")
    return float(np.abs(d).mean())


def _ends_in_goal(road: Road, state: Array, step: int) -> bool:
    """Whether a plan that is known to end in the goal does so in a window of this road."""
    psi = float(state[State.PSI])
    centre = state[[State.X, State.Y]] + CAR.rear_to_centre * np.array([np.cos(psi), np.sin(psi)])
    s = float(road.frame.to_frenet(centre)[0])
    return any(
        goal.first <= step <= goal.last
        and (goal.s is None or goal.s[0] - GOAL_EDGE <= s <= goal.s[1] + GOAL_EDGE)
        for goal in road.goals
    )
