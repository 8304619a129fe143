"""Bounds as they are judged: solutions written and evaluated by the official checker.

A recorded scenario is its own traffic. Of an interactive one the bound is sought on the traffic
that was simulated with a run, and it arrives no later than the run did: what the others would have
done after that nobody knows.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mpcplan.bound.clairvoyant import Clairvoyant, Optimum
from mpcplan.config import Config
from mpcplan.errors import BoundError
from mpcplan.scenario import LoadedScenario, load
from mpcplan.score.judge import Judgement
from mpcplan.score.referee import evaluate
from mpcplan.score.referee_start import Start, as_program
from mpcplan.score.verdict import Verdict
from mpcplan.simulate.run import Drive, Run
from mpcplan.task import task_of
from mpcplan.trajectory import State, Trajectory

SIMULATED = ".simulated.cr.xml"


@dataclass(frozen=True, eq=False)
class Bound:
    """A bound with its verdict.

    Attributes:
        optima: of every planning problem.
        run: the optima as a run.
        verdict: the official checker's, valid.
        solution: the file.
    """

    optima: tuple[Optimum, ...]
    run: Run
    verdict: Verdict
    solution: Path

    @property
    def tr1(self) -> float:
        """TR1 under the checker's weights."""
        assert self.verdict.tr1 is not None  # a valid solution has its cost
        return self.verdict.tr1

    @property
    def words(self) -> str:
        """How it came about and what was enumerated."""
        return "; ".join(
            f"{o.source}, {o.label}; {o.found} ways, {o.refined} refined, {o.verified} verified"
            for o in self.optima
        )


def bound_of(
    loaded: LoadedScenario, config: Config, folder: Path, start: Start = as_program,
    driven: dict[int, Trajectory] | None = None, in_time: bool = False,
) -> Bound:  # fmt: skip
    """The bound of a scenario with recorded traffic.

    Args:
        loaded: the scenario.
        config: the planner's weights and margins, and how much is enumerated.
        folder: for the solution file.
        start: starts the referee's child processes.
        driven: trajectories by problem, in the scenario's coordinates: ways to begin from.
        in_time: whether the bound has to arrive no later than these.

    Raises:
        BoundError: no way to the goal was found, or the official checker refuses the best one.
        RoadError: no route leads to the goal.
    """
    optima = []
    for problem in loaded.problems:
        known = driven.get(problem.id) if driven is not None else None
        last = known.last_step if known is not None and in_time else None
        search = Clairvoyant(task_of(loaded, problem), config, last)
        optima.append(search.optimum(known))
    drives = [
        Drive(problem.id, optimum.trajectory, optimum.trajectory.last_step, "", (), False)
        for problem, optimum in zip(loaded.problems, optima, strict=True)
    ]
    run = Run(loaded, config, tuple(drives))
    solution = run.write_solution(folder)
    verdict = evaluate(loaded.path, solution, start=start)
    if not verdict.valid or verdict.tr1 is None:
        raise BoundError(f"the official checker refuses the best way: {verdict.cause}")
    return Bound(tuple(optima), run, verdict, solution)


def bound_of_run(run: Run, judgement: Judgement, folder: Path, start: Start = as_program) -> Bound:
    """The bound on the traffic of a run that reached its goals; see :func:`bound_of`."""
    loaded = run.loaded
    if loaded.interactive:
        loaded = load(next(f for f in judgement.files if f.name.endswith(SIMULATED)))
    shift = run.loaded.origin - loaded.origin
    driven = {drive.problem_id: _moved(drive.trajectory, shift) for drive in run.drives}
    return bound_of(loaded, run.config, folder, start, driven, in_time=run.loaded.interactive)


def _moved(trajectory: Trajectory, shift: np.ndarray) -> Trajectory:
    """The trajectory in coordinates whose origin lies elsewhere."""
    states = trajectory.states.copy()
    states[:, [State.X, State.Y]] += shift
    return replace(trajectory, states=states)
