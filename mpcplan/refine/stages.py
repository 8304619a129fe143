"""The quadratic subproblem in stages, as :mod:`mpcplan.refine.hpipm` wants it.

Stage 0 has the inputs u_0 and no state, for the first one is given; stage k the state x_k and the
inputs (u_k, slacks of k), the last one the slacks of N and of the goal. What the layout lists entry
by entry is given a place in the stages' matrices here, once per horizon.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mpcplan.refine.hpipm import Sizes, StageQp
from mpcplan.refine.layout import Index, Layout
from mpcplan.refine.model import NU, NX
from mpcplan.refine.stage import N_GOAL, N_ROWS, Slack


@dataclass(frozen=True, eq=False)
class Stages:
    """Where what belongs.

    Attributes:
        sizes: of the stages.
        stage, index: of every variable its stage and place among its states or inputs;
            is_input: whether it is an input there.
        x, u: the variables that are states, and inputs, in the order of the stages.
        rows: the layout's rows that are neither dynamics nor bounds, in that order; state_boxes,
            input_boxes: those that are bounds.
        idxbx, idxbu: the bounds' variables among the states, and the inputs, of their stage.
        is_slack: (n,) whether a row of ``input_boxes`` bounds a slack.
        boxes: all bounds in the order of their multipliers: the inputs' first, stage by stage.
    """

    sizes: Sizes
    stage: Index
    index: Index
    is_input: NDArray[np.bool_]
    x: Index
    u: Index
    rows: Index
    state_boxes: Index
    input_boxes: Index
    idxbx: Index
    idxbu: Index
    is_slack: NDArray[np.bool_]
    boxes: Index


@lru_cache(maxsize=256)
def stages_of(layout: Layout) -> Stages:
    """The stages of one layout."""
    n, k, slacks = layout.n, np.arange(1, layout.n + 1)[:, None], np.arange(len(Slack))
    stage = np.full(layout.n_vars, n)
    index = np.full(layout.n_vars, len(Slack))
    is_input = np.ones(layout.n_vars, bool)
    stage[layout.x], index[layout.x], is_input[layout.x] = k, np.arange(NX), False
    stage[layout.u], index[layout.u] = k - 1, np.arange(NU)
    stage[layout.slack], index[layout.slack] = k, slacks + np.where(k < n, NU, 0)
    order = np.lexsort((index, stage))
    bounded = stage[layout.boxed]
    rows_of_boxes = np.arange(layout.box.start, layout.box.stop)
    by_stage = np.lexsort((index[layout.boxed], bounded))
    of_input = is_input[layout.boxed][by_stage]
    first, second = by_stage[~of_input], by_stage[of_input]
    both = np.concatenate([second, first])
    both = both[np.argsort(bounded[both], kind="stable")]
    slack = np.zeros(layout.n_vars, bool)
    slack[layout.slacks] = True

    def count(which: Index) -> tuple[int, ...]:
        return tuple(np.bincount(which, minlength=n + 1).tolist())

    sizes = Sizes(
        count(stage[~is_input]), count(stage[is_input]), count(bounded[first]),
        count(bounded[second]), (0, *[N_ROWS] * (n - 1), N_ROWS + N_GOAL),
    )  # fmt: skip
    return Stages(
        sizes, stage, index, is_input, order[~is_input[order]], order[is_input[order]],
        np.arange(layout.between.start, layout.between.stop), rows_of_boxes[first],
        rows_of_boxes[second], index[layout.boxed[first]], index[layout.boxed[second]],
        slack[layout.boxed[second]], rows_of_boxes[both],
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Places:
    """Places of the layout's data in the stages' matrices.

    Attributes:
        a_from, a_to: of the constraints' entries but for bounds and the state reached.
        h_to, h_mirrored: of the Hessian's upper triangle, and of its mirror image.
    """

    a_from: Index
    a_to: Index
    h_to: Index
    h_mirrored: Index


def places(layout: Layout, stages: Stages, solver: StageQp) -> Places:
    """The places in a solver's ``matrices``."""
    stage, index, is_input = stages.stage, stages.index, stages.is_input
    nx, nu, ng = (np.array(getattr(stages.sizes, name)) for name in ("nx", "nu", "ng"))

    def at(name: str, k: Index, row: Index, column: Index, height: Index) -> Index:
        return solver.first[name] + solver.data[name].start[k] + row + column * height

    rows, columns = layout.a.rows, layout.a.columns
    used = np.flatnonzero((columns >= 0) & (rows < layout.box.start))
    used = used[~_reached(layout, stages, rows[used], columns[used])]
    row, column = rows[used], columns[used]
    k, i, of_input = stage[column], index[column], is_input[column]
    dynamics = row < layout.dynamics.stop
    in_goal = row >= layout.at_goal.start
    line = np.where(
        dynamics, row % NX,
        np.where(in_goal, N_ROWS + row - layout.at_goal.start, (row - layout.soft.start) % N_ROWS),
    )  # fmt: skip
    height = np.where(dynamics, NX, ng[k])
    names = np.where(dynamics, np.where(of_input, "B", "A"), np.where(of_input, "D", "C"))
    a_to = np.zeros(len(used), int)
    for name in ("A", "B", "C", "D"):
        m = names == name
        a_to[m] = at(name, k[m], line[m], i[m], height[m])
    row, column = layout.h.rows, layout.h.columns
    k, of_input = stage[row], is_input[row]
    # each entry of the Hessian belongs to one stage: no cost couples an input to a state
    assert np.array_equal(k, stage[column]) and np.array_equal(of_input, is_input[column])
    both = []
    for first, second in ((row, column), (column, row)):
        to_r = at("R", k, index[first], index[second], nu[k])
        to_q = at("Q", k, index[first], index[second], nx[k])
        both.append(np.where(of_input, to_r, to_q))
    return Places(used, a_to, *both)


def _reached(layout: Layout, stages: Stages, rows: Index, columns: Index) -> NDArray[np.bool_]:
    """Whether entries are those of the state that a row of the dynamics leads to: there the
    layout has -1 in the scale of the state, as the stages have."""
    dynamics = rows < layout.dynamics.stop
    return dynamics & ~stages.is_input[columns] & (stages.stage[columns] == rows // NX + 1)
