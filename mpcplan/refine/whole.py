"""The refinement's problem as one nonlinear program, solved by CasADi's IPOPT or fatrop.

Both are interior-point methods with exact second derivatives; fatrop uses the stages' structure
(Vanroye et al.: FATROP, a fast constrained optimal control problem solver, 2023), IPOPT does not
(Waechter and Biegler, Mathematical Programming 106, 2006). They are the independent reference for
the sequential quadratic programming of :mod:`mpcplan.refine.sqp`, and may replace it
(``refine.backend``). Tables along the road are read off at an iterate
(:mod:`mpcplan.refine.reading`) and again at the solution, until it stays the same.

Variables: x_0, u_0, slacks of x_0, x_1, ..., x_N; those of x_0 and u_N serve nothing but for the
goal's slack, which stands in place of u_N's jerk.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from mpcplan.config import Config
from mpcplan.refine.model import NU, NX, one_step
from mpcplan.refine.problem import SLACK_CURVATURE, Problem, step_size
from mpcplan.refine.reading import Iterate
from mpcplan.refine.stage import (
    CURVATURE,
    N_GIVEN,
    N_GOAL,
    N_ROWS,
    SLACK_OF_ROW,
    Input,
    Slack,
    closeness,
    goal_rows,
    penalty_weights,
    residuals,
    rows,
)
from mpcplan.seed.seed import Stage
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

PLUGINS = ("ipopt", "fatrop")
OPTIMAL = ("Solve_Succeeded", "Solved_To_Acceptable_Level", "0")
READINGS = 5  # of the road's tables at most
SETTLED = 1e-2  # typical steps, by which two readings' solutions may differ
TOLERANCE = 1e-7
INPUTS = slice(NX, NX + NU)
SLACKS = slice(NX + NU, NX + NU + len(Slack))
NZ = SLACKS.stop
GOAL_SLACK = NX + Input.J  # of the last stage


@dataclass(frozen=True, eq=False)
class WholeAnswer:
    """An iterate, whether the solver calls it optimal, its status, and iterations in all."""

    z: Iterate
    ok: bool
    status: str
    iterations: int


def solve_whole(
    problem: Problem, plugin: str, iterations: int, readings: int = READINGS
) -> WholeAnswer:
    """Solves a problem from its seed; ``iterations`` at most for each reading of the tables."""
    program = _program(problem.n, problem.dt, problem.config, plugin, iterations)
    z, total, status = problem.initial(), 0, ""
    for _ in range(readings):
        found, count, status = program.solve(problem, z)
        total += count
        if status not in OPTIMAL or not np.isfinite(found.x).all():
            return WholeAnswer(z, False, status, total)
        change = step_size(found.x - z.x)
        z = found
        if change < SETTLED:
            break
    return WholeAnswer(z, True, status, total)


@lru_cache(maxsize=64)
def _program(n: int, dt: float, config: Config, plugin: str, iterations: int) -> "_Program":
    return _Program(n, dt, config, plugin, iterations)


class _Program:
    """The program of one horizon."""

    def __init__(self, n: int, dt: float, config: Config, plugin: str, iterations: int) -> None:
        self._n, self._config = n, config
        self._as_rows = plugin == "fatrop"  # which wants bounds of variables as rows
        self._box = _box(n, config)
        bounded: Array = np.any(np.isfinite(self._box), axis=0)
        self._bounded = [np.flatnonzero(stage) for stage in bounded]
        z, par = ca.SX.sym("z", NZ, n + 1), ca.SX.sym("par", N_GIVEN, n)
        weights, end = ca.SX.sym("weights", NX), ca.SX.sym("end", NX)
        bounds, turn = ca.SX.sym("bounds", N_GOAL), ca.SX.sym("turn", 3)
        x, u, slack = z[:NX, :], z[INPUTS, :], z[SLACKS, :]
        unused = ca.vertcat(slack[:, 0], u[1:, n])
        cost = ca.sumsqr(unused) + ca.dot(weights, (x[:, n] - end) ** 2)
        made: list[ca.SX] = []
        for k in range(n + 1):
            if k < n:
                made.append(x[:, k + 1] - one_step(x[:, k], u[:, k], par[CURVATURE, k], dt))
            if k == 0:
                made.append(x[:, 0])
            else:
                made.append(_slackened(rows(x[:, k], par[:, k - 1], config), slack[:, k]))
                cost += self._cost(x[:, k], u[:, k - 1], slack[:, k], par[:, k - 1], dt)
            if self._as_rows:
                made.append(z[self._bounded[k].tolist(), k])
        goal_slack = z[GOAL_SLACK, n]
        cost += config.refine.penalty_goal * goal_slack + SLACK_CURVATURE / 2 * goal_slack**2
        made.append(goal_rows(x[:, n], bounds, turn) - goal_slack)
        given = ca.vertcat(ca.vec(par), weights, end, bounds, turn)
        program = {"x": ca.vec(z), "f": cost, "g": ca.vertcat(*made), "p": given}
        self._solver = ca.nlpsol("whole", plugin, program, self._options(plugin, iterations))

    def _cost(self, x: ca.SX, u: ca.SX, slack: ca.SX, par: ca.SX, dt: float) -> ca.SX:
        """The cost of one step with its slacks."""
        judged, other = residuals(x, u, par, self._config, dt)
        cost = ca.sumsqr(judged) + ca.sumsqr(other) + SLACK_CURVATURE / 2 * ca.sumsqr(slack)
        cost += closeness(x[Stage.S], par, self._config, dt)
        return cost + ca.dot(ca.DM(penalty_weights(self._config, dt)), slack)

    def _options(self, plugin: str, iterations: int) -> dict[str, Any]:
        """Quiet, and for fatrop which rows are equations."""
        options: dict[str, Any] = {
            "print_time": False,
            "error_on_fail": False,
            plugin: {"print_level": 0, "tol": TOLERANCE, "max_iter": iterations},
        }
        if plugin == "ipopt":
            options[plugin]["sb"] = "yes"
            return options
        low, high = self._row_bounds(np.zeros(NX))
        equal = (low == high).tolist()
        return options | {"structure_detection": "auto", "equality": equal}

    def solve(self, problem: Problem, z: Iterate) -> tuple[Iterate, int, str]:
        """The solution with the tables read off at an iterate, iterations and status."""
        reading = problem.read(z)
        low, high = self._row_bounds(problem.x0)
        low_x, high_x = self._box.reshape(2, -1)
        bounds = {} if self._as_rows else {"lbx": low_x, "ubx": high_x}
        end = problem.seed.states[self._n]
        given = [reading.par.ravel(), problem.terminal, end, reading.goal, reading.turn]
        found = self._solver(
            x0=self._start(problem, z), p=np.concatenate(given), lbg=low, ubg=high, **bounds
        )
        stats = self._solver.stats()
        values = np.asarray(found["x"]).reshape(self._n + 1, NZ)
        answer = Iterate(values[:, :NX], values[:-1, INPUTS])
        return answer, int(stats["iter_count"]), str(stats["return_status"])

    def _start(self, problem: Problem, z: Iterate) -> Array:
        """The iterate and its slacks as one vector."""
        slack = problem.at(z).slacks
        values = np.zeros((self._n + 1, NZ))
        values[:, :NX] = z.x
        values[:-1, INPUTS] = z.u
        values[1:, SLACKS] = slack[:-1].reshape(self._n, -1)
        values[-1, GOAL_SLACK] = slack[-1]
        return values.ravel()

    def _row_bounds(self, x0: Array) -> tuple[Array, Array]:
        """Bounds of all rows."""
        below = np.stack([np.full(N_ROWS, -np.inf), np.zeros(N_ROWS)])
        parts = []
        for k in range(self._n + 1):
            if k < self._n:
                parts.append(np.zeros((2, NX)))
            parts.append(below if k else np.stack([x0, x0]))
            if self._as_rows:
                parts.append(self._box[:, k, self._bounded[k]])
        parts.append(np.stack([np.full(N_GOAL, -np.inf), np.zeros(N_GOAL)]))
        low, high = np.concatenate(parts, axis=1)
        return low, high


def _slackened(g: ca.SX, slack: ca.SX) -> ca.SX:
    """Rows less their slacks."""
    return ca.vertcat(
        *(g[i] if s is None else g[i] - slack[int(s)] for i, s in enumerate(SLACK_OF_ROW))
    )


def _box(n: int, config: Config) -> Array:
    """(2, N + 1, NZ) bounds of actuators, speed and slacks; the first state has none."""
    share = config.refine.actuator_share
    high = np.full((n + 1, NZ), np.inf)
    high[1:, Stage.DELTA] = share * CAR.delta_max
    high[1:, Stage.A] = share * CAR.a_max
    high[:-1, NX + Input.W] = share * CAR.v_delta_max
    low = -high
    low[1:, Stage.V], high[1:, Stage.V] = 0.0, CAR.v_max
    low[:, SLACKS] = 0.0
    low[-1, GOAL_SLACK] = 0.0
    return np.stack([low, high])
