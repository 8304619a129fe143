"""Sequential quadratic programming for the refinement's problem.

At each iterate the quadratic model is solved for a step p, which is shortened by halving until the
merit function

    phi(z) = objective + slack penalties + sum_i rho_i sum_k |defect_ki| + rho_h hard(z)

falls (Nocedal and Wright, Numerical Optimization, ch. 18); hard is the largest violation of what
has no slack. The weights are a little more than the multipliers ask for, component by component of
the state (eq. 18.32): heavier ones would refuse good steps for defects that the next step removes.
Where no shortened step lowers it, the model is solved again with more Levenberg-Marquardt damping.
KKT residuals are computed here from the multipliers, not taken from the QP solver, and only when
they are asked for.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mpcplan.config import WHOLE, Backend, RefineConfig
from mpcplan.refine.layout import STATE_SCALE, Layout
from mpcplan.refine.problem import SLACK_CURVATURE, Point, Problem, step_size
from mpcplan.refine.qp import QpSolver
from mpcplan.refine.reading import Iterate
from mpcplan.refine.whole import solve_whole
from mpcplan.trajectory import Array

RHO_SHARE = 1.2  # multiple of the largest multipliers that weighs defects in the merit function
RHO_LEAST = 0.01  # but at least this, for a defect of typical size
HARD_LEAST = 1.0  # weight of actuator bounds at least [s^2/m, ...]
DEFECT_TOLERANCE = 1e-3
ARMIJO = 1e-6
DAMPING_LESS, DAMPING_MORE = 0.3, 4.0  # after a whole step, after a short one
DAMPING_REFUSED, DAMPING_LEAST = 10.0, 0.01  # after a step without descent
DAMPING_MAX = 10.0  # beyond which no step can be expected to help
FAILED = "subproblem failed"
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
    damping, merit = config.damping, Merit(problem.layout)
    for iteration in range(1, most + 1):  # noqa: B007 (told in the result)
        answer = solver.solve(problem.quadratic(point, damping))
        qp_iterations += answer.iterations
        if not answer.usable:
            status = f"{FAILED}: {answer.status}"
            break
        multipliers = answer.y
        merit.weigh(multipliers)
        moved = _line_search(problem, point, answer.p, merit, config.line_search)
        if moved is None:  # the model is not trusted that far: a shorter step by more damping
            if damping > DAMPING_MAX:
                status = "no descent"
                break
            damping = max(damping * DAMPING_REFUSED, DAMPING_LEAST)
            continue
        trial, size, gain, share = moved
        point = problem.again(trial)
        damping *= DAMPING_LESS if share == 1.0 else DAMPING_MORE if share < 0.5 else 1.0
        settled = size < config.tolerance or gain < config.gain * (1.0 + point.cost)
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


class Merit:
    """The merit function; its weights never fall, so that it can judge one iteration's progress
    after the other."""

    def __init__(self, layout: Layout) -> None:
        """Without multipliers yet, for problems of a layout."""
        self._layout = layout
        self._rho, self._hard = RHO_LEAST / STATE_SCALE, HARD_LEAST

    def weigh(self, y: Array) -> None:
        """Raises the weights to what the multipliers of a subproblem ask for: the largest of each
        component of the state; of the bounds, of which the largest violation counts, their sum."""
        lay = self._layout
        largest = np.abs(y[lay.dynamics]).reshape(lay.n, -1).max(axis=0)
        self._rho = np.maximum(self._rho, RHO_SHARE * largest)
        self._hard = max(self._hard, RHO_SHARE * float(np.abs(y[lay.hard]).sum()))

    def __call__(self, point: Point) -> float:
        """phi at a point."""
        defects = float((np.abs(point.defects) @ self._rho).sum())
        return point.cost + defects + self._hard * point.hard


def _line_search(
    problem: Problem, point: Point, p: Array, merit: Merit, halvings: int
) -> tuple[Point, float, float, float] | None:
    """The first shortened step that lowers the merit: point, scaled size, gain, share.

    The merit is taken with what was read off at the iterate, as the model is.
    """
    z, lay = point.z, problem.layout
    dx, du = np.zeros_like(z.x), p[lay.u]
    dx[1:] = p[lay.x]
    before = merit(point)
    alpha, whole = 1.0, step_size(dx)
    for _ in range(halvings + 1):
        trial = problem.at(Iterate(z.x + alpha * dx, z.u + alpha * du), point.reading)
        gain = before - merit(trial)
        if gain >= ARMIJO * alpha * abs(before):
            return trial, alpha * whole, gain, alpha
        alpha /= 2
    if whole < STALLED:
        return point, 0.0, 0.0, 1.0  # the model finds nothing better nearby: this is the optimum
    return None
