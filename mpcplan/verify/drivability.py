"""What every plan must pass before it is executed; stricter than the official checker.

1. kinematics: the KS model, simulated from the first state with the plan's inputs, reproduces
   every state (position, steering angle, speed, heading), and all inputs are within the limits;
2. collision: the body, grown by a margin, overlaps no predicted rectangle at any time step
   (separating axis theorem on oriented rectangles, exact);
3. road: the body lies within the drivable area at every time step.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from mpcplan.config import VerifyConfig
from mpcplan.observation import Box, Forecast
from mpcplan.trajectory import Array, State, Trajectory
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import centres, input_violations, rectangles, simulate

LIMIT_TOLERANCE = 1e-9
OFF_ROAD = 1e-8  # m^2, area outside of the road that counts as on it (rounding)


@dataclass(frozen=True)
class Finding:
    """The result of verification: ``ok``, or the check that failed, where and by how much.

    Attributes:
        check: 'kinematics', 'collision' or 'road'; '' where all passed.
        step: time step of the first failure.
        obstacle: the obstacle hit.
        amount: by how much, in ``unit``.
        detail: the limit or state concerned.
    """

    ok: bool
    check: str = ""
    step: int | None = None
    obstacle: int | None = None
    amount: float = 0.0
    unit: str = ""
    detail: str = ""

    def as_dict(self) -> dict[str, Any]:
        """For the trace."""
        return {name: value for name, value in vars(self).items() if value not in (None, "")}

    def __str__(self) -> str:
        if self.ok:
            return "passed"
        what = f" with obstacle {self.obstacle}" if self.obstacle is not None else ""
        size = f" ({self.detail} {self.amount:.3g} {self.unit})".replace("( ", "(")
        return f"{self.check}{what} at step {self.step}{size}"


PASSED = Finding(True)


def verify(
    trajectory: Trajectory, forecast: Forecast, area: shapely.Geometry, config: VerifyConfig,
    tail: int | None = None, behind: Array | None = None,
) -> Finding:  # fmt: skip
    """The first of the checks that a trajectory fails, or :data:`PASSED`.

    Args:
        trajectory: what is checked.
        forecast: of the others.
        area: the drivable area.
        config: margins and tolerances.
        tail: time step after which it is a contingency that a later plan will most likely replace:
            there the body may be ``config.tail_road`` off the road; None: nowhere.
        behind: (o,) obstacles that stay behind by themselves in the tail; None: no one.
    """
    allowed = np.zeros(len(trajectory))
    if tail is not None:
        allowed[trajectory.steps > tail] = config.tail_road
    for finding in (
        check_kinematics(trajectory, config.position_tolerance),
        check_collision(trajectory, forecast, config.margin, tail, behind),
        check_road(trajectory, area, allowed),
    ):
        if not finding.ok:
            return finding
    return PASSED


def check_kinematics(trajectory: Trajectory, tolerance: float) -> Finding:
    """States follow from the inputs, and the inputs are within the model's limits."""
    again = simulate(trajectory.states[0], trajectory.inputs, trajectory.dt, trajectory.first_step)
    error = np.abs(again.states - trajectory.states)
    if error.max() > tolerance:
        k, column = (int(i) for i in np.unravel_index(np.argmax(error), error.shape))
        return Finding(
            False, "kinematics", trajectory.first_step + k, None, float(error.max()), "m or rad",
            f"{State(column).name.lower()} differs by",
        )  # fmt: skip
    for name, excess in input_violations(trajectory).items():
        if excess.max(initial=-1.0) > LIMIT_TOLERANCE:
            k = int(np.argmax(excess > LIMIT_TOLERANCE))
            return Finding(
                False, "kinematics", trajectory.first_step + k, None, float(excess.max()),
                "over the limit", name,
            )  # fmt: skip
    return PASSED


def check_collision(
    trajectory: Trajectory, forecast: Forecast, margin: float, tail: int | None = None,
    behind: Array | None = None,
) -> Finding:  # fmt: skip
    """No overlap with any predicted rectangle from the second state on; after the time step
    ``tail`` those (o,) that are ``behind`` do not count.

    The margin shrinks to what the first state leaves of it: a start close to another car is no
    reason to refuse every plan, touching it is.
    """
    boxes = forecast.at(trajectory.steps)
    if tail is not None and behind is not None:
        boxes[behind[:, None] & (trajectory.steps > tail)] = np.nan
    gap = separation(trajectory.states, boxes)
    with np.errstate(invalid="ignore"):
        present = np.nan_to_num(gap[:, 0], nan=np.inf)
    allowed = np.clip(present - margin / 10, 0.0, margin)
    hit = gap[:, 1:] < allowed[:, None]
    if not hit.any():
        return PASSED
    k = int(np.argmax(hit.any(axis=0)))
    row = int(np.argmax(hit[:, k]))
    return Finding(
        False, "collision", trajectory.first_step + k + 1, forecast.ids[row],
        float(gap[row, k + 1]), "m", "gap",
    )  # fmt: skip


def separation(states: Array, boxes: Array) -> Array:
    """(o, n) gap [m] between the body at (n, 5) states and (o, n, 6) boxes.

    The largest separation along the axes of both rectangles: negative where they overlap, at most
    the distance where they do not; NaN where there is no box.
    """
    centre = centres(states)
    dx = boxes[..., Box.X] - centre[None, :, 0]
    dy = boxes[..., Box.Y] - centre[None, :, 1]
    ego, other = states[None, :, State.PSI], boxes[..., Box.PSI]
    half = (CAR.length / 2, CAR.width / 2)
    gap = np.full(dx.shape, -np.inf)
    for axis in (ego, ego + np.pi / 2, other, other + np.pi / 2):
        reach = half[0] * np.abs(np.cos(ego - axis)) + half[1] * np.abs(np.sin(ego - axis))
        reach = reach + boxes[..., Box.LENGTH] / 2 * np.abs(np.cos(other - axis))
        reach = reach + boxes[..., Box.WIDTH] / 2 * np.abs(np.sin(other - axis))
        gap = np.maximum(gap, np.abs(dx * np.cos(axis) + dy * np.sin(axis)) - reach)
    return gap


def check_road(
    trajectory: Trajectory, area: shapely.Geometry, allowed: Array | float = 0.0
) -> Finding:
    """The body stays on the drivable area, or no further off it than it is at the first state, or
    than is allowed, (n + 1,) areas [m^2]."""
    bodies = shapely.polygons(rectangles(trajectory.states))
    inside = shapely.covers(area, bodies)
    if inside[1:].all():
        return PASSED
    outside = np.zeros(len(bodies))
    outside[~inside] = shapely.area(shapely.difference(bodies[~inside], area))
    least = np.maximum(outside[0], np.broadcast_to(allowed, len(bodies))[1:])
    bad = outside[1:] > least + OFF_ROAD
    if not bad.any():
        return PASSED
    k = int(np.argmax(bad)) + 1
    return Finding(
        False, "road", trajectory.first_step + k, None, float(outside[k]), "m^2", "off the road by"
    )
