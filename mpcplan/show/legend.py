"""Names of what moves on a picture of a planning cycle, and the scale of its road."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from mpcplan.show import colours

_LENGTHS = (1, 2, 5, 10, 20, 50, 100, 200, 500)  # m, of the scale
_SHARE = 0.5  # of the radius, the scale is at most so long


def draw_legend(figure: Figure) -> None:
    """One line at the bottom."""
    entries = [
        Line2D([], [], color=colours.of_problem(0), lw=2, label="driven"),
        Line2D([], [], color=colours.CHOSEN, lw=1.6, marker="o", ms=3, label="plan, every second"),
        Line2D([], [], color=colours.CHOSEN, lw=1, ls=":", label="other options"),
        Patch(facecolor=f"{colours.CORRIDOR}30", edgecolor=colours.CORRIDOR, label="corridor"),
        Line2D([], [], color=colours.ACCEPTED, lw=1, marker=".", ms=5, label="candidate"),
        Line2D([], [], color=colours.ALARM, lw=1, ls="--", label="in somebody's way"),
        Line2D([], [], color=colours.REFUSED, lw=1, label="refused otherwise"),
        Patch(facecolor=colours.TRAFFIC, edgecolor="#7a5200", label="others"),
        Patch(facecolor="none", edgecolor=colours.TRAFFIC, label="predicted, every second"),
        Patch(facecolor="none", edgecolor=colours.ALARM, lw=2, label="feared"),
        Patch(facecolor=f"{colours.GOAL}38", edgecolor=colours.GOAL, hatch="//", label="goal"),
    ]
    figure.legend(
        handles=entries, loc="lower left", bbox_to_anchor=(0.005, 0.0), ncols=len(entries),
        frameon=False, fontsize=7.5, handlelength=1.6, columnspacing=1.1, handletextpad=0.5,
    )  # fmt: skip


def scale_length(radius: float) -> int:
    """A round length [m] that is at most half the radius [m] of a view."""
    return max((one for one in _LENGTHS if one <= _SHARE * radius), default=_LENGTHS[0])
