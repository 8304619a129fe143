"""Solvers of quadratic problems, one interface: min p' H p / 2 + g' p  s.t.  low <= A p <= high.

OSQP is called directly, and so are HPIPM (:mod:`mpcplan.refine.hpipm`) and PIQP where they use the
stages of the problem; PIQP and ProxQP through CasADi's conic plugins, others through qpsolvers.

Sources: Stellato et al.: OSQP, Mathematical Programming Computation 12 (2020); Schwan, Jiang, Kuhn,
Jones: PIQP, a proximal interior-point quadratic programming solver (CDC 2023); Bambade et al.:
ProxQP, an efficient and versatile quadratic programming solver (2023); Frison, Diehl: HPIPM, a
high-performance quadratic programming framework for model predictive control (IFAC 2020).
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Protocol

import casadi as ca
import numpy as np
import osqp
import piqp
import scipy.sparse as sp

from mpcplan.errors import InputError
from mpcplan.refine.foreign import ForeignBackend
from mpcplan.refine.hpipm import STATUS, Settings, StageQp
from mpcplan.refine.layout import Layout
from mpcplan.refine.rearranged import Rearranged, mirrored
from mpcplan.refine.stages import places, stages_of
from mpcplan.trajectory import Array

POLISHED, EXACT = "solved and polished", "solved by interior point"
SOLVED = {POLISHED, EXACT, "solved", "solved inaccurate", *STATUS[1:3]}
FREE = 500.0  # scaled bounds beyond this are none
RHO = 1.0
RHO_INTERVAL = 25  # iterations between updates of rho; the default goes by wall-clock time
CHECK_INTERVAL = 10
LIBRARY = "qpsolvers "  # how the names of qpsolvers' solvers begin
MULTISTAGE_TOLERANCE = 1e-4  # of scaled rows; the step counts to 2e-3
HPIPM = Settings(iterations=60, tolerance=1e-5, mu0=100.0)
FAR = 1e3  # scaled bounds of HPIPM at most


@dataclass(frozen=True, eq=False)
class Answer:
    """A QP's answer: step, multipliers, the solver's status and iterations."""

    p: Array
    y: Array
    status: str
    iterations: int

    @property
    def usable(self) -> bool:
        """Whether the step may be tried: finite, and of a status that has one."""
        return self.status in SOLVED and bool(np.isfinite(self.p).all())


@dataclass(frozen=True, eq=False)
class Scaled:
    """A problem in scaled variables and rows.

    Attributes:
        layout: of the problem.
        h, a: data of the Hessian's upper triangle and of the constraints' matrix, in the order of
            the layout's patterns.
        gradient, low, high: vectors.
    """

    layout: Layout
    h: Array
    gradient: Array
    a: Array
    low: Array
    high: Array

    @cached_property
    def hessian(self) -> sp.csc_matrix:
        """The Hessian's upper triangle."""
        return self.layout.h.matrix(self.h)

    @cached_property
    def matrix(self) -> sp.csc_matrix:
        """The constraints' matrix."""
        return self.layout.a.matrix(self.a)


class QpBackend(Protocol):
    """Solves problems of one sparsity one after the other.

    Attributes:
        levelled: whether its rows are scaled until their largest entry is one.
    """

    levelled: bool

    def __call__(self, problem: Scaled, y: Array | None) -> Answer:
        """The answer; ``y`` are the multipliers of the problem before, in this one's scale."""
        ...


@lru_cache(maxsize=64)
def make_backend(name: str, layout: Layout, iterations: int, tolerance: float) -> QpBackend:
    """The solver of a name for problems of one layout; made once, for that may take longer than to
    solve one.

    Raises:
        InputError: it is one of qpsolvers' and not installed, or names no usable class.
    """
    if ":" in name:
        return ForeignBackend(name, layout)
    if name == "osqp":
        return OsqpBackend(iterations, tolerance)
    if name == "piqp multistage":
        return MultistageBackend(layout)
    if name == "hpipm":
        return HpipmBackend(layout)
    return LibraryBackend(name) if name.startswith(LIBRARY) else ConicBackend(name, {})


class OsqpBackend:
    """OSQP with polishing, warm-started with the multipliers before."""

    levelled = True

    def __init__(self, iterations: int, tolerance: float) -> None:
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

    def __call__(self, problem: Scaled, y: Array | None) -> Answer:
        """OSQP's answer."""
        h, g, a = problem.hessian, problem.gradient, problem.matrix
        low, high = problem.low, problem.high
        if self._solver is None:
            self._solver = osqp.OSQP()
            self._solver.setup(h, g, a, low, high, **self._settings)
        else:
            self._solver.update(q=g, l=low, u=high, Px=h.data, Ax=a.data)
            if y is None:  # another problem: nothing of the one before is left
                self._solver.update_settings(rho=RHO)
                y = np.zeros(len(low))
            self._solver.warm_start(x=np.zeros(len(g)), y=y)
        result = self._solver.solve()
        if result.x is None or result.x[0] is None:
            return Answer(np.zeros(len(g)), np.zeros(len(low)), "failed", 0)
        status = POLISHED if result.info.status_polish == 1 else result.info.status
        return Answer(result.x, result.y, status, int(result.info.iter))


class ConicBackend:
    """One of CasADi's conic plugins, one workspace per sparsity.

    Data goes through CasADi's function buffer, which reads our arrays where they lie: converting
    them to CasADi's own matrices would cost a sixth of the solution.
    """

    levelled = True

    def __init__(self, plugin: str, options: dict[str, Any]) -> None:
        self._plugin, self._options = plugin, options
        self._ready = False

    def __call__(self, problem: Scaled, y: Array | None) -> Answer:
        """The plugin's answer; it is not warm-started."""
        if not self._ready:
            self._prepare(problem.hessian, problem.matrix)
        low, high = _open(problem)
        given = (self._whole(problem.hessian).data, problem.gradient, problem.matrix.data)
        for array, values in zip(self._data, (*given, low, high), strict=True):
            array[:] = values
        self._start()
        stats = self._buffer.stats()
        status = EXACT if stats["success"] else f"failed ({stats.get('return_status', '?')})"
        iterations = max(int(stats.get("iter_count") or 0), 0)  # -1: not told
        return Answer(self._p.copy(), self._y.copy(), status, iterations)

    def _prepare(self, upper: sp.csc_matrix, a: sp.csc_matrix) -> None:
        """Builds the solver for a sparsity and ties its arguments to arrays."""
        self._whole = Rearranged(upper, mirrored)
        h = self._whole.matrix
        options = {"error_on_fail": False, "print_time": False, **self._options}
        pattern = {"h": _pattern(h), "a": _pattern(a)}
        self._solver = ca.conic("qp", self._plugin, pattern, options)
        rows, columns = a.shape
        self._data = [np.empty(k) for k in (h.nnz, columns, a.nnz, rows, rows)]
        self._p, self._y = np.empty(columns), np.empty(rows)
        self._bind(columns)
        self._ready = True

    def _bind(self, columns: int) -> None:
        """Ties the solver's arguments to our arrays; the buffer does not own what it reads."""
        made: Any = self._solver.buffer()
        self._buffer, self._start = made
        self._bounds = [np.full(columns, -np.inf), np.full(columns, np.inf)]
        for index, array in enumerate([*self._data, *self._bounds]):  # h, g, a, lba, uba, lbx, ubx
            self._buffer.set_arg(index, array.data)
        self._buffer.set_res(0, self._p.data)
        self._buffer.set_res(2, self._y.data)


class MultistageBackend:
    """PIQP with its factorisation for problems in stages, which the layout's order has."""

    levelled = True

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        a, h = layout.a.ones(), layout.h.ones()
        self._equations = Rearranged(a, lambda m: m.tocsr()[layout.dynamics])
        self._between = Rearranged(a, lambda m: m.tocsr()[layout.between])
        self._whole = Rearranged(h, mirrored)
        self._solver = piqp.SparseSolver()
        self._solver.settings.kkt_solver = piqp.KKTSolver.sparse_multistage
        self._solver.settings.eps_abs = self._solver.settings.eps_rel = MULTISTAGE_TOLERANCE
        # the problem is scaled already, and PIQP's own scaling remembers the problem before
        self._solver.settings.preconditioner_iter = 0
        self._ready = False

    def __call__(self, problem: Scaled, y: Array | None) -> Answer:
        """PIQP's answer; it is not warm-started."""
        lay = self._layout
        low, high = _open(problem)
        columns_low = np.full(lay.n_vars, -np.inf)
        columns_high = np.full(lay.n_vars, np.inf)
        columns_low[lay.boxed], columns_high[lay.boxed] = low[lay.box], high[lay.box]
        data = (
            self._whole(problem.hessian), problem.gradient,
            self._equations(problem.matrix), low[lay.dynamics],
            self._between(problem.matrix), low[lay.between], high[lay.between],
            columns_low, columns_high,
        )  # fmt: skip
        (self._solver.update if self._ready else self._solver.setup)(*data)
        self._ready = True
        status = self._solver.solve()
        found = self._solver.result
        multipliers = np.empty(lay.n_rows)
        multipliers[lay.dynamics] = found.y
        multipliers[lay.between] = found.z_u - found.z_l
        multipliers[lay.box] = (found.z_bu - found.z_bl)[lay.boxed]
        solved = status == piqp.Status.PIQP_SOLVED
        told = EXACT if solved else f"failed ({status.name})"
        return Answer(found.x, multipliers, told, int(found.info.iter))


class HpipmBackend:
    """HPIPM on the problem in stages. It is not warm-started: an answer depends on its problem
    alone."""

    levelled = False  # the state that a step leads to has to keep its factor

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._stages = stages = stages_of(layout)
        self._solver = solver = StageQp(stages.sizes, HPIPM)
        self._places = places(layout, stages, solver)
        solver.data["idxbx"].values[:] = stages.idxbx
        solver.data["idxbu"].values[:] = stages.idxbu
        solver.data["lg"].values[:] = -FAR
        first = solver.data["lbu"].start
        for k in range(1, layout.n + 1):  # rows are bounded above, slacks below
            solver.ask("lg", k, np.zeros(stages.sizes.ng[k], bool))
            upper = ~stages.is_slack[first[k] : first[k] + stages.sizes.nbu[k]]
            solver.ask("ubu", k, upper)

    def __call__(self, problem: Scaled, y: Array | None) -> Answer:
        """HPIPM's answer."""
        lay, stages, at, solver = self._layout, self._stages, self._places, self._solver
        data, low, high = solver.data, problem.low, problem.high
        solver.matrices[at.a_to] = problem.a[at.a_from]
        solver.matrices[at.h_to] = problem.h
        solver.matrices[at.h_mirrored] = problem.h
        data["b"].values[:] = -low[lay.dynamics]
        data["q"].values[:] = problem.gradient[stages.x]
        data["r"].values[:] = problem.gradient[stages.u]
        data["lbx"].values[:], data["ubx"].values[:] = (
            low[stages.state_boxes],
            high[stages.state_boxes],
        )
        data["lbu"].values[:] = low[stages.input_boxes]
        data["ubu"].values[:] = np.minimum(high[stages.input_boxes], FAR)
        data["ug"].values[:] = np.minimum(high[stages.rows], FAR)
        status, iterations = solver.solve()
        found = solver.found
        p, multipliers = np.empty(lay.n_vars), np.empty(lay.n_rows)
        p[stages.x], p[stages.u] = found["x"].values, found["u"].values
        multipliers[lay.dynamics] = found["pi"].values
        multipliers[stages.rows] = found["lam_ug"].values
        multipliers[stages.boxes] = found["lam_ub"].values - found["lam_lb"].values
        return Answer(p, multipliers, EXACT if status == STATUS[0] else status, iterations)


class LibraryBackend:
    """A solver of the library qpsolvers, by its name there."""

    levelled = True

    def __init__(self, name: str) -> None:
        self._name = name.removeprefix(LIBRARY)
        try:
            import qpsolvers
        except ImportError as error:
            raise InputError(
                f"refine backend {name!r} needs qpsolvers: pip install 'mpcplan[solvers]'"
            ) from error
        if self._name not in qpsolvers.available_solvers:
            known = ", ".join(qpsolvers.available_solvers) or "none"
            raise InputError(
                f"refine backend {name!r}: qpsolvers does not find this solver, it has: {known}"
            )
        self._library: Any = qpsolvers

    def __call__(self, problem: Scaled, y: Array | None) -> Answer:
        """The solver's answer: equations and inequalities are told apart for it."""
        low, high = _open(problem)
        equal, above, below = low == high, np.isfinite(high), np.isfinite(low)
        above, below = above & ~equal, below & ~equal
        whole = mirrored(problem.hessian).tocsc()
        a = problem.matrix.tocsr()
        asked = self._library.Problem(
            whole, problem.gradient, sp.vstack([a[above], -a[below]]).tocsc(),
            np.concatenate([high[above], -low[below]]), a[equal].tocsc(), low[equal],
        )  # fmt: skip
        found = self._library.solve_problem(asked, self._name)
        multipliers = np.zeros(len(low))
        if not found.found or found.x is None:
            return Answer(np.zeros(len(problem.gradient)), multipliers, "failed", 0)
        multipliers[equal] = found.y
        multipliers[above] += found.z[: above.sum()]
        multipliers[below] -= found.z[above.sum() :]
        return Answer(found.x, multipliers, EXACT, 0)


def _open(problem: Scaled) -> tuple[Array, Array]:
    """Bounds without those that never bind; a row without any keeps one, or PIQP complains."""
    none = problem.low < -FREE
    low = np.where(none, -np.inf, problem.low)
    return low, np.where((problem.high > FREE) & ~none, np.inf, problem.high)


def _pattern(matrix: sp.csc_matrix) -> ca.Sparsity:
    """A CSC matrix's sparsity as CasADi's."""
    rows, columns = matrix.shape
    return ca.Sparsity(rows, columns, matrix.indptr.tolist(), matrix.indices.tolist())
