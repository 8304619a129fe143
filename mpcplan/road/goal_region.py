"""The goal's position region in the coordinates of a reference path, as a raster.

A region of any shape, seen along a curved path, is no rectangle in (s, d). The raster holds the
depth, the signed distance to the region's edge, which between nodes is interpolated: along straight
edges without error. Around a given centre the largest rectangle serves where bounds are needed.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.ndimage import map_coordinates

from mpcplan.road.frame import Frame
from mpcplan.trajectory import Array

CELL = 0.25  # m, of the raster at least,
CELLS = 200  # and as many of them along either axis at most
DEPTH = 0.02  # m, a centre in the region lies at least this deep
FINE = 0.1  # m, of the raster on which rectangles are sought,
REACH = 10.0  # m, to either side of the given centre


@dataclass(frozen=True, eq=False)
class GoalRegion:
    """Raster over arc length and offset of the vehicle's centre.

    Attributes:
        s: (n,) arc lengths [m], evenly spaced.
        d: (m,) offsets [m], evenly spaced.
        depth: (n, m) distance of the node from the region's edge [m], negative outside.
    """

    s: Array
    d: Array
    depth: Array

    def contains(self, s: Array, d: Array) -> Array:
        """Whether centres lie in the region; none does beyond the raster."""
        s, d = np.broadcast_arrays(s, d)
        places = [(x - grid[0]) / (grid[1] - grid[0]) for x, grid in ((s, self.s), (d, self.d))]
        depth = map_coordinates(self.depth, places, order=1, mode="constant", cval=-np.inf)
        found: Array = depth >= DEPTH
        return found

    def box(self, s: float, d: float) -> tuple[tuple[float, float], tuple[float, float]] | None:
        """Ranges of s and of d: the largest rectangle in the region around the centre (s, d), as
        far as REACH; None where that is not in the region."""
        away = np.arange(-REACH, REACH + FINE / 2, FINE)
        grid_s, grid_d = s + away, d + away
        inside = self.contains(grid_s[:, None], grid_d[None, :])
        row = column = len(away) // 2
        if not inside[row, column]:
            return None
        low, high = _runs(inside, row)
        left, right = run_around(inside[row], column)
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
            (float(grid_s[first[i, j]]), float(grid_s[last[i, j]])),
            (float(grid_d[left + i]), float(grid_d[column + j])),
        )


def goal_region(
    region: shapely.Geometry, frame: Frame, s: tuple[float, float], d: tuple[float, float]
) -> GoalRegion:
    """The raster of a region over ranges of s and d that hold it."""
    grid_s, grid_d = _grid(s), _grid(d)
    points = frame.to_cartesian(grid_s[:, None], grid_d[None, :])
    shapely.prepare(region)
    inside = shapely.contains_xy(region, points[..., 0], points[..., 1])
    far = shapely.distance(shapely.points(points), shapely.boundary(region))
    return GoalRegion(grid_s, grid_d, np.where(inside, far, -far))


def _grid(interval: tuple[float, float]) -> Array:
    low, high = interval
    count = int(np.clip(np.ceil((high - low) / CELL), 1, CELLS)) + 1
    return np.linspace(low, high, count)


def _runs(inside: Array, row: int) -> tuple[Array, Array]:
    """For every column the first and last row of the run of True around a row; an empty run, after
    itself, where that is False."""
    n = len(inside)
    rows = np.arange(n)[:, None]
    before = np.where(inside[: row + 1], -1, rows[: row + 1]).max(axis=0)
    after = np.where(inside[row:], n, rows[row:]).min(axis=0)
    return before + 1, after - 1


def run_around(mask: Array, index: int) -> tuple[int, int]:
    """First and last index of the run of True around an index."""
    low = high = index
    while low > 0 and mask[low - 1]:
        low -= 1
    while high + 1 < len(mask) and mask[high + 1]:
        high += 1
    return low, high
