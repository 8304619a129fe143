"""Limits along the reference path: drivable area, lane centres and speed.

For every sample of the path: the drivable area's edges d_left(s), d_right(s) around the lane, the
offsets of the centres of this and the neighbouring lanes, and the largest speed from signs and
from the lateral acceleration v^2 |kappa| <= a_lat.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork, LaneletType
from commonroad.scenario.scenario import Scenario
from commonroad.scenario.traffic_sign_interpreter import TrafficSignInterpreter
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from mpcplan.config import RoadConfig
from mpcplan.road.boundary import official_boundary
from mpcplan.road.frame import Frame
from mpcplan.trajectory import Array

NOT_FOR_CARS = {
    LaneletType.SIDEWALK,
    LaneletType.BICYCLE_LANE,
    LaneletType.CROSSWALK,
    LaneletType.BUS_STOP,
}
HOLE = 1.5  # m^2, smaller holes between lanelets are closed
INTRUSION = 1e-6  # m^2, overlap of a boundary triangle with the road that counts
SEAM = 0.02  # m, gaps between lanelets up to twice this wide count as road
EDGE_REACH = 12.0  # m, the area is searched this far to either side
LANE_REACH = 6.0  # m, a neighbouring lane's centre lies within this of the reference


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits at the samples of a reference path (all arrays (n,), in m or m/s).

    Attributes:
        left, right: edges of the drivable area that is connected with the lane (left > right).
        lane: offset of the nearest lane's centre from the reference.
        lane_left, lane_right: centres of the neighbouring lanes of the same direction, else NaN.
        posted: largest speed from signs.
        speed: largest speed from signs and curvature.
        end: arc length at which the road ends.
    """

    left: Array
    right: Array
    lane: Array
    lane_left: Array
    lane_right: Array
    posted: Array
    speed: Array
    end: float

    def lane_offset(self, frame: Frame, s: Array, d: Array) -> Array:
        """Offsets [m] of points (s, d) from the nearest of the lanes' centres there."""
        centres = np.stack(
            [np.interp(s, frame.s, lane) for lane in (self.lane, self.lane_left, self.lane_right)]
        )
        gap = np.where(np.isfinite(centres), d - centres, np.inf)
        nearest = np.abs(gap).argmin(axis=0)
        offset: Array = np.take_along_axis(gap, nearest[None], 0)[0]
        return offset


def drivable_area(scenario: Scenario) -> shapely.Geometry:
    """The area that a body must not leave, prepared for queries.

    The union of the lanelets that cars may use, with seams and small holes between lanelets closed,
    less what the official checker's triangulated road boundary takes of it.
    """
    network = scenario.lanelet_network
    cars = [lane for lane in network.lanelets if not lane.lanelet_type & NOT_FOR_CARS]
    shapes = shapely.buffer([lane.polygon.shapely_object for lane in cars], SEAM)
    area = _without_small_holes(shapely.buffer(shapely.union_all(shapes), -SEAM))
    boundary = official_boundary(scenario)
    inside = shapely.area(shapely.intersection(boundary, area)) > INTRUSION
    area = shapely.difference(area, shapely.union_all(boundary[inside]))
    shapely.prepare(area)
    return area


def _without_small_holes(area: shapely.Geometry) -> shapely.Geometry:
    """The area with holes below HOLE closed: gaps of the map, not islands."""
    parts = []
    for part in shapely.get_parts(area):
        shell, *holes = shapely.get_rings(part)
        kept = [hole for hole in holes if shapely.area(shapely.polygons(hole)) > HOLE]
        parts.append(shapely.polygons(shell, holes=kept or None))
    return shapely.union_all(parts)


def build_limits(
    scenario: Scenario, area: shapely.Geometry, frame: Frame, config: RoadConfig
) -> Limits:
    """Limits along a frame on the drivable area."""
    network = scenario.lanelet_network
    left, right = _edges(area, frame, config.margin)
    on_path = _lanelets_on_path(network, frame)
    lane, lane_left, lane_right = _lane_centres(network, on_path, frame)
    return Limits(
        left, right, lane, lane_left, lane_right,
        *_speed_limits(scenario, on_path, frame, config),
        _road_end(left, right, frame),
    )  # fmt: skip


def _edges(area: shapely.Geometry, frame: Frame, margin: float) -> tuple[Array, Array]:
    """Edges of the area along the normals; 0 where the reference lies off the road."""
    low, high = frame.domain(frame.s)
    low, high = np.maximum(low, -EDGE_REACH), np.minimum(high, EDGE_REACH)
    ends = np.stack([frame.to_cartesian(frame.s, low), frame.to_cartesian(frame.s, high)], axis=1)
    pieces = shapely.intersection(shapely.linestrings(ends), area)
    left, right = np.zeros(len(frame.s)), np.zeros(len(frame.s))
    parts, owner = shapely.get_parts(pieces, return_index=True)
    is_line = (shapely.get_type_id(parts) == 1) & ~shapely.is_empty(parts)  # 1: LineString
    start = shapely.points(ends[:, 0])
    for part, i in zip(parts[is_line], owner[is_line], strict=True):
        ends_of_part = shapely.points(shapely.get_coordinates(part)[[0, -1]])
        a, b = sorted(low[i] + shapely.distance(ends_of_part, start[i]))
        if a <= 0.0 <= b:
            right[i], left[i] = min(a + margin, 0.0), max(b - margin, 0.0)
    # a corner between two samples of the path must be seen by one of them
    return minimum_filter1d(left, 3), maximum_filter1d(right, 3)


def _lanelets_on_path(network: LaneletNetwork, frame: Frame) -> list[Lanelet | None]:
    """For every sample the lanelet that holds it and is best aligned with it."""
    held = network.find_lanelet_by_position(list(frame.points))
    found: list[Lanelet | None] = []
    for ids, point, theta in zip(held, frame.points, frame.theta, strict=True):
        lanes = [network.find_lanelet_by_id(i) for i in ids]
        before = found[-1].lanelet_id if found and found[-1] is not None else None
        found.append(
            min(lanes, key=lambda lane: _mismatch(lane, point, theta, before)) if lanes else None
        )
    return found


def _mismatch(lane: Lanelet, point: Array, theta: float, before: int | None) -> tuple[float, int]:
    """Angle plus offset between lanelet and path; the lanelet of the sample before wins ties."""
    centre = lane.center_vertices
    i = min(int(np.argmin(np.hypot(*(centre - point).T))), len(centre) - 2)
    dx, dy = centre[i + 1] - centre[i]
    angle = abs((theta - np.arctan2(dy, dx) + np.pi) % (2 * np.pi) - np.pi)
    offset = abs(dx * (point[1] - centre[i, 1]) - dy * (point[0] - centre[i, 0]))
    mismatch = angle + offset / max(float(np.hypot(dx, dy)), 1e-6)
    return round(float(mismatch), 1) - (0.2 if lane.lanelet_id == before else 0.0), lane.lanelet_id


def _lane_centres(
    network: LaneletNetwork, on_path: list[Lanelet | None], frame: Frame
) -> tuple[Array, Array, Array]:
    """Offsets of the own lane's centre and of the left and right neighbours' centres."""
    own, left, right = (np.full(len(frame.s), np.nan) for _ in range(3))
    lanelets = {lane.lanelet_id: lane for lane in on_path if lane is not None}
    ids = np.array([-1 if lane is None else lane.lanelet_id for lane in on_path])
    for lanelet_id, lane in lanelets.items():
        here = ids == lanelet_id
        own[here] = _centre_offsets(lane, frame)[here]
        if lane.adj_left is not None and lane.adj_left_same_direction:
            left[here] = _centre_offsets(network.find_lanelet_by_id(lane.adj_left), frame)[here]
        if lane.adj_right is not None and lane.adj_right_same_direction:
            right[here] = _centre_offsets(network.find_lanelet_by_id(lane.adj_right), frame)[here]
    own = np.where(np.isfinite(own) & (np.abs(own) < LANE_REACH / 2), own, 0.0)
    left = np.where(np.abs(left) < LANE_REACH, left, np.nan)
    right = np.where(np.abs(right) < LANE_REACH, right, np.nan)
    return own, left, right


def _centre_offsets(lane: Lanelet, frame: Frame) -> Array:
    """Offset of a lanelet's centre line at every sample of the frame (held beyond its ends)."""
    s, d = frame.to_frenet(np.asarray(lane.center_vertices, float))
    order = np.argsort(s)
    return np.interp(frame.s, s[order], d[order])


def _speed_limits(
    scenario: Scenario, on_path: list[Lanelet | None], frame: Frame, config: RoadConfig
) -> tuple[Array, Array]:
    """Largest speed [m/s] from signs, and from signs and lateral acceleration."""
    signs = TrafficSignInterpreter(scenario.scenario_id.country_id, scenario.lanelet_network)
    known: dict[int, float] = {}
    limit = np.full(len(frame.s), config.speed_max)
    for i, lane in enumerate(on_path):
        if lane is None:
            continue
        if lane.lanelet_id not in known:
            posted = signs.speed_limit(frozenset([lane.lanelet_id]))
            known[lane.lanelet_id] = config.speed_max if posted is None else float(posted)
        limit[i] = min(known[lane.lanelet_id] * config.speed_limit_factor, config.speed_max)
    curve = np.sqrt(config.lateral_acceleration / np.maximum(np.abs(frame.kappa), 1e-6))
    return limit, np.minimum(limit, curve)


def _road_end(left: Array, right: Array, frame: Frame) -> float:
    """Arc length of the last sample before the road ends ahead of the path's middle part."""
    on_road = (left - right) > 0.0
    if not on_road.any():
        return 0.0
    return float(frame.s[np.flatnonzero(on_road)[-1]])
