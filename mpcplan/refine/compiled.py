"""The problem's functions of all steps at once, compiled by CasADi for one horizon.

Two functions of a step (:mod:`mpcplan.refine.stage`, :mod:`mpcplan.refine.model`) are mapped over
all of them: its values alone, for the line search, and its values with derivatives, for the
quadratic model. Arguments and results are arrays that CasADi reads and writes where they lie.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from mpcplan.config import Config
from mpcplan.refine.model import NU, NX, one_step
from mpcplan.refine.native import as_machine_code
from mpcplan.refine.stage import (
    CURVATURE,
    N_GIVEN,
    N_GOAL,
    N_ROWS,
    closeness,
    goal_rows,
    hard_excess,
    residuals,
    rows,
    slacks_of,
)
from mpcplan.seed.seed import Stage
from mpcplan.trajectory import Array

SHARED = {"cse": True}  # equal parts of expressions are evaluated once


class Mapped:
    """A function of one step, evaluated at n of them.

    Arguments are (n, size) arrays; results are arrays of the same kind, overwritten by every call.
    """

    def __init__(self, function: ca.Function, n: int) -> None:
        whole = function.map(n) if n > 1 else function
        made: Any = whole.buffer()
        self._buffer, self._start = made
        self._arguments = [np.zeros((n, function.nnz_in(i))) for i in range(function.n_in())]
        self.results = [np.zeros((n, function.nnz_out(i))) for i in range(function.n_out())]
        for i, array in enumerate(self._arguments):
            self._buffer.set_arg(i, array.data)
        for i, array in enumerate(self.results):
            self._buffer.set_res(i, array.data)

    def __call__(self, *arguments: Array) -> list[Array]:
        """The results at (n, size) arguments; they are valid until the next call."""
        for mine, given in zip(self._arguments, arguments, strict=True):
            mine[:] = given
        self._start()
        return self.results


class Functions:
    """The functions of a step, and of the goal, with the sparsity of their derivatives.

    Attributes:
        values: of (x, u, x_next, par): the defect x_next - F(x, u), the smallest slacks, the
            violation of what has none, the cost and that part of it which TR1 counts.
        model: of the same: the rows g, and the nonzeros of dF/d(x, u), dg/dx_next, of the cost's
            gradient by (u, x_next) and of its convex Hessian's upper triangle.
        goal: of (x, bounds, turn): the goal's rows, and their Jacobian's nonzeros.
        dynamics, of_rows, hessian, of_goal: the sparsities, as (row, column) of each nonzero.
    """

    def __init__(self, config: Config, dt: float) -> None:
        x, u, after = ca.SX.sym("x", NX), ca.SX.sym("u", NU), ca.SX.sym("after", NX)
        par = ca.SX.sym("par", N_GIVEN)
        reached = one_step(x, u, par[CURVATURE], dt)
        g = rows(after, par, config)
        judged, other = residuals(after, u, par, config, dt)
        near = closeness(after[Stage.S], par, config, dt)
        tr1 = ca.sumsqr(judged) + near
        cost = tr1 + ca.sumsqr(other)
        given, defect = [x, u, after, par], after - reached
        values = [defect, slacks_of(g), hard_excess(after, u, g, config), cost, tr1]
        self.values = ca.Function("values", given, values, SHARED)
        variables = ca.vertcat(u, after)
        by_state = ca.jacobian(reached, ca.vertcat(x, u))
        by_after = ca.jacobian(g, after)
        squares = ca.jacobian(ca.vertcat(judged, other), variables)
        gauss_newton = 2 * squares.T @ squares + ca.hessian(near, variables)[0]
        # the closeness is constant below its smallest gap and convex above: never negative
        hessian = ca.triu(gauss_newton)
        gradient = ca.densify(ca.gradient(cost, variables))
        sparse = [by_state, by_after, hessian]
        self.dynamics, self.of_rows, self.hessian = (places(m.sparsity()) for m in sparse)
        nonzeros = [_nonzeros(m) for m in sparse]
        derivatives = [g, nonzeros[0], nonzeros[1], gradient, nonzeros[2]]
        self.model = ca.Function("model", given, derivatives, SHARED)
        if config.refine.compile:
            self.values, self.model = as_machine_code([self.values, self.model])
        bounds, turn = ca.SX.sym("bounds", N_GOAL), ca.SX.sym("turn", 3)
        at_goal = goal_rows(x, bounds, turn)
        by_last = ca.jacobian(at_goal, x)
        self.of_goal = places(by_last.sparsity())
        self.goal = ca.Function("goal", [x, bounds, turn], [at_goal, _nonzeros(by_last)])
        assert g.numel() == N_ROWS


def _nonzeros(matrix: ca.SX) -> ca.SX:
    """A matrix's nonzeros as a dense column."""
    elements: Any = matrix.nonzeros()
    return ca.vertcat(*elements)


def places(pattern: ca.Sparsity) -> tuple[list[int], list[int]]:
    """Row and column of every nonzero, in the order of the nonzeros."""
    found: Sequence[list[int]] = pattern.get_triplet()
    return list(found[0]), list(found[1])


@lru_cache(maxsize=16)
def functions(config: Config, dt: float) -> Functions:
    """The functions of a configuration."""
    return Functions(config, dt)


class Compiled:
    """All steps of one horizon: see :class:`Functions`."""

    def __init__(self, made: Functions, n: int) -> None:
        self.values = Mapped(made.values, n)
        self.model = Mapped(made.model, n)
        self.goal = Mapped(made.goal, 1)


@lru_cache(maxsize=256)
def compiled(config: Config, dt: float, n: int) -> Compiled:
    """The functions of all steps for a configuration and horizon, made once."""
    return Compiled(functions(config, dt), n)
