"""The level-k game over a drive: one decision on the map, beliefs, and what the others did."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from mpcplan.errors import InputError
from mpcplan.game.actions import Action, Command
from mpcplan.game.decide import Decision, Order
from mpcplan.game.levels import LEVELS
from mpcplan.game.player import EGO
from mpcplan.game.way import Place, Pose, Ways, way_of_road
from mpcplan.observation import Box, box_corners
from mpcplan.show import colours
from mpcplan.show.cycles import LookedInto, Moment
from mpcplan.show.scene import draw_map
from mpcplan.show.traffic import traffic_of
from mpcplan.trajectory import Array
from mpcplan.vehicle import rectangles

_DPI = 110
_WIDTH = 13.0  # inches
_HEIGHT = 7.4  # inches, of the decision
_PER_AGENT = 1.9  # inches, of each agent's strip,
_ABOVE, _BELOW = 0.75, 0.5  # and around all of them
_LONGER = 1.0  # s, shown after the last game
_AROUND = 12.0  # m, shown around the players
_LEVEL_COLOURS = (colours.VARIANTS[3], colours.VARIANTS[0], colours.VARIANTS[1])
_LEVEL_WIDTHS = (5.0, 3.0, 1.3)  # where levels coincide all can be seen
_ORDER_COLOURS = {
    Order.GO: colours.GOAL, Order.YIELD: colours.ALARM, Order.NONE: colours.EDGE,
}  # fmt: skip
_MOST_AGENTS = 4  # strips in a figure
_MOST = 6.0  # m/s^2, accelerations beyond this are not shown


@dataclass(frozen=True, eq=False)
class AgentOverTime:
    """One agent over the cycles in which it was in the game (all with k rows).

    Attributes:
        id: of the obstacle.
        time: (k,) of the cycles [s].
        beliefs: (k, 3) in levels 0, 1 and 2.
        orders: who goes first.
        predicted: (k, 3) acceleration of its first action at each level [m/s^2].
    """

    id: int
    time: Array
    beliefs: Array
    orders: tuple[Order, ...]
    predicted: Array


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


def agents_over_time(looked: LookedInto) -> list[AgentOverTime]:
    """All agents, those longest in the game first.

    Raises:
        InputError: no game was played.
    """
    played, dt = games(looked), looked.run.loaded.dt
    often = Counter(number for _, decision in played for number in decision.beliefs)
    found = []
    for number, _ in sorted(often.items(), key=lambda item: (-item[1], item[0])):
        there = [(moment, one) for moment, one in played if number in one.beliefs]
        found.append(
            AgentOverTime(
                number,
                dt * np.array([moment.step for moment, _ in there]),
                np.stack([one.beliefs[number] for _, one in there]),
                tuple(one.orders[number] for _, one in there),
                np.stack([one.predicted[number][:, Command.A] for _, one in there]),
            )
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
                *line.T, color=_LEVEL_COLOURS[level], lw=_LEVEL_WIDTHS[level],
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
        axes.plot([], [], color=_LEVEL_COLOURS[level], lw=_LEVEL_WIDTHS[level],
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
            names, shares[:, level], left=left, color=_LEVEL_COLOURS[level], label=f"level {level}"
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


def plot_beliefs(looked: LookedInto) -> Figure:
    """Draws beliefs over time, a strip per agent, above it who is expected to go first.

    Raises:
        InputError: no game was played.
    """
    figure, strips, agents = _strips(looked)
    for axes, agent in zip(strips, agents, strict=True):
        time = np.append(agent.time, agent.time[-1] + looked.run.config.drive.replan)
        below = np.zeros(len(time))
        for level in range(LEVELS):
            share = np.append(agent.beliefs[:, level], agent.beliefs[-1, level])
            axes.fill_between(
                time, below, below + share, step="post", color=_LEVEL_COLOURS[level], alpha=0.75,
                lw=0, label=f"level {level}",
            )  # fmt: skip
            below = below + share
        for order, colour in _ORDER_COLOURS.items():
            at = [t for t, found in zip(agent.time, agent.orders, strict=True) if found is order]
            axes.plot(at, np.full(len(at), 1.08), "s", ms=4, color=colour, clip_on=False,
                      label=f"ego: {order.value}")  # fmt: skip
        axes.set(ylim=(0, 1.16), yticks=(0, 0.5, 1))
        _name(axes, f"P(k), {agent.id}")
    _finish(figure, strips, "beliefs in the agents' levels, and the order as the ego sees it")
    return figure


def plot_others(looked: LookedInto) -> Figure:
    """Draws what agents did, their acceleration, beside what each level would have done.

    Raises:
        InputError: no game was played.
    """
    figure, strips, agents = _strips(looked)
    run, traffic = looked.run, traffic_of(looked.run)
    steps = run.drives[0].trajectory.steps
    boxes = traffic.during(steps)
    for axes, agent in zip(strips, agents, strict=True):
        v = boxes[traffic.ids.index(agent.id), :, Box.V]
        axes.stairs(
            np.diff(v) / run.loaded.dt, steps * run.loaded.dt, baseline=None, color=colours.PLAN,
            lw=1.0, label="driven",
        )  # fmt: skip
        for level in range(LEVELS):
            axes.plot(
                agent.time, agent.predicted[:, level], ls="", marker=("v", "s", "o")[level],
                ms=(7, 5, 3)[level], color=_LEVEL_COLOURS[level], label=f"level {level}",
            )  # fmt: skip
        axes.set_ylim(-_MOST, _MOST)
        _name(axes, f"a [m/s²], {agent.id}")
    _finish(figure, strips, "what the agents did, and the first action of each level")
    return figure


def _strips(looked: LookedInto) -> tuple[Figure, list[Axes], list[AgentOverTime]]:
    agents = agents_over_time(looked)[:_MOST_AGENTS]
    high = _ABOVE + _BELOW + _PER_AGENT * len(agents)
    figure = Figure(figsize=(_WIDTH, high), dpi=_DPI)
    FigureCanvasAgg(figure)
    figure.subplots_adjust(
        left=0.06, right=0.98, top=1 - _ABOVE / high, bottom=_BELOW / high, hspace=0.22
    )
    strips = figure.subplots(len(agents), 1, sharex=True, squeeze=False)[:, 0]
    dt, last = looked.run.loaded.dt, looked.run.drives[0].trajectory.last_step
    strips[0].set_xlim(0, min(max(a.time[-1] for a in agents) + _LONGER, last * dt))
    return figure, list(strips), agents


def _name(axes: Axes, label: str) -> None:
    axes.set_ylabel(label, fontsize=9)
    axes.grid(color=colours.GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)


def _finish(figure: Figure, strips: list[Axes], title: str) -> None:
    strips[-1].set_xlabel("time t [s]")
    strips[0].legend(
        fontsize=8, ncols=6, loc="lower right", bbox_to_anchor=(1.0, 1.02), frameon=False
    )
    figure.suptitle(title, x=0.06, ha="left", fontsize=12)
