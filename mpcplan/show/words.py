"""What a picture of a planning cycle says above the road, from the trace."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import Any

from mpcplan.show.moment import Moment
from mpcplan.simulate.run import Drive
from mpcplan.trajectory import State

WIDTH = 175  # characters of a line
MOST_LINES = 2  # of the fallback
TOLD = 4  # constraints that refused most


@dataclass(frozen=True)
class Line:
    """A line of words, perhaps in the colour of alarm."""

    text: str
    alarming: bool = False


def headline(moment: Moment, scenario: str, drive: Drive) -> str:
    """Which run, when, how fast, and how it ended."""
    speed = moment.driven.states[-1, State.V]
    end, dt = "", moment.driven.dt
    if moment.step == drive.trajectory.last_step:
        failed = "collided" if drive.collided else "goal not reached"
        end = "    " + (failed if drive.reached_step is None else "goal reached")
    return (
        f"{scenario}    t = {moment.step * dt:.1f} s    step {moment.step}    "
        f"v = {speed:.1f} m/s    {len(moment.ids)} others{end}"
    )


def plan_lines(moment: Moment, missing: str) -> list[Line]:
    """The plan, what refused the candidates, and the fallback; what is missing on the picture."""
    if moment.cycle is None:
        return [Line("nothing was planned")]
    told = moment.cycle.plan.trace
    lines = [Line(_plan(told)), Line(_candidates(told))]
    if told.get("fallback"):
        lines += _wrapped(f"fallback: {told['fallback']}", MOST_LINES)
    if moment.considered is None or not moment.considered.agrees:
        lines += _wrapped(f"not shown: predictions, candidates, plan: {missing}", 1)
    return lines


def _plan(told: dict[str, Any]) -> str:
    chosen = told["chosen"]
    cost = "" if chosen["cost"] is None else f", cost {chosen['cost']:.2f}"
    goal = "reaches the goal" if chosen["reaches_goal"] else "does not reach the goal"
    return f"plan of step {told['step']}: {told['source']}{cost}, {goal}"


def _candidates(told: dict[str, Any]) -> str:
    lattice = told["seeds"].get("lattice")
    if lattice is None:
        return "candidates: none, the last plan goes on" if not told["seeds"] else ""
    often = sorted(lattice["rejected"].items(), key=lambda item: -item[1]["count"])
    refused = ", ".join(f"{name} {one['count']}" for name, one in often[:TOLD])
    return (
        f"candidates: {lattice['accepted']} of {lattice['candidates']} drivable, "
        f"{lattice['reaching_goal']} reach the goal" + (f"; refused: {refused}" if refused else "")
    )


def _wrapped(text: str, most: int) -> list[Line]:
    lines = textwrap.wrap(text, WIDTH, max_lines=most, placeholder=" ...")
    return [Line(line, True) for line in lines]
