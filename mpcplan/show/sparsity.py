"""The size and the sparsity of the refinement's quadratic subproblem.

min p' H p / 2 + g' p    s.t.    low <= A p <= high
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mpcplan.bench.table import align
from mpcplan.refine.layout import N_STEP
from mpcplan.refine.problem import Problem
from mpcplan.show import colours

_DPI = 110
_SIZE = (12.0, 6.6)  # inches
_STEPS = 2  # of which the beginning is shown enlarged
_BLOCKS = {  # of rows, with their colours
    "dynamics": colours.of_variant(0),
    "soft rows": colours.TRAFFIC,
    "goal": colours.GOAL,
    "bounds": colours.of_variant(1),
}


@dataclass(frozen=True, eq=False)
class Sparsity:
    """The matrices at the seed.

    Attributes:
        steps: N.
        hessian: both triangles of H, with explicit zeros left out.
        matrix: A, likewise.
        blocks: of rows of A by their names.
    """

    steps: int
    hessian: sp.csc_matrix
    matrix: sp.csc_matrix
    blocks: dict[str, slice]

    def told(self) -> str:
        """Sizes and fill as a table."""
        lines: list[tuple[str, ...]] = [("matrix", "rows", "columns", "nonzeros", "fill")]
        parts = {"H": self.hessian, "A": self.matrix}
        parts |= {f"  {name}": self.matrix[rows] for name, rows in self.blocks.items()}
        for name, part in parts.items():
            rows, columns = part.shape
            fill = part.nnz / max(rows * columns, 1)
            lines.append((name, str(rows), str(columns), str(part.nnz), f"{fill:.2%}"))
        return align(lines)


def sparsity_of(problem: Problem) -> Sparsity:
    """The quadratic subproblem's matrices of a problem, at its seed."""
    model, lay = problem.quadratic(problem.at(problem.initial())), problem.layout
    upper, matrix = lay.h.matrix(model.hessian), lay.a.matrix(model.matrix)
    whole = sp.csc_matrix(upper + sp.triu(upper, 1).T)
    matrix = matrix.copy()  # its pattern is the layout's own
    for part in (whole, matrix):
        part.eliminate_zeros()
    rows = (lay.dynamics, lay.soft, lay.at_goal, lay.box)
    return Sparsity(lay.n, whole, matrix, dict(zip(_BLOCKS, rows, strict=True)))


def plot_sparsity(problem: Problem) -> Figure:
    """Draws the nonzeros of H and A, and of the first steps enlarged.

    Args:
        problem: of the refinement.

    Returns:
        The figure.
    """
    found = sparsity_of(problem)
    figure = Figure(figsize=_SIZE, dpi=_DPI)
    FigureCanvasAgg(figure)
    (h, a, near) = figure.subplots(1, 3)
    _spy(h, found.hessian, {"H": slice(0, None)}, {"H": colours.PLAN})
    h.set_title(f"H, {found.hessian.shape[0]} x {found.hessian.shape[1]}", fontsize=11)
    _spy(a, found.matrix, found.blocks, _BLOCKS)
    a.set_title(f"A, {found.matrix.shape[0]} x {found.matrix.shape[1]}", fontsize=11)
    a.legend(
        fontsize=8, loc="upper right", bbox_to_anchor=(1.0, 1.0), markerscale=4, handletextpad=0.1
    )
    _spy_first(near, found)
    figure.suptitle(f"the quadratic subproblem over N = {found.steps} steps: {_fill(found)}")
    figure.tight_layout()
    return figure


def _fill(found: Sparsity) -> str:
    rows, columns = found.matrix.shape
    return f"{found.matrix.nnz} nonzeros in A, {found.matrix.nnz / (rows * columns):.2%}"


def _spy(
    axes: Axes, matrix: sp.csc_matrix, blocks: dict[str, slice], shown: dict[str, str]
) -> None:
    """Dots at the nonzeros, coloured by block of rows."""
    entries = matrix.tocoo()
    for name, rows in blocks.items():
        within = entries.row >= (rows.start or 0)
        if rows.stop is not None:
            within &= entries.row < rows.stop
        axes.plot(
            entries.col[within], entries.row[within], ".", ms=1.2, color=shown[name], label=name
        )
    axes.set(xlim=(0, matrix.shape[1]), ylim=(matrix.shape[0], 0))
    axes.set(xlabel="variables, step by step", ylabel="rows")
    axes.tick_params(labelsize=8)


def _spy_first(axes: Axes, found: Sparsity) -> None:
    """The entries in the variables of the first steps, rows without any left out."""
    part = found.matrix[:, : _STEPS * N_STEP].tocoo()
    rows, at = np.unique(part.row, return_inverse=True)
    for name, block in found.blocks.items():
        within = (part.row >= block.start) & (part.row < block.stop)
        axes.plot(part.col[within], at[within], "s", ms=2.4, color=_BLOCKS[name])
    for step in range(1, _STEPS):
        axes.axvline(step * N_STEP - 0.5, color=colours.LIMIT, lw=0.8, ls="--")
    axes.set(xlim=(-1, _STEPS * N_STEP), ylim=(len(rows), -1))
    axes.set_title(f"A, variables of the first {_STEPS} steps", fontsize=11)
    axes.set(xlabel="of each step: u, x, slacks", ylabel="rows that have any")
    axes.tick_params(labelsize=8)
