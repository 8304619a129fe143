"""Sequential quadratic programming for the refinement's problem.

At each iterate the quadratic model is solved for a step p, which is shortened by halving until the
merit function phi(z) = objective + slack penalties + rho |defects|_1 falls (Nocedal and Wright,
Numerical Optimization, ch. 18). Where no shortened step does that, the model is solved again with
more Levenberg-Marquardt damping. KKT residuals are computed here from the multipliers, not taken
from the QP solver.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from mpcplan.config import WHOLE, Backend, RefineConfig
from mpcplan.refine.backends import Answer
from mpcplan.refine.constraints import Iterate
from mpcplan.refine.problem import STATE_SCALE, Problem, Quadratic
from mpcplan.refine.qp import QpSolver
from mpcplan.refine.whole import solve_whole
from mpcplan.seed.seed import Stage
from mpcplan.trajectory import Array

STEP_SCALE = np.array(STATE_SCALE)
DEFECT_PENALTY = 200.0  # rho of the merit function, at least
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
        iterations: SQP iterations; qp_iterations: those of OSQP in all.
        kkt: residuals at the last linearisation.
        cost_before, cost_after: objective plus slack penalties.
    """

    z: Iterate
    status: str
    iterations: int
    qp_iterations: int
    kkt: Kkt
    cost_before: float
    cost_after: float

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
    z = problem.initial()
    before = problem.objective(z) + problem.penalty(z)
    status, qp_iterations, iteration = "iteration limit", 0, 0
    multipliers: Array | None = None
    damping = config.damping
    for iteration in range(1, most + 1):  # noqa: B007 (told in the result)
        model = problem.quadratic(z, damping)
        answer = _solved(solver, model)
        qp_iterations += answer.iterations
        if not answer.usable:
            status = f"{FAILED}: {answer.status}"
            break
        multipliers = answer.y
        moved = _line_search(problem, z, answer.p, multipliers, config.line_search)
        if moved is None:  # the model is not trusted that far: a shorter step by more damping
            if damping > DAMPING_MAX:
                status = "no descent"
                break
            damping = max(damping * DAMPING_REFUSED, DAMPING_LEAST)
            continue
        z, size, gain, share = moved
        damping *= DAMPING_LESS if share == 1.0 else DAMPING_MORE if share < 0.5 else 1.0
        settled = size < config.tolerance or gain < config.gain * (1.0 + before)
        if settled and np.abs(problem.defects(z)).max() < DEFECT_TOLERANCE:
            status = "converged"
            break
    kkt = Kkt(*(4 * (float("inf"),)))
    if multipliers is not None:
        kkt = _residuals(problem, z, problem.quadratic(z), multipliers)
    after = problem.objective(z) + problem.penalty(z)
    return SqpResult(z, status, iteration, qp_iterations, kkt, before, after)


def _solver(problem: Problem, backend: Backend, config: RefineConfig) -> QpSolver:
    return QpSolver(
        problem.scales(), problem.layout, backend, config.qp_iterations, config.qp_tolerance
    )


def _solved(solver: QpSolver, model: Quadratic) -> Answer:
    return solver.solve(model.hessian, model.gradient, model.matrix, model.low, model.high)


def _whole(problem: Problem, backend: str, config: RefineConfig) -> SqpResult:
    """The result of a solver of the whole problem; multipliers are those of an exact step."""
    z = problem.initial()
    before = problem.objective(z) + problem.penalty(z)
    answer = solve_whole(problem, backend, config.whole_iterations)
    model = problem.quadratic(answer.z)
    step = _solved(_solver(problem, "piqp", config), model)
    kkt = _residuals(problem, answer.z, model, step.y)
    after = problem.objective(answer.z) + problem.penalty(answer.z)
    status = "converged" if answer.ok else f"{FAILED}: {answer.status}"
    return SqpResult(answer.z, status, 1, answer.iterations, kkt, before, after)


def _residuals(problem: Problem, z: Iterate, model: Quadratic, y: Array) -> Kkt:
    """KKT residuals at z with the multipliers of the last subproblem."""
    stationarity = np.abs(model.gradient + model.matrix.T @ y).max()
    slack_low, slack_high = np.abs(np.minimum(model.low, 0.0)), np.abs(np.maximum(model.high, 0.0))
    products = np.where(y < 0, -y * slack_low, y * slack_high)
    equality = model.low == model.high
    return Kkt(
        float(stationarity),
        float(np.abs(problem.defects(z)).max()),
        problem.hard_violation(z),
        float(np.where(equality, 0.0, products).max()),
    )


def _split(problem: Problem, p: Array) -> tuple[Array, Array]:
    """The parts of a step for states and inputs."""
    return p[problem.layout.x], p[problem.layout.u]


def _merit(problem: Problem, z: Iterate, rho: float) -> float:
    defect = np.abs(problem.defects(z)).sum() + 10 * problem.hard_violation(z)
    return problem.objective(z) + problem.penalty(z) + rho * float(defect)


def _line_search(
    problem: Problem, z: Iterate, p: Array, y: Array, halvings: int
) -> tuple[Iterate, float, float, float] | None:
    """The first shortened step that lowers the merit: iterate, scaled size, gain, share."""
    dx, du = _split(problem, p)
    dynamics = slice(len(Stage), len(Stage) * (problem.n + 1))
    rho = max(DEFECT_PENALTY, 1.2 * float(np.abs(y[dynamics]).max()))
    before = _merit(problem, z, rho)
    alpha, whole = 1.0, float(np.abs(dx / STEP_SCALE).max())
    for _ in range(halvings + 1):
        trial = Iterate(z.x + alpha * dx, z.u + alpha * du)
        gain = before - _merit(problem, trial, rho)
        if gain >= ARMIJO * alpha * abs(before):
            return trial, alpha * whole, gain, alpha
        alpha /= 2
    if whole < STALLED:
        return z, 0.0, 0.0, 1.0  # the model finds nothing better nearby: this is the optimum
    return None
