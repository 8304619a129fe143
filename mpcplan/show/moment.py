"""One time step of a drive as it is drawn: who is where, and what the planner had in mind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mpcplan.explain.feared import COLLISION, refused_plans
from mpcplan.observation import Box
from mpcplan.review.again import cycle_at
from mpcplan.review.considered import Considered
from mpcplan.review.replan import Replanned
from mpcplan.simulate.run import Cycle, Drive
from mpcplan.trajectory import Array, Trajectory
from mpcplan.vehicle import centres

NEAR = 15.0  # m, who comes this near to the plan is drawn in full
MOST_IN_FULL = 12  # of the others, those who come nearest
AROUND, LEAST_IN_FULL = 50.0, 5  # m, of those who come no nearer than this, so many too


@dataclass(frozen=True, eq=False)
class Moment:
    """A time step that was driven.

    Attributes:
        step: the time step.
        driven: from the beginning to it.
        ids: (n,) of the others; boxes: (n, 6) theirs, columns :class:`mpcplan.observation.Box`.
        full: (n,) whom to draw with all that is predicted of them; the others are mere boxes.
        feared: time step and obstacle of the collisions for which plans were turned down.
        cycle: whose plan is driven; None: nothing was planned.
        considered: what it considered; None: that is not known.
    """

    step: int
    driven: Trajectory
    ids: tuple[int, ...]
    boxes: Array
    full: Array
    feared: tuple[tuple[int, int], ...]
    cycle: Cycle | None
    considered: Considered | None

    @property
    def plan(self) -> Trajectory | None:
        """What is left of the plan that is driven."""
        known = self.considered
        if known is None or not known.agrees:
            return None
        plan = known.plan
        return plan.since(min(max(self.step, plan.first_step), plan.last_step))

    @property
    def fresh(self) -> bool:
        """Whether the plan was made at just this time step."""
        return self.cycle is not None and self.cycle.step == self.step


def moment(drive: Drive, replanned: Replanned, step: int) -> Moment:
    """A time step that was driven."""
    seen = drive.others[step - drive.trajectory.first_step]
    cycle = cycle_at(drive.cycles, step) if drive.cycles else None
    considered = replanned.at(cycle) if cycle is not None else None
    feared = considered.feared if considered is not None else ()
    if not feared and cycle is not None and cycle.plan.trace.get("fallback"):
        feared = _told(cycle.plan.trace)
    driven = drive.trajectory.until(step)
    full = _in_full(seen.ids, seen.boxes, considered, driven, {who for _, who in feared})
    return Moment(step, driven, seen.ids, seen.boxes, full, feared, cycle, considered)


def _told(trace: dict[str, Any]) -> tuple[tuple[int, int], ...]:
    """Time step and obstacle of the collisions by which a fallback was come to, from the trace:
    those of plans, else of the candidates that came closest to passing."""
    plans = {r.obstacle: r.step for r in refused_plans(trace) if r.obstacle is not None}
    if not plans:
        rejections = (report["rejected"].get(COLLISION) for report in trace["seeds"].values())
        plans = {
            one["obstacle"]: one["step"] for one in rejections if one and one["step"] is not None
        }
    return tuple((step, who) for who, step in plans.items())


def _in_full(
    ids: tuple[int, ...], boxes: Array, considered: Considered | None, driven: Trajectory,
    feared: set[int],
) -> Array:  # fmt: skip
    """(n,) who comes near the plan, or near the vehicle where the plan is not known."""
    if not ids:
        return np.zeros(0, dtype=bool)
    here = centres(driven.states[-1:])[0]
    away = np.hypot(*(boxes[:, [Box.X, Box.Y]] - here).T)
    if considered is not None:
        rows = {who: i for i, who in reversed(list(enumerate(considered.forecast.ids)))}
        nearest = _nearest(considered)
        known = [nearest[rows[i]] if i in rows else np.inf for i in ids]
        away = np.fmin(away, np.array(known))
    full = np.zeros(len(ids), dtype=bool)
    order = np.argsort(away, kind="stable")[:MOST_IN_FULL]
    full[order[away[order] <= NEAR]] = True
    few = order[:LEAST_IN_FULL]
    full[few[away[few] <= AROUND]] = True
    return full | np.array([i in feared for i in ids])


def _nearest(considered: Considered) -> Array:
    """(o,) how near [m] everybody's prediction comes to the plan at the same time."""
    plan, boxes = considered.plan, considered.forecast.boxes
    points = centres(plan.states)[: boxes.shape[1]]
    apart = boxes[:, : len(points), [Box.X, Box.Y]] - points
    away = np.hypot(apart[..., 0], apart[..., 1])
    return np.where(np.isnan(away), np.inf, away).min(axis=1, initial=np.inf)
