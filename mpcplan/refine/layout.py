"""The quadratic subproblem's layout: which entry of its matrices belongs to what.

Variables, step by step: the changes of u_{k-1} and x_k and the slacks sigma_k, k = 1..N (the first
state is given); then the goal's slack. Rows: dynamics; soft rows, as
:func:`mpcplan.refine.stage.rows` has them; the goal's; bounds of single variables. The sparsity is
fixed per horizon, so only data vectors are written in an iteration. So are the scales: variables
are measured in typical sizes, and a row in those of what it bounds.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from mpcplan.refine.compiled import Functions
from mpcplan.refine.model import NU, NX
from mpcplan.refine.stage import BOXES, LIMIT_ROW, N_GOAL, N_ROWS, SLACK_OF_ROW, Slack
from mpcplan.seed.seed import Stage
from mpcplan.trajectory import Array

Index = NDArray[np.int64]
STATE_SCALE = np.array([1.0, 0.2, 0.05, 0.5, 0.05, 1.0])  # s, d, mu, v, delta, a
INPUT_SCALE = (4.0, 0.05)  # j, w
SLACK_SCALE = (0.3, 0.1, 0.5)  # in s, in d, acceleration
GOAL_SCALE = 0.1
N_STEP = NU + NX + len(Slack)


@dataclass(frozen=True, eq=False)
class Pattern:
    """A sparse matrix's pattern, and where data in another order belongs in it.

    Entries of a column below zero are none of the matrix's.
    """

    shape: tuple[int, int]
    rows: Index
    columns: Index

    @cached_property
    def order(self) -> Index:
        """The entries' permutation into columns."""
        order = np.lexsort((self.rows, self.columns))
        return order[np.count_nonzero(self.columns < 0) :]

    @cached_property
    def indices(self) -> NDArray[np.int32]:
        """Rows of the entries, column by column."""
        return self.rows[self.order].astype(np.int32)

    @cached_property
    def indptr(self) -> NDArray[np.int32]:
        """Where columns begin."""
        counts = np.bincount(self.columns[self.order], minlength=self.shape[1])
        return np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)

    def matrix(self, data: Array) -> sp.csc_matrix:
        """The matrix of data in the order of ``rows`` and ``columns``."""
        return sp.csc_matrix((data[self.order], self.indices, self.indptr), shape=self.shape)

    def ones(self) -> sp.csc_matrix:
        """The pattern as a matrix."""
        return self.matrix(np.ones(len(self.rows)))


@dataclass(frozen=True, eq=False)
class Layout:
    """Index sets of the quadratic problem with N steps.

    Attributes:
        n: steps N.
        x: (N, 6), u: (N, 2), slack: (N, 3) columns; goal: that of the goal's slack.
        a: the constraints' matrix, data in the order: nonzeros of the dynamics, of the soft rows
            (step by step), of the goal's, then ``constants``.
        h: the Hessian's upper triangle, data in the order: diagonal, then ``h_apart``.
        constants: data of the rest of the constraints' matrix.
        h_on: of the nonzeros of a step's Hessian, those on the diagonal; h_at: their columns, as
            (N, m); h_apart: the nonzeros that are not.
        dynamics, soft, at_goal, box: the blocks of rows; boxed: the columns that rows of ``box``
            bound.
        columns, lines: scales of the variables, and of the rows.
    """

    n: int
    x: Index
    u: Index
    slack: Index
    goal: int
    a: Pattern
    h: Pattern
    constants: Array
    h_on: Index
    h_at: Index
    h_apart: Index
    dynamics: slice
    soft: slice
    at_goal: slice
    box: slice
    boxed: Index
    columns: Array
    lines: Array

    @property
    def n_vars(self) -> int:
        """Number of variables."""
        return self.goal + 1

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return self.box.stop

    @property
    def between(self) -> slice:
        """The rows that are neither equations nor bounds of single variables."""
        return slice(self.soft.start, self.at_goal.stop)

    @cached_property
    def hard(self) -> Index:
        """The rows that have no slack: acceleration limits, and bounds but for those of slacks."""
        limits = self.soft.start + LIMIT_ROW + N_ROWS * np.arange(self.n)
        boxes = np.arange(self.box.start, self.box.stop - 1).reshape(self.n, -1)
        return np.concatenate([limits, boxes[:, : len(BOXES)].ravel()])

    @property
    def slacks(self) -> Index:
        """(3 N + 1,) columns of all slacks, the goal's last."""
        return np.append(self.slack.ravel(), self.goal)


@lru_cache(maxsize=256)
def layout(made: Functions, n: int) -> Layout:
    """The layout for N = n steps."""
    first = N_STEP * np.arange(n)[:, None]
    u, x, slack = (first + at + np.arange(k) for at, k in ((0, NU), (NU, NX), (NU + NX, 3)))
    goal = N_STEP * n
    blocks = np.cumsum([0, NX * n, N_ROWS * n, N_GOAL, (len(BOXES) + len(Slack)) * n + 1])
    dynamics, soft, at_goal, box = (slice(int(a), int(b)) for a, b in pairwise(blocks))
    bounded = [*BOXES, *(NU + NX + np.arange(len(Slack)))]
    boxed = np.append((first + np.array(bounded)).ravel(), goal)
    columns = np.append(np.tile([*INPUT_SCALE, *STATE_SCALE, *SLACK_SCALE], n), GOAL_SCALE)
    of_row = [STATE_SCALE[Stage.A] if s is None else SLACK_SCALE[s] for s in SLACK_OF_ROW]
    lines = np.concatenate(
        [np.tile(STATE_SCALE, n), np.tile(of_row, n), np.full(N_GOAL, GOAL_SCALE), columns[boxed]]
    )
    pattern, constants = _matrix(made, x, u, slack, goal, blocks, boxed)
    h_rows, h_columns = (np.array(index) for index in made.hessian)
    on = h_rows == h_columns
    variables = np.hstack([u, x])
    apart = variables[:, h_rows[~on]].ravel(), variables[:, h_columns[~on]].ravel()
    diagonal = np.arange(goal + 1)
    h = Pattern(
        (goal + 1, goal + 1),
        np.concatenate([diagonal, np.minimum(*apart)]),
        np.concatenate([diagonal, np.maximum(*apart)]),
    )
    return Layout(
        n, x, u, slack, goal, pattern, h, constants, np.flatnonzero(on), variables[:, h_rows[on]],
        np.flatnonzero(~on), dynamics, soft, at_goal, box, boxed, columns, 1.0 / lines,
    )  # fmt: skip


def _matrix(
    made: Functions, x: Index, u: Index, slack: Index, goal: int, blocks: Index, boxed: Index
) -> tuple[Pattern, Array]:
    """The constraints' matrix: nonzeros of the functions, then constants: see :class:`Layout`."""
    n = len(x)
    step = np.arange(n)[:, None]
    entries: list[tuple[Index, Index]] = []
    before = np.hstack([np.vstack([np.full((1, NX), -1), x[:-1]]), u])  # -1: the given first state
    for at, height, (rows, columns), of in (
        (blocks[0], NX, made.dynamics, before),
        (blocks[1], N_ROWS, made.of_rows, x),
    ):
        entries.append(((at + height * step + np.array(rows)).ravel(), of[:, columns].ravel()))
    rows, columns = made.of_goal
    entries.append((blocks[2] + np.array(rows), x[-1][columns]))
    soft = [i for i in range(N_ROWS) if i != LIMIT_ROW]
    slack_of = [s for s in SLACK_OF_ROW if s is not None]
    constant = [
        (blocks[0] + np.arange(NX * n), x.ravel()),
        ((blocks[1] + N_ROWS * step + np.array(soft)).ravel(), slack[:, slack_of].ravel()),
        (blocks[2] + np.arange(N_GOAL), np.full(N_GOAL, goal)),
    ]
    box = blocks[3] + np.arange(len(boxed)), boxed
    minus = sum(len(r) for r, _ in constant)
    rows_, columns_ = (
        np.concatenate(parts) for parts in zip(*entries, *constant, box, strict=True)
    )
    constants = np.concatenate([np.full(minus, -1.0), np.ones(len(boxed))])
    return Pattern((int(blocks[-1]), goal + 1), rows_, columns_), constants
