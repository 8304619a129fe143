"""The refinement's problems of a run, as they came up."""

from dataclasses import dataclass
from pathlib import Path

from mpcplan.config import Config
from mpcplan.planner import Planner
from mpcplan.refine.problem import Problem
from mpcplan.scenario import load
from mpcplan.simulate.loop import drive
from mpcplan.task import Task

GOES_ON, TO_GOAL = "goes on", "to the goal"


@dataclass(frozen=True, eq=False)
class Recorded:
    """One problem.

    Attributes:
        scenario: in which it came up.
        kind: of a plan that goes on, or of a fresh seed the whole way to the goal.
        problem: the problem itself.
    """

    scenario: str
    kind: str
    problem: Problem


def record_problems(path: Path, config: Config) -> list[Recorded]:
    """All problems of driving one scenario.

    Raises:
        InputError: the scenario cannot be read.
    """
    loaded, found = load(path), []

    def watch(problem: Problem, fresh: bool) -> None:
        found.append(Recorded(loaded.id, TO_GOAL if fresh else GOES_ON, problem))

    def planner(task: Task, config: Config) -> Planner:
        return Planner(task, config, watch)

    drive(loaded, config, planner=planner)
    return found


def chosen(
    problems: list[Recorded], kind: str, steps: tuple[int, int], most: int
) -> list[Recorded]:
    """At most so many of one kind and length, evenly over all."""
    fitting = [p for p in problems if p.kind == kind and steps[0] <= p.problem.n <= steps[1]]
    every = max(-(-len(fitting) // most), 1)
    return fitting[::every]
