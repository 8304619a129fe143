"""The quadratic subproblem's layout: which entry of its matrices belongs to what.

Variables: stages x_0, u_0, x_1, ..., x_N, then slacks sigma_s, sigma_d, sigma_a for k = 1..N and
one for the goal. Rows, in blocks: initial state, dynamics, box bounds, acceleration limit, friction
and lateral acceleration, corridor in s, corridor in d, goal, slacks >= 0. The sparsity is fixed per
horizon, so only data vectors are written in an iteration.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from mpcplan.refine.model import NU, NX
from mpcplan.seed.paths import BODY_POINTS
from mpcplan.seed.seed import Stage
from mpcplan.trajectory import Array

Index = NDArray[np.int64]
POINTS = len(BODY_POINTS)


@dataclass(frozen=True, eq=False)
class Layout:
    """Index sets of the quadratic problem with N steps.

    Attributes:
        n: steps N.
        x: (N + 1, 6) and u: (N, 2) columns of the stages.
        slack_s, slack_d, slack_a: (N,) columns; slack_goal: the last column.
        h_indices, h_indptr: CSC pattern of the Hessian's upper triangle; h_diagonal and h_pair are
            the places of its diagonal and of its entries (d_k, mu_k), k = 1..N, in the data.
        rows, cols: positions of all entries of A in the order in which data is given.
        order, indptr, indices: that order's permutation into CSC.
    """

    n: int
    x: Index
    u: Index
    slack_s: Index
    slack_d: Index
    slack_a: Index
    slack_goal: int
    rows: Index
    cols: Index
    order: Index
    indices: Index
    indptr: Index
    n_rows: int
    h_indices: Index
    h_indptr: Index
    h_pair: Index
    h_diagonal: Index

    @property
    def n_vars(self) -> int:
        """Number of variables."""
        return self.slack_goal + 1

    def matrix(self, data: Array) -> sp.csc_matrix:
        """A from the data in the order of the entries."""
        shape = (self.n_rows, self.n_vars)
        return sp.csc_matrix((data[self.order], self.indices, self.indptr), shape=shape)

    def hessian(self, diagonal: Array, pairs: Array) -> sp.csc_matrix:
        """The Hessian's upper triangle from its diagonal and the entries (d_k, mu_k)."""
        data = np.empty(len(self.h_indices))
        data[self.h_diagonal], data[self.h_pair] = diagonal, pairs
        shape = (self.n_vars, self.n_vars)
        return sp.csc_matrix((data, self.h_indices, self.h_indptr), shape=shape)


@lru_cache(maxsize=256)
def layout(n: int) -> Layout:
    """The layout for N = n steps."""
    stage = NX + NU
    x = np.arange(n + 1)[:, None] * stage + np.arange(NX)
    u = np.arange(n)[:, None] * stage + NX + np.arange(NU)
    base = (n + 1) * NX + n * NU
    slack_s, slack_d, slack_a = (base + i * n + np.arange(n) for i in range(3))
    goal = base + 3 * n
    rows, cols = _entries(n, x, u, slack_s, slack_d, slack_a, goal)
    n_rows = int(rows.max()) + 1
    order = np.lexsort((rows, cols))
    counts = np.bincount(cols, minlength=goal + 1)
    indptr = np.concatenate([[0], np.cumsum(counts)])
    pattern = _hessian_pattern(goal + 1, x[1:, Stage.D], x[1:, Stage.MU])
    return Layout(
        n, x, u, slack_s, slack_d, slack_a, goal, rows, cols, order, rows[order], indptr, n_rows,
        *pattern,
    )  # fmt: skip


def _hessian_pattern(size: int, d: Index, mu: Index) -> tuple[Index, Index, Index, Index]:
    """Indices, index pointers and the data's places of pairs and diagonal: see :class:`Layout`."""
    rows = np.concatenate([np.arange(size), d])
    cols = np.concatenate([np.arange(size), mu])
    order = np.lexsort((rows, cols))
    place = np.empty(len(order), int)
    place[order] = np.arange(len(order))
    indptr = np.concatenate([[0], np.cumsum(np.bincount(cols, minlength=size))])
    return rows[order], indptr, place[size:], place[:size]


def _entries(
    n: int, x: Index, u: Index, slack_s: Index, slack_d: Index, slack_a: Index, goal: int
) -> tuple[Index, Index]:
    """Rows and columns of all entries, block by block; problem.py writes data in this order."""
    blocks: list[tuple[Index, Index]] = []
    count = 0

    def add(columns: Index, height: int) -> None:
        """A block of ``height`` rows, each with the entries ``columns[row]``."""
        nonlocal count
        index = count + np.arange(height)
        columns = np.asarray(columns).reshape(height, -1)
        blocks.append((np.repeat(index, columns.shape[1]), columns.ravel()))
        count += height

    s, d, mu, v, delta, a = (x[1:, c] for c in Stage)
    add(x[0], NX)  # initial state
    for i in range(NX):  # dynamics, state by state: x_k, u_k, -x_{k+1}[i]
        add(np.column_stack([x[:-1], u, x[1:, i]]), n)
    for column in (delta, v, a):  # boxes
        add(column, n)
    add(u[:, 1], n)
    add(np.column_stack([a, v]), n)  # acceleration limit
    add(np.column_stack([a, v, delta, slack_a]), n)  # friction circle
    for _ in range(2):
        add(np.column_stack([v, delta, slack_a]), n)  # lateral acceleration, both signs
    for _ in range(2):
        add(np.column_stack([s, slack_s]), n)  # corridor in s
    for _ in range(2 * POINTS):
        add(np.column_stack([s, d, mu, slack_d]), n)  # corridor in d
    add(np.column_stack([s, d, mu, slack_s]), n)  # half-planes against turned obstacles
    last = x[-1]
    goal_slack = np.full(2, goal)
    for columns in ((Stage.S,), (Stage.D, Stage.MU), (Stage.V,), (Stage.S, Stage.MU)):
        both = np.tile(last[list(columns)], (2, 1))
        add(np.column_stack([both, goal_slack]), 2)
    slacks = np.concatenate([slack_s, slack_d, slack_a, [goal]])
    add(slacks, len(slacks))
    return np.concatenate([r for r, _ in blocks]), np.concatenate([c for _, c in blocks])
