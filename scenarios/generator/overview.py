"""Table of the scenarios for the README and the overview picture."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from shapely.affinity import rotate, translate
from shapely.geometry import Polygon, box

from .frame import MAP_TURN
from .model import EGO_LENGTH, EGO_WIDTH, Actor, Case, Size, Task
from .motion import Motion, Pose

COLUMNS = 2
TILE_WIDTH = 7.0  # [inch]
FLAT_TILE_HEIGHT = 1.1  # tiles of straight roads [inch]
TALL_TILE_HEIGHT = 4.0  # tiles of all other roads [inch]
RESOLUTION = 75  # [dpi]
VIEW_MARGIN = 12.0  # free space around the drawn motions [m]
TRAIL_STRIDE = 20  # steps between two drawn outlines of a moving vehicle
FLAT_HEIGHT = 12.0  # below this height [m] a road is stretched to fill its tile
ROAD_COLOR, ACTOR_COLOR, EGO_COLOR, GOAL_COLOR = "0.86", "tab:blue", "tab:red", "gold"

README_HEAD = f"""# Scenarios

Small CommonRoad 2020a scenarios (dt = 0.1 s) with recorded traffic, each made for one situation.
They are written by a deterministic generator, so every run gives the same bytes:

    python scenarios/make_scenarios.py            # XML files and this table
    python scenarios/make_scenarios.py --picture  # overview.png as well

The start positions are vehicle centres; the vehicle is CommonRoad vehicle type 1
(4.298 m x 1.674 m). Traffic is recorded for 3 s beyond the last goal step. The generator keeps one
simple example motion per planning problem; the tests use it to show that each scenario is
solvable. The scenarios are described in `generator/straight_cases.py` and
`generator/curved_cases.py`. Scenarios whose traffic reacts are in [`interactive`](interactive).

All maps are turned by {MAP_TURN} rad about the origin, so that no straight road is parallel to an
axis: the official cost evaluator takes an obstacle whose orientation is exactly 0 for an
axis-aligned rectangle without a centre and leaves it out of the distance cost, which would then
be 0 on straight roads.

![overview](overview.png)

In the picture the red car is the start, the dotted line the example motion, yellow the goal, blue
the other road users, drawn every 2 s. It shows the maps before they are turned, and the compass
directions in the table refer to it. Roads without curves are stretched sideways.

"""


INTERACTIVE_HEAD = """# Interactive scenarios

Small scenarios whose traffic SUMO drives: it reacts to the planned vehicle. Each folder holds

- `*.cr.xml`: CommonRoad 2020a, the map, the problem, and where the others start: every obstacle is
  put into SUMO where its record begins, at that time step, and then takes the recorded way;
- `*.net.xml`: the map as a SUMO net;
- `*.sumo.cfg`, `*.vehicles.rou.xml`: what SUMO's own programs want; there are no routes.

In `ZAM_SideStreet` some appear later: commonroad-io reads and writes that, though CommonRoad's
schema wants all initial states at step 0.

They are written by a deterministic generator, so every run gives the same bytes (with the versions
that the extra `twin` asks for):

    pip install '.[twin]'
    python scenarios/make_interactive.py            # the folders and this table
    python scenarios/make_interactive.py --picture  # overview.png as well

The scenarios are described in `../generator/interactive_cases.py`; start positions, vehicle, frame
and picture are those of the [recorded scenarios](../README.md).

![overview](overview.png)

In the picture the dotted line is one way to go if nobody else were there; blue is the recorded
begin of the others' ways, drawn every 2 s.

"""


def readme(cases: list[Case]) -> str:
    """Text of the README with one table row per scenario."""
    return README_HEAD + _table(cases)


def interactive_readme(cases: list[Case]) -> str:
    """Text of the interactive scenarios' README."""
    return INTERACTIVE_HEAD + _table(cases)


def _table(cases: list[Case]) -> str:
    """One row per scenario."""
    rows = ["| Name | What happens | Goal | A good planner must |", "|---|---|---|---|"]
    for case in cases:
        demand = case.demand[0].lower() + case.demand[1:].rstrip(".")
        rows.append(f"| `{case.benchmark_id}` | {case.story} | {case.goal_text} | {demand} |")
    return "\n".join(rows) + "\n"


def outline(pose: Pose, size: Size) -> Polygon:
    """Rectangle covered by a vehicle [m]."""
    body = box(-size.length / 2, -size.width / 2, size.length / 2, size.width / 2)
    turned = rotate(body, pose.orientation, origin=(0.0, 0.0), use_radians=True)
    return translate(turned, pose.x, pose.y)


def draw(cases: list[Case], target: FilePath) -> None:
    """Write the overview picture with one tile per case, straight roads first."""
    flat = [case for case in cases if _is_flat(case)]
    tall = [case for case in cases if not _is_flat(case)]
    flat_rows, tall_rows = (-(-len(group) // COLUMNS) for group in (flat, tall))
    heights = [FLAT_TILE_HEIGHT] * flat_rows + [TALL_TILE_HEIGHT] * tall_rows
    figure = Figure(figsize=(TILE_WIDTH * COLUMNS, sum(heights)), layout="constrained")
    tiles = figure.subplots(len(heights), COLUMNS, height_ratios=heights).ravel()
    for axes in tiles:
        axes.set_axis_off()
    for group, first in ((flat, 0), (tall, flat_rows * COLUMNS)):
        for case, axes in zip(group, tiles[first:], strict=False):
            _draw_case(axes, case)
    figure.savefig(target, dpi=RESOLUTION, metadata={"Software": None})


def _draw_case(axes: Axes, case: Case) -> None:
    axes.set_title(case.benchmark_id, fontsize=9, pad=2)
    for draft in case.road.drafts.values():
        ring = np.vstack([draft.left, draft.right[::-1]])
        axes.fill(*ring.T, facecolor=ROAD_COLOR, edgecolor="white", linewidth=0.8)
    for task in case.tasks:
        _draw_goal(axes, case, task)
    for actor in case.actors:
        _draw_actor(axes, actor, min(case.last_goal_step, case.last_step))
    for task in case.tasks:
        _draw_ego(axes, task)
    _set_view(axes, case)


def _draw_goal(axes: Axes, case: Case, task: Task) -> None:
    for lanelet in task.goal.lanelets:
        draft = case.road.drafts[lanelet]
        ring = np.vstack([draft.left, draft.right[::-1]])
        axes.fill(*ring.T, color=GOAL_COLOR, alpha=0.5)
    if task.goal.zone is not None:
        path, s, length, width = task.goal.zone
        pose = Motion(path, s, 0.0).pose(0)
        axes.fill(*outline(pose, Size(length, width)).exterior.xy, color=GOAL_COLOR, alpha=0.7)


def _draw_actor(axes: Axes, actor: Actor, last_step: int) -> None:
    first = actor.first_step
    steps = [0] if actor.static else range(first, last_step + 1, TRAIL_STRIDE)
    for step in reversed(steps):
        fade = 1.0 if step == first else 0.25
        ring = outline(actor.motion.pose(step), actor.size).exterior.xy
        axes.fill(*ring, facecolor=ACTOR_COLOR, alpha=fade, edgecolor="black", linewidth=0.4)


def _draw_ego(axes: Axes, task: Task) -> None:
    poses = [task.example.pose(step) for step in range(task.goal.last + 1)]
    axes.plot([p.x for p in poses], [p.y for p in poses], ":", color=EGO_COLOR, linewidth=1.2)
    ring = outline(poses[0], Size(EGO_LENGTH, EGO_WIDTH)).exterior.xy
    axes.fill(*ring, facecolor=EGO_COLOR, edgecolor="black", linewidth=0.4)


def _view(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Corners [m] around example motions, goal rectangles and starts of other road users."""
    points = [t.example.pose(k)[:2] for t in case.tasks for k in range(t.goal.last + 1)]
    points += [actor.motion.pose(actor.first_step)[:2] for actor in case.actors]
    points += [t.goal.zone.path.point(t.goal.zone.s) for t in case.tasks if t.goal.zone]
    return np.min(points, axis=0), np.max(points, axis=0)


def _is_flat(case: Case) -> bool:
    low, high = _view(case)
    return bool(high[1] - low[1] < FLAT_HEIGHT)


def _set_view(axes: Axes, case: Case) -> None:
    low, high = _view(case)
    axes.set_xlim(low[0] - VIEW_MARGIN, high[0] + VIEW_MARGIN)
    if _is_flat(case):
        middle = 0.5 * (low[1] + high[1])
        axes.set_ylim(middle - FLAT_HEIGHT / 2, middle + FLAT_HEIGHT / 2)
    else:
        axes.set_ylim(low[1] - VIEW_MARGIN, high[1] + VIEW_MARGIN)
        axes.set_aspect("equal")
