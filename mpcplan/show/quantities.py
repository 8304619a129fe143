"""What strips over time can show of a drive: each quantity with its unit and how it is computed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from mpcplan.road.road import build_roads
from mpcplan.seed.cost import evaluated_jerk
from mpcplan.seed.seed import Stage
from mpcplan.seed.track import frenet_states
from mpcplan.show import colours
from mpcplan.show.gap import REACH, gap_ahead
from mpcplan.trajectory import Array, Input, State, Trajectory

if TYPE_CHECKING:
    from mpcplan.simulate.run import Run

Values = Callable[[Trajectory, Array], Array]


@dataclass(frozen=True)
class Quantity:
    """A quantity over time.

    Attributes:
        label: name with unit.
        least: the strip's range at least, so that noise does not fill it.
        signed: whether values may be negative.
        values: of a trajectory with n steps and the others' (o, n + 1, 6) boxes meanwhile; (n + 1,)
            at the time steps, or (n,) constant between them.
        none: what a strip says in which all values are NaN.
    """

    label: str
    least: float
    signed: bool
    values: Values
    none: str = "nothing to show"


SPEED = Quantity("speed [m/s]", 1.0, False, lambda driven, _: driven.states[:, State.V])
ACCELERATION = Quantity(
    "acceleration [m/s²]", 1.0, True, lambda driven, _: driven.inputs[:, Input.A]
)
STEERING_ANGLE = Quantity(
    "steering angle [rad]", 0.05, True, lambda driven, _: driven.states[:, State.DELTA]
)
STEERING_RATE = Quantity(
    "steering rate [rad/s]", 0.02, True, lambda driven, _: driven.inputs[:, Input.V_DELTA]
)
GAP = Quantity("gap ahead [m]", 10.0, False, gap_ahead, f"nobody ahead within {REACH:.0f} m")


def jerk_of(run: Run) -> Quantity:
    """The longitudinal jerk of drives of a run's scenario, as TR1 evaluates it.

    Positions along the road, smoothed and differentiated three times (:mod:`mpcplan.seed.cost`);
    of all roads to the goals, along the one that the drive leaves least.
    """
    loaded, config = run.loaded, run.config.road
    problems = [problem.planning_problem for problem in loaded.problems]
    frames = [
        road.frame for goal in problems for road in build_roads(loaded.scenario, goal, config)
    ]

    def values(driven: Trajectory, _: Array) -> Array:
        ways = (frenet_states(frame, driven, 0.0) for frame in frames)
        nearest = min(ways, key=lambda states: float(np.abs(states[:, Stage.D]).max()))
        return evaluated_jerk(nearest, driven.dt, begins=True, ends=True)

    return Quantity("jerk, as evaluated [m/s³]", 1.0, True, values)


def draw(axes: Axes, quantity: Quantity, driven: Trajectory, boxes: Array, colour: str) -> None:
    """Draws a quantity of a drive among the others' boxes at the same time steps."""
    values, time = quantity.values(driven, boxes), driven.steps * driven.dt
    if np.isnan(values).all():
        return
    if len(values) == len(time):
        axes.plot(time, values, color=colour)
    else:
        axes.stairs(values, time, baseline=None, color=colour)


def prepare(axes: Axes, quantity: Quantity) -> None:
    """Names a strip and sets its range, after everything was drawn."""
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -quantity.least) if quantity.signed else 0.0, max(high, quantity.least))
    if not axes.lines and not axes.patches:
        axes.text(0.5, 0.5, quantity.none, transform=axes.transAxes, ha="center", fontsize=9)
    axes.set_title(quantity.label, fontsize=9)
    axes.set_xlabel("time [s]", fontsize=8)
    axes.grid(color=colours.GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
