"""The lanes along a reference path: where they are, which belong together, what speed they allow.

Every lanelet that leads the same way and comes near the path is a strip between two curves
d_right(s) and d_left(s) in the path's Frenet frame. A lane is a chain of lanelets that follow each
other; where it forks and one of the branches is the path's, that one is its continuation. So a
vehicle that turns off soon leaves the lane, and one that drives ahead on the path stays on it. What
lies on the path's own lane belongs to that alone.
"""

import math
from dataclasses import dataclass

import numpy as np
from commonroad.scenario.lanelet import Lanelet, LaneletType
from commonroad.scenario.scenario import Scenario
from commonroad.scenario.traffic_sign_interpreter import TrafficSignInterpreter

from mpcplan.config import RulesConfig
from mpcplan.road.frame import Frame
from mpcplan.trajectory import Array

ASIDE = 12.0  # m, lanes whose centre lies further from the path are left out
TURN_MAX = math.pi / 3  # rad, a lane or a vehicle that leads the same way deviates by less
SEAM = 0.5  # m, by which a strip reaches over its ends: lanelets may not touch exactly
SAMPLING = 2.0  # m, between the points of a lanelet that are projected
ON_PATH = 0.5  # part of its length on which the path's own lanelet holds the path
STRAIGHT = 1e-6  # 1/m, least curvature that limits the speed
FAST = {LaneletType.INTERSTATE, LaneletType.HIGHWAY, LaneletType.ACCESS_RAMP, LaneletType.EXIT_RAMP}


@dataclass(frozen=True, eq=False)
class Strips:
    """The lanelets along a path (m of them).

    Attributes:
        spacing: distance [m] of the samples along the path, the first at s = 0.
        left, right: (m, n) offsets [m] of the edges at the samples; NaN where a lanelet is not.
        same: (m, m) whether two are parts of one lane.
        beside: (m, m) whether they are neighbours.
        limit: (m,) speed [m/s] that signs allow, or that is usual where none stands.
        bend: (n,) speed [m/s] that the path's curvature allows.
        usual: speed [m/s] off all lanes.
    """

    spacing: float
    left: Array
    right: Array
    same: Array
    beside: Array
    limit: Array
    bend: Array
    usual: float

    def _at(self, s: Array) -> tuple[Array, Array]:
        """Nearest samples of arc lengths [m], and whether these are on the path; NaN is not."""
        with np.errstate(invalid="ignore"):
            there = (s >= 0) & (s <= self.spacing * (self.left.shape[1] - 1))
        at = np.where(there, np.nan_to_num(s) / self.spacing, 0.0)
        return np.rint(at).astype(np.int64), there

    def overlap(self, s: Array, right: Array, left: Array) -> Array:
        """(m, ...) width [m] by which bodies cover each strip; negative: the distance to it.

        Args:
            s: (...) arc length [m] of the bodies' centres.
            right, left: (...) least and largest offset [m] of the bodies.
        """
        at, there = self._at(s)
        shared = np.minimum(left, self.left[:, at]) - np.maximum(right, self.right[:, at])
        return np.where(there & np.isfinite(shared), shared, -np.inf)

    def speed_at(self, s: Array, overlap: Array) -> Array:
        """(...) largest speed [m/s] from signs and curvature where bodies are.

        Args:
            s: (...) arc length [m] of the bodies' centres.
            overlap: (m, ...) as from :meth:`overlap`; the strip that a body covers most counts.
        """
        bend = self.bend[self._at(s)[0]]
        if not len(self.limit):
            return np.minimum(bend, self.usual)
        most = overlap.argmax(axis=0)
        on = np.take_along_axis(overlap, most[None], 0)[0] > 0
        speed: Array = np.minimum(np.where(on, self.limit[most], self.usual), bend)
        return speed


def build_strips(
    scenario: Scenario, frame: Frame, lateral_acceleration: float, rules: RulesConfig
) -> Strips:
    """The strips along a frame.

    Args:
        scenario: the map.
        frame: of the path.
        lateral_acceleration: [m/s^2] from which the speed in bends follows.
        rules: usual speeds.
    """
    network = scenario.lanelet_network
    found = [(lane, edges) for lane in network.lanelets if (edges := _edges(lane, frame))]
    lanelets = [lane for lane, _ in found]
    shape = (len(found), len(frame.s))
    left = np.array([edges[0] for _, edges in found]).reshape(shape)
    right = np.array([edges[1] for _, edges in found]).reshape(shape)
    holds = _holds(left, right)
    left, right = _apart(left, right, holds)
    bend = np.sqrt(lateral_acceleration / np.maximum(np.abs(frame.kappa), STRAIGHT))
    return Strips(
        frame.spacing, left, right, _same(lanelets, holds), _beside(lanelets),
        _limits(scenario, lanelets, rules), bend, rules.speed_usual,
    )  # fmt: skip


def _edges(lane: Lanelet, frame: Frame) -> tuple[Array, Array] | None:
    """(n,) offsets of both edges at the frame's samples, None for a lanelet that is not along."""
    centre, left, right = _sampled(lane)
    s, d = frame.to_frenet(centre)
    step = np.gradient(centre, axis=0)
    turn = np.arctan2(step[:, 1], step[:, 0]) - frame.heading(s)
    turn = np.abs((turn + np.pi) % (2 * np.pi) - np.pi)
    along = (np.abs(d) < ASIDE) & (turn < TURN_MAX) & (np.gradient(s) > 0)
    begin, end = _longest_run(along)
    if end - begin < 2:
        return None
    low, high = s[begin] - SEAM, s[end - 1] + SEAM
    inside = (frame.s >= low) & (frame.s <= high)
    if not inside.any():
        return None
    edges = []
    for points in (left, right):
        edge_s, edge_d = frame.to_frenet(points[begin:end])
        edge_s = np.maximum.accumulate(edge_s)  # the inner edge of a bend may be wrinkled
        edges.append(np.where(inside, np.interp(frame.s, edge_s, edge_d), np.nan))
    return edges[0], edges[1]


def _sampled(lane: Lanelet) -> tuple[Array, Array, Array]:
    """(k, 2) points of the centre and of both edges at matching places."""
    centre = np.asarray(lane.center_vertices, float)
    way = np.append(0.0, np.cumsum(np.hypot(*np.diff(centre, axis=0).T)))
    count = max(math.ceil(way[-1] / SAMPLING), 2) + 1
    where = np.linspace(0.0, way[-1], count)

    def at(line: Array) -> Array:
        return np.column_stack([np.interp(where, way, line[:, i]) for i in (0, 1)])

    left, right = np.asarray(lane.left_vertices, float), np.asarray(lane.right_vertices, float)
    return at(centre), at(left), at(right)


def _longest_run(mask: Array) -> tuple[int, int]:
    """Begin and end (exclusive) of the longest run of True."""
    changes = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    runs = changes.reshape(-1, 2)
    if not len(runs):
        return 0, 0
    begin, end = runs[np.argmax(runs[:, 1] - runs[:, 0])].tolist()
    return begin, end


def _holds(left: Array, right: Array) -> Array:
    """(m,) part of its length on which a strip holds the path."""
    with np.errstate(invalid="ignore"):
        held: Array = ((left > 0) & (right < 0)).sum(axis=1)
    return held / np.maximum(np.isfinite(left).sum(axis=1), 1)


def _apart(left: Array, right: Array, holds: Array) -> tuple[Array, Array]:
    """Edges of the strips without what lies on the path's own lane.

    Where lanelets fork, merge or cross they lie on each other: who is on what they share is on the
    path's lane, and not on all others too.
    """
    if not len(left):
        return left, right
    with np.errstate(invalid="ignore"):
        rank = np.where((left > 0) & (right < 0), holds[:, None], -1.0)
        own, n = rank.argmax(axis=0), np.arange(left.shape[1])
        low, high = right[own, n], left[own, n]
        others = (rank.max(axis=0) >= 0) & (np.arange(len(left))[:, None] != own)
        to_left = left + right > low + high
        right = np.where(others & to_left, np.maximum(right, high), right)
        left = np.where(others & ~to_left, np.minimum(left, low), left)
    return left, right


def _same(lanelets: list[Lanelet], holds: Array) -> Array:
    """(m, m) whether one lanelet leads to the other along a lane, or both are one."""
    index = {lane.lanelet_id: i for i, lane in enumerate(lanelets)}
    follows = np.eye(len(lanelets), dtype=bool)
    for i, lane in enumerate(lanelets):
        onward = [index[j] for j in lane.successor or () if j in index]
        best = max(onward, key=lambda j: holds[j], default=None)
        if best is not None and holds[best] > ON_PATH:
            onward = [best]
        follows[i, onward] = True
    while True:  # closed under succession: each round doubles the number of lanelets passed
        further = follows @ follows
        if (further == follows).all():
            return follows | follows.T
        follows = further


def _beside(lanelets: list[Lanelet]) -> Array:
    """(m, m) neighbours of the same direction."""
    index = {lane.lanelet_id: i for i, lane in enumerate(lanelets)}
    beside = np.zeros((len(lanelets), len(lanelets)), bool)
    for i, lane in enumerate(lanelets):
        for other, same in (
            (lane.adj_left, lane.adj_left_same_direction),
            (lane.adj_right, lane.adj_right_same_direction),
        ):
            if same and other in index:
                beside[i, index[other]] = beside[index[other], i] = True
    return beside


def _limits(scenario: Scenario, lanelets: list[Lanelet], rules: RulesConfig) -> Array:
    """(m,) speed [m/s] by signs, else the usual one of the kind of road."""
    signs = TrafficSignInterpreter(scenario.scenario_id.country_id, scenario.lanelet_network)
    speeds = []
    for lane in lanelets:
        posted = signs.speed_limit(frozenset([lane.lanelet_id]))
        usual = rules.speed_interstate if lane.lanelet_type & FAST else rules.speed_usual
        speeds.append(usual if posted is None else float(posted))
    return np.array(speeds)
