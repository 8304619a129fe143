"""The goal's position region in the coordinates of a reference path, as a raster.

A region of any shape, seen along a curved path, is no rectangle in (s, d). Raster nodes tell which
centres lie in it; around a given one the largest rectangle of such nodes serves where bounds are
needed.
"""

from dataclasses import dataclass

import numpy as np
import shapely

from mpcplan.road.frame import Frame
from mpcplan.trajectory import Array

CELL = 0.1  # m, of the raster at least,
CELLS = 200  # and as many of them along either axis at most


@dataclass(frozen=True, eq=False)
class GoalRegion:
    """Raster over arc length and offset of the vehicle's centre.

    Attributes:
        s: (n,) arc lengths [m], evenly spaced.
        d: (m,) offsets [m], evenly spaced.
        inside: (n, m) whether the node lies in the region.
    """

    s: Array
    d: Array
    inside: Array

    def contains(self, s: Array, d: Array) -> Array:
        """Whether centres lie in the region: all nodes around them do."""
        found = np.ones(np.broadcast_shapes(np.shape(s), np.shape(d)), bool)
        rows, columns = _around(self.s, s), _around(self.d, d)
        for row in rows:
            for column in columns:
                there = (row >= 0) & (row < len(self.s)) & (column >= 0) & (column < len(self.d))
                at = np.where(there, row, 0), np.where(there, column, 0)
                found &= there & self.inside[at]
        return found

    def box(self, s: float, d: float) -> tuple[tuple[float, float], tuple[float, float]] | None:
        """Ranges of s and of d: the largest rectangle in the region around the centre (s, d); None
        where that is not in the region."""
        row, column = (int(np.abs(grid - at).argmin()) for grid, at in ((self.s, s), (self.d, d)))
        if not self.inside[row, column]:
            return None
        low, high = _runs(self.inside, row)
        left = _run(self.inside[row], column)[0]
        right = _run(self.inside[row], column)[1]
        # the run of s that all columns from the centre's to another one have in common
        low_left = np.maximum.accumulate(low[left : column + 1][::-1])[::-1]
        high_left = np.minimum.accumulate(high[left : column + 1][::-1])[::-1]
        low_right = np.maximum.accumulate(low[column : right + 1])
        high_right = np.minimum.accumulate(high[column : right + 1])
        first = np.maximum(low_left[:, None], low_right[None, :])
        last = np.minimum(high_left[:, None], high_right[None, :])
        width = np.arange(column, right + 1)[None, :] - np.arange(left, column + 1)[:, None]
        i, j = np.unravel_index(int(((last - first + 1) * (width + 1)).argmax()), width.shape)
        return (
            (float(self.s[first[i, j]]), float(self.s[last[i, j]])),
            (float(self.d[left + i]), float(self.d[column + j])),
        )


def goal_region(
    region: shapely.Geometry, frame: Frame, s: tuple[float, float], d: tuple[float, float]
) -> GoalRegion:
    """The raster of a region over ranges of s and d that hold it."""
    grid_s, grid_d = _grid(s), _grid(d)
    points = frame.to_cartesian(grid_s[:, None], grid_d[None, :])
    inside = shapely.contains_xy(region, points[..., 0], points[..., 1])
    return GoalRegion(grid_s, grid_d, inside)


def _grid(interval: tuple[float, float]) -> Array:
    low, high = interval
    count = int(np.clip(np.ceil((high - low) / CELL), 1, CELLS)) + 1
    return np.linspace(low, high, count)


def _around(grid: Array, values: Array) -> tuple[Array, Array]:
    """Indices of the nodes before and after values."""
    place = (np.asarray(values) - grid[0]) / (grid[1] - grid[0])
    return np.floor(place).astype(int), np.ceil(place).astype(int)


def _runs(inside: Array, row: int) -> tuple[Array, Array]:
    """For every column the first and last row of the run of True around a row; an empty run, after
    itself, where that is False."""
    n = len(inside)
    rows = np.arange(n)[:, None]
    before = np.where(inside[: row + 1], -1, rows[: row + 1]).max(axis=0)
    after = np.where(inside[row:], n, rows[row:]).min(axis=0)
    return before + 1, after - 1


def _run(mask: Array, index: int) -> tuple[int, int]:
    """First and last index of the run of True around an index."""
    low = high = index
    while low > 0 and mask[low - 1]:
        low -= 1
    while high + 1 < len(mask) and mask[high + 1]:
        high += 1
    return low, high
