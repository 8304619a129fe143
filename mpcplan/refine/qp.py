"""The quadratic subproblems' solvers: min p' H p / 2 + g' p  s.t.  low <= A p <= high.

OSQP solves them when a plan goes on: variables are scaled by typical sizes and rows by their
largest entry before it sees them, its answer is polished, and the next cycle improves on it anyway.
For a fresh seed an answer of ADMM's tolerance costs up to a fifth of the result (lane changes,
measured against IPOPT); there an interior-point solver is the default, PIQP through CasADi, which
is exact at a lower price. 'osqp then piqp' asks the second only where the first could not be
polished. Only iterations are limited, never time, so that the same problem gives the same answer
on every machine.

Sources: Stellato et al.: OSQP, Mathematical Programming Computation 12 (2020); Schwan, Jiang, Kuhn,
Jones: PIQP, a proximal interior-point quadratic programming solver (CDC 2023).
"""

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
import osqp
import scipy.sparse as sp

from mpcplan.config import Backend
from mpcplan.trajectory import Array

POLISHED, EXACT = "solved and polished", "solved by interior point"
SOLVED = {POLISHED, EXACT, "solved", "solved inaccurate", "maximum iterations reached"}
RHO = 1.0
COST = 10.0  # scale of the cost against the constraints
RHO_INTERVAL = 25  # iterations between updates of rho; the default goes by wall-clock time
CHECK_INTERVAL = 10
SMALLEST_ENTRY = 1e-6
FREE = 500.0  # scaled bounds beyond this are none


@dataclass(frozen=True, eq=False)
class Answer:
    """A QP's answer: step, multipliers, OSQP's status and iterations."""

    p: Array
    y: Array
    status: str
    iterations: int

    @property
    def usable(self) -> bool:
        """Whether the step may be tried: finite, and of a status that has one."""
        return self.status in SOLVED and bool(np.isfinite(self.p).all())


Scaled = tuple[sp.csc_matrix, Array, sp.csc_matrix, Array, Array]


class QpSolver:
    """Solves subproblems of one sparsity one after the other, warm-started where possible."""

    def __init__(self, columns: Array, backend: Backend, iterations: int, tolerance: float) -> None:
        """``columns`` (n,) are the typical sizes of the variables."""
        self._columns, self._backend = columns, backend
        self._interior: Callable[[Scaled], Answer] = PiqpSolver()
        self._settings = {
            "verbose": False,
            "max_iter": iterations,
            "eps_abs": tolerance,
            "eps_rel": tolerance,
            "rho": RHO,
            "adaptive_rho_interval": RHO_INTERVAL,
            "check_termination": CHECK_INTERVAL,
            "polish": True,
            "scaling": 0,
        }
        self._solver: osqp.OSQP | None = None
        self._y: Array | None = None

    def solve(
        self,
        hessian: sp.csc_matrix,
        gradient: Array,
        matrix: sp.csc_matrix,
        low: Array,
        high: Array,
    ) -> Answer:
        """The step of a subproblem; sparsity must not change between calls."""
        d = self._columns
        h = hessian.copy()
        h.data *= d[h.indices] * np.repeat(d, np.diff(h.indptr)) * COST
        a = matrix.copy()
        a.data *= np.repeat(d, np.diff(a.indptr))
        largest = np.full(len(low), SMALLEST_ENTRY)
        np.maximum.at(largest, a.indices, np.abs(a.data))
        r = 1.0 / largest
        a.data *= r[a.indices]
        scaled = (h, gradient * d * COST, a, low * r, high * r)
        answer = self._answer(scaled, r)
        self._y = answer.y * r / COST
        return Answer(answer.p * d, self._y, answer.status, answer.iterations)

    def _answer(self, scaled: Scaled, r: Array) -> Answer:
        """The answer to a scaled problem, by the configured solvers."""
        first = None if self._backend == "piqp" else self._osqp(scaled, r)
        if first is not None and (self._backend == "osqp" or first.status == POLISHED):
            return first
        exact = self._interior(scaled)
        if first is None:
            return exact
        total = first.iterations + exact.iterations
        best = exact if exact.usable else first
        return Answer(best.p, best.y, best.status, total)

    def _osqp(self, scaled: Scaled, r: Array) -> Answer:
        """OSQP's answer to a scaled problem."""
        h, g, a, low, high = scaled
        if self._solver is None:
            self._solver = osqp.OSQP()
            self._solver.setup(h, g, a, low, high, **self._settings)
        else:
            self._solver.update(q=g, l=low, u=high, Px=h.data, Ax=a.data)
            if self._y is not None:
                self._solver.warm_start(x=np.zeros(len(g)), y=self._y / r * COST)
        result = self._solver.solve()
        if result.x is None or result.x[0] is None:
            return Answer(np.zeros(len(g)), np.zeros(len(low)), "failed", 0)
        status = POLISHED if result.info.status_polish == 1 else result.info.status
        return Answer(result.x, result.y, status, int(result.info.iter))


class PiqpSolver:
    """PIQP through CasADi, one workspace per sparsity."""

    def __init__(self) -> None:
        self._solver: ca.Function | None = None

    def __call__(self, scaled: Scaled) -> Answer:
        """The answer to a scaled problem."""
        upper, g, a, low, high = scaled
        h = (upper + sp.triu(upper, 1).T).tocsc()
        h.sort_indices()
        if self._solver is None:
            self._h, self._a = (_pattern(m) for m in (h, a))
            options = {"error_on_fail": False, "print_time": False}
            self._solver = ca.conic("qp", "piqp", {"h": self._h, "a": self._a}, options)
        # a bound that never binds is dropped; a row without any keeps one, or PIQP complains
        none = low < -FREE
        low, high = np.where(none, -np.inf, low), np.where((high > FREE) & ~none, np.inf, high)
        found = self._solver(
            h=ca.DM(self._h, h.data), g=g, a=ca.DM(self._a, a.data), lba=low, uba=high
        )
        stats = self._solver.stats()
        status = EXACT if stats["success"] else f"failed ({stats.get('return_status', '?')})"
        p, y = (np.asarray(found[name]).ravel() for name in ("x", "lam_a"))
        return Answer(p, y, status, int(stats.get("iter_count", 0) or 0))


def _pattern(matrix: sp.csc_matrix) -> ca.Sparsity:
    """A CSC matrix's sparsity as CasADi's."""
    rows, columns = matrix.shape
    return ca.Sparsity(rows, columns, matrix.indptr.tolist(), matrix.indices.tolist())
