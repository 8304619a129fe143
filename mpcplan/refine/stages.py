"""The quadratic subproblem ordered by stages, as structured solvers want it.

Variables: u_0, x_1, (u_1, slacks of 1), ..., x_N, (slacks of N and of the goal); rows: of each
stage the dynamics first, then all others. A last stage without states or inputs is added: these
solvers have no inputs at the last one, but slacks are inputs to them.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mpcplan.refine.layout import Index, Layout


@dataclass(frozen=True, eq=False)
class Stages:
    """Orders of variables and rows, and the sizes of the stages.

    Attributes:
        columns: old places of the variables in the new order; rows: of the rows.
        nx, nu, ng: numbers of states, inputs and rows but for the dynamics, (N + 2,) each.
    """

    columns: Index
    rows: Index
    nx: list[int]
    nu: list[int]
    ng: list[int]


@lru_cache(maxsize=256)
def stages_of(layout: Layout) -> Stages:
    """The order of one layout."""
    n = layout.n
    stage = np.full(layout.n_vars, n)
    stage[layout.x] = np.arange(1, n + 1)[:, None]
    stage[layout.u] = np.arange(n)[:, None]
    stage[layout.slack] = np.arange(1, n + 1)[:, None]
    is_input = np.ones(layout.n_vars, bool)
    is_input[layout.x] = False
    columns = np.lexsort((np.arange(layout.n_vars), is_input, stage))
    dynamics = np.zeros(layout.n_rows, bool)
    dynamics[layout.dynamics] = True
    of_row = np.zeros(layout.n_rows, int)
    inside = layout.a.columns >= 0
    np.maximum.at(of_row, layout.a.rows[inside], stage[layout.a.columns[inside]])
    of_row[dynamics] -= 1
    rows = np.lexsort((np.arange(layout.n_rows), ~dynamics, of_row))
    count = n + 2
    return Stages(
        columns,
        rows,
        np.bincount(stage[~is_input], minlength=count).tolist(),
        np.bincount(stage[is_input], minlength=count).tolist(),
        np.bincount(of_row[~dynamics], minlength=count).tolist(),
    )
