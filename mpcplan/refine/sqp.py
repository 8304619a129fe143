"""Sequential quadratic programming for the refinement's problem.

At each iterate the quadratic model is solved for a step p, which is shortened by halving until the
merit function phi(z) = objective + slack penalties + rho |defects|_1 falls (Nocedal and Wright,
Numerical Optimization, ch. 18). Where no shortened step does that, the model is solved again with
more Levenberg-Marquardt damping. KKT residuals are computed here from the multipliers, not taken
from the QP solver, and only when they are asked for.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mpcplan.config import WHOLE, Backend, RefineConfig
from mpcplan.refine.problem import SLACK_CURVATURE, Point, Problem, step_size
from mpcplan.refine.qp import QpSolver
from mpcplan.refine.reading import Iterate
from mpcplan.refine.whole import solve_whole
from mpcplan.trajectory import Array

DEFECT_PENALTY = 200.0  # rho of the merit function, at least
RHO_SHARE = 1.2  # or this multiple of the largest multiplier
DEFECT_TOLERANCE = 1e-3
ARMIJO = 1e-6
DAMPING_LESS, DAMPING_MORE = 0.3, 4.0  # after a whole step, after a short one
DAMPING_REFUSED, DAMPING_LEAST = 10.0, 0.01  # after a step without descent
DAMPING_MAX = 10.0  # beyond which no step can be expected to help
FAILED = "subproblem failed"
HARD = 10.0  # weight of actuator bounds beside that of defects
STALLED = 0.1  # scaled step below which no descent means that the optimum is reached


@dataclass(frozen=True)
class Kkt:
    """KKT residuals: |grad L|_inf, largest defect, largest actuator excess, complementarity."""

    stationarity: float
    defect: float
    bounds: float
    complementarity: float

    def as_dict(self) -> dict[str, float | None]:
        """For the trace; None where no subproblem was solved."""
        return {
            name: float(f"{value:.3e}") if np.isfinite(value) else None
            for name, value in vars(self).items()
        }


@dataclass(frozen=True, eq=False)
class SqpResult:
    """The last iterate with how it came about.

    Attributes:
        z: the iterate.
        status: 'converged', 'iteration limit', 'no descent' or 'subproblem failed: ...'.
        iterations: SQP iterations; qp_iterations: those of the QP solver in all.
        cost_before, cost_after: objective plus slack penalties; tr1: the terms of the objective
            that TR1 counts, before and after.
        residuals: computes the KKT residuals.
    """

    z: Iterate
    status: str
    iterations: int
    qp_iterations: int
    cost_before: float
    cost_after: float
    tr1: tuple[float, float]
    residuals: Callable[[], Kkt]

    @cached_property
    def kkt(self) -> Kkt:
        """KKT residuals at the last iterate with the multipliers of the last subproblem."""
        return self.residuals()

    @property
    def gained(self) -> float:
        """How much the cost fell."""
        return self.cost_before - self.cost_after

    @property
    def failed(self) -> bool:
        """Whether a subproblem could not be solved."""
        return self.status.startswith(FAILED)

    def as_dict(self) -> dict[str, Any]:
        """For the trace."""
        return {
            "status": self.status,
            "iterations": self.iterations,
            "qp_iterations": self.qp_iterations,
            "kkt": self.kkt.as_dict(),
            "cost_before": round(self.cost_before, 6),
            "cost_after": round(self.cost_after, 6),
        }


def solve(problem: Problem, config: RefineConfig, fresh: bool = True) -> SqpResult:
    """Solves a problem from its seed; ``fresh``: with the effort for a seed never refined."""
    backend = config.fresh_backend if fresh else config.backend
    if backend in WHOLE:
        return _whole(problem, backend, config)
    most = config.fresh_iterations if fresh else config.iterations
    solver = _solver(problem, backend, config)
    start = point = problem.at(problem.initial())
    status, qp_iterations, iteration = "iteration limit", 0, 0
    multipliers: Array | None = None
    damping = config.damping
    for iteration in range(1, most + 1):  # noqa: B007 (told in the result)
        answer = solver.solve(problem.quadratic(point, damping))
        qp_iterations += answer.iterations
        if not answer.usable:
            status = f"{FAILED}: {answer.status}"
            break
        multipliers = answer.y
        moved = _line_search(problem, point, answer.p, multipliers, config.line_search)
        if moved is None:  # the model is not trusted that far: a shorter step by more damping
            if damping > DAMPING_MAX:
                status = "no descent"
                break
            damping = max(damping * DAMPING_REFUSED, DAMPING_LEAST)
            continue
        trial, size, gain, share = moved
        point = problem.again(trial)
        damping *= DAMPING_LESS if share == 1.0 else DAMPING_MORE if share < 0.5 else 1.0
        settled = size < config.tolerance or gain < config.gain * (1.0 + start.cost)
        if settled and np.abs(point.defects).max() < DEFECT_TOLERANCE:
            status = "converged"
            break
    return SqpResult(
        point.z, status, iteration, qp_iterations, start.cost, point.cost, (start.tr1, point.tr1),
        lambda: _residuals(problem, point, multipliers),
    )  # fmt: skip


def _solver(problem: Problem, backend: Backend, config: RefineConfig) -> QpSolver:
    return QpSolver(problem.layout, backend, config.qp_iterations, config.qp_tolerance)


def _whole(problem: Problem, backend: str, config: RefineConfig) -> SqpResult:
    """The result of a solver of the whole problem; multipliers are those of an exact step."""
    start = problem.at(problem.initial())
    answer = solve_whole(problem, backend, config.whole_iterations)
    point = problem.at(answer.z)
    status = "converged" if answer.ok else f"{FAILED}: {answer.status}"

    def residuals() -> Kkt:
        step = _solver(problem, "piqp", config).solve(problem.quadratic(point))
        return _residuals(problem, point, step.y)

    return SqpResult(
        point.z, status, 1, answer.iterations, start.cost, point.cost, (start.tr1, point.tr1),
        residuals,
    )  # fmt: skip


def _residuals(problem: Problem, point: Point, y: Array | None) -> Kkt:
    """KKT residuals at a point; infinite where there are no multipliers."""
    if y is None:
        return Kkt(*(4 * (float("inf"),)))
    lay, model = problem.layout, problem.quadratic(point)
    matrix = lay.a.matrix(model.matrix)
    gradient = model.gradient.copy()
    gradient[lay.slacks] += SLACK_CURVATURE * point.slacks
    here = np.zeros(lay.n_vars)
    here[lay.slacks] = point.slacks
    value = matrix @ here
    room = np.abs(np.where(y < 0, np.minimum(model.low - value, 0.0), model.high - value))
    products = np.where(model.low == model.high, 0.0, np.abs(y) * room)
    return Kkt(
        float(np.abs(gradient + matrix.T @ y).max()),
        float(np.abs(point.defects).max()),
        point.hard,
        float(products.max()),
    )


def _merit(point: Point, rho: float) -> float:
    return point.cost + rho * (float(np.abs(point.defects).sum()) + HARD * point.hard)


def _line_search(
    problem: Problem, point: Point, p: Array, y: Array, halvings: int
) -> tuple[Point, float, float, float] | None:
    """The first shortened step that lowers the merit: point, scaled size, gain, share.

    The merit is taken with what was read off at the iterate, as the model is.
    """
    z, lay = point.z, problem.layout
    dx, du = np.zeros_like(z.x), p[lay.u]
    dx[1:] = p[lay.x]
    rho = max(DEFECT_PENALTY, RHO_SHARE * float(np.abs(y[lay.dynamics]).max()))
    before = _merit(point, rho)
    alpha, whole = 1.0, step_size(dx)
    for _ in range(halvings + 1):
        trial = problem.at(Iterate(z.x + alpha * dx, z.u + alpha * du), point.reading)
        gain = before - _merit(trial, rho)
        if gain >= ARMIJO * alpha * abs(before):
            return trial, alpha * whole, gain, alpha
        alpha /= 2
    if whole < STALLED:
        return point, 0.0, 0.0, 1.0  # the model finds nothing better nearby: this is the optimum
    return None
