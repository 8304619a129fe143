"""Whether a scenario's map admits any solution at all.

Two faults of maps leave none: a start off the drivable area, and a drivable area that is cut, or
too narrow for the vehicle, between start and goal (the official checker's triangulated boundary
does that to a few published maps). A vehicle's body always covers a disc of its width, so the
centres of such discs in the area, the area shrunk by half the width, must hold a way.
"""

import numpy as np
import shapely
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.scenario.scenario import Scenario

from mpcplan.road.goal import region_of
from mpcplan.road.limits import drivable_area
from mpcplan.scenario import LoadedScenario
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import rectangles

SPARE = 0.05  # m, to either side: the vehicle is taken to be this much narrower
OFF_ROAD = 1e-3  # m^2, less is rounding


def fault(road_map: Scenario, problem: PlanningProblem) -> str:
    """Why nobody can solve a planning problem, in a sentence; '' where nothing is found.

    Args:
        road_map: the map.
        problem: start and goal, in the map's coordinates.
    """
    area = drivable_area(road_map)
    start, psi = problem.initial_state, float(problem.initial_state.orientation)
    centre = np.asarray(start.position, float)
    axle = centre - CAR.rear_to_centre * np.array([np.cos(psi), np.sin(psi)])
    body = shapely.polygons(rectangles(np.array([[*axle, 0.0, 0.0, psi]])))[0]
    off = float(shapely.area(shapely.difference(body, area)))
    if off > OFF_ROAD:
        return (
            f"the scenario has no solution: its start is off the road by {off:.3f} m^2, as the "
            "official checker sees it"
        )
    return _cut(area, centre, problem)


def fault_of(loaded: LoadedScenario) -> str:
    """The same for the first of a scenario's problems that has none, '' where all may have one."""
    found = (fault(loaded.scenario, problem.planning_problem) for problem in loaded.problems)
    return next(filter(None, found), "")


def _cut(area: shapely.Geometry, start: Array, problem: PlanningProblem) -> str:
    """Where the way to every goal is cut, in a sentence; '' where it is not."""
    regions = [
        region_of(state.position)
        for state in problem.goal.state_list
        if state.has_value("position")
    ]
    if len(regions) < len(problem.goal.state_list):
        return ""  # a goal anywhere
    reach = CAR.width / 2
    parts = shapely.get_parts(shapely.buffer(area, SPARE - reach))
    near = shapely.distance(parts, shapely.Point(*start)) <= reach
    goal = shapely.union_all(regions)
    there = shapely.distance(parts, goal) <= reach
    if not near.any() or (near & there).any():
        return ""
    mine = shapely.union_all(parts[near])
    beyond = shapely.union_all(parts[there]) if there.any() else goal
    line = shapely.shortest_line(mine, beyond)
    x, y = shapely.get_coordinates(line).mean(axis=0)
    return (
        "the scenario has no solution: the road is cut between start and goal, as the official "
        f"checker sees it, or narrower than the vehicle, near x {x:.2f} m, y {y:.2f} m of the start"
    )
