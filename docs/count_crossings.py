"""How many of the scenarios whose way crosses lanes of others a benchmark has solved.

    python docs/count_crossings.py SCENARIOS RESULTS

A scenario counts where, on the most direct route from the start to the goal, the centre line of
another lane crosses (forks and merges alone do not make a crossing).
"""

import argparse
from pathlib import Path

import numpy as np
from make_ablation import read

from mpcplan import load
from mpcplan.config import Config
from mpcplan.predict.lanes import Lanes
from mpcplan.predict.right_of_way import conflicts
from mpcplan.reassociate import planned_roads
from mpcplan.road.road import Road
from mpcplan.scenario import LoadedScenario
from mpcplan.task import task_of

PAST = 5.0  # m, past the goal's begin a crossing still counts
ASIDE = 3.0  # m, from the reference: the crossing is on the way


def crosses(loaded: LoadedScenario) -> bool:
    """Whether other lanes cross the way of a scenario's first planning problem."""
    task = task_of(loaded, loaded.problems[0])
    problem = task.problem.planning_problem
    lanes = Lanes(task.road_map.lanelet_network)
    road = planned_roads(task.road_map, problem, Config())[0]
    start = float(road.frame.to_frenet(np.array([problem.initial_state.position]))[0][0])
    goal = max((goal.s[0] for goal in road.goals if goal.s is not None), default=road.frame.s[-1])
    met = conflicts(task.road_map.lanelet_network, lanes)
    return any(
        _on_way(road, _point(lanes, lanelet, conflict.at), start, goal + PAST)
        for lanelet in road.route.lanelets
        for conflict in met.get(lanes.index[lanelet], ())
        if not conflict.merges
    )


def _point(lanes: Lanes, lanelet: int, s: float) -> np.ndarray:
    """(1, 2) point on a lanelet's centre line."""
    lane = lanes.lanes[lanes.index[lanelet]]
    return np.array([[np.interp(s, lane.s, lane.points[:, axis]) for axis in range(2)]])


def _on_way(road: Road, point: np.ndarray, start: float, end: float) -> bool:
    s, d = road.frame.to_frenet(point)
    return bool(start < s[0] < end and abs(d[0]) < ASIDE)


def main() -> None:
    """Command line entry."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", type=Path, help="folder of scenarios")
    parser.add_argument("results", type=Path, help="results of bench over them")
    arguments = parser.parse_args()
    rows = read(arguments.results)
    counted, lost = 0, []
    for path in sorted(arguments.scenarios.iterdir()):
        loaded = load(path)
        if loaded.id in rows and crosses(loaded):
            counted += 1
            if rows[loaded.id]["valid"] != "True":
                lost.append(loaded.id)
    print(f"{counted - len(lost)} of {counted} solved; not: {', '.join(lost) or 'none'}")


if __name__ == "__main__":
    main()
