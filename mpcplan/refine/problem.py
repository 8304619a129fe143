"""The refinement's optimal-control problem, and its quadratic model at an iterate.

States x = [s, d, mu, v, delta, a], inputs u = [j, w], steps k = 0..N (see :mod:`.model`):

    min  dt sum_k  w_J j_k^2 + w_SR w_k^2 + w_D exp(-c (lead_k - s_k - b - r)) + w_LC e_k^2
         + w_v max(0, v_k - v_lim)^2 + w_T max(0, due_k - s_k)^2 + rho' sigma
         (+ |x_N - x_seed|_W^2 where the goal lies further)
    s.t. x_{k+1} = F(x_k, u_k), x_0 given,
         |delta| <= 0.91, 0 <= v <= 45.8, |w| <= 0.4, -11.5 <= a, a <= 11.5 min(1, 4.755/v),
         a^2 + (v^2/l tan delta)^2 <= 11.5^2 + sigma_a, |v^2/l tan delta| <= a_lat + sigma_a,
         s_min - sigma_s <= s <= s_max + sigma_s,
         d_min - sigma_d <= d_i(s, d, mu) <= d_max + sigma_d for four points i of the body's axis
         (rear to front), projected exactly; half-planes against turned obstacles,
         goal window at k = N,

with e = d + b sin mu - lane the offset of the body's centre. The slacks have an exact (L1) penalty
rho. The quadratic model linearises the constraints and takes the Gauss-Newton Hessian; the
closeness term is convex in s and enters with its own second derivative.
Source: Diehl et al.: Fast direct multiple shooting algorithms (2006).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from mpcplan.config import Config
from mpcplan.refine.constraints import FREE, Body, Constraints, Iterate
from mpcplan.refine.corridor import Corridor
from mpcplan.refine.layout import Layout, layout
from mpcplan.refine.model import linearise, propagate
from mpcplan.road.goal import GoalWindow
from mpcplan.seed.seed import Seed, Stage
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

GAUSS_POINTS = (0.5 - np.sqrt(1 / 12), 0.5 + np.sqrt(1 / 12))  # of a step
SLACK_CURVATURE = 0.1  # quadratic part of the slack penalty
DAMPING = 1e-5  # added to the Hessian's diagonal
CLOSEST = -6.0  # m, smallest gap in the closeness term
STATE_SCALE = (1.0, 0.2, 0.05, 0.5, 0.05, 1.0)  # s, d, mu, v, delta, a
INPUT_SCALE = (4.0, 0.05)  # j, w
SLACK_SCALE = (0.3, 0.1, 0.5, 0.1)  # in s, in d, acceleration, goal


class _Values:
    """What is computed once per iterate and asked for several times."""

    def __init__(self, problem: "Problem", z: Iterate) -> None:
        self._problem, self._z = problem, z

    @cached_property
    def defects(self) -> Array:
        z, problem = self._z, self._problem
        return z.x[1:] - propagate(z.x[:-1], z.u, problem.curvatures(z.x), problem.dt)

    @cached_property
    def body(self) -> Body:
        return self._problem.rows.project_body(self._z.x[1:])

    @cached_property
    def soft_rows(self) -> tuple[Array, Array, Array]:
        return self._problem.rows.soft(self._z, self.body)

    @cached_property
    def slacks(self) -> Array:
        return self._problem.rows.least_slacks(*self.soft_rows)


@dataclass(frozen=True, eq=False)
class Quadratic:
    """min p' H p / 2 + g' p  s.t.  low <= A p <= high, at an iterate."""

    hessian: Array  # diagonal blocks as a sparse matrix's upper triangle
    gradient: Array
    matrix: sp.csc_matrix
    low: Array
    high: Array


class Problem:
    """The problem of one seed; all data that does not change with the iterate."""

    def __init__(
        self, seed: Seed, corridor: Corridor, x0: Array, goal: GoalWindow | None, n: int,
        config: Config, dt: float, extra: float = 0.0,
    ) -> None:  # fmt: skip
        """N = n steps from state x0; ``goal`` is met at k = n, or None where it lies further.

        ``extra`` is kept from the road's edge on top of the configured margin [m].
        """
        self.seed, self.corridor, self.goal, self.n = seed, corridor, goal, n
        self.config, self.dt, self.x0 = config, dt, x0
        self.layout: Layout = layout(n)
        self._latest: tuple[Iterate, _Values] | None = None
        road = seed.road
        s = seed.states[: n + 1, Stage.S]
        d = seed.states[: n + 1, Stage.D]
        self.lane = d - road.limits.lane_offset(road.frame, s, d)  # the lane nearest to the seed
        self.speed_limit = np.maximum(np.interp(s, road.frame.s, road.limits.posted), 0.5)
        self.due = road.due(seed.first_step, n, config.cost.reserve)[1:]
        self.terminal = np.zeros(len(Stage)) if goal else np.array(config.refine.terminal)
        start = abs(float(x0[Stage.V] ** 2 / CAR.wheelbase * np.tan(x0[Stage.DELTA])))
        self.lateral_limit = max(config.road.lateral_acceleration, min(start, 0.9 * CAR.a_max))
        self.rows = Constraints(seed, corridor, goal, n, config, extra, self.lateral_limit)

    def scales(self) -> Array:
        """Typical sizes of all variables, in the layout's order."""
        stage = np.tile([*STATE_SCALE, *INPUT_SCALE], self.n + 1)[: -len(INPUT_SCALE)]
        slack = np.repeat(SLACK_SCALE[:3], self.n)
        return np.concatenate([stage, slack, SLACK_SCALE[3:]])

    def initial(self) -> Iterate:
        """The seed as an iterate: its states, and the inputs between them."""
        x = self.seed.states[: self.n + 1].copy()
        x[0] = self.x0
        u = np.column_stack(
            [np.diff(x[:, Stage.A]) / self.dt, np.diff(x[:, Stage.DELTA]) / self.dt]
        )
        limit = CAR.v_delta_max * self.config.refine.actuator_share
        u[:, 1] = np.clip(u[:, 1], -limit, limit)
        return Iterate(x, u)

    def curvatures(self, x: Array) -> Array:
        """(N, 3) curvature model of every step: kappa_0, kappa_1, s_0."""
        frame = self.seed.road.frame
        s = x[:-1, Stage.S]
        way = np.maximum(np.abs(x[:-1, Stage.V]) * self.dt, 0.1)
        # the line through the step's two Gauss points integrates a cubic curvature exactly
        first, second = (s + share * way for share in GAUSS_POINTS)
        kappa = frame.curvature(first)
        return np.column_stack([kappa, (frame.curvature(second) - kappa) / (second - first), first])

    def _at(self, z: Iterate) -> _Values:
        """The values at an iterate; the latest are kept."""
        if self._latest is None or self._latest[0] is not z:
            self._latest = z, _Values(self, z)
        return self._latest[1]

    def defects(self, z: Iterate) -> Array:
        """(N, 6) x_{k+1} - F(x_k, u_k)."""
        return self._at(z).defects

    def objective(self, z: Iterate) -> float:
        """The cost without slack penalties."""
        cost, x = self.config.cost, z.x[1:]
        rate = cost.jerk * z.u[:, 0] ** 2 + cost.steering_rate * z.u[:, 1] ** 2
        rate = rate + self._closeness(x) + cost.lane * self._offset(x) ** 2
        speeding = np.maximum(x[:, Stage.V] - self.speed_limit[1:], 0.0)
        rate = rate + self.config.refine.speeding * speeding**2 + cost.late * self._late(x) ** 2
        end = z.x[-1] - self.seed.states[self.n]
        return float(self.dt * rate.sum() + self.terminal @ end**2)

    def tr1(self, z: Iterate) -> float:
        """The four TR1 terms alone."""
        cost, x = self.config.cost, z.x[1:]
        rate = cost.jerk * z.u[:, 0] ** 2 + cost.steering_rate * z.u[:, 1] ** 2
        return float(self.dt * (rate + self._closeness(x) + cost.lane * self._offset(x) ** 2).sum())

    def _late(self, x: Array) -> Array:
        return np.maximum(self.due - x[:, Stage.S], 0.0)

    def _closeness(self, x: Array) -> Array:
        cost = self.config.cost
        gap = self.corridor.lead[1 : self.n + 1] - x[:, Stage.S] - CAR.rear_to_centre
        gap = np.maximum(gap - cost.distance_offset, CLOSEST)
        return cost.distance * np.exp(-cost.distance_decay * gap)

    def _offset(self, x: Array) -> Array:
        centre = x[:, Stage.D] + CAR.rear_to_centre * np.sin(x[:, Stage.MU])
        return centre - self.lane[1:]

    def slacks(self, z: Iterate) -> Array:
        """(3 N + 1,) smallest slacks with which the constraints hold: s, d, a, goal."""
        return self._at(z).slacks

    def penalty_weights(self) -> Array:
        """(3 N + 1,) weights of the slacks."""
        r = self.config.refine
        weights = np.repeat([r.penalty_lon, r.penalty_lat, r.penalty_acceleration], self.n)
        # the friction circle is scaled by 1 / a_max, so that its slack is an acceleration
        return np.concatenate([weights * self.dt, [r.penalty_goal]])

    def penalty(self, z: Iterate) -> float:
        """Slack penalties at an iterate."""
        slack = self.slacks(z)
        return float(self.penalty_weights() @ slack + SLACK_CURVATURE / 2 * slack @ slack)

    def hard_violation(self, z: Iterate) -> float:
        """Largest violation of actuator bounds."""
        low, high, value = self.rows.boxes(z)
        return float(np.maximum(np.maximum(low - value, value - high), 0.0).max(initial=0.0))

    def gradient(self, z: Iterate) -> Array:
        """Gradient of objective and slack penalty with respect to all variables."""
        lay, cost, dt = self.layout, self.config.cost, self.dt
        g = np.zeros(lay.n_vars)
        x = z.x[1:]
        g[lay.u[:, 0]] = 2 * dt * cost.jerk * z.u[:, 0]
        g[lay.u[:, 1]] = 2 * dt * cost.steering_rate * z.u[:, 1]
        late = 2 * dt * cost.late * self._late(x)
        g[lay.x[1:, Stage.S]] = dt * cost.distance_decay * self._closeness(x) - late
        offset = 2 * dt * cost.lane * self._offset(x)
        g[lay.x[1:, Stage.D]] = offset
        g[lay.x[1:, Stage.MU]] = offset * CAR.rear_to_centre * np.cos(x[:, Stage.MU])
        speeding = np.maximum(x[:, Stage.V] - self.speed_limit[1:], 0.0)
        g[lay.x[1:, Stage.V]] = 2 * dt * self.config.refine.speeding * speeding
        g[lay.x[-1]] += 2 * self.terminal * (z.x[-1] - self.seed.states[self.n])
        slack = slice(lay.slack_s[0], None)
        g[slack] = self.penalty_weights() + SLACK_CURVATURE * self.slacks(z)
        return g

    def hessian(self, z: Iterate, damping: float) -> sp.csc_matrix:
        """Gauss-Newton Hessian with Levenberg-Marquardt damping in units of the typical sizes;
        upper triangle (diagonal but for the pairs (d, mu))."""
        lay, cost, dt = self.layout, self.config.cost, self.dt
        h = DAMPING + damping / self.scales() ** 2
        h[lay.slack_s[0] :] = DAMPING
        x = z.x[1:]
        h[lay.u[:, 0]] += 2 * dt * cost.jerk
        h[lay.u[:, 1]] += 2 * dt * cost.steering_rate
        h[lay.x[1:, Stage.S]] += dt * cost.distance_decay**2 * self._closeness(x)
        h[lay.x[1:, Stage.S]] += 2 * dt * cost.late * (self._late(x) > 0)
        arm = CAR.rear_to_centre * np.cos(x[:, Stage.MU])
        h[lay.x[1:, Stage.D]] += 2 * dt * cost.lane
        h[lay.x[1:, Stage.MU]] += 2 * dt * cost.lane * arm**2
        fast = x[:, Stage.V] > self.speed_limit[1:]
        h[lay.x[1:, Stage.V]] += 2 * dt * self.config.refine.speeding * fast
        h[lay.x[-1]] += 2 * self.terminal
        h[lay.slack_s[0] :] += SLACK_CURVATURE
        return lay.hessian(h, 2 * dt * cost.lane * arm)

    def quadratic(self, z: Iterate, damping: float = 0.0) -> Quadratic:
        """The quadratic model at an iterate, in the step p."""
        after, jacobian = linearise(z.x[:-1], z.u, self.curvatures(z.x), self.dt)
        defect = z.x[1:] - after
        box_low, box_high, box = self.rows.boxes(z)
        low, high, value = self._at(z).soft_rows
        slack = self.slacks(z)
        start = self.x0 - z.x[0]
        data = np.concatenate([
            np.ones(len(Stage)), self._dynamics_data(jacobian), np.ones(4 * self.n),
            *self.rows.soft_data(z, self._at(z).body), np.ones(3 * self.n + 1),
        ])  # fmt: skip
        soft_slack = self.rows.slack_offsets(slack)
        low_all = [start, defect.T.ravel(), box_low - box, low - value + soft_slack[0], -slack]
        high_all = [start, defect.T.ravel(), box_high - box, high - value + soft_slack[1],
                    np.full(len(slack), FREE)]  # fmt: skip
        return Quadratic(
            self.hessian(z, damping), self.gradient(z), self.layout.matrix(data),
            np.maximum(np.concatenate(low_all), -FREE), np.minimum(np.concatenate(high_all), FREE),
        )  # fmt: skip

    def _dynamics_data(self, jacobian: Array) -> Array:
        """Entries of A_k p_x + B_k p_u - p_{x+1} = defect, state by state."""
        minus = np.full((self.n, 1), -1.0)
        return np.concatenate(
            [np.hstack([jacobian[:, i, :], minus]).ravel() for i in range(len(Stage))]
        )
