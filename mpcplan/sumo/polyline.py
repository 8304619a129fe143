"""Polylines (n, 2) [m]: pieces, lengths, and SUMO's way to write them."""

import math

import numpy as np

from mpcplan.trajectory import Array

_KINK = 1.0  # m
_SAME = 1e-3  # m, nearer points are one


def parse(shape: str) -> Array:
    """A polyline of SUMO's 'x,y x,y ...'; heights are left out."""
    points = [[float(v) for v in point.split(",")[:2]] for point in shape.split()]
    return np.array(points, float).reshape(-1, 2)


def text(points: Array) -> str:
    """A polyline as SUMO writes it."""
    return " ".join(f"{x:.4f},{y:.4f}" for x, y in points)


def length(points: Array) -> float:
    """Length [m]; 0 for less than two points."""
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def between(points: Array, begin: float, end: float) -> Array:
    """The part between two distances [m] from the begin, cut to the polyline's ends."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    begin, end = (float(np.clip(at, 0.0, along[-1])) for at in (begin, end))
    inside = along[(along > begin + _SAME) & (along < end - _SAME)]
    at = np.concatenate([[begin], inside, [max(end, begin)]])
    return np.column_stack([np.interp(at, along, points[:, k]) for k in (0, 1)])


def joined(begin: Array, points: Array, end: Array) -> Array:
    """A polyline from one point (2,) to another by those of (n, 2) that are far from both, and
    between them: what lies a little beside them would make a kink."""
    ahead = (points - begin) @ (end - begin)
    far = [np.hypot(*(points - one).T) > _KINK for one in (begin, end)]
    between_them = (ahead > 0) & (ahead < (end - begin) @ (end - begin))
    return np.vstack([begin, points[far[0] & far[1] & between_them], end])


def leap(one: Array, other: Array) -> tuple[float, float]:
    """How far [m] and by how much [rad] the way from a polyline to the next one leaps."""
    gap = float(np.hypot(*(other[0] - one[-1])))
    if length(one) < _SAME or length(other) < _SAME:
        return gap, math.pi  # a point leads nowhere
    turn = _heading(other[:2]) - _heading(one[-2:])
    return gap, abs(math.remainder(turn, 2 * math.pi))


def sharpest_turn(points: Array, span: float) -> float:
    """The largest angle [rad] between the directions at a distance [m] along a polyline."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    marks = np.arange(0.0, along[-1], span / 4)
    spots = np.column_stack([np.interp(marks, along, points[:, k]) for k in (0, 1)])
    steps = np.diff(spots, axis=0)
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    turns = np.abs(headings[4:] - headings[:-4])
    return float(turns.max(initial=0.0))


def _heading(piece: Array) -> float:
    dx, dy = piece[-1] - piece[0]
    return math.atan2(dy, dx)
