"""OSQP behind one call: min p' H p / 2 + g' p  s.t.  low <= A p <= high.

Variables are scaled by typical sizes and rows by their largest entry before OSQP sees them: on
recorded subproblems this halves the iterations against OSQP's own scaling; polishing then gives
the digits that the exact penalties need. Only iterations are limited, never time, so that the same
problem gives the same answer on every machine.
Source: Stellato et al.: OSQP, Mathematical Programming Computation 12 (2020).
"""

from dataclasses import dataclass

import numpy as np
import osqp
import scipy.sparse as sp

from mpcplan.trajectory import Array

SOLVED = {"solved", "solved inaccurate", "maximum iterations reached"}
RHO = 1.0
COST = 10.0  # scale of the cost against the constraints
RHO_INTERVAL = 25  # iterations between updates of rho; the default goes by wall-clock time
CHECK_INTERVAL = 10
SMALLEST_ENTRY = 1e-6


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


class OsqpSolver:
    """One OSQP workspace for subproblems of the same sparsity, warm-started between them."""

    def __init__(self, columns: Array, iterations: int, tolerance: float) -> None:
        """``columns`` (n,) are the typical sizes of the variables."""
        self._columns = columns
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
        return self._run(h, gradient * d * COST, a, low * r, high * r, d, r)

    def _run(
        self, h: sp.csc_matrix, g: Array, a: sp.csc_matrix, low: Array, high: Array, d: Array,
        r: Array,
    ) -> Answer:  # fmt: skip
        """Solves the scaled problem and scales the answer back."""
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
        self._y = result.y * r / COST
        return Answer(result.x * d, self._y, result.info.status, int(result.info.iter))
