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
from typing import Any

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
    """PIQP through CasADi, one workspace per sparsity.

    Data goes through CasADi's function buffer, which reads our arrays where they lie: converting
    them to CasADi's own matrices would cost a sixth of the solution.
    """

    def __init__(self) -> None:
        self._ready = False

    def __call__(self, scaled: Scaled) -> Answer:
        """The answer to a scaled problem."""
        upper, g, a, low, high = scaled
        if not self._ready:
            self._prepare(upper, a)
        # a bound that never binds is dropped; a row without any keeps one, or PIQP complains
        none = low < -FREE
        low, high = np.where(none, -np.inf, low), np.where((high > FREE) & ~none, np.inf, high)
        for array, values in zip(
            self._data, (upper.data[self._mirror], g, a.data, low, high), strict=True
        ):
            array[:] = values
        self._run()
        stats = self._buffer.stats()
        status = EXACT if stats["success"] else f"failed ({stats.get('return_status', '?')})"
        iterations = max(int(stats.get("iter_count") or 0), 0)  # -1: not told
        return Answer(self._p.copy(), self._y.copy(), status, iterations)

    def _prepare(self, upper: sp.csc_matrix, a: sp.csc_matrix) -> None:
        """Builds the solver for a sparsity and ties its arguments to arrays."""
        numbered = sp.csc_matrix(
            (np.arange(1.0, upper.nnz + 1), upper.indices, upper.indptr), shape=upper.shape
        )
        h = (numbered + sp.triu(numbered, 1).T).tocsc()
        h.sort_indices()
        self._mirror = h.data.astype(int) - 1  # entry of the upper triangle for each of the whole
        options = {"error_on_fail": False, "print_time": False}
        self._solver = ca.conic("qp", "piqp", {"h": _pattern(h), "a": _pattern(a)}, options)
        made: Any = self._solver.buffer()
        self._buffer, self._run = made
        rows, columns = a.shape
        self._data = [np.empty(k) for k in (h.nnz, columns, a.nnz, rows, rows)]
        bounds = [np.full(columns, -np.inf), np.full(columns, np.inf)]
        self._p, self._y = np.empty(columns), np.empty(rows)
        for index, array in enumerate([*self._data, *bounds]):  # h, g, a, lba, uba, lbx, ubx
            self._buffer.set_arg(index, array.data)
        self._buffer.set_res(0, self._p.data)
        self._buffer.set_res(2, self._y.data)
        self._bounds, self._ready = bounds, True  # the buffer does not own what it reads


def _pattern(matrix: sp.csc_matrix) -> ca.Sparsity:
    """A CSC matrix's sparsity as CasADi's."""
    rows, columns = matrix.shape
    return ca.Sparsity(rows, columns, matrix.indptr.tolist(), matrix.indices.tolist())
