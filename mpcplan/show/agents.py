"""The level-k game over a drive: beliefs in the agents' levels, and what the agents did."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mpcplan.game.actions import Command
from mpcplan.game.decide import Order
from mpcplan.game.levels import LEVELS
from mpcplan.observation import Box
from mpcplan.show import colours
from mpcplan.show.cycles import LookedInto
from mpcplan.show.game import LEVEL_COLOURS, games
from mpcplan.show.traffic import traffic_of
from mpcplan.trajectory import Array

_DPI = 110
_WIDTH = 13.0  # inches
_PER_AGENT = 1.9  # inches, of each agent's strip,
_ABOVE, _BELOW = 0.75, 0.5  # and around all of them
_LONGER = 1.0  # s, shown after the last game
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
                time, below, below + share, step="post", color=LEVEL_COLOURS[level], alpha=0.75,
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
                ms=(7, 5, 3)[level], color=LEVEL_COLOURS[level], label=f"level {level}",
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
