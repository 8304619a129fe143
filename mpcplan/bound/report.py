"""One scenario's bound in a few lines, for the command line."""

from pathlib import Path

from mpcplan.bound.judged import bound_of, bound_of_run
from mpcplan.config import Config
from mpcplan.errors import BoundError
from mpcplan.scenario import LoadedScenario, load
from mpcplan.score.judge import Judgement, judge_run
from mpcplan.score.tr1 import CHECKER_WEIGHTS
from mpcplan.simulate.loop import Progress, drive
from mpcplan.simulate.run import Run


def bound_lines(path: Path, config: Config, folder: Path, tell: Progress | None) -> list[str]:
    """The bound of one scenario; an interactive one is driven first, for its traffic.

    Raises:
        InputError: the scenario cannot be read.
        MpcplanError: there is no bound, and why.
    """
    loaded, beside = load(path), ""
    if loaded.interactive:
        run, judgement = _driven(loaded, config, folder / "driven", tell)
        found = bound_of_run(run, judgement, folder)
        if judgement.verdict.tr1 is not None:
            beside = f"; driven {judgement.verdict.tr1:.3f}"
    else:
        found = bound_of(loaded, config, folder)
    parts = found.verdict.parts or {}
    told = ", ".join(f"{name} {CHECKER_WEIGHTS[name] * parts[name]:.3f}" for name in parts)
    return [
        f"{loaded.id}: TR1 {found.tr1:.3f} ({told}){beside}",
        f"{'by':<10}{found.words}",
        f"{'file':<10}{found.solution}",
    ]


def _driven(
    loaded: LoadedScenario, config: Config, folder: Path, tell: Progress | None
) -> tuple[Run, Judgement]:
    """An interactive scenario's run, and what is said of it; raises BoundError where it failed."""
    run = drive(loaded, config, tell)
    if not run.solved:
        raise BoundError(f"no bound without a drive that reaches the goal: {run.cause}")
    return run, judge_run(run, folder)
