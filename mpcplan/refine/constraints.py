"""The constraints of the refinement's problem as rows: bounds, values, and derivatives.

The problem is stated in :mod:`mpcplan.refine.problem`; the order of the rows and of their entries
is that of :mod:`mpcplan.refine.layout`. A row that bounds one side only is free (``FREE``) on the
other.
"""

from dataclasses import dataclass

import numpy as np

from mpcplan.config import Config
from mpcplan.refine.corridor import Corridor, lateral_bounds
from mpcplan.road.goal import GoalWindow
from mpcplan.seed.paths import BODY_POINTS
from mpcplan.seed.seed import Seed, Stage
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

FREE = 1e4  # no bound
GOAL_MARGIN = 0.02  # m (and m/s, and 1e-2 of it rad), the window is entered by this much
Body = tuple[Array, Array, Array]  # arc lengths, offsets, heading of the body at its points


@dataclass(frozen=True, eq=False)
class Iterate:
    """States (N + 1, 6) and inputs (N, 2)."""

    x: Array
    u: Array


class Constraints:
    """The rows of one seed's problem with N = n steps."""

    def __init__(
        self, seed: Seed, corridor: Corridor, goal: GoalWindow | None, n: int, config: Config,
        extra: float, lateral_limit: float,
    ) -> None:  # fmt: skip
        """``extra`` [m] is kept from the edge; ``lateral_limit`` bounds v^2 kappa [m/s^2]."""
        self.seed, self.corridor, self.goal, self.n = seed, corridor, goal, n
        self.config, self.extra, self.lateral_limit = config, extra, lateral_limit

    def least_slacks(self, low: Array, high: Array, value: Array) -> Array:
        """(3 N + 1,) smallest slacks with which the soft rows hold: s, d, a, goal."""
        excess = np.maximum(np.maximum(low - value, value - high), 0.0)
        n, at = self.n, 0
        groups = []
        for count in (3, 2, 2 * len(BODY_POINTS), 1):  # acceleration, s, d, slant: rows per step
            groups.append(excess[at : at + count * n].reshape(count, n).max(axis=0))
            at += count * n
        acceleration, lon, lat, slant = groups
        lon = np.maximum(lon, slant)
        return np.concatenate([lon, lat, acceleration, [excess[at:].max(initial=0.0)]])

    def boxes(self, z: Iterate) -> tuple[Array, Array, Array]:
        """low, high, value of delta, v, a, w and of the acceleration limit."""
        n, share = self.n, self.config.refine.actuator_share
        x = z.x[1:]
        v, a = x[:, Stage.V], x[:, Stage.A]
        ones = np.ones(n)
        limit = CAR.a_max * np.minimum(1.0, CAR.v_switch / np.maximum(v, CAR.v_switch)) * share
        low = np.concatenate([
            -share * CAR.delta_max * ones, 0 * ones, -share * CAR.a_max * ones,
            -share * CAR.v_delta_max * ones, -FREE * ones,
        ])  # fmt: skip
        high = np.concatenate([
            share * CAR.delta_max * ones, CAR.v_max * ones, share * CAR.a_max * ones,
            share * CAR.v_delta_max * ones, limit,
        ])  # fmt: skip
        return low, high, np.concatenate([x[:, Stage.DELTA], v, a, z.u[:, 1], a])

    def soft(self, z: Iterate, body: Body) -> tuple[Array, Array, Array]:
        """low, high, value of friction, lateral acceleration (twice), s (twice), d, goal."""
        x = z.x[1:]
        lat = x[:, Stage.V] ** 2 / CAR.wheelbase * np.tan(x[:, Stage.DELTA])
        circle = (x[:, Stage.A] ** 2 + lat**2) / CAR.a_max
        circle_max = CAR.a_max * self.config.refine.friction_share**2
        s = x[:, Stage.S]
        free = np.full(self.n, FREE)
        points, d_low, d_high = self.sides(body)
        slant = self.corridor.slant[1 : self.n + 1]
        centre = self._slant_value(x)
        goal_low, goal_high, goal = self.goal_rows(z.x[-1])
        side, limit = np.full(self.n, self.lateral_limit), np.full(self.n, circle_max)
        corridor = self.corridor
        s_min, s_max = corridor.s_min[1 : self.n + 1], corridor.s_max[1 : self.n + 1]
        low = [-free, -free, -side, -free, s_min, *_both(d_low.T, -FREE, upper=False),
               -free, goal_low]  # fmt: skip
        high = [limit, side, free, s_max, free, *_both(d_high.T, FREE, upper=True),
                slant[:, 2], goal_high]  # fmt: skip
        value = [circle, lat, lat, s, s, *np.repeat(points.T, 2, axis=0), centre, goal]
        return np.concatenate(low), np.concatenate(high), np.concatenate(value)

    def _slant_value(self, x: Array) -> Array:
        """(N,) n_s s_c + n_d d_c of the body's centre."""
        slant = self.corridor.slant[1 : self.n + 1]
        s_c = x[:, Stage.S] + CAR.rear_to_centre * np.cos(x[:, Stage.MU])
        d_c = x[:, Stage.D] + CAR.rear_to_centre * np.sin(x[:, Stage.MU])
        return slant[:, 0] * s_c + slant[:, 1] * d_c

    def sides(self, body: Body) -> tuple[Array, Array, Array]:
        """(N, 3) offsets of the body's points, projected exactly, and their bounds."""
        at, offset, turn = body
        half = CAR.width / 2 * np.abs(np.cos(turn))
        corridor = self.corridor.steps(1, self.n + 1)
        low, high = lateral_bounds(self.seed, corridor, at, half, self.extra)
        return offset, low, high

    def project_body(self, x: Array) -> Body:
        """(N, 3) arc lengths and offsets of the body's points, and the body's heading there."""
        frame = self.seed.road.frame
        s, mu = x[:, Stage.S], x[:, Stage.MU]
        psi = frame.heading(s) + mu
        axle = frame.to_cartesian(s, x[:, Stage.D])
        ahead = np.stack([np.cos(psi), np.sin(psi)], axis=1)
        points = axle[:, None] + np.array(BODY_POINTS)[None, :, None] * ahead[:, None]
        at, offset = frame.to_frenet(points, s[:, None] + np.array(BODY_POINTS))
        return at, offset, psi[:, None] - frame.heading(at)

    def goal_rows(self, x: Array) -> tuple[Array, Array, Array]:
        """low, high, value of the goal's eight rows (free where nothing is asked for)."""
        goal = self.goal
        intervals = (goal.s, goal.d, goal.v, goal.psi) if goal else (None,) * 4
        mu = float(x[Stage.MU])
        heading = float(self.seed.road.frame.heading(x[Stage.S])) + mu
        values = [
            x[Stage.S] + CAR.rear_to_centre * np.cos(mu),
            x[Stage.D] + CAR.rear_to_centre * np.sin(mu),
            x[Stage.V],
            heading,
        ]
        low, high, value = [], [], []
        for i, (interval, number) in enumerate(zip(intervals, values, strict=True)):
            margin = GOAL_MARGIN * (0.1 if i == 3 else 1.0)
            a, b = _shrunk(interval, margin, number if i == 3 else None)
            low += [-FREE, a]
            high += [b, FREE]
            value += [number, number]
        return np.array(low), np.array(high), np.array(value)

    def soft_data(self, z: Iterate, body: Body) -> list[Array]:
        """Entries of the acceleration limit and of all rows with slacks, in the layout's order."""
        x = z.x[1:]
        v, delta, a = x[:, Stage.V], x[:, Stage.DELTA], x[:, Stage.A]
        ones = np.ones(self.n)
        share = self.config.refine.actuator_share
        power = CAR.a_max * CAR.v_switch * share
        slope = np.where(v > CAR.v_switch, power / np.maximum(v, CAR.v_switch) ** 2, 0.0)
        lat = v**2 / CAR.wheelbase * np.tan(delta)
        lat_v = 2 * v / CAR.wheelbase * np.tan(delta)
        lat_delta = v**2 / CAR.wheelbase / np.cos(delta) ** 2
        blocks = [np.column_stack([ones, slope])]
        circle = [2 * a, 2 * lat * lat_v, 2 * lat * lat_delta]
        blocks.append(np.column_stack([*(c / CAR.a_max for c in circle), -ones]))
        blocks.append(np.column_stack([lat_v, lat_delta, -ones]))
        blocks.append(np.column_stack([lat_v, lat_delta, ones]))
        blocks.append(np.column_stack([ones, -ones]))
        blocks.append(np.column_stack([ones, ones]))
        blocks += self._body_data(x, body[2])
        blocks.append(self._slant_data(x))
        blocks += self._goal_data(z.x[-1])
        return [block.ravel() for block in blocks]

    def _body_data(self, x: Array, turn: Array) -> list[Array]:
        """Derivatives of the points' offsets by s, d and mu: the point's motion across the path.

        At the point's projection the path has the heading psi - turn, so that a motion of the point
        along the body's own direction e counts sin(turn), and one to its left cos(turn).
        """
        frame = self.seed.road.frame
        kappa, mu = frame.curvature(x[:, Stage.S]), x[:, Stage.MU]
        stretch = 1.0 - kappa * x[:, Stage.D]
        blocks = []
        for i, point in enumerate(BODY_POINTS):
            across = np.cos(turn[:, i])
            # the rear axle moves along the path's tangent (angle -mu to the body) and its normal
            by_s = stretch * np.sin(turn[:, i] - mu) + point * kappa * across
            by_d = np.cos(turn[:, i] - mu)
            for sign in (-1.0, 1.0):  # upper bound, lower bound
                sign_column = np.full(self.n, sign)
                blocks.append(np.column_stack([by_s, by_d, point * across, sign_column]))
        return blocks

    def _slant_data(self, x: Array) -> Array:
        """Derivatives of the half-planes' values by s, d, mu, and the slack's entry."""
        slant, mu = self.corridor.slant[1 : self.n + 1], x[:, Stage.MU]
        arm = CAR.rear_to_centre
        by_mu = arm * (slant[:, 1] * np.cos(mu) - slant[:, 0] * np.sin(mu))
        return np.column_stack([slant[:, 0], slant[:, 1], by_mu, -np.ones(self.n)])

    def _goal_data(self, x: Array) -> list[Array]:
        arm = CAR.rear_to_centre * float(np.cos(x[Stage.MU]))
        turn = float(self.seed.road.frame.curvature(x[Stage.S]))
        rows = ([1.0], [1.0, arm], [1.0], [turn, 1.0])
        return [np.array([[*row, -1.0], [*row, 1.0]]) for row in rows]

    def slack_offsets(self, slack: Array) -> tuple[Array, Array]:
        """What the present slacks add to the soft rows' bounds: they are variables with steps."""
        n, points = self.n, len(BODY_POINTS)
        lon, lat, acceleration = slack[:n], slack[n : 2 * n], slack[2 * n : 3 * n]
        zero, goal = np.zeros(n), np.full(4, slack[-1])
        high = [acceleration, acceleration, zero, lon, zero, *[lat, zero] * points, lon]
        low = [zero, zero, -acceleration, zero, -lon, *[zero, -lat] * points, zero]
        pairs = np.zeros((2, 8))
        pairs[0, 1::2], pairs[1, 0::2] = -goal, goal
        return np.concatenate([*low, pairs[0]]), np.concatenate([*high, pairs[1]])


def _both(bounds: Array, free: float, upper: bool) -> list[Array]:
    """Rows (upper bound row, lower bound row) per point; the other side is free."""
    rows: list[Array] = []
    for bound in bounds:
        other = np.full(len(bound), free)
        rows += [bound, other] if upper else [other, bound]
    return rows


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
