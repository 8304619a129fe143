"""The rules' robustness over time: one strip for each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mpcplan.show import colours
from mpcplan.show.strips import mark_goal_times, prepare_strip

if TYPE_CHECKING:
    from mpcplan.rules.judge import Robustness, RulesDriven
    from mpcplan.simulate.run import Run

RULE_STRIPS = ("rule R_G1 [m]", "rule R_G4 [m/s]")
MOST = 40.0  # m or m/s, more robustness than this is not shown
LEAST_HIGH = 5.0  # m or m/s, the scale reaches this far above 0 at least,
LEAST_LOW = -1.0  # and this far below
_DPI = 110
_SIZE = (13.0, 5.0)  # inches


def plot_rules(rules: Sequence[RulesDriven], run: Run) -> Figure:
    """Draws the robustness of R_G1 and R_G4 over a run.

    Args:
        rules: how each drive kept them, see :func:`mpcplan.simulate.rules.rules_of`.
        run: what was driven.

    Returns:
        The figure.
    """
    figure = Figure(figsize=_SIZE, dpi=_DPI)
    FigureCanvasAgg(figure)
    strips = list(figure.subplots(len(RULE_STRIPS), 1, sharex=True))
    draw_rules(strips, rules, run)
    for axes, rule in zip(strips, ("safe_distance", "traffic_flow"), strict=True):
        if not any(np.isfinite(getattr(drive, rule).values).any() for drive in rules):
            axes.text(0.5, 0.5, "the rule demands nothing", transform=axes.transAxes, ha="center")
    kept = ", ".join(drive.kept for drive in rules)
    figure.suptitle(f"robustness of the traffic rules (safe distance: {kept})", fontsize=12)
    figure.tight_layout()
    return figure


def draw_rules(strips: Sequence[Axes], rules: Sequence[RulesDriven], run: Run) -> None:
    """Draws the strips named in :data:`RULE_STRIPS`; broken rules lie below the dashed line.

    There is no line where a rule demands nothing.
    """
    for index, drive in enumerate(rules):
        colour = colours.of_problem(index)
        for axes, rule in zip(strips, (drive.safe_distance, drive.traffic_flow), strict=True):
            _draw(axes, rule, run.loaded.dt, colour)
    for axes, label in zip(strips, RULE_STRIPS, strict=True):
        prepare_strip(axes, label)
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, LEAST_LOW), min(max(1.05 * high, LEAST_HIGH), MOST))
        axes.axhline(0.0, ls="--", color=colours.LIMIT, lw=0.9)
    mark_goal_times(strips, run)


def _draw(axes: Axes, rule: Robustness, dt: float, colour: str) -> None:
    """One rule over time, alarming where it is broken."""
    time = (rule.first_step + np.arange(len(rule.values))) * dt
    shown = np.where(np.isfinite(rule.values), rule.values, np.nan)
    axes.plot(time, shown, ".-", ms=2, color=colour)
    axes.plot(time, np.where(shown < 0, shown, np.nan), ".", ms=4, color=colours.ALARM)
