"""Sparse matrices whose entries are those of another, in another place: only data is moved."""

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp


class Rearranged:
    """A matrix made of another's entries; the pattern is arranged once."""

    def __init__(
        self, pattern: sp.csc_matrix, arrange: Callable[[sp.csc_matrix], sp.spmatrix]
    ) -> None:
        """``arrange`` makes the matrix of one with ``pattern``, without adding entries up."""
        numbers = np.arange(1.0, pattern.nnz + 1)
        numbered = sp.csc_matrix((numbers, pattern.indices, pattern.indptr), shape=pattern.shape)
        self.matrix = arrange(numbered).tocsc()
        self.matrix.sort_indices()
        self._source = self.matrix.data.astype(np.int64) - 1

    def __call__(self, matrix: sp.csc_matrix) -> sp.csc_matrix:
        """The matrix of another's entries; it is overwritten by the next call."""
        self.matrix.data = matrix.data[self._source]
        return self.matrix


def mirrored(upper: sp.csc_matrix) -> sp.csc_matrix:
    """The symmetric matrix of an upper triangle."""
    return upper + sp.triu(upper, 1).T
