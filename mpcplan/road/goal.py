"""The goal of a planning problem, seen along a reference path.

A goal state becomes a window: time steps [first, last], the arc lengths and offsets of the
vehicle's centre at which its position region is met (None: anywhere), and intervals of speed and
heading. The official test (`GoalRegion.is_reached`) has the last word on what was driven.
"""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from commonroad.common.util import AngleInterval, Interval
from commonroad.geometry.shape import Circle, Shape, ShapeGroup
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.scenario.state import CustomState, TraceState

from mpcplan.road.frame import Frame
from mpcplan.road.goal_region import GoalRegion, goal_region, run_around
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import FORD_ESCORT

LATERAL_REACH = 7.0  # m, the region is looked for this far beside the reference
LATERAL_STEP = 0.25  # m
ROUNDING = 1e-6  # m, by which regions are grown against rounding
NEARLY = 0.9  # of the longest stretch
EDGE = 0.1  # m, windows are this much smaller than what was sampled
OPEN_END_STEP = 200  # time steps after the start, where the goal sets no time


@dataclass(frozen=True)
class GoalWindow:
    """One goal state along a reference path.

    Attributes:
        first, last: time steps between which it may be reached.
        s: (least, largest) arc length [m] of the vehicle's centre, or None.
        d: (least, largest) offset [m] of the centre within that range, or None.
        v: (least, largest) speed [m/s], or None.
        psi: (least, largest) heading [rad], or None.
        region: where exactly the centre may be, beyond the ranges of s and d; None: in these.
    """

    first: int
    last: int
    s: tuple[float, float] | None
    d: tuple[float, float] | None
    v: tuple[float, float] | None
    psi: tuple[float, float] | None
    region: GoalRegion | None = None

    def holds(self, s: Array, d: Array) -> Array:
        """Whether centres (s, d) are where the goal is."""
        if self.region is not None:
            return self.region.contains(s, d)
        found = np.ones(np.broadcast_shapes(np.shape(s), np.shape(d)), bool)
        for values, interval in ((s, self.s), (d, self.d)):
            if interval is not None:
                found &= (values >= interval[0]) & (values <= interval[1])
        return found

    def around(self, s: float, d: float) -> "GoalWindow":
        """The window with ranges of s and d that hold throughout: those around a centre in it."""
        box = self.region.box(s, d) if self.region is not None else None
        return self if box is None else replace(self, s=box[0], d=box[1])


def goal_windows(
    problem: PlanningProblem, frame: Frame, start: float, last_step: int
) -> tuple[GoalWindow, ...]:
    """Windows of all goal states that the path from arc length ``start`` on meets.

    Args:
        problem: the planning problem, in the frame's coordinates.
        frame: the reference path.
        start: arc length [m] of the vehicle's centre at the beginning.
        last_step: time step taken as the last one where the goal gives no time.
    """
    windows = [_window(state, frame, start, last_step) for state in problem.goal.state_list]
    return tuple(window for window in windows if window is not None)


def _window(state: TraceState, frame: Frame, start: float, last_step: int) -> GoalWindow | None:
    first, last = 0, last_step
    if state.has_value("time_step"):
        first, last = (int(v) for v in _interval(state.time_step))
    s = d = region = None
    if state.has_value("position"):
        met = _position_window(region_of(state.position), frame, start)
        if met is None:
            return None
        s, d, region = met
    v = _interval(state.velocity) if state.has_value("velocity") else None
    psi = _interval(state.orientation) if state.has_value("orientation") else None
    return GoalWindow(first, last, s, d, v, psi, region)


def region_of(shape: Shape) -> shapely.Geometry:
    """The area of a CommonRoad shape, the union where it is a group; published lanelets may cross
    themselves."""
    if isinstance(shape, ShapeGroup):
        return shapely.union_all([region_of(part) for part in shape.shapes])
    if isinstance(shape, Circle):  # commonroad-io's shapely_object has half the radius
        return shapely.buffer(shapely.Point(*shape.center), shape.radius)
    return shapely.make_valid(shape.shapely_object)


def _interval(value: Interval | AngleInterval | float) -> tuple[float, float]:
    if isinstance(value, Interval | AngleInterval):
        return float(value.start), float(value.end)
    return float(value), float(value)


def _position_window(
    region: shapely.Geometry, frame: Frame, start: float
) -> tuple[tuple[float, float], tuple[float, float], GoalRegion] | None:
    """Range of s, and of d about its middle, in which the path's neighbourhood meets the region,
    and where it does exactly.

    Of all offsets the one nearest to the reference that meets the region is taken; of several
    stretches along it the longest that is not passed yet.
    """
    offsets = np.arange(-LATERAL_REACH, LATERAL_REACH + LATERAL_STEP / 2, LATERAL_STEP)
    points = frame.to_cartesian(frame.s[:, None], offsets[None, :])
    region = shapely.buffer(region, ROUNDING)
    inside = shapely.contains_xy(region, points[..., 0], points[..., 1])
    inside[frame.s < start] = False
    if not inside.any():
        return None
    runs = [_longest_run(column) if column.any() else (0, -1) for column in inside.T]
    lengths = np.array([high - low for low, high in runs])
    # a region's edge is met by chance only: look at offsets along which it is met for long
    wide = np.flatnonzero(lengths >= NEARLY * lengths.max())
    column = int(wide[np.argmin(np.abs(offsets[wide]))])
    low, high = runs[column]
    middle = (low + high) // 2
    left, right = run_around(inside[middle], column)
    met, beside = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    # the region may reach up to the next samples
    along = max(frame.s[met[0]] - frame.spacing, start), frame.s[met[-1]] + frame.spacing
    across = offsets[beside[0]] - LATERAL_STEP, offsets[beside[-1]] + LATERAL_STEP
    return (
        _shrunk(frame.s[low], frame.s[high]),
        _shrunk(offsets[left], offsets[right]),
        goal_region(region, frame, along, across),
    )


def _longest_run(mask: Array) -> tuple[int, int]:
    """First and last index of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    starts, ends = edges[::2], edges[1::2] - 1
    best = int(np.argmax(ends - starts))
    return int(starts[best]), int(ends[best])


def _shrunk(low: float, high: float) -> tuple[float, float]:
    edge = min(EDGE, (high - low) / 2)
    return float(low + edge), float(high - edge)


def last_goal_step(problem: PlanningProblem) -> int:
    """Last time step of any goal state; OPEN_END_STEP after the start where no time is set."""
    first = int(problem.initial_state.time_step)
    steps = []
    for state in problem.goal.state_list:
        if not state.has_value("time_step"):
            steps.append(first + OPEN_END_STEP)
        elif isinstance(state.time_step, int):
            steps.append(state.time_step)
        else:
            steps.append(int(state.time_step.end))
    return max(steps)


def is_reached(problem: PlanningProblem, state: Array, step: int) -> bool:
    """Whether the rear-axle state (columns :class:`State`) meets the goal, by the official test."""
    times = [g.time_step for g in problem.goal.state_list if g.has_value("time_step")]
    if len(times) == len(problem.goal.state_list) and not any(
        _interval(t)[0] <= step <= _interval(t)[1] for t in times
    ):
        return False  # the official test copies the goal: keep it for the steps that can succeed
    psi = float(state[State.PSI])
    ahead = FORD_ESCORT.rear_to_centre * np.array([np.cos(psi), np.sin(psi)])
    centre = state[[State.X, State.Y]] + ahead
    judged = CustomState(
        position=centre, velocity=float(state[State.V]), orientation=psi, time_step=step
    )
    return bool(problem.goal.is_reached(judged))
