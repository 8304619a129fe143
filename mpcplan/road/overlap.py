"""Where centre lines of other lanes overlap a reference path: the measure of complex intersections.

To which lane a vehicle belongs is read from its offset and heading to lane centres. Where centres
of several lanes lie on each other, that answer flickers from one cycle to the next. With the
reference path p(s), the ego vehicle at s_0, and the centre lines c_j of the lanes j that are not
ours, the overlap within the look-ahead distance L is

    S_j = {s in [s_0, s_0 + L] : dist(p(s), c_j) <= r},    n = number of j with S_j not empty,

and the intersection is complex where n reaches a threshold. Ours are the lanes of the reference,
those beside them of the same direction, and the successors of both: a road of several lanes, its
forks and its lane ends are not complex; a crossing is, and so is a lane that comes in from another
road. Distances alone count, so n is the same however the map is turned or moved.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely
from commonroad.scenario.lanelet import LaneletNetwork

from mpcplan.config import AssociationConfig
from mpcplan.road.frame import Frame
from mpcplan.road.limits import NOT_FOR_CARS
from mpcplan.road.route import beside

SAMPLING = 1.0  # m, between the points of the reference that are compared with centre lines


@dataclass(frozen=True)
class Overlap:
    """Other lanes' centre lines on the reference ahead.

    Attributes:
        count: centre lines that overlap it (n).
        share: part of the way looked at on which at least one does.
        ahead: distance [m] to the first overlap; inf where there is none.
    """

    count: int
    share: float
    ahead: float

    def __str__(self) -> str:
        lines = (
            "1 centre line overlaps" if self.count == 1 else f"{self.count} centre lines overlap"
        )
        return f"{lines} on {self.share:.0%} of the way looked at"


class CentreLines:
    """The centre lines of the lanes that cars may use, found by place."""

    def __init__(self, network: LaneletNetwork) -> None:
        lanes = [lane for lane in network.lanelets if not lane.lanelet_type & NOT_FOR_CARS]
        self._network = network
        self._ids = np.array([lane.lanelet_id for lane in lanes], dtype=np.int64)
        self._lines = np.array([shapely.linestrings(lane.center_vertices) for lane in lanes])
        self._tree = shapely.STRtree(self._lines)

    def overlap(
        self, frame: Frame, s: float, lanes: Iterable[int], config: AssociationConfig
    ) -> Overlap:
        """Other lanes' centre lines on a reference path ahead.

        Args:
            frame: the reference path.
            s: arc length [m] of the ego vehicle.
            lanes: lanelets of the reference, in their order.
            config: how far is looked, and how near an overlap is.
        """
        way = np.arange(s, min(s + config.look, frame.length), SAMPLING)
        if not len(way):
            return Overlap(0, 0.0, float("inf"))
        points = shapely.points(frame.to_cartesian(way, np.zeros(len(way))))
        near = np.unique(self._tree.query(points, predicate="dwithin", distance=config.near)[1])
        others = near[~np.isin(self._ids[near], sorted(self._ours(lanes, config.look)))]
        apart = shapely.distance(self._lines[others, None], points[None, :])
        overlaps = (apart <= config.near).any(axis=0)
        ahead = float(way[overlaps.argmax()] - s) if overlaps.any() else float("inf")
        return Overlap(len(others), float(overlaps.mean()), ahead)

    def _ours(self, lanes: Iterable[int], look: float) -> set[int]:
        """Lanelets of the reference, beside it, and those that follow."""
        lanes = list(lanes)
        onward = reachable(self._network, lanes[-1], look)
        ours = beside(self._network, [*lanes, *onward])
        return ours | {
            after for i in ours for after in self._network.find_lanelet_by_id(i).successor
        }


def reachable(network: LaneletNetwork, lanelet: int, reach: float) -> set[int]:
    """A lanelet and its successors that begin within a distance [m] of its end."""
    found: dict[int, float] = {lanelet: 0.0}
    open_ = [lanelet]
    while open_:
        here = open_.pop(0)
        for after in network.find_lanelet_by_id(here).successor:
            begins = found[here]
            ends = begins + float(network.find_lanelet_by_id(after).distance[-1])
            if begins <= reach and ends < found.get(after, float("inf")):
                found[after] = ends
                open_.append(after)
    return set(found)
