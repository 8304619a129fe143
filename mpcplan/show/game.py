"""One decision of the level-k game: everybody on the map, beliefs, and the best rewards."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from mpcplan.errors import InputError
from mpcplan.game.actions import Action
from mpcplan.game.decide import Decision
from mpcplan.game.levels import LEVELS
from mpcplan.game.player import EGO
from mpcplan.game.way import Place, Pose, Ways, way_of_road
from mpcplan.observation import Box, box_corners
from mpcplan.show import colours
from mpcplan.show.cycles import LookedInto, Moment
from mpcplan.show.scene import draw_map
from mpcplan.trajectory import Array
from mpcplan.vehicle import rectangles

_DPI = 110
_WIDTH = 13.0  # inches
_HEIGHT = 7.4  # inches, of the decision
_AROUND = 12.0  # m, shown around the players
LEVEL_COLOURS = (colours.VARIANTS[3], colours.VARIANTS[0], colours.VARIANTS[1])  # by level
_LEVEL_WIDTHS = (5.0, 3.0, 1.3)  # where levels coincide all can be seen


def games(looked: LookedInto) -> list[tuple[Moment, Decision]]:
    """The cycles in which a game was played.

    Raises:
        InputError: there is none.
    """
    found = [
        (moment, moment.played.decision)
        for moment in looked.moments
        if moment.played is not None and moment.played.decision is not None
    ]
    if not found:
        told = {why for m in looked.moments if m.played is not None for why in m.played.reasons}
        raise InputError(
            f"{looked.run.loaded.id}: no game was played; "
            + ("; ".join(sorted(told)) or "set game.enabled, and the others' motion to a guess")
        )
    return found


def plot_decision(looked: LookedInto, moment: Moment) -> Figure:
    """Draws a cycle's game: everybody's best sequences at each level, beliefs, the best rewards.

    Args:
        looked: the run, for the map.
        moment: one of its cycles, with a game.

    Returns:
        The figure.

    Raises:
        InputError: no game was played in this cycle.
    """
    played = moment.played
    if played is None or played.decision is None:
        reasons = "; ".join(played.reasons) if played is not None else "game.enabled is off"
        raise InputError(f"{looked.run.loaded.id}: no game at step {moment.step}: {reasons}")
    decision = played.decision
    figure = Figure(figsize=(_WIDTH, _HEIGHT), dpi=_DPI)
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        2, 2, width_ratios=[1.35, 1], height_ratios=[1, 1.1], left=0.06, right=0.97, top=0.87,
        bottom=0.08, hspace=0.36, wspace=0.14,
    )  # fmt: skip
    _draw_players(figure.add_subplot(grid[:, 0]), looked, moment, decision)
    _draw_beliefs_now(figure.add_subplot(grid[0, 1]), decision)
    _draw_rewards(figure.add_subplot(grid[1, 1]), decision)
    figure.suptitle(f"game of time step {moment.step}: {_words(decision.actions)}", fontsize=12)
    return figure


def _words(actions: tuple[Action, ...]) -> str:
    return ", then ".join(action.name.lower().replace("_", " ") for action in actions)


def chosen_path(moment: Moment, decision: Decision) -> Array:
    """(T m + 1, 2) centres of the ego vehicle's body [m] by its decision, the present one first."""
    way, path = way_of_road(moment.road), decision.path
    mu = path[:, Place.MU]
    who = np.zeros(1, int)
    poses = Ways((way,)).poses(
        who, path[None, :, Place.S], path[None, :, Place.D], np.cos(mu)[None], np.sin(mu)[None]
    )
    return np.column_stack([poses[Pose.X, 0], poses[Pose.Y, 0]])


def _draw_players(axes: Axes, looked: LookedInto, moment: Moment, decision: Decision) -> None:
    """Bodies as they are, and where everybody goes at each level."""
    ways = {
        number: [np.stack([one.poses[Pose.X].ravel(), one.poses[Pose.Y].ravel()], axis=1)
                 for one in found]
        for number, found in decision.responses.items()
    }  # fmt: skip
    own = chosen_path(moment, decision)
    points = np.vstack([own, *(line for lines in ways.values() for line in lines)])
    low, high = points.min(axis=0) - _AROUND, points.max(axis=0) + _AROUND
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    draw_map(axes, looked.run)
    now = moment.observation.now
    boxes = np.stack([box for i in decision.beliefs if (box := now.box_of(i)) is not None])
    others = [i for i, number in enumerate(now.ids) if number not in decision.beliefs]
    for shown, alpha in ((boxes, "90"), (now.boxes[others], "28")):
        axes.add_collection(
            PolyCollection(
                list(box_corners(shown)), facecolors=f"{colours.TRAFFIC}{alpha}",
                edgecolors=colours.TRAFFIC, zorder=4,
            )
        )  # fmt: skip
    body = rectangles(moment.observation.state[None])
    axes.add_collection(PolyCollection(list(body), facecolors=colours.PLAN, zorder=4))
    for number, lines in ways.items():
        if number == EGO:
            continue
        for level, line in enumerate(lines):
            axes.plot(
                *line.T, color=LEVEL_COLOURS[level], lw=_LEVEL_WIDTHS[level],
                marker=".", ms=5, zorder=6 + level,
            )  # fmt: skip
        box = now.box_of(number)
        if box is not None:
            axes.annotate(
                f"{number}: {decision.orders[number].value}",
                (float(box[Box.X]), float(box[Box.Y])), fontsize=8, ha="center", zorder=9,
                textcoords="offset points", xytext=(0, 10),
            )  # fmt: skip
    axes.plot(*own.T, color=colours.GOAL, marker="o", ms=3.5, lw=2, zorder=9, label="ego: chosen")
    for level in range(LEVELS):
        axes.plot([], [], color=LEVEL_COLOURS[level], lw=_LEVEL_WIDTHS[level],
                  label=f"agents at level {level}")  # fmt: skip
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.legend(fontsize=8, loc="lower left", bbox_to_anchor=(0, 1.0), ncols=4, frameon=False)


def _draw_beliefs_now(axes: Axes, decision: Decision) -> None:
    """Beliefs in the levels of every agent."""
    names = [str(number) for number in decision.beliefs]
    shares = np.stack(list(decision.beliefs.values()))
    left = np.zeros(len(names))
    for level in range(LEVELS):
        axes.barh(
            names, shares[:, level], left=left, color=LEVEL_COLOURS[level], label=f"level {level}"
        )
        left += shares[:, level]
    axes.set(xlim=(0, 1), xlabel="belief P(k)")
    axes.invert_yaxis()
    axes.set_title("beliefs in levels", loc="left", fontsize=10)
    axes.legend(fontsize=8, ncols=LEVELS, loc="lower right", bbox_to_anchor=(1, 1), frameon=False)
    axes.tick_params(labelsize=8)


def _draw_rewards(axes: Axes, decision: Decision) -> None:
    """Expected rewards of the best sequences."""
    names = [_words(actions) for actions, _ in decision.best]
    rewards = np.array([reward for _, reward in decision.best])
    rows = np.arange(len(names))
    shown = [colours.GOAL if actions == decision.actions else colours.EDGE
             for actions, _ in decision.best]  # fmt: skip
    axes.barh(rows, rewards, color=shown)
    for row, (name, reward) in enumerate(zip(names, rewards, strict=True)):
        axes.annotate(
            f"{name}: {reward:.1f}", (0.98, row), xycoords=("axes fraction", "data"), fontsize=8,
            ha="right", va="center",
        )  # fmt: skip
    axes.set(xlim=(1.1 * min(rewards.min(), -1.0), 0), yticks=[])
    axes.invert_yaxis()
    axes.set_xlabel("expected reward R_P, at most 0")
    axes.set_title("the best sequences (green: chosen)", loc="left", fontsize=10)
    axes.tick_params(labelsize=8)
