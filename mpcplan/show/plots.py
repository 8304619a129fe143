"""The figure of a run: the road seen from above, and strips over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec

from mpcplan.show.rules import RULE_STRIPS, draw_rules
from mpcplan.show.scene import draw_scene, view_centre, view_size
from mpcplan.show.strips import STRIPS, draw_strips
from mpcplan.show.traffic import traffic_of

if TYPE_CHECKING:
    from mpcplan.rules.judge import RulesDriven
    from mpcplan.simulate.run import Run

_DPI = 110
_WIDE = (13.0, 9.5)  # inches, the road above 2 x 3 strips
_TALL = (13.0, 8.5)  # inches, the road beside a column of 6 strips
_BETWEEN = 0.08  # of a strip, between two columns of them, for each column
_TEXT = 110  # characters of the title


def plot_run(run: Run, path: str | Path | None = None, rules: Sequence[RulesDriven] = ()) -> Figure:
    """Road, traffic, planned and driven trajectories, and the driven states over time.

    Needs no display and leaves pyplot's global state alone.

    Args:
        run: what was driven; of several planning problems, all are drawn.
        path: file to write; its suffix (.png, .pdf, .svg) selects the format. None for no file.
        rules: how each drive kept the traffic rules, for two more strips; none without them.

    Returns:
        The figure.
    """
    size = view_size(run)
    wide = bool(size[0] >= size[1])
    count = len(STRIPS) + (len(RULE_STRIPS) if rules else 0)
    figure = Figure(figsize=_WIDE if wide else (_TALL[0], _TALL[1] * count / len(STRIPS)), dpi=_DPI)
    FigureCanvasAgg(figure)
    scene, strips = (_wide_axes if wide else _tall_axes)(figure, count)
    traffic = traffic_of(run)
    _frame(scene, figure, view_centre(run), size)
    draw_scene(scene, run, traffic)
    draw_strips(strips[: len(STRIPS)], run, traffic)
    if rules:
        draw_rules(strips[len(STRIPS) :], rules, run)
    figure.suptitle(_title(run), x=0.5, y=0.985, fontsize=12)
    if path is not None:
        figure.savefig(path)
    return figure


def _wide_axes(figure: Figure, count: int) -> tuple[Axes, list[Axes]]:
    outer = figure.add_gridspec(
        2, 1, height_ratios=[1.55, 1], left=0.06, right=0.94, top=0.925, bottom=0.06, hspace=0.17
    )
    columns = count // 2
    inner = outer[1].subgridspec(2, columns, hspace=0.16, wspace=_BETWEEN * columns)
    return figure.add_subplot(outer[0]), _shared(
        figure, [inner[i, j] for j in range(columns) for i in (0, 1)]
    )


def _tall_axes(figure: Figure, count: int) -> tuple[Axes, list[Axes]]:
    outer = figure.add_gridspec(
        1, 2, width_ratios=[1.4, 1], left=0.06, right=0.98, top=0.925, bottom=0.06, wspace=0.3
    )
    inner = outer[1].subgridspec(count, 1, hspace=0.25)
    return figure.add_subplot(outer[0]), _shared(figure, [inner[i] for i in range(count)])


def _shared(figure: Figure, cells: list[SubplotSpec]) -> list[Axes]:
    """Axes that share the time axis."""
    strips: list[Axes] = []
    for cell in cells:
        strips.append(figure.add_subplot(cell, sharex=strips[0] if strips else None))
    return strips


def _frame(axes: Axes, figure: Figure, centre: np.ndarray, size: np.ndarray) -> None:
    """Limits around the centre, in equal scales, that fill the panel and show at least the size."""
    panel = np.array(axes.get_position().size) * figure.get_size_inches()
    half = panel * (size / panel).max() / 2
    axes.set_xlim(centre[0] - half[0], centre[0] + half[0])
    axes.set_ylim(centre[1] - half[1], centre[1] + half[1])
    axes.set_aspect("equal", adjustable="box")


def _title(run: Run) -> str:
    text = f"{run.loaded.id}: " + ("solved" if run.solved else f"not solved, {run.cause}")
    return text if len(text) <= _TEXT else f"{text[: _TEXT - 3]}..."
