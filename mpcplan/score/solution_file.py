"""Solution files of any planner, read and checked."""

from pathlib import Path

import numpy as np
from commonroad.common.solution import CommonRoadSolutionReader, Solution

from mpcplan.errors import InputError


def read_solution(path: Path) -> Solution:
    """The solution file; raises InputError when it is broken or a value in it not finite."""
    try:
        solution = CommonRoadSolutionReader.open(str(path))
    except Exception as error:  # the reader raises whatever the broken place makes it raise
        raise InputError(f"{path} is not a readable solution: {error}") from error
    for part in solution.planning_problem_solutions:
        for state in part.trajectory.state_list:
            values = [getattr(state, name) for name in state.used_attributes]
            if not all(np.all(np.isfinite(value)) for value in values):
                raise InputError(
                    f"{path}: problem {part.planning_problem_id}, step {state.time_step}: "
                    "a value is not a finite number"
                )
    return solution
