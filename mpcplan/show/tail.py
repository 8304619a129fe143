"""How a plan is verified: the part that is driven, the part that is checked, and its tail.

Where the others' motion is a guess, a plan is verified as far as the guess is good, and with a
fail-safe tail from there (:mod:`mpcplan.verify.guard`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from mpcplan.observation import box_corners
from mpcplan.show import colours
from mpcplan.show.cycles import LookedInto, Moment
from mpcplan.show.scene import draw_map
from mpcplan.trajectory import Array, State, Trajectory
from mpcplan.vehicle import centres, rectangles
from mpcplan.verify.drivability import Finding, separation
from mpcplan.verify.guard import Guard

_DPI = 110
_SIZE = (13.0, 7.2)  # inches
_AROUND = 12.0  # m, shown around the plan
_EVERY = 0.5  # s, between drawn rectangles
_FAR = 30.0  # m, gaps above this are not shown
DRIVEN, CHECKED, TAIL = "driven before the next cycle", "verified", "fail-safe tail"
_COLOURS = {DRIVEN: colours.of_variant(1), CHECKED: colours.of_variant(0), TAIL: colours.ALARM}


@dataclass(frozen=True, eq=False)
class Verified:
    """What verification looked at.

    Attributes:
        trajectory: the plan as far as it is verified, with its tail.
        parts: the trajectory's parts by name; each begins with the last state of the one before.
        gap: (k,) to the nearest predicted body [m]; infinite for none.
        margin: that is asked for [m].
        finding: of verification.
    """

    trajectory: Trajectory
    parts: dict[str, Trajectory]
    gap: Array
    margin: float
    finding: Finding


def verified(moment: Moment, dt: float) -> Verified:
    """What verification of a cycle's plan looks at; done again."""
    guard, plan, forecast = Guard(moment.config, dt), moment.plan.trajectory, moment.forecast
    far = plan.last_step if forecast.exact else moment.step + guard.certain
    whole = guard.broken_off(plan, moment.onward, far) if far < plan.last_step else plan
    far = min(far, whole.last_step)
    soon = min(moment.step + round(moment.config.drive.replan / dt), far)
    parts = {DRIVEN: whole.until(soon), CHECKED: whole.since(soon).until(far)}
    if whole.last_step > far:
        parts[TAIL] = whole.since(far)
    boxes = forecast.at(whole.steps)
    gap = np.nan_to_num(separation(whole.states, boxes), nan=np.inf)
    finding = guard.verify(plan, moment.onward, forecast, moment.step)
    margin = moment.config.verify.margin
    return Verified(whole, parts, gap.min(axis=0, initial=np.inf), margin, finding)


def plot_tail(looked: LookedInto, moment: Moment) -> Figure:
    """Draws a plan's parts on the map, its speed and its gap to the nearest predicted body.

    Args:
        looked: the run, for the map.
        moment: one of its cycles.

    Returns:
        The figure.
    """
    dt = looked.run.loaded.dt
    found = verified(moment, dt)
    figure = Figure(figsize=_SIZE, dpi=_DPI)
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        2, 2, width_ratios=[1.4, 1], left=0.06, right=0.97, top=0.86, bottom=0.09, hspace=0.28,
        wspace=0.18,
    )  # fmt: skip
    _draw_parts(figure.add_subplot(grid[:, 0]), looked, moment, found)
    speed = figure.add_subplot(grid[0, 1])
    gap = figure.add_subplot(grid[1, 1], sharex=speed)
    for name, part in found.parts.items():
        time = part.steps * dt
        speed.plot(time, part.states[:, State.V], color=_COLOURS[name], lw=1.8)
        gaps = found.gap[part.steps - found.trajectory.first_step]
        shown = np.where(gaps <= _FAR, gaps, np.nan)
        gap.plot(time, shown, color=_COLOURS[name], lw=1.8)
    gap.axhline(found.margin, ls="--", color=colours.LIMIT, lw=0.9)
    gap.annotate(f"margin {found.margin:g} m", (found.trajectory.first_step * dt, found.margin),
                 textcoords="offset points", xytext=(2, 3), fontsize=8)  # fmt: skip
    _name(speed, "speed [m/s]")
    _name(gap, f"gap to the nearest predicted body [m], up to {_FAR:g} m")
    gap.set_xlabel("time t [s]", fontsize=9)
    figure.suptitle(f"plan of time step {moment.step}: {moment.plan.source}; {found.finding}")
    return figure


def _name(axes: Axes, title: str) -> None:
    axes.set_title(title, loc="left", fontsize=10)
    axes.set_ylim(bottom=0.0)
    axes.grid(color=colours.GRID, lw=0.6)
    axes.set_axisbelow(True)


def _draw_parts(axes: Axes, looked: LookedInto, moment: Moment, found: Verified) -> None:
    """Body and path of each part, and where the others are predicted when the tail begins."""
    points = centres(found.trajectory.states)
    low, high = points.min(axis=0) - _AROUND, points.max(axis=0) + _AROUND
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    draw_map(axes, looked.run)
    every = max(1, round(_EVERY / looked.run.loaded.dt))
    for name, part in found.parts.items():
        bodies = rectangles(part.states[::every])
        axes.add_collection(
            PolyCollection(
                list(bodies), facecolors=f"{_COLOURS[name]}30", edgecolors=_COLOURS[name], lw=0.8,
                zorder=5,
            )
        )  # fmt: skip
        axes.plot(*centres(part.states).T, color=_COLOURS[name], lw=1.8, label=name, zorder=6)
    begin = next(reversed(found.parts.values())).first_step
    boxes = moment.forecast.at(np.array([begin]))[:, 0]
    boxes = boxes[np.isfinite(boxes[:, 0])]
    axes.add_collection(
        PolyCollection(
            list(box_corners(boxes)), facecolors=f"{colours.TRAFFIC}70", edgecolors=colours.TRAFFIC,
            zorder=4, label=f"others as predicted for {begin * looked.run.loaded.dt:.1f} s",
        )
    )  # fmt: skip
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.legend(fontsize=8, loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2, frameon=False)
