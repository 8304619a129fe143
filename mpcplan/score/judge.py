"""The verdict on a run: on its own traffic, and with the ego one time step late.

A recorded scenario is judged as published. An interactive one is judged on the traffic that was
simulated with it (lag 0). The organisers of the competition replay solutions one step late (lag 1):
the replayed traffic is written too, the official collision check is done on it, and the late ego
itself must not touch anyone either.
"""

from dataclasses import dataclass
from pathlib import Path

from mpcplan.errors import MpcplanError
from mpcplan.score.referee import check, evaluate
from mpcplan.score.verdict import Verdict
from mpcplan.simulate.replay import replay
from mpcplan.simulate.run import Run
from mpcplan.simulate.simulated_scenario import write_simulated

LATE = 1  # time steps by which the organisers' replay is late


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


def judge_run(run: Run, folder: Path, timeout_s: float = 180.0) -> Judgement:
    """Writes solution and simulated traffic into a folder and judges them.

    Raises:
        RefereeError: the checker died twice.
    """
    solution = run.write_solution(folder)
    if not run.loaded.interactive:
        return Judgement(evaluate(run.loaded.path, solution, timeout_s), None, (solution,))
    simulated = write_simulated(
        run.loaded, run.drives[0].others, folder / f"{run.loaded.id}.simulated.cr.xml",
        "the traffic as simulated with the solution",
    )  # fmt: skip
    verdict = evaluate(simulated, solution, timeout_s)
    if not verdict.valid:
        return Judgement(verdict, None, (solution, simulated))
    late_path = folder / f"{run.loaded.id}.late.cr.xml"
    late = judge_late(run, solution, late_path, timeout_s)
    files = (solution, simulated, *([late_path] if late_path.exists() else []))
    return Judgement(verdict, late, files)


def judge_late(run: Run, solution: Path, path: Path, timeout_s: float) -> Late:
    """Replays a run one step late, writes that traffic to ``path`` and judges it."""
    drive, problem = run.drives[0], run.loaded.problems[0]
    try:
        late = replay(run.loaded, problem, drive.trajectory, LATE)
    except MpcplanError as error:
        return Late(False, f"the replay failed: {error}")
    note = f"the traffic as simulated with the ego {LATE} time step late"
    write_simulated(run.loaded, late.others, path, note)
    ok, reason = check("no_collision", path, solution, timeout_s)
    if ok and late.hit is not None:
        step, obstacle = late.hit
        return Late(False, f"the late ego touches obstacle {obstacle} at step {step}")
    return Late(ok, "" if ok else f"no_collision: {reason}")
