"""The verdict on a run: on its own traffic, and with the ego one time step late.

A recorded scenario is judged as published. An interactive one is judged on the traffic that was
simulated with it (lag 0). The organisers of the competition replay solutions one step late (lag 1):
the replayed traffic is written too, the official collision check is done on it, and the late ego
itself must not touch anyone either.
"""

from dataclasses import dataclass
from pathlib import Path

from mpcplan.errors import MpcplanError
from mpcplan.score.referee import evaluate, evaluate_with_late
from mpcplan.score.referee_start import Start, as_program
from mpcplan.score.verdict import Verdict
from mpcplan.simulate.replay import Replay, replay
from mpcplan.simulate.run import Run
from mpcplan.simulate.simulated_scenario import write_simulated

LAG = 1  # time steps by which the organisers' replay is late


@dataclass(frozen=True)
class Late:
    """The verdict with the ego one time step late: valid or not, and why not."""

    valid: bool
    cause: str


@dataclass(frozen=True)
class Judgement:
    """All that is said of a run.

    Attributes:
        verdict: the official checker's, on the run's own traffic.
        late: the same with the ego one step late; None for recorded scenarios, and where the run
            is not valid on time.
        files: the solution, then the scenarios of simulated traffic.
    """

    verdict: Verdict
    late: Late | None
    files: tuple[Path, ...]


def judge_run(
    run: Run, folder: Path, timeout_s: float = 180.0, start: Start = as_program
) -> Judgement:
    """Writes solution and simulated traffic into a folder and judges them.

    Args:
        run: what was driven.
        folder: for the files.
        timeout_s: time limit of one of the referee's child processes [s].
        start: starts those.

    Raises:
        RefereeError: the checker died twice.
    """
    solution = run.write_solution(folder)
    if not run.loaded.interactive:
        return Judgement(evaluate(run.loaded.path, solution, timeout_s, start), None, (solution,))
    simulated = write_simulated(
        run.loaded, run.drives[0].others, folder / f"{run.loaded.id}.simulated.cr.xml",
        "the traffic as simulated with the solution",
    )  # fmt: skip
    files = (solution, simulated)
    if not run.solved:
        return Judgement(evaluate(simulated, solution, timeout_s, start), None, files)
    try:
        late = replay(run.loaded, run.loaded.problems[0], run.drives[0].trajectory, LAG)
    except MpcplanError as error:
        verdict = evaluate(simulated, solution, timeout_s, start)
        return _judgement(verdict, Late(False, f"the replay failed: {error}"), files)
    path = write_simulated(
        run.loaded, late.others, folder / f"{run.loaded.id}.late.cr.xml",
        f"the traffic as simulated with the ego {LAG} time step late",
    )  # fmt: skip
    verdict, free, reason = evaluate_with_late(simulated, path, solution, timeout_s, start)
    return _judgement(verdict, _late(late, free, reason), (*files, path))


def _late(late: Replay, free: bool, reason: str) -> Late:
    """The verdict one step late, from the replay and the official check on its traffic."""
    if not free:
        return Late(False, f"no_collision: {reason}")
    if late.hit is not None:
        step, obstacle = late.hit
        return Late(False, f"the late ego touches obstacle {obstacle} at step {step}")
    return Late(True, "")


def _judgement(verdict: Verdict, late: Late, files: tuple[Path, ...]) -> Judgement:
    """What is not valid on time is not asked to be so late."""
    return Judgement(verdict, late if verdict.valid else None, files)
