"""The road seen from above: map, goal, traffic, planned and driven trajectories."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from commonroad.geometry.shape import Shape
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from mpcplan.observation import Box, box_corners
from mpcplan.show import colours
from mpcplan.show.traffic import Traffic
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import centres, rectangles

if TYPE_CHECKING:
    from mpcplan.scenario import Problem
    from mpcplan.simulate.run import Drive, Run

MARGIN = 20.0  # m, shown around what was driven
_EGO_EVERY = 0.5  # s, between drawn rectangles of the driven vehicle
_TRAFFIC_EVERY = 1.0  # s, between faded rectangles of the traffic


def view_size(run: Run) -> Array:
    """(2,) width and height [m] of what must be seen."""
    return np.ptp(_driven(run), axis=0) + 2 * MARGIN


def view_centre(run: Run) -> Array:
    """(2,) centre [m] of what must be seen."""
    points = _driven(run)
    return (points.min(axis=0) + points.max(axis=0)) / 2


def _driven(run: Run) -> Array:
    starts = [problem.start[None] for problem in run.loaded.problems]
    return np.vstack([centres(s) for s in [*starts, *(d.trajectory.states for d in run.drives)]])


def draw_scene(axes: Axes, run: Run, traffic: Traffic) -> None:
    """Draws everything into axes whose limits are set."""
    draw_ground(axes, run, traffic)
    steps = max((drive.trajectory.last_step for drive in run.drives), default=0)
    end = max(steps, 1) * run.loaded.dt
    for index, drive in enumerate(run.drives):
        _draw_drive(axes, drive, end, colours.of_problem(index))
        if len(run.drives) > 1:
            _label(axes, drive, colours.of_problem(index))
    _draw_legend(axes)
    _draw_clock(axes, end)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")


def draw_ground(axes: Axes, run: Run, traffic: Traffic) -> None:
    """Draws map, goals and traffic into axes whose limits are set."""
    draw_map(axes, run)
    _draw_traffic(axes, traffic, run.loaded.dt)


def draw_map(axes: Axes, run: Run) -> None:
    """Draws map and goals into axes whose limits are set."""
    axes.set_autoscale_on(False)
    draw_road(axes, run)
    for problem in run.loaded.problems:
        draw_goal(axes, problem)


def draw_road(axes: Axes, run: Run) -> None:
    """Draws the lanelets."""
    lanelets = run.loaded.scenario.lanelet_network.lanelets
    areas = [np.vstack([lane.left_vertices, lane.right_vertices[::-1]]) for lane in lanelets]
    edges = [side for lane in lanelets for side in (lane.left_vertices, lane.right_vertices)]
    axes.add_collection(PolyCollection(areas, facecolors=colours.ROAD, zorder=0))
    axes.add_collection(LineCollection(edges, colors=colours.EDGE, linewidths=0.7, zorder=1))


def draw_goal(axes: Axes, problem: Problem) -> None:
    """Draws the regions of a problem's goals."""
    goals = problem.planning_problem.goal.state_list
    shapes = [state.position for state in goals if state.has_value("position")]
    polygons = [polygon for shape in shapes for polygon in _polygons(shape)]
    axes.add_collection(
        PolyCollection(
            polygons, facecolors=f"{colours.GOAL}38", edgecolors=colours.GOAL, hatch="//", zorder=2
        )
    )


def _polygons(shape: Shape) -> Iterable[Array]:
    for part in getattr(shape, "shapes", [shape]):
        yield np.asarray(part.shapely_object.exterior.coords)


def _draw_traffic(axes: Axes, traffic: Traffic, dt: float) -> None:
    """Paths, where every obstacle is first seen, and faded where it is later."""
    starts, later, paths = [], [], []
    every = max(1, round(_TRAFFIC_EVERY / dt))
    for boxes, still in zip(traffic.boxes, traffic.still, strict=True):
        seen = boxes[~np.isnan(boxes[:, Box.X])]
        corners = box_corners(seen[:1] if still else seen[::every])
        starts += [*corners[:1]]
        later += [*corners[1:]]
        paths.append(seen[:, [Box.X, Box.Y]])
    colour = colours.TRAFFIC
    axes.add_collection(LineCollection(paths, colors=colour, linewidths=0.7, zorder=3))
    axes.add_collection(
        PolyCollection(later, facecolors=f"{colour}18", edgecolors=f"{colour}60", lw=0.5, zorder=3)
    )
    axes.add_collection(
        PolyCollection(starts, facecolors=f"{colour}90", edgecolors=colour, lw=0.8, zorder=4)
    )


def _draw_drive(axes: Axes, drive: Drive, end: float, colour: str) -> None:
    """Plans, driven centre line, and rectangles coloured by time [s] up to the end."""
    plans = [centres(cycle.plan.trajectory.states) for cycle in drive.cycles]
    axes.add_collection(
        LineCollection(plans, colors=colours.PLAN, linewidths=0.5, alpha=0.5, zorder=5)
    )
    driven = drive.trajectory
    every = max(1, round(_EGO_EVERY / driven.dt))
    bodies = PolyCollection(
        list(rectangles(driven.states[::every])),
        array=driven.steps[::every] * driven.dt,
        cmap=colours.TIME,
        clim=(0, end),
        alpha=0.75,
        edgecolors=colour,
        linewidths=0.6,
        zorder=6,
    )
    axes.add_collection(bodies)
    axes.plot(*centres(driven.states).T, color=colour, lw=1.2, zorder=7)
    if drive.collided:
        axes.plot(
            *centres(driven.states[-1:]).T, "X", color=colours.ALARM, ms=11, mec="w", zorder=9
        )


def _draw_legend(axes: Axes) -> None:
    """Names above the panel."""
    entries = [
        Patch(facecolor=f"{colours.TRAFFIC}90", edgecolor=colours.TRAFFIC, label="traffic, first"),
        Patch(facecolor=f"{colours.TRAFFIC}18", edgecolor=f"{colours.TRAFFIC}60", label="later"),
        Patch(facecolor=f"{colours.GOAL}38", edgecolor=colours.GOAL, hatch="//", label="goal"),
        Line2D([], [], color=colours.PLAN, lw=0.8, alpha=0.6, label="plans"),
        Line2D([], [], color=colours.of_problem(0), lw=1.4, label="driven"),
    ]
    axes.legend(
        handles=entries,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncol=len(entries),
        frameon=False,
        fontsize=8,
        handlelength=1.6,
        columnspacing=1.2,
    )


def _draw_clock(axes: Axes, end: float) -> None:
    """The colours of the driven vehicle's rectangles over time [s]."""
    bar = axes.inset_axes((1.01, 0.0, 0.012, 1.0))
    scale = ScalarMappable(Normalize(0, end), colours.TIME)
    axes.figure.colorbar(scale, cax=bar)
    bar.set_ylabel("time of the driven rectangles [s]", fontsize=8)
    bar.tick_params(labelsize=8)


def _label(axes: Axes, drive: Drive, colour: str) -> None:
    x, y = drive.trajectory.states[0, [State.X, State.Y]]
    axes.annotate(
        f"problem {drive.problem_id}",
        (x, y),
        textcoords="offset points",
        xytext=(0, 9),
        color=colour,
        fontsize=8,
        zorder=9,
    )
