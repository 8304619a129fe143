"""Routes: sequences of lanelets from the start to the goal, with their lane-change variants.

The CommonRoad route planner finds the first routes; further ones come from a search over the
graph of lanelets (edges to successors and to neighbours of the same direction, Yen's algorithm of
networkx). Without a goal position the routes are the ways on along the lane, turns included.
"""

import logging
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice, pairwise

import networkx as nx
import numpy as np
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad_route_planner.route_planner import RoutePlanner

from mpcplan.errors import RoadError

LANE_CHANGE_PENALTY = 30.0  # m, a lane change counts as this much way
DETOUR_FACTOR = 1.5  # variants longer than this multiple of the shortest route are left out
DETOUR_SLACK = 60.0  # m, added to it
SURVIVAL_DEPTH = 6  # successors looked ahead where no goal position is given
PATHS_TRIED = 12


@dataclass(frozen=True)
class Route:
    """Lanelet ids from start to goal; neighbours of the same direction mean a lane change."""

    lanelets: tuple[int, ...]


def find_routes(
    network: LaneletNetwork, problem: PlanningProblem, variants: int
) -> tuple[Route, ...]:
    """At most ``variants`` distinct routes, the most direct first.

    Raises:
        RoadError: where no lanelet holds the start, or the goal cannot be reached from it.
    """
    starts = start_lanelets(network, problem)
    goals = goal_lanelets(network, problem)
    found: list[tuple[int, ...]] = []
    for route in _candidates(network, problem, starts, goals):
        if route not in found:
            found.append(route)
        if len(found) == variants:
            break
    if not found:
        raise RoadError(
            f"planning problem {problem.planning_problem_id}: no route from lanelets {starts} to "
            f"goal lanelets {sorted(goals)}; check successors and neighbours of the lanelets"
        )
    return tuple(Route(route) for route in found)


def start_lanelets(network: LaneletNetwork, problem: PlanningProblem) -> list[int]:
    """Lanelets at the initial position, best aligned with the initial orientation first."""
    state = problem.initial_state
    ids = network.find_lanelet_by_position([state.position])[0]
    if not ids:
        raise RoadError(
            f"planning problem {problem.planning_problem_id}: no lanelet holds the start"
        )
    return sorted(ids, key=lambda i: (_misalignment(network, i, state), i))


def goal_lanelets(network: LaneletNetwork, problem: PlanningProblem) -> set[int]:
    """Lanelets that touch a goal position; empty where no position is asked for."""
    ids: set[int] = set()
    for index, state in enumerate(problem.goal.state_list):
        given = (problem.goal.lanelets_of_goal_position or {}).get(index)
        if given:
            ids.update(given)
        elif state.has_value("position"):
            ids.update(network.find_lanelet_by_shape(state.position))
    return ids


def _misalignment(network: LaneletNetwork, lanelet_id: int, state: object) -> float:
    """Angle between the state and the lanelet [rad], rounded, plus a little for its offset."""
    centre = network.find_lanelet_by_id(lanelet_id).center_vertices
    position, orientation = state.position, state.orientation  # type: ignore[attr-defined]
    i = min(int(np.argmin(np.hypot(*(centre - position).T))), len(centre) - 2)
    dx, dy = centre[i + 1] - centre[i]
    angle = (orientation - np.arctan2(dy, dx) + np.pi) % (2 * np.pi) - np.pi
    offset = abs(dx * (position[1] - centre[i, 1]) - dy * (position[0] - centre[i, 0]))
    return float(abs(angle) + 0.1 * offset / max(np.hypot(dx, dy), 1e-6))


def _candidates(
    network: LaneletNetwork, problem: PlanningProblem, starts: list[int], goals: set[int]
) -> Iterator[tuple[int, ...]]:
    yield from _official_routes(network, problem, starts)
    if goals:
        yield from _searched_routes(network, starts, goals)
    else:
        yield from _onward_routes(network, starts)


def _official_routes(
    network: LaneletNetwork, problem: PlanningProblem, starts: list[int]
) -> list[tuple[int, ...]]:
    """Routes of the CommonRoad route planner, those from the best aligned start first."""
    try:
        planner = RoutePlanner(network, problem, logging_level=logging.CRITICAL)
        routes = [tuple(route.lanelet_ids) for route in planner.plan_routes()]
    except Exception:  # the planner raises bare exceptions of many kinds; the search below follows
        return []
    return sorted((r for r in routes if r and r[0] in starts), key=lambda r: starts.index(r[0]))


def _searched_routes(
    network: LaneletNetwork, starts: list[int], goals: set[int]
) -> Iterator[tuple[int, ...]]:
    """Shortest simple paths of the lanelet graph, lane changes penalised."""
    graph = _graph(network)
    paths: list[tuple[float, tuple[int, ...]]] = []
    for start in starts:
        for goal in sorted(goals):
            if start == goal:
                paths.append((0.0, (start,)))
            elif nx.has_path(graph, start, goal):
                simple = nx.shortest_simple_paths(graph, start, goal, weight="length")
                paths += [(_length(graph, p), tuple(p)) for p in islice(simple, PATHS_TRIED)]
    if not paths:
        return
    paths.sort()
    limit = DETOUR_FACTOR * paths[0][0] + DETOUR_SLACK
    yield from (path for length, path in paths if length <= limit)


def _graph(network: LaneletNetwork) -> nx.DiGraph:
    graph = nx.DiGraph()
    for lanelet in network.lanelets:
        length = float(lanelet.distance[-1])
        for successor in lanelet.successor:
            graph.add_edge(lanelet.lanelet_id, successor, length=length)
        for neighbour in neighbours(lanelet):
            graph.add_edge(lanelet.lanelet_id, neighbour, length=LANE_CHANGE_PENALTY)
        graph.add_node(lanelet.lanelet_id)
    return graph


def neighbours(lanelet: Lanelet) -> list[int]:
    """Neighbouring lanelets of the same direction, left before right."""
    left = lanelet.adj_left if lanelet.adj_left_same_direction else None
    right = lanelet.adj_right if lanelet.adj_right_same_direction else None
    return [i for i in (left, right) if i is not None]


def beside(network: LaneletNetwork, lanes: Iterable[int]) -> set[int]:
    """Lanelets with all those beside them of the same direction."""
    found, open_ = set(lanes), list(lanes)
    while open_:
        for neighbour in neighbours(network.find_lanelet_by_id(open_.pop())):
            if neighbour not in found:
                found.add(neighbour)
                open_.append(neighbour)
    return found


def _length(graph: nx.DiGraph, path: list[int]) -> float:
    return float(sum(graph.edges[a, b]["length"] for a, b in pairwise(path)))


def _onward_routes(network: LaneletNetwork, starts: list[int]) -> Iterator[tuple[int, ...]]:
    """Ways on without a goal: from each start along every branch, breadth of turns first."""
    for start in starts:
        queue: list[tuple[int, ...]] = [(start,)]
        while queue:
            path = queue.pop(0)
            lanelet = network.find_lanelet_by_id(path[-1])
            onward = [s for s in sorted(lanelet.successor) if s not in path]
            if not onward or len(path) >= SURVIVAL_DEPTH:
                yield path
            else:
                queue = [(*path, s) for s in onward] + queue
