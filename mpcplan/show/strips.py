"""Strips over time: speed, acceleration, steering, gap ahead and planning time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from mpcplan.show import colours
from mpcplan.show.gap import gap_ahead
from mpcplan.show.traffic import Traffic
from mpcplan.trajectory import Input, State
from mpcplan.vehicle import FORD_ESCORT, acceleration_limit

if TYPE_CHECKING:
    from mpcplan.scenario import Problem
    from mpcplan.simulate.run import Drive, Run

STRIPS = (
    "speed [m/s]",
    "acceleration [m/s²]",
    "steering angle [rad]",
    "steering rate [rad/s]",
    "gap ahead [m]",
    "planning time [ms]",
)


def draw_strips(strips: list[Axes], run: Run, traffic: Traffic) -> None:
    """Draws the strips named in :data:`STRIPS` for every drive."""
    for axes, label in zip(strips, STRIPS, strict=True):
        prepare_strip(axes, label)
    for index, drive in enumerate(run.drives):
        _draw_drive(strips, drive, traffic, colours.of_problem(index))
    _set_scales(strips)
    _draw_limits(strips, run)
    mark_goal_times(strips, run)


def mark_goal_times(strips: Sequence[Axes], run: Run) -> None:
    """Shades the goals' time intervals."""
    for problem in run.loaded.problems:
        _mark_goal_time(strips, problem, run.loaded.dt)


def prepare_strip(axes: Axes, label: str) -> None:
    """Names a strip; only the lowest have words below the time axis."""
    axes.set_ylabel(label, fontsize=8)
    axes.grid(color="#e4e4e4", lw=0.6)
    axes.set_axisbelow(True)
    cell = axes.get_subplotspec()
    bottom = cell is not None and cell.is_last_row()
    axes.tick_params(labelsize=8, labelbottom=bottom)
    axes.set_xlabel("time [s]" if bottom else "", fontsize=8)


def _draw_drive(strips: list[Axes], drive: Drive, traffic: Traffic, colour: str) -> None:
    driven = drive.trajectory
    x, time = driven.states, driven.steps * driven.dt
    speed, acceleration, angle, rate, gap, planning = strips
    speed.plot(time, x[:, State.V], color=colour)
    acceleration.stairs(driven.inputs[:, Input.A], time, baseline=None, color=colour)
    angle.plot(time, x[:, State.DELTA], color=colour)
    rate.stairs(driven.inputs[:, Input.V_DELTA], time, baseline=None, color=colour)
    gaps = gap_ahead(driven, traffic.during(driven.steps))
    gap.plot(time, gaps, ".-", ms=2, color=colour)
    seconds = np.array([cycle.seconds for cycle in drive.cycles])
    starts = np.array([cycle.step for cycle in drive.cycles]) * driven.dt
    planning.plot(starts, 1e3 * seconds, ".", ms=4, color=colour)


def _draw_limits(strips: list[Axes], run: Run) -> None:
    """The vehicle's limits, dashed; the strips' scales still follow what was driven."""
    _, acceleration, angle, rate, _, _ = strips
    for drive in run.drives:
        driven = drive.trajectory
        limit = acceleration_limit(driven.states[:, State.V])
        _dashed(acceleration, driven.steps * driven.dt, limit)
    car = FORD_ESCORT
    for axes, bounds in (
        (acceleration, (-car.a_max,)),
        (angle, (-car.delta_max, car.delta_max)),
        (rate, (-car.v_delta_max, car.v_delta_max)),
    ):
        for bound in bounds:
            _dashed(axes, np.array(axes.get_xlim()), np.full(2, bound))


def _dashed(axes: Axes, time: np.ndarray, limit: np.ndarray) -> None:
    """A line that does not widen the scales."""
    low, high = axes.get_ylim()
    axes.plot(time, limit, "--", color=colours.LIMIT, lw=0.9, scalex=False, scaley=False)
    axes.set_ylim(low, high)


def _set_scales(strips: list[Axes]) -> None:
    """At least the given ranges, so that noise does not fill a strip; from 0 where usual."""
    speed, acceleration, angle, rate, gap, planning = strips
    for axes, least in ((acceleration, 1.0), (angle, 0.05), (rate, 0.05)):
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, -least), max(high, least))
    for axes, least in ((speed, 1.0), (gap, 10.0), (planning, 10.0)):
        axes.set_ylim(0, max(1.05 * axes.get_ylim()[1], least))


def _mark_goal_time(strips: Sequence[Axes], problem: Problem, dt: float) -> None:
    """Shades the time intervals of a problem's goals."""
    for state in problem.planning_problem.goal.state_list:
        start, end = state.time_step.start * dt, state.time_step.end * dt
        for axes in strips:
            axes.axvspan(start, end, color=colours.GOAL, alpha=0.12, lw=0)
