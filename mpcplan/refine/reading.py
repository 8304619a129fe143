"""What the refinement's problem looks up along the road, read off at an iterate.

The parameters of :mod:`mpcplan.refine.stage`: the curvature as a line over the step, the road's
edges and the neighbours beside as lines in s, and what the body's exact projection adds to that
onto a circle. The projection's derivative by s joins the slopes of the edges, so that the rows and
their derivatives by s are exact where they were read off.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from mpcplan.refine.corridor import Corridor
from mpcplan.refine.stage import CURVATURE, N_GIVEN, N_GOAL, Given, Point, body_offset_at
from mpcplan.road.goal import GoalWindow
from mpcplan.road.road import Road
from mpcplan.seed.paths import BODY_POINTS
from mpcplan.seed.seed import Stage
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

FREE = 1e4  # no bound
NO_LEAD = 1e3  # m ahead, in place of infinity
REACH = 0.25  # m, to either side, over which the edges' slopes are read off
AROUND = 3.0  # m, to either side, over which an edge is the strictest for a body far from it
ROOM = 0.3  # m, from the strictest edge around, from which a body counts as far
PROJECTED = 1e-4  # m, of the body's points in s; the error of their offsets is its square's size
GAUSS_POINTS = (0.5 - np.sqrt(1 / 12), 0.5 + np.sqrt(1 / 12))  # of a step
LEAST_STRETCH = 0.1  # of a circle around which the body's points are sought
SHORTEST_WAY = 0.1  # m, between the Gauss points' places at least
GOAL_MARGIN = 0.02  # m (and m/s, and 1e-2 of it rad), the window is entered by this much
AHEAD = np.array(BODY_POINTS)
NO_GOAL = np.repeat([-FREE, FREE], N_GOAL // 2)


@dataclass(frozen=True, eq=False)
class Iterate:
    """States (N + 1, 6) and inputs (N, 2)."""

    x: Array
    u: Array


@dataclass(frozen=True, eq=False)
class Reading:
    """What was read off at an iterate.

    Attributes:
        par: (N, N_GIVEN) parameters of the steps into the states 1..N.
        goal: (8,) bounds of the last body's s, d, speed and heading: lower ones, then upper ones.
        turn: (3,) heading and curvature of the path at an arc length: for the last heading.
        x: (N + 1, 6) the iterate's states.
    """

    par: Array
    goal: Array
    turn: Array
    x: Array


class Reader:
    """Reads off for one seed's problem."""

    def __init__(
        self, road: Road, corridor: Corridor, goal: GoalWindow | None, n: int, dt: float,
        constant: dict[Given, Array], extra: float,
    ) -> None:  # fmt: skip
        """``constant`` does not depend on the iterate; ``extra`` [m] is kept from the edge."""
        self._road, self._corridor, self._goal, self._dt = road, corridor, goal, dt
        self._extra = extra
        later = corridor.steps(1, n + 1)
        self._beside = later.d_min, later.d_max
        self._par = np.zeros((n, N_GIVEN))
        for name, values in constant.items():
            self._par[:, name] = values
        self._par[:, Given.S_MIN], self._par[:, Given.S_MAX] = later.s_min, later.s_max
        self._par[:, [Given.SLANT_S, Given.SLANT_D, Given.SLANT_MAX]] = later.slant
        self._lead = later.lead
        self._strictest = _strictest(road)

    def __call__(self, z: Iterate) -> Reading:
        """The reading at an iterate."""
        par, frame = self._par.copy(), self._road.frame
        s = z.x[1:, Stage.S]
        kappa, bend = frame.curvature(np.stack([s, s + CAR.rear_to_centre]))
        par[:, CURVATURE] = self.curvatures(z.x)
        par[:, Given.LEAD] = np.minimum(self._lead, s + NO_LEAD)
        par[:, Given.AT], par[:, Given.BEND] = s, bend
        self._read_body(z.x[1:], par, kappa, bend)
        last = s[-1:]
        turn = np.concatenate([frame.heading(last), kappa[-1:], last])
        return Reading(par, self._goal_bounds(float(turn[0] + z.x[-1, Stage.MU])), turn, z.x)

    def curvatures(self, x: Array) -> Array:
        """(N, 3) curvature model of every step: kappa_0, kappa_1, s_0."""
        s = x[:-1, Stage.S]
        way = np.maximum(np.abs(x[:-1, Stage.V]) * self._dt, SHORTEST_WAY)
        # the line through the step's two Gauss points integrates a cubic curvature exactly
        model = np.empty((len(s), len(CURVATURE)))
        places = s + np.multiply.outer(GAUSS_POINTS, way)
        first, second = self._road.frame.curvature(places)
        model[:, 0], model[:, 1] = first, (second - first) / (places[1] - places[0])
        model[:, 2] = places[0]
        return model

    def project_body(self, x: Array, bend: Array | None = None) -> tuple[Array, Array, Array]:
        """(n, 4) arc lengths and offsets of the body's points, and the body's heading there.

        ``bend``: the curvatures at the bodies' centres, where they are known already.
        """
        frame = self._road.frame
        s, d, mu = x[:, Stage.S], x[:, Stage.D], x[:, Stage.MU]
        psi = frame.heading(s) + mu
        axle = frame.to_cartesian(s, d)
        along, across = np.cos(mu)[:, None] * AHEAD, np.sin(mu)[:, None] * AHEAD
        points = np.empty((*along.shape, 2))
        points[..., 0] = axle[:, 0, None] + np.cos(psi)[:, None] * AHEAD
        points[..., 1] = axle[:, 1, None] + np.sin(psi)[:, None] * AHEAD
        # where the points would be if the path was a circle; the projection starts from there
        kappa = (frame.curvature(s + CAR.rear_to_centre) if bend is None else bend)[:, None]
        near = along / np.maximum(1.0 - kappa * (d[:, None] + across), LEAST_STRETCH)
        near *= 1.0 - (kappa * near) ** 2 / 3
        at, offset = frame.to_frenet(points, s[:, None] + near, PROJECTED)
        return at, offset, psi[:, None] - frame.heading(at)

    def _read_body(self, x: Array, par: Array, kappa: Array, bend: Array) -> None:
        """Parameters of the body's points, into their rows."""
        d, mu = x[:, Stage.D, None], x[:, Stage.MU, None]
        at, offset, turn = self.project_body(x, bend)
        of_points = par[:, len(Given) :].reshape(len(x), len(AHEAD), len(Point))
        of_points[..., Point.BIAS] = offset - body_offset_at(d, mu, bend[:, None], AHEAD)
        # the rear axle moves along the path's tangent (angle -mu to the body); a motion of the
        # point along the body's own direction counts sin(turn), one to its left cos(turn)
        by_s = (1.0 - kappa[:, None] * d) * np.sin(turn - mu)
        by_s += AHEAD * kappa[:, None] * np.cos(turn)
        low, high = self.sides(at, offset, turn)
        of_points[..., Point.LOW], of_points[..., Point.HIGH] = low[0], high[0]
        of_points[..., Point.LOW_SLOPE] = low[1] - by_s
        of_points[..., Point.HIGH_SLOPE] = high[1] - by_s

    def sides(
        self, at: Array, offset: Array, turn: Array
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Lower and upper bounds, with slopes, of the body's points at (n, 4) s and offsets.

        The tighter of the road's edge and the obstacle beside bounds. The edge counts where the
        body's side is, which a turned body has ahead of the point or behind it; an obstacle's bound
        was made for the body's full half width. An edge that is nowhere near the body is the
        strictest one around, and level: the line along a corner of the road far aside would stop
        the body from moving along the path.
        """
        frame, limits = self._road.frame, self._road.limits
        half = CAR.width / 2 * np.abs(np.cos(turn))
        shift = CAR.width / 2 * np.sin(turn)
        sides = []
        for edge, strictest, beside, sign in (
            (limits.right, self._strictest[0], self._beside[0], 1.0),
            (limits.left, self._strictest[1], self._beside[1], -1.0),
        ):
            side = at + sign * shift
            before, here, after = np.interp([side - REACH, side, side + REACH], frame.s, edge)
            around = np.interp(side, frame.s, strictest)
            kept = sign * (half + self._extra)
            far = sign * (offset - around - kept) > ROOM
            road = np.where(far, around, here) + kept
            other = beside[:, None] + sign * (half - CAR.width / 2)
            sloped = (sign * road >= sign * other) & ~far
            slope = np.where(sloped, (after - before) / (2 * REACH), 0.0)
            sides.append((sign * np.maximum(sign * road, sign * other), slope))
        return sides[0], sides[1]

    def _goal_bounds(self, heading: float) -> Array:
        """(8,) bounds of the goal's four values; far where nothing is asked for."""
        if self._goal is None:
            return NO_GOAL
        goal = self._goal
        bounds = []
        for i, interval in enumerate((goal.s, goal.d, goal.v, goal.psi)):
            margin = GOAL_MARGIN * (0.1 if i == 3 else 1.0)
            bounds.append(_shrunk(interval, margin, heading if i == 3 else None))
        return np.array(bounds).T.ravel()


@lru_cache(maxsize=32)
def _strictest(road: Road) -> tuple[Array, Array]:
    """The strictest right and left edge within :data:`AROUND` of every sample."""
    samples = 2 * (int(np.ceil(AROUND / road.frame.spacing)) + 1) + 1
    return maximum_filter1d(road.limits.right, samples), minimum_filter1d(road.limits.left, samples)


def _shrunk(
    interval: tuple[float, float] | None, margin: float, angle: float | None
) -> tuple[float, float]:
    """The interval less a margin; angles are moved to the turn of the present value."""
    if interval is None:
        return -FREE, FREE
    low, high = interval
    margin = min(margin, (high - low) / 2)
    low, high = low + margin, high - margin
    if angle is not None:
        turn = 2 * np.pi * np.round((angle - (low + high) / 2) / (2 * np.pi))
        low, high = low + turn, high + turn
    return low, high
