"""One scenario driven by several configurations: drives, verdicts, a table of both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite, nan
from pathlib import Path

from matplotlib.figure import Figure

from mpcplan.bench.table import align
from mpcplan.config import Config
from mpcplan.scenario import load
from mpcplan.score.judge import judge_run
from mpcplan.score.tr1 import CHECKER_WEIGHTS, PARTS, tr1
from mpcplan.show.comparison import Compared, plot_comparison
from mpcplan.show.quantities import ACCELERATION, GAP, SPEED, STEERING_RATE, jerk_of
from mpcplan.simulate.loop import drive

NO_COST: Mapping[str, float] = dict.fromkeys(PARTS, nan)


def drive_variants(
    path: str | Path, configs: Mapping[str, Config], folder: str | Path
) -> list[Compared]:
    """Drives a scenario once with every configuration and has each drive judged.

    Args:
        path: the scenario.
        configs: by the names that the figures show.
        folder: for the solution files, in a folder for each name.

    Returns:
        The drives in the order of the configurations; the name of one that is not valid says so.

    Raises:
        InputError: the scenario cannot be read.
        RefereeError: the official checker died twice.
    """
    loaded, compared = load(path), []
    for name, config in configs.items():
        run = drive(loaded, config)
        if not run.driven:
            compared.append(Compared(f"{name} (not driven)", run, NO_COST))
            continue
        verdict = judge_run(run, Path(folder) / name).verdict
        told = name if verdict.valid else f"{name} (not valid)"
        compared.append(Compared(told, run, verdict.parts or NO_COST))
    return compared


def plot_variants(compared: Sequence[Compared], path: str | Path | None = None) -> Figure:
    """The drives' paths, what the terms of TR1 are made of over time, and TR1 by its parts.

    Args:
        compared: drives of one scenario; traffic and road are those of the first.
        path: file to write, see :func:`mpcplan.show.comparison.plot_comparison`.

    Returns:
        The figure.
    """
    jerk = jerk_of(compared[0].run)
    return plot_comparison(compared, path, (SPEED, ACCELERATION, jerk, STEERING_RATE, GAP))


def told(compared: Sequence[Compared]) -> str:
    """The drives as a table: TR1 with its weighted parts, and why a goal was not reached."""
    lines: list[tuple[str, ...]] = [("drive", "TR1", *PARTS, "cycles")]
    for one in compared:
        parts = [CHECKER_WEIGHTS[part] * one.parts[part] for part in PARTS]
        costs = [f"{value:.3f}" if isfinite(value) else "-" for value in (tr1(one.parts), *parts)]
        cycles = sum(len(driven.cycles) for driven in one.run.drives)
        lines.append((one.name, *costs, str(cycles)))
    causes = [f"{one.name}: {one.run.cause}" for one in compared if one.run.cause]
    return "\n".join([align(lines), *causes])
