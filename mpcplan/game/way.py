"""A player's way on the map: a sampled centre line with what is allowed along it.

A way's frame has coordinates (s, d, mu): arc length of the foot point on the centre line, signed
distance to its left, heading relative to it. Curvature enters through the table alone: motion in
the frame is that on a straight way (:mod:`mpcplan.game.tree`), which is then laid on the map.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np

from mpcplan.road.road import Road
from mpcplan.trajectory import Array

SPACING = 1.0  # m, between the samples of a road's way
PROJECTIONS = 3  # Newton steps of a projection


class Sample(IntEnum):
    """Columns of a way's table: m, m, rad (unwrapped), m/s, and in m from the centre line, to the
    left, the edges of the lane and of the road."""

    X = 0
    Y = 1
    HEADING = 2
    CAP = 3
    LANE_LEFT = 4
    LANE_RIGHT = 5
    ROAD_LEFT = 6
    ROAD_RIGHT = 7


EDGES = slice(Sample.LANE_LEFT, Sample.ROAD_RIGHT + 1)


class Place(IntEnum):
    """Columns of a player's state in its way's frame, for the body's centre: m, m, rad, m/s."""

    S = 0
    D = 1
    MU = 2
    V = 3


class Pose(IntEnum):
    """Rows of poses on the map: m, m, and the heading's cosine and sine."""

    X = 0
    Y = 1
    COS = 2
    SIN = 3


@dataclass(frozen=True, eq=False)
class Way:
    """A sampled way.

    Attributes:
        begin: arc length [m] of the first sample.
        spacing: between samples [m].
        table: (n, 8) samples, columns :class:`Sample`.
    """

    begin: float
    spacing: float
    table: Array

    def __post_init__(self) -> None:
        if self.table.ndim != 2 or self.table.shape[1] != len(Sample) or len(self.table) < 2:
            raise ValueError(f"a way's table must be (n >= 2, {len(Sample)}), {self.table.shape}")

    @cached_property
    def _alone(self) -> "Ways":
        return Ways((self,))

    @cached_property
    def _edges(self) -> Array:
        return np.ascontiguousarray(self.table[:, EDGES].T)

    @cached_property
    def _at(self) -> Array:
        return self.begin + self.spacing * np.arange(len(self.table))

    @property
    def end(self) -> float:
        """Arc length [m] of the last sample."""
        return float(self._at[-1])

    def pose(self, place: Array) -> Array:
        """(4,) pose on the map, columns :class:`Pose`, of a place (4,), columns :class:`Place`."""
        s, d, mu, _ = place[:, None]
        found: Array = self._alone.poses(np.zeros(1, int), s, d, np.cos(mu), np.sin(mu))[:, 0]
        return found

    def centre(self, s: float) -> tuple[float, float, float]:
        """A point x, y [m] of the centre line, and its heading [rad]."""
        x, y, heading = self._alone.centres(np.zeros(1, int), np.array([s]))
        return float(x[0]), float(y[0]), float(heading[0])

    def edges(self, s: Array) -> Array:
        """(4, ...) edges of lane and road [m] of the nearest samples: the table's last columns."""
        u = (s - self.begin) * (1.0 / self.spacing) + 0.5
        edges: Array = self._edges.take(u.astype(np.int64), axis=1, mode="clip")
        return edges

    def cap(self, s: Array) -> Array:
        """Largest speeds [m/s] at arc lengths [m]."""
        return np.interp(s, self._at, self.table[:, Sample.CAP])

    def curvature(self, s: float) -> float:
        """Curvature [1/m] at an arc length [m], from the samples around it; 0 beyond the ends."""
        i = int(np.clip((s - self.begin) // self.spacing, 0, len(self.table) - 2))
        inside = self.begin <= s <= self.end
        turn = self.table[i + 1, Sample.HEADING] - self.table[i, Sample.HEADING]
        return float(turn) / self.spacing if inside else 0.0

    def place(self, point: Array, heading: float, v: float, near: float | None = None) -> Array:
        """(4,) state, columns :class:`Place`, of a body at a point (2,) with heading and speed.

        Args:
            point: centre of the body [m].
            heading: of the body [rad].
            v: speed [m/s].
            near: arc length [m] from which the projection starts; None: the nearest sample.
        """
        if near is None:
            gap = self.table[:, [Sample.X, Sample.Y]] - point
            near = self.begin + self.spacing * int((gap**2).sum(axis=1).argmin())
        s = near
        for _ in range(PROJECTIONS):
            x, y, along = self.centre(s)
            ahead = (point[0] - x) * np.cos(along) + (point[1] - y) * np.sin(along)
            s += float(ahead)
        x, y, along = self.centre(s)
        d = np.cos(along) * (point[1] - y) - np.sin(along) * (point[0] - x)
        mu = (heading - along + np.pi) % (2 * np.pi) - np.pi
        return np.array([s, d, mu, v])


class Ways:
    """Several ways, looked up at once."""

    def __init__(self, ways: Sequence[Way]) -> None:
        self._begin = np.array([way.begin for way in ways])
        self._scale = 1.0 / np.array([way.spacing for way in ways])
        self._last = np.array([len(way.table) - 2 for way in ways])
        sizes = self._last + 1
        self._base = np.cumsum(sizes) - sizes
        # x, y and heading of the samples, and by how much they change to the next
        poses = [way.table[:, : Sample.HEADING + 1] for way in ways]
        lines = [np.hstack([pose[:-1], np.diff(pose, axis=0)]) for pose in poses]
        self._lines = np.ascontiguousarray(np.vstack(lines).T)

    def centres(self, who: Array, s: Array) -> tuple[Array, Array, Array]:
        """Points x, y [m] of the centre lines of ways (n,) and their heading [rad], at arc lengths
        (n, ...); straight on beyond the ends."""
        who = who.reshape(-1, *[1] * (s.ndim - 1))
        u = (s - self._begin[who]) * self._scale[who]
        i = np.minimum(np.maximum(u, 0.0), self._last[who]).astype(np.int64)
        x, y, heading, dx, dy, turn = self._lines.take(self._base[who] + i, axis=1)
        share = u - i
        heading = heading + np.minimum(np.maximum(share, 0.0), 1.0) * turn
        return x + share * dx, y + share * dy, heading

    def poses(self, who: Array, s: Array, d: Array, cos_mu: Array, sin_mu: Array) -> Array:
        """(4, n, ...) poses on the map, rows :class:`Pose`, on ways (n,)."""
        x, y, heading = self.centres(who, s)
        cos, sin = np.cos(heading), np.sin(heading)
        found = np.empty((len(Pose), *s.shape))
        found[Pose.X] = x - sin * d
        found[Pose.Y] = y + cos * d
        found[Pose.COS] = cos * cos_mu - sin * sin_mu
        found[Pose.SIN] = sin * cos_mu + cos * sin_mu
        return found


def way_of_road(road: Road) -> Way:
    """The way along a road's reference: lane edges half way to the neighbouring lanes' centres,
    or the road's where there are none."""
    s = np.arange(0.0, road.frame.length, SPACING)
    at = road.frame.s
    limits = road.limits

    def along(values: Array) -> Array:
        return np.interp(s, at, values)

    left, right = limits.left, limits.right
    lane_left = np.where(np.isfinite(limits.lane_left), (limits.lane + limits.lane_left) / 2, left)
    lane_right = np.where(
        np.isfinite(limits.lane_right), (limits.lane + limits.lane_right) / 2, right
    )
    points = road.frame.to_cartesian(s, np.zeros_like(s))
    columns = [
        points[:, 0], points[:, 1], road.frame.heading(s), along(limits.speed),
        along(np.minimum(lane_left, left)), along(np.maximum(lane_right, right)),
        along(left), along(right),
    ]  # fmt: skip
    return Way(0.0, SPACING, np.column_stack(columns))
