"""The reference path and its Frenet frame.

The reference path is a C2 curve p(s) with heading theta(s) and curvature kappa(s). A point has
Frenet coordinates (s, d): p(s) is its nearest point on the path, d its signed distance to the left.
The frame is unique where 1 - kappa(s) d > 0; :attr:`Frame.domain` states the d that it covers.

Source: Werling, Ziegler, Kammel, Thrun: Optimal trajectory generation for dynamic street
scenarios in a Frenet frame, ICRA 2010.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from mpcplan.trajectory import Array

NEWTON_ITERATIONS = 6
NEWTON_TOLERANCE = 1e-7  # m
FOLLOW_REACH = 12.0  # m, a body's points lie within this of its centre along the path
MIN_STRETCH = 0.1  # smallest 1 - kappa d of the domain


@dataclass(frozen=True, eq=False)
class Frame:
    """Frenet frame of a reference path.

    Attributes:
        s: (n,) arc lengths [m], uniformly spaced from 0.
        points: (n, 2) points [m].
    """

    s: Array
    points: Array

    @cached_property
    def _curve(self) -> CubicSpline:
        return CubicSpline(self.s, self.points, bc_type="natural")

    @cached_property
    def _coefficients(self) -> Array:
        """(8, n - 1) coefficients of the pieces: those of x and y, lowest power first."""
        return np.ascontiguousarray(self._curve.c[::-1].transpose(0, 2, 1)).reshape(8, -1)

    def _evaluate(self, s: Array) -> tuple[Array, Array, Array]:
        """p, p', p'', (2, m) each, at arc lengths (m,) inside the ends.

        Direct evaluation: the samples are evenly spaced, so that no search is needed; this is the
        inner loop of projection and refinement.
        """
        piece = (s * (1.0 / self.spacing)).astype(np.int64)
        piece = np.minimum(piece, len(self.s) - 2)
        u = s - piece * self.spacing
        c0, c1, c2, c3 = self._coefficients.take(piece, axis=1).reshape(4, 2, -1)
        c3u, twice = c3 * u, 2.0 * c2
        return c0 + u * (c1 + u * (c2 + c3u)), c1 + u * (twice + 3.0 * c3u), twice + 6.0 * c3u

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.points)

    @cached_property
    def theta(self) -> Array:
        """(n,) unwrapped headings [rad] at ``s``."""
        x, y = self._evaluate(self.s)[1]
        return np.unwrap(np.arctan2(y, x))

    @cached_property
    def kappa(self) -> Array:
        """(n,) curvatures [1/m] at ``s``."""
        _, (x, y), (xx, yy) = self._evaluate(self.s)
        return (x * yy - y * xx) / np.hypot(x, y) ** 3

    @cached_property
    def dkappa(self) -> Array:
        """(n,) derivative of the curvature [1/m^2] at ``s``."""
        return np.gradient(self.kappa, self.s)

    @property
    def length(self) -> float:
        """Length of the reference path [m]."""
        return float(self.s[-1])

    @property
    def spacing(self) -> float:
        """Distance between samples [m]."""
        return float(self.s[1] - self.s[0])

    def domain(self, s: Array) -> tuple[Array, Array]:
        """Least and largest d [m] at which the projection is unique (1 - kappa d >= 0.1)."""
        kappa = self.curvature(s)
        reach = (1 - MIN_STRETCH) / np.maximum(np.abs(kappa), 1e-9)
        return np.where(kappa < 0, -reach, -np.inf), np.where(kappa > 0, reach, np.inf)

    def curvature(self, s: Array) -> Array:
        """Curvature [1/m] at arc lengths s [m]; constant beyond the ends."""
        return np.interp(s, self.s, self.kappa)

    def curvature_slope(self, s: Array) -> Array:
        """Derivative of the curvature [1/m^2] at arc lengths s [m]."""
        return np.interp(s, self.s, self.dkappa)

    def heading(self, s: Array) -> Array:
        """Heading [rad] of the path at arc lengths s [m]."""
        return np.interp(s, self.s, self.theta)

    def to_cartesian(self, s: Array, d: Array) -> Array:
        """(..., 2) points [m] at Frenet coordinates; s is extended linearly beyond the ends."""
        s, d = np.broadcast_arrays(np.asarray(s, float), np.asarray(d, float))
        shape, s, d = s.shape, s.ravel(), d.ravel()
        inside = np.clip(s, 0.0, self.length)
        point, tangent, _ = self._evaluate(inside)
        tangent /= np.hypot(*tangent)
        point += (s - inside) * tangent
        point[0] -= d * tangent[1]
        point[1] += d * tangent[0]
        return point.T.reshape(*shape, 2)

    def to_frenet(
        self, points: Array, near: Array | None = None, tolerance: float = NEWTON_TOLERANCE
    ) -> tuple[Array, Array]:
        """Frenet coordinates (s, d) [m] of (..., 2) points: their nearest point on the path.

        Beyond the ends the path is continued by its tangents. Where several points of the path
        are equally near (outside :meth:`domain`), one of them is returned.

        Args:
            points: the points [m].
            near: (...) arc lengths [m] from which the projection is followed, so that all points
                of one body land on the same stretch of a winding path; None: the nearest sample.
            tolerance: of s [m].
        """
        points = np.asarray(points, float)
        shape = points.shape[:-1]
        flat = np.ascontiguousarray(points.reshape(-1, 2).T)
        if near is None:
            s = self.s[self._tree.query(flat.T)[1]]
            low, high = s - self.spacing, s + self.spacing
        else:
            s = np.array(near, float).reshape(-1)
            low, high = s - FOLLOW_REACH, s + FOLLOW_REACH
        s, point, tangent = self._nearest(flat, s, low, high, tolerance)
        tangent /= np.hypot(*tangent)
        x, y = flat - point
        along = x * tangent[0] + y * tangent[1]
        d = tangent[0] * y - tangent[1] * x
        beyond = (s <= 0.0) | (s >= self.length)
        s = np.where(beyond, np.clip(s, 0.0, self.length) + along, s)
        return s.reshape(shape), d.reshape(shape)

    def _nearest(
        self, points: Array, s: Array, low: Array, high: Array, tolerance: float
    ) -> tuple[Array, Array, Array]:
        """Newton's method for (p(s) - q) . p'(s) = 0 from s, kept between bounds: s, p and p', for
        (2, m) points.

        p and p' are those of the last iterate but one, which is nearer than the tolerance: the
        distance to the path changes by its square.
        """
        point, tangent, second = self._evaluate(np.clip(s, 0.0, self.length))
        for _ in range(NEWTON_ITERATIONS):
            gap = point - points
            slope = (tangent * tangent + gap * second).sum(0)
            move = (gap * tangent).sum(0) / np.maximum(slope, MIN_STRETCH)
            before = s
            s = np.minimum(np.maximum(s - move, low), high)
            far = np.abs(s - before) >= tolerance
            if not far.any():
                break
            found = self._evaluate(np.clip(s[far], 0.0, self.length))
            for array, part in zip((point, tangent, second), found, strict=True):
                array[:, far] = part
        return s, point, tangent
