"""The refinement's optimal-control problem, and its quadratic model at an iterate.

States x = [s, d, mu, v, delta, a], inputs u = [j, w], steps k = 0..N (see :mod:`.model`):

    min  dt sum_k  w_J (e_k j_k)^2 + w_SR w_k^2 + w_D exp(-c (lead_k - s_k - b - r)) + w_LC e_k^2
         + w_v max(0, v_k - v_lim)^2 + w_T max(0, due_k - s_k)^2 + rho' sigma
         + dt w_J (3/8 a_N / dt)^2 where the drive ends
         (+ |x_N - x_seed|_W^2 where the goal lies further)
    s.t. x_{k+1} = F(x_k, u_k), x_0 given,
         |delta| <= 0.91, 0 <= v <= 45.8, |w| <= 0.4, -11.5 <= a, a <= 11.5 min(1, 4.755/v),
         a^2 + (v^2/l tan delta)^2 <= 11.5^2 + sigma_a, |v^2/l tan delta| <= a_lat + sigma_a,
         s_min - sigma_s <= s <= s_max + sigma_s,
         d_min - sigma_d <= d_i(s, d, mu) <= d_max + sigma_d for four points i of the body's axis
         (rear to front), projected exactly; half-planes against turned obstacles,
         goal window at k = N,

with e = d + b sin mu - lane the offset of the body's centre, and e_k = 1 but for 3/8 in the drive's
first step (:mod:`mpcplan.seed.cost`). The slacks have an exact (L1) penalty
rho. The quadratic model linearises the constraints and takes the Gauss-Newton Hessian; the
closeness term is convex in s and enters with its own second derivative. Functions and derivatives
of a step are CasADi's (:mod:`.stage`, :mod:`.compiled`), their parameters are read off along the
road at every iterate (:mod:`.reading`).
Source: Diehl et al.: Fast direct multiple shooting algorithms (2006).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mpcplan.config import Config
from mpcplan.refine.compiled import compiled, functions
from mpcplan.refine.corridor import Corridor
from mpcplan.refine.layout import STATE_SCALE, Layout, layout
from mpcplan.refine.reading import FREE, Iterate, Reader, Reading
from mpcplan.refine.stage import BOXES, Given, box_bounds, penalty_weights
from mpcplan.road.goal import GoalWindow
from mpcplan.seed.cost import EDGE
from mpcplan.seed.seed import Seed, Stage
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

SLACK_CURVATURE = 0.1  # quadratic part of the slack penalty
DAMPING = 1e-5  # added to the Hessian's diagonal
SLOWEST_LIMIT = 0.5  # m/s, of a speed limit
READ = 3  # the first of a state's components: what is read off depends on s, d and mu
NEAR = 0.05  # typical sizes, by which they may move before it is read off again
FRICTION_LEFT = 0.9  # part of the friction circle that lateral acceleration may take from the start


@dataclass(frozen=True, eq=False)
class Quadratic:
    """min p' H p / 2 + g' p  s.t.  low <= A p <= high, at an iterate.

    Variables are the changes of states and inputs, and the slacks themselves.

    Attributes:
        hessian, matrix: data of the upper triangle of H and of A, in the order of the layout's
            patterns.
        gradient, low, high: vectors.
    """

    hessian: Array
    gradient: Array
    matrix: Array
    low: Array
    high: Array


@dataclass(frozen=True, eq=False)
class Point:
    """An iterate with its values.

    Attributes:
        z: the iterate.
        reading: the parameters with which it was evaluated.
        defects: (N, 6) x_{k+1} - F(x_k, u_k).
        slacks: (3 N + 1,) smallest slacks with which the constraints hold: s, d, a of every state,
            and the goal's.
        objective: cost without penalties; tr1: the part that TR1 counts; penalty: of the slacks.
        hard: largest violation of actuator bounds.
    """

    z: Iterate
    reading: Reading
    defects: Array
    slacks: Array
    objective: float
    tr1: float
    penalty: float
    hard: float

    @property
    def cost(self) -> float:
        """Objective and penalties."""
        return self.objective + self.penalty


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
        made = functions(config, dt)
        self.layout: Layout = layout(made, n)
        self._compiled = compiled(config, dt, n)
        road = seed.road
        s = seed.states[1 : n + 1, Stage.S]
        d = seed.states[1 : n + 1, Stage.D]
        self.lane = d - road.limits.lane_offset(road.frame, s, d)  # the lane nearest to the seed
        posted = np.interp(s, road.frame.s, road.limits.posted)
        self.speed_limit = np.maximum(posted, SLOWEST_LIMIT)
        self.due = road.due(seed.first_step, n, config.cost.reserve)[1:]
        self.terminal = np.zeros(len(Stage)) if goal else np.array(config.refine.terminal)
        start = abs(float(x0[Stage.V] ** 2 / CAR.wheelbase * np.tan(x0[Stage.DELTA])))
        self.lateral_limit = max(
            config.road.lateral_acceleration, min(start, FRICTION_LEFT * CAR.a_max)
        )
        edges, begins = config.cost.edges, seed.first_step == road.first_step
        constant = {
            Given.SPEED_LIMIT: self.speed_limit,
            Given.DUE: np.maximum(self.due, -FREE),
            Given.LANE: self.lane,
            Given.LATERAL: np.full(n, self.lateral_limit),
            Given.JERK_SHARE: _shares(n, edges and begins, 0, 1.0),
            Given.END_SHARE: _shares(n, edges and goal is not None, -1, 0.0),
        }
        self.read = Reader(road, corridor, goal, n, dt, constant, extra)
        self.weights = np.append(
            np.tile(penalty_weights(config, dt), n), config.refine.penalty_goal
        )
        self._box = box_bounds(config)

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

    def at(self, z: Iterate, reading: Reading | None = None) -> Point:
        """Values at an iterate; with a reading, by that instead of the iterate's own."""
        reading = reading or self.read(z)
        made = self._compiled.values(z.x[:-1], z.u, z.x[1:], reading.par)
        defects, slack, hard, cost, tr1 = made
        goal, _ = self._compiled.goal(z.x[-1], reading.goal, reading.turn)
        slacks = np.append(slack, max(float(goal.max()), 0.0))
        away = z.x[-1] - self.seed.states[self.n]
        return Point(
            z, reading, defects.copy(), slacks, float(cost.sum() + self.terminal @ away**2),
            float(tr1.sum()), float(self.weights @ slacks + SLACK_CURVATURE / 2 * slacks @ slacks),
            float(hard.max()),
        )  # fmt: skip

    def again(self, point: Point) -> Point:
        """A point with what is read off there; itself if the iterate has hardly moved since the
        last reading."""
        moved = np.abs(point.z.x[:, :READ] - point.reading.x[:, :READ]) / STATE_SCALE[:READ]
        return point if moved.max() < NEAR else self.at(point.z)

    def quadratic(self, point: Point, damping: float = 0.0) -> Quadratic:
        """The quadratic model at an iterate; Levenberg-Marquardt damping in units of the typical
        sizes is added to its Hessian."""
        z, lay, reading = point.z, self.layout, point.reading
        rows, dynamics, of_rows, gradient, hessian = self._compiled.model(
            z.x[:-1], z.u, z.x[1:], reading.par
        )
        goal, of_goal = self._compiled.goal(z.x[-1], reading.goal, reading.turn)
        low, high, g = (array.copy() for array in self._template)
        low[lay.dynamics] = high[lay.dynamics] = point.defects.ravel()
        high[lay.soft], high[lay.at_goal] = -rows.ravel(), -goal.ravel()
        value = np.hstack([z.u, z.x[1:]])[:, BOXES]
        for bound, own in zip((low, high), self._box, strict=True):
            of_steps = bound[lay.box][:-1].reshape(self.n, -1)
            of_steps[:, : len(BOXES)] = own - value
        data = np.concatenate([dynamics.ravel(), of_rows.ravel(), of_goal.ravel(), lay.constants])
        g[:-1].reshape(self.n, -1)[:, : gradient.shape[1]] = gradient
        g[lay.x[-1]] += 2 * self.terminal * (z.x[-1] - self.seed.states[self.n])
        return Quadratic(self._hessian(hessian, damping), g, data, low, np.minimum(high, FREE))

    @cached_property
    def _template(self) -> tuple[Array, Array, Array]:
        """Bounds and gradient of the quadratic model as far as they do not change."""
        lay = self.layout
        low, high = np.full(lay.n_rows, -FREE), np.full(lay.n_rows, FREE)
        low[lay.box] = 0.0  # of the slacks
        gradient = np.zeros(lay.n_vars)
        gradient[lay.slacks] = self.weights
        return low, high, gradient

    def _hessian(self, nonzeros: Array, damping: float) -> Array:
        """Data of the Hessian's upper triangle, of the nonzeros of its steps."""
        lay = self.layout
        h = DAMPING + damping / lay.columns**2
        h[lay.slacks] = DAMPING + SLACK_CURVATURE
        h[lay.h_at] += nonzeros[:, lay.h_on]
        h[lay.x[-1]] += 2 * self.terminal
        return np.concatenate([h, nonzeros[:, lay.h_apart].ravel()])


def _shares(n: int, at_edge: bool, edge: int, inside: float) -> Array:
    """(n,) the same share for all steps but for the one at an edge of the drive."""
    shares = np.full(n, inside)
    if at_edge:
        shares[edge] = EDGE
    return shares


def step_size(dx: Array) -> float:
    """The largest change of a state in units of typical sizes."""
    return float(np.abs(dx / STATE_SCALE).max())
