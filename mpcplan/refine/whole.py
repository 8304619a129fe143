"""The refinement's problem as one nonlinear program, solved by CasADi's IPOPT or fatrop.

Both are interior-point methods with exact second derivatives; fatrop uses the stages' structure
(Vanroye et al.: FATROP, a fast constrained optimal control problem solver, 2023), IPOPT does not
(Waechter and Biegler, Mathematical Programming 106, 2006). They are the independent reference for
the sequential quadratic programming of :mod:`mpcplan.refine.sqp`, and may replace it
(``refine.backend``). Tables along the road are read off at an iterate
(:mod:`mpcplan.refine.reading`) and again at the solution, until it stays the same.

Variables: x_0, u_0, x_1, ..., x_N, u_N (:mod:`mpcplan.refine.stage`); u_N holds the last state's
slacks, and in place of a jerk that of the goal.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from mpcplan.config import Config
from mpcplan.refine.constraints import Iterate
from mpcplan.refine.model import NX, one_step
from mpcplan.refine.problem import SLACK_CURVATURE, STATE_SCALE, Problem
from mpcplan.refine.reading import read
from mpcplan.refine.stage import (
    N_GIVEN,
    N_ROWS,
    Free,
    Given,
    goal_rows,
    input_cost,
    stage_cost,
    stage_rows,
)
from mpcplan.seed.seed import Stage
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

PLUGINS = ("ipopt", "fatrop")
OPTIMAL = ("Solve_Succeeded", "Solved_To_Acceptable_Level", "0")
READINGS = 5  # of the road's tables at most
SETTLED = 1e-2  # typical steps, by which two readings' solutions may differ
TOLERANCE = 1e-7
NZ = NX + len(Free)
CURVATURE = [Given.KAPPA, Given.KAPPA_SLOPE, Given.KAPPA_FROM]
SLACKS = [Free.SLACK_S, Free.SLACK_D, Free.SLACK_A]


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
        change = float(np.abs((found.x - z.x) / STATE_SCALE).max())
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
        z, par = ca.SX.sym("z", NZ, n + 1), ca.SX.sym("par", N_GIVEN, n + 1)
        weights, end, turn = (ca.SX.sym(name, k) for name, k in (("w", NX), ("end", NX), ("t", 3)))
        x, u = ca.horzsplit(z[:NX, :]), ca.horzsplit(z[NX:, :])
        cost, rows = ca.SX(0), []
        for k in range(n + 1):
            if k < n:
                after = one_step(x[k], u[k][: Free.W + 1], par[CURVATURE, k], dt)
                rows.append(x[k + 1] - after)
                cost += input_cost(u[k], config, dt)
            if k == 0:
                rows.append(x[0])
                cost += ca.sumsqr(u[0][SLACKS])  # not needed there
            else:
                rows.append(stage_rows(x[k], u[k], par[:, k], config))
                cost += stage_cost(x[k], u[k], par[:, k], config, dt)
            if self._as_rows:
                rows.append(z[self._bounded[k].tolist(), k])
        goal_slack = u[n][Free.J]
        cost += ca.dot(weights, (x[n] - end) ** 2) + ca.sumsqr(u[n][Free.W])
        cost += config.refine.penalty_goal * goal_slack + SLACK_CURVATURE / 2 * goal_slack**2
        rows.append(goal_rows(x[n], goal_slack, turn))
        given = ca.vertcat(ca.vec(par), weights, end, turn)
        made = {"x": ca.vec(z), "f": cost, "g": ca.vertcat(*rows), "p": given}
        self._solver = ca.nlpsol("whole", plugin, made, self._options(plugin, iterations))

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
        free = np.stack([np.full((self._n, N_ROWS), value) for value in (-1.0, 1.0)])
        low, high = self._row_bounds(np.zeros(NX), free, np.array([[-1.0] * 4, [1.0] * 4]))
        equal = (low == high).tolist()
        return options | {"structure_detection": "auto", "equality": equal}

    def solve(self, problem: Problem, z: Iterate) -> tuple[Iterate, int, str]:
        """The solution with the tables read off at an iterate, iterations and status."""
        reading = read(problem, z)
        low, high = self._row_bounds(problem.x0, reading.rows, reading.goal)
        low_x, high_x = self._box.reshape(2, -1)
        bounds = {} if self._as_rows else {"lbx": low_x, "ubx": high_x}
        end = problem.seed.states[self._n]
        given = [reading.par.ravel(), problem.terminal, end, reading.turn]
        found = self._solver(
            x0=self._start(problem, z), p=np.concatenate(given), lbg=low, ubg=high, **bounds
        )
        stats = self._solver.stats()
        values = np.asarray(found["x"]).reshape(self._n + 1, NZ)
        answer = Iterate(values[:, :NX], values[:-1, NX : NX + Free.W + 1])
        return answer, int(stats["iter_count"]), str(stats["return_status"])

    def _start(self, problem: Problem, z: Iterate) -> Array:
        """The iterate and its slacks as one vector."""
        slack = problem.slacks(z)
        values = np.zeros((self._n + 1, NZ))
        values[:, :NX] = z.x
        values[:-1, NX : NX + Free.W + 1] = z.u
        values[1:, NX + np.array(SLACKS)] = slack[:-1].reshape(3, self._n).T
        values[-1, NX + Free.J] = slack[-1]
        return values.ravel()

    def _row_bounds(self, x0: Array, rows: Array, goal: Array) -> tuple[Array, Array]:
        """Bounds of all rows: see :class:`mpcplan.refine.reading.Reading`."""
        parts = []
        for k in range(self._n + 1):
            if k < self._n:
                parts.append(np.zeros((2, NX)))
            parts.append(rows[:, k - 1] if k else np.stack([x0, x0]))
            if self._as_rows:
                parts.append(self._box[:, k, self._bounded[k]])
        free = np.full(len(goal[0]), np.inf)
        parts.append(np.stack([np.append(-free, goal[0]), np.append(goal[1], free)]))
        low, high = np.concatenate(parts, axis=1)
        return low, high


def _box(n: int, config: Config) -> Array:
    """(2, N + 1, NZ) bounds of actuators, speed and slacks; the first state has none."""
    share = config.refine.actuator_share
    high = np.full((n + 1, NZ), np.inf)
    high[1:, Stage.DELTA] = share * CAR.delta_max
    high[1:, Stage.A] = share * CAR.a_max
    high[:-1, NX + Free.W] = share * CAR.v_delta_max
    low = -high
    low[1:, Stage.V], high[1:, Stage.V] = 0.0, CAR.v_max
    low[:, NX + np.array(SLACKS)] = 0.0
    low[-1, NX + Free.J] = 0.0
    return np.stack([low, high])
