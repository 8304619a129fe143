"""The sampled lattice of one planning cycle: its paths, its profiles, and what refused whom."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from mpcplan.observation import box_corners
from mpcplan.predict.occupancy import occupancy
from mpcplan.seed.judge import TOLERANCE
from mpcplan.seed.lattice import Judged, judge_all
from mpcplan.seed.seed import COLLISION
from mpcplan.show import colours
from mpcplan.show.cycles import LookedInto, Moment
from mpcplan.show.scene import draw_map
from mpcplan.trajectory import Array
from mpcplan.vehicle import centres, rectangles

ACCEPTED, COLLIDES, OTHERWISE = "accepted", "refused: collision", "refused otherwise"
_COLOURS = {
    ACCEPTED: colours.of_variant(0), COLLIDES: colours.TRAFFIC, OTHERWISE: colours.EDGE,
}  # fmt: skip
_DPI = 110
_SIZE = (13.0, 8.0)  # inches
_SHOWN = 500  # candidates drawn at most, evenly among all
_AROUND = 12.0  # m, shown around the paths
_BESIDE = 1.0  # m, who reaches this near to the reference path is drawn over time


@dataclass(frozen=True, eq=False)
class Candidates:
    """The lattice of a planning cycle, judged again.

    Attributes:
        judged: all candidates.
        s: (p, i, m) arc length [m] at the times looked at; NaN after a candidate's end.
        verdict: (p, i) one of :data:`ACCEPTED`, :data:`COLLIDES`, :data:`OTHERWISE`.
        best: (p, i) of the cheapest that was accepted; None: none was.
    """

    judged: Judged
    s: Array
    verdict: Array
    best: tuple[int, int] | None


def candidates_of(moment: Moment, dt: float) -> Candidates:
    """The lattice on the road on which a cycle began, judged again as the cycle judged it."""
    seen, road = moment.observation, moment.road
    around = occupancy(moment.forecast, road.frame)
    found = judge_all(road, seen.state, seen.acceleration, seen.step, around, moment.config, dt)
    s = np.where(found.table.alive, _along(found), np.nan)
    hit = found.violations[COLLISION][0] > TOLERANCE
    verdict = np.where(found.accepted, ACCEPTED, np.where(hit, COLLIDES, OTHERWISE))
    best = None
    if found.accepted.any():
        cheapest = np.where(found.accepted, found.cost, np.inf).argmin()
        path, profile = np.unravel_index(cheapest, found.cost.shape)
        best = int(path), int(profile)
    return Candidates(found, s, verdict, best)


def _along(found: Judged) -> Array:
    """(p, i, m) arc length [m] of all candidates at the times looked at."""
    paths, sigma = found.paths, found.profiles.sigma[:, found.table.ks]
    grid = paths.spacing * np.arange(paths.s.shape[1])
    return np.stack([np.interp(sigma, grid, s) for s in paths.s])


def plot_candidates(looked: LookedInto, moment: Moment) -> Figure:
    """Draws the lattice: paths on the map, candidates in (t, s), refusals by constraint.

    Args:
        looked: the run, for the map.
        moment: one of its cycles.

    Returns:
        The figure.
    """
    dt = looked.run.loaded.dt
    found = candidates_of(moment, dt)
    figure = Figure(figsize=_SIZE, dpi=_DPI)
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        2, 2, width_ratios=[1.25, 1], height_ratios=[1.25, 1], left=0.11, right=0.97, top=0.9,
        bottom=0.08, hspace=0.36, wspace=0.16,
    )  # fmt: skip
    _draw_paths(figure.add_subplot(grid[0, 0]), looked, moment, found)
    _draw_profiles(figure.add_subplot(grid[:, 1]), moment, found, dt)
    _draw_refusals(figure.add_subplot(grid[1, 0]), found)
    report = found.judged.report
    figure.suptitle(
        f"lattice of time step {moment.step}: {report.candidates} candidates, "
        f"{report.accepted} accepted, {report.reaching_goal} of these reach the goal"
    )
    return figure


def _draw_paths(axes: Axes, looked: LookedInto, moment: Moment, found: Candidates) -> None:
    """The candidate paths, those with an accepted candidate on top."""
    paths = found.judged.paths
    lines = np.stack([paths.x, paths.y], axis=-1)
    usable = found.judged.accepted.any(axis=1)
    axes.set_xlim(lines[..., 0].min() - _AROUND, lines[..., 0].max() + _AROUND)
    axes.set_ylim(lines[..., 1].min() - _AROUND, lines[..., 1].max() + _AROUND)
    axes.set_aspect("equal")
    draw_map(axes, looked.run)
    for kept, name, label in (
        (~usable, OTHERWISE, "no candidate accepted"), (usable, ACCEPTED, "some accepted")
    ):  # fmt: skip
        axes.add_collection(
            LineCollection(list(lines[kept]), colors=_COLOURS[name], lw=1.0, zorder=5, label=label)
        )
    now = box_corners(moment.observation.now.boxes)
    axes.add_collection(
        PolyCollection(
            list(now), facecolors=f"{colours.TRAFFIC}90", edgecolors=colours.TRAFFIC, zorder=6
        )
    )
    state = moment.observation.state[None]
    axes.add_collection(PolyCollection(list(rectangles(state)), facecolors=colours.PLAN, zorder=6))
    x, y = centres(state)[0]
    axes.annotate(
        "ego",
        (float(x), float(y)),
        textcoords="offset points",
        xytext=(6, -12),
        fontsize=8,
        zorder=7,
    )
    axes.set_title("paths of the rear axle", loc="left", fontsize=11)
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.legend(fontsize=8, loc="lower right", bbox_to_anchor=(1, 1), ncols=2, frameon=False)


def _draw_profiles(axes: Axes, moment: Moment, found: Candidates, dt: float) -> None:
    """Candidates in (t, s), with the others that come near to the path."""
    t = dt * (moment.step + found.judged.table.ks)
    flat, names = found.s.reshape(-1, len(t)), found.verdict.ravel()
    for name in (OTHERWISE, COLLIDES, ACCEPTED):
        rows = np.flatnonzero(names == name)
        # the same share of each kind is drawn
        every = max(len(names) // _SHOWN, 1)
        lines = [np.column_stack([t, s])[np.isfinite(s)] for s in flat[rows[::every]]]
        label = f"{name} ({len(rows)})"
        axes.add_collection(LineCollection(lines, colors=_COLOURS[name], lw=0.6, label=label))
    if found.best is not None:
        axes.plot(t, found.s[found.best], color=colours.of_variant(1), lw=2.2, label="the cheapest")
    axes.set(xlim=(t[0], t[-1]), ylim=(np.nanmin(flat), np.nanmax(flat)))
    _draw_occupied(axes, moment, found, dt)
    axes.set(xlabel="time t [s]", ylabel="rear axle's s [m]")
    axes.set_title("candidates in (t, s)", loc="left", fontsize=11)
    axes.legend(fontsize=8, loc="upper left")


def _draw_occupied(axes: Axes, moment: Moment, found: Candidates, dt: float) -> None:
    """What the others occupy of the reference path."""
    window = found.judged.window
    t = dt * (moment.step + np.arange(window.s.shape[1]))
    label: str | None = "others on the reference path"
    for row in range(len(window.ids)):
        with np.errstate(invalid="ignore"):
            there = (window.d_low[row] < _BESIDE) & (window.d_high[row] > -_BESIDE)
        if not there.any():
            continue
        axes.fill_between(
            t, window.s_low[row], window.s_high[row], where=there, color=colours.PLAN, alpha=0.5,
            lw=0, label=label, zorder=4,
        )  # fmt: skip
        label = None


def _draw_refusals(axes: Axes, found: Candidates) -> None:
    """How many candidates each constraint refused, and by how little the best of them failed."""
    report = found.judged.report
    names = sorted(report.rejected, key=lambda name: report.rejected[name].count)
    counts = [report.rejected[name].count for name in names]
    shown = [_COLOURS[COLLIDES if name == COLLISION else OTHERWISE] for name in names]
    axes.barh(names, counts, color=shown)
    for name, count in zip(names, counts, strict=True):
        least = report.rejected[name]
        told = f" {count}, the best by {least.smallest_violation:.2g} {least.unit}"
        axes.annotate(told, (count, name), va="center", fontsize=8)
    axes.set_xlim(0, 1.5 * max(counts, default=1))
    axes.set_xlabel("candidates that break the constraint (one may break several)")
    axes.set_title("why candidates were refused", loc="left", fontsize=11)
    axes.tick_params(axis="y", labelsize=9)
