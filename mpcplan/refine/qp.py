"""The quadratic subproblems: min p' H p / 2 + g' p  s.t.  low <= A p <= high, scaled and solved.

Variables are measured in typical sizes and rows in those of what they bound (:mod:`.layout`) before
a solver (:mod:`mpcplan.refine.backends`) sees them. For most solvers every row is then scaled by
its largest entry too: without that OSQP's answers cost 5 % more over 30 steps, and half as much
again over 100. HPIPM, which uses the stages of the problem, is exact and the fastest, and so the
default. OSQP's polished answers serve where a plan goes on, for the next cycle improves on it
anyway; for a fresh seed an answer of ADMM's tolerance costs up to a fifth of the result (lane
changes, measured against IPOPT). 'osqp then piqp' asks the second only where the first could not be
polished. Only iterations are limited, never time, so that the same problem gives the same answer on
every machine.
"""

import numpy as np

from mpcplan.config import Backend
from mpcplan.refine.backends import EXACT, POLISHED, Answer, QpBackend, Scaled, make_backend
from mpcplan.refine.layout import Layout
from mpcplan.refine.problem import Quadratic
from mpcplan.trajectory import Array

COST = 10.0  # scale of the cost against the constraints
SMALLEST = 1e-3  # scaled rows of smaller entries are not blown up further
THEN = " then "  # between the names of a solver and of the one asked where it is not exact


class QpSolver:
    """Solves subproblems of one layout one after the other, warm-started where possible."""

    def __init__(self, layout: Layout, backend: Backend, iterations: int, tolerance: float) -> None:
        """For a layout.

        Args:
            layout: of the problems.
            backend: the solvers' names.
            iterations: of OSQP at most.
            tolerance: OSQP's.

        Raises:
            InputError: a solver is not installed.
        """
        d, r = layout.columns, layout.lines
        self._columns, self._lines = d, r
        self._a_scale = r[layout.a.rows] * d[layout.a.columns]
        self._h_scale = COST * d[layout.h.rows] * d[layout.h.columns]
        self._layout = layout
        self._solvers = [
            make_backend(name, layout, iterations, tolerance) for name in backend.split(THEN)
        ]
        self._y: Array | None = None

    def solve(self, model: Quadratic) -> Answer:
        """The step of a subproblem: the first exact answer, or the last usable one."""
        data, total, best = model.matrix * self._a_scale, 0, None
        for solver in self._solvers:
            r = self._levelled(data) if solver.levelled else self._lines
            answer = self._answer(solver, model, data, r)
            total += answer.iterations
            if best is None or answer.usable:
                best = answer
            if answer.status in (POLISHED, EXACT):
                break
        assert best is not None  # there is a solver
        self._y = best.y
        return Answer(best.p, best.y, best.status, total)

    def _answer(self, solver: QpBackend, model: Quadratic, data: Array, r: Array) -> Answer:
        """A solver's answer in our units, of the problem with rows in scale r."""
        d = self._columns
        if r is not self._lines:
            data = data * (r / self._lines)[self._layout.a.rows]
        scaled = Scaled(
            self._layout, model.hessian * self._h_scale, COST * model.gradient * d,
            data, model.low * r, model.high * r,
        )  # fmt: skip
        answer = solver(scaled, None if self._y is None else self._y / r * COST)
        return Answer(answer.p * d, answer.y * r / COST, answer.status, answer.iterations)

    def _levelled(self, data: Array) -> Array:
        """The rows' scale by which their largest entry becomes one."""
        largest = np.full(len(self._lines), SMALLEST)
        np.maximum.at(largest, self._layout.a.rows, np.abs(data))
        return self._lines / largest
