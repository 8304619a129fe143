"""The reference path: a smooth curve along the lane centres of a route.

The centre lines of the route's lanelets are joined, continued behind the start and past the goal,
and smoothed: with samples q_i of the joined line at arc lengths t_i, the path minimises

    sum_i |p(t_i) - q_i|^2 + lambda integral |p''(t)|^2 dt

over all curves, whose solution is a natural cubic spline (Reinsch 1967), so that heading and
curvature are continuous. lambda grows until the curvature stays below the configured bound.
Where a route changes lanes, the path lies on the later lane as early as that lane exists, and the
lateral motion into it is left to the planner. In curves the path is meant for the rear axle: it
runs inside the lane's centre, so that the whole body is centred in the lane.
"""

import numpy as np
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from scipy.interpolate import make_smoothing_spline

from mpcplan.config import RoadConfig
from mpcplan.errors import RoadError
from mpcplan.road.frame import Frame
from mpcplan.road.route import Route, beside, neighbours
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

SHIFT_MAX = 0.8  # m, largest inward shift of the path
SAMPLING = 1.0  # m, between the samples that are smoothed
LAMBDA_FACTOR = 3.0  # growth of lambda while the curvature is too large
LAMBDA_TRIALS = 8
SWITCH_GAP = 8.0  # m, cut off a piece on either side of a jump between lanes
MIN_SAMPLES = 6  # the smoothing spline needs five


def build_frame(
    network: LaneletNetwork, route: Route, start: Array, reach: float, config: RoadConfig,
    lanes: list[int] | None = None,
) -> Frame:  # fmt: skip
    """Frenet frame along a route.

    Args:
        network: the lanelets.
        route: lanelets from start to goal.
        start: (2,) position [m] from which ``reach`` counts.
        reach: length [m] of road needed ahead of the start.
        config: sampling and smoothing.
        lanes: lanelets to lie on; None: :func:`reference_lanes`.

    Raises:
        RoadError: where the route's lanelets are too short to give a path.
    """
    lanes = reference_lanes(network, route) if lanes is None else lanes
    line = join([network.find_lanelet_by_id(i) for i in lanes])
    line = continue_behind(network, lanes[0], line, start, config.behind)
    line = continue_ahead(network, lanes, line, start, reach + config.ahead)
    line = _cut(line, start, config.behind, reach + config.ahead)
    return smooth(line, config)


def reference_lanes(network: LaneletNetwork, route: Route) -> list[int]:
    """The route's lanelets with every lane change made as early as the later lane exists."""
    lanes = [route.lanelets[-1]]
    earlier = list(route.lanelets[:-1])
    while earlier:
        head = network.find_lanelet_by_id(lanes[0])
        previous = earlier.pop()
        if previous in neighbours(head):
            continue  # the same stretch of road: stay on the later lane
        if previous in head.predecessor:
            lanes.insert(0, previous)
            continue
        # the route is on a neighbouring lane here: take the lane that leads to ours, if any
        beside = {previous, *neighbours(network.find_lanelet_by_id(previous))}
        on_lane = sorted(set(head.predecessor) & beside)
        lanes.insert(0, on_lane[0] if on_lane else previous)
    return lanes


def lasting_lanes(network: LaneletNetwork, route: Route) -> list[int]:
    """The lane on which a route ends, as far back as it exists: unlike :func:`reference_lanes` it
    jumps nowhere but where a lane begins."""
    lanes = [here := route.lanelets[-1]]
    for previous in reversed(route.lanelets[:-1]):
        if here not in neighbours(network.find_lanelet_by_id(previous)):  # else: still abreast
            before = network.find_lanelet_by_id(lanes[0]).predecessor
            on_lane = sorted(set(before) & beside(network, [previous]))
            lanes.insert(0, previous if previous in before or not on_lane else on_lane[0])
        here = previous
    return lanes


def join(lanelets: list[Lanelet]) -> Array:
    """(n, 2) centre line of lanelets; at a jump between lanes both sides are cut back."""
    line = np.asarray(lanelets[0].center_vertices, float)
    for lanelet in lanelets[1:]:
        piece = np.asarray(lanelet.center_vertices, float)
        if np.hypot(*(piece[0] - line[-1])) > SAMPLING:
            piece = _skip_passed(line, piece)
            line, piece = _shorten(line, from_end=True), _shorten(piece, from_end=False)
        line = np.vstack([line, piece])
    return drop_repeated(line)


def _skip_passed(line: Array, piece: Array) -> Array:
    """The part of ``piece`` that lies ahead of the end of ``line``."""
    heading = line[-1] - line[-2]
    ahead = (piece - line[-1]) @ heading > 0
    return piece[ahead] if ahead.sum() >= 2 else piece[-2:]


def _shorten(line: Array, from_end: bool) -> Array:
    """The line without its last (or first) SWITCH_GAP metres, at least two points."""
    if from_end:
        return _shorten(line[::-1], from_end=False)[::-1]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    first = min(int(np.searchsorted(along, SWITCH_GAP)), len(line) - 2)
    return line[max(first, 0) :]


def drop_repeated(line: Array, gap: float = 0.01) -> Array:
    """The line without points that (nearly) repeat the one before."""
    keep = np.concatenate([[True], np.hypot(*np.diff(line, axis=0).T) > gap])
    return line[keep]


def continue_behind(
    network: LaneletNetwork, first: int, line: Array, start: Array, length: float
) -> Array:
    """Predecessors, then a straight line, so that ``length`` metres lie behind the start."""
    lanelet, passed = network.find_lanelet_by_id(first), {first}
    while _arc(line, start) < length:
        before = [p for p in sorted(lanelet.predecessor) if p not in passed]
        if not before:
            return _straight(line[::-1], length + SAMPLING - _arc(line, start))[::-1]
        best = min(before, key=lambda i: _turn(network.find_lanelet_by_id(i), lanelet))
        lanelet = network.find_lanelet_by_id(best)
        passed.add(best)
        line = drop_repeated(np.vstack([lanelet.center_vertices, line]))
    return line


def continue_ahead(
    network: LaneletNetwork, lanes: list[int], line: Array, start: Array, length: float
) -> Array:
    """The straightest successors, then a straight line, so that ``length`` metres lie ahead."""
    lanelet, passed = network.find_lanelet_by_id(lanes[-1]), set(lanes)
    while _total(line) - _arc(line, start) < length:
        after = [s for s in sorted(lanelet.successor) if s not in passed]
        if not after:
            return _straight(line, length + SAMPLING - (_total(line) - _arc(line, start)))
        here = lanelet
        best = min(after, key=lambda i: _turn(here, network.find_lanelet_by_id(i)))
        lanelet = network.find_lanelet_by_id(best)
        passed.add(best)
        line = drop_repeated(np.vstack([line, lanelet.center_vertices]))
    return line


def _turn(first: Lanelet, second: Lanelet) -> float:
    """Change of heading [rad] from the first lanelet's start to the second's end, absolute."""
    a = first.center_vertices[1] - first.center_vertices[0]
    b = second.center_vertices[-1] - second.center_vertices[-2]
    return float(abs(np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)))


def _total(line: Array) -> float:
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def _arc(line: Array, point: Array) -> float:
    """Arc length [m] of the point's projection on a polyline."""
    a, step = line[:-1], np.diff(line, axis=0)
    length = np.maximum(np.hypot(*step.T), 1e-9)
    share = np.clip(((point - a) * step).sum(1) / length**2, 0.0, 1.0)
    nearest = int(np.argmin(np.hypot(*(a + share[:, None] * step - point).T)))
    return float(length[:nearest].sum() + share[nearest] * length[nearest])


def _straight(line: Array, length: float) -> Array:
    """The line continued straight at its end by ``length`` metres."""
    base = line[max(-len(line), -4)]
    direction = (line[-1] - base) / np.hypot(*(line[-1] - base))
    steps = np.arange(SAMPLING, length + SAMPLING, SAMPLING)
    return np.vstack([line, line[-1] + steps[:, None] * direction])


def _cut(line: Array, start: Array, behind: float, ahead: float) -> Array:
    """The part of the line from ``behind`` metres before the start to ``ahead`` past it."""
    at = _arc(line, start)
    return resample(line, SAMPLING, max(at - behind, 0.0), min(at + ahead, _total(line)))


def resample(line: Array, spacing: float, first: float = 0.0, last: float | None = None) -> Array:
    """Points of a polyline at uniform arc lengths between ``first`` and ``last`` [m]."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    last = along[-1] if last is None else last
    count = max(round((last - first) / spacing) + 1, 2)
    at = np.linspace(first, last, count)
    return np.column_stack([np.interp(at, along, line[:, 0]), np.interp(at, along, line[:, 1])])


def smooth(line: Array, config: RoadConfig) -> Frame:
    """The smoothing spline of a polyline, resampled by arc length.

    Raises:
        RoadError: where the line is too short.
    """
    if len(line) < MIN_SAMPLES:
        raise RoadError(f"reference path of {_total(line):.1f} m is too short")
    t = np.linspace(0.0, _total(line), len(line))
    lam = config.smoothing
    for _ in range(LAMBDA_TRIALS):
        frame = _spline_frame(t, line, lam, config.spacing)
        frame = _for_rear_axle(frame, config)
        if np.abs(frame.kappa).max() <= config.curvature_max:
            break
        lam *= LAMBDA_FACTOR
    return frame


def _for_rear_axle(frame: Frame, config: RoadConfig) -> Frame:
    """The path moved inwards in curves, so that the body of a car on it is centred in the lane.

    With the rear axle on a circle of curvature kappa, the front bumper lies front^2 kappa / 2
    outside of it: half of that to either side is the least that the body can stick out.
    """
    shift = np.clip(frame.kappa * CAR.front**2 / 4, -SHIFT_MAX, SHIFT_MAX)
    points = frame.to_cartesian(frame.s, shift)
    t = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    return _spline_frame(t, points, config.smoothing, config.spacing)


def _spline_frame(t: Array, line: Array, lam: float, spacing: float) -> Frame:
    curves = [make_smoothing_spline(t, line[:, axis], lam=lam) for axis in range(2)]
    fine = np.linspace(t[0], t[-1], 4 * len(t))
    coarse = np.column_stack([curve(fine) for curve in curves])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(coarse, axis=0).T))])
    s = np.linspace(0.0, along[-1], max(round(along[-1] / spacing) + 1, MIN_SAMPLES))
    at = np.interp(s, along, fine)  # points on the spline itself, so that curvature is smooth
    return Frame(s, np.column_stack([curve(at) for curve in curves]))
