"""The quadratic subproblems: min p' H p / 2 + g' p  s.t.  low <= A p <= high, scaled and solved.

Variables are scaled by typical sizes and rows by their largest entry before a solver
(:mod:`mpcplan.refine.backends`) sees them. When a plan goes on, OSQP's polished answer serves: the
next cycle improves on it anyway. For a fresh seed an answer of ADMM's tolerance costs up to a fifth
of the result (lane changes, measured against IPOPT); there an interior-point solver is the default,
which is exact at a lower price. 'osqp then piqp' asks the second only where the first could not be
polished. Only iterations are limited, never time, so that the same problem gives the same answer
on every machine.
"""

import numpy as np
import scipy.sparse as sp

from mpcplan.config import Backend
from mpcplan.refine.backends import EXACT, POLISHED, Answer, Scaled, make_backend
from mpcplan.refine.layout import Layout
from mpcplan.trajectory import Array

COST = 10.0  # scale of the cost against the constraints
SMALLEST_ENTRY = 1e-6
THEN = " then "  # between the names of a solver and of the one asked where it is not exact


class QpSolver:
    """Solves subproblems of one sparsity one after the other, warm-started where possible."""

    def __init__(
        self, columns: Array, layout: Layout, backend: Backend, iterations: int, tolerance: float
    ) -> None:
        """For a layout.

        Args:
            columns: (n,) typical sizes of the variables.
            layout: of the problems.
            backend: the solvers' names.
            iterations: of OSQP at most.
            tolerance: OSQP's.

        Raises:
            InputError: a solver is not installed.
        """
        self._columns = columns
        self._solvers = [
            make_backend(name, layout, iterations, tolerance) for name in backend.split(THEN)
        ]
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
        before = None if self._y is None else self._y / r * COST
        answer = self._answer(Scaled(h, gradient * d * COST, a, low * r, high * r), before)
        self._y = answer.y * r / COST
        return Answer(answer.p * d, self._y, answer.status, answer.iterations)

    def _answer(self, problem: Scaled, y: Array | None) -> Answer:
        """The first exact answer, or the last usable one."""
        total, best = 0, None
        for solver in self._solvers:
            answer = solver(problem, y)
            total += answer.iterations
            if best is None or answer.usable:
                best = answer
            if answer.status in (POLISHED, EXACT):
                break
        assert best is not None  # there is a solver
        return Answer(best.p, best.y, best.status, total)
