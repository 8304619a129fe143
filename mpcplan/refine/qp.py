"""OSQP behind one call: min p' H p / 2 + g' p  s.t.  low <= A p <= high.

Source: Stellato et al.: OSQP, Mathematical Programming Computation 12 (2020). Only iterations are
limited, never time, so that the same problem gives the same answer on every machine.
"""

from dataclasses import dataclass

import numpy as np
import osqp
import scipy.sparse as sp

from mpcplan.trajectory import Array

SOLVED = {"solved", "solved inaccurate", "maximum iterations reached"}
DIVERGED = 1e6


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

    def __init__(self, iterations: int, tolerance: float) -> None:
        self._settings = {
            "verbose": False,
            "max_iter": iterations,
            "eps_abs": tolerance,
            "eps_rel": tolerance,
            "adaptive_rho_interval": 50,  # by iterations: the default goes by wall-clock time
            "check_termination": 20,
            "polish": False,
            "scaling": 4,
        }
        self._solver: osqp.OSQP | None = None

    def solve(
        self, hessian: sp.csc_matrix, gradient: Array, matrix: sp.csc_matrix, low: Array, high: Array
    ) -> Answer:
        """The step of a subproblem; sparsity must not change between calls."""
        if self._solver is None:
            self._solver = osqp.OSQP()
            self._solver.setup(hessian, gradient, matrix, low, high, **self._settings)
        else:
            self._solver.update(
                q=gradient, l=low, u=high, Px=hessian.data, Ax=matrix.data
            )
        result = self._solver.solve()
        if result.x is None or result.x[0] is None:
            return Answer(np.zeros(len(gradient)), np.zeros(len(low)), "failed", 0)
        return Answer(result.x, result.y, result.info.status, int(result.info.iter))
