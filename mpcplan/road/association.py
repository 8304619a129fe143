"""To which lane the ego vehicle belongs, and when its routes are to begin there.

The routes lead from the lane in which they began, and their reference lies on the later lane of
every lane change. A vehicle that has come into yet another lane is associated anew with it where

    |d| <= association.offset  and  |mu| <= association.heading     at that lane's centre line
    for association.settled seconds, in this lane and its successors,
    and fewer than association.overlaps centre lines overlap the reference ahead

(:mod:`mpcplan.road.overlap`). Who stays in the lane of the routes' beginning, and in those of the
reference, is associated rightly. Time is counted in time steps, so the same drive gives the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from commonroad.scenario.lanelet import LaneletNetwork

from mpcplan.config import AssociationConfig
from mpcplan.road.limits import NOT_FOR_CARS
from mpcplan.road.overlap import CentreLines, reachable
from mpcplan.road.reference import reference_lanes
from mpcplan.road.road import Road
from mpcplan.road.route import beside
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import FORD_ESCORT as CAR

ROUNDING = 1e-9  # s


@dataclass(frozen=True)
class Place:
    """Where the ego vehicle is in a lanelet: offset [m] of its centre and deviation [rad]."""

    lanelet: int
    offset: float
    turn: float


@dataclass(frozen=True)
class Judgement:
    """Whether the routes are to begin in another lane.

    Attributes:
        lanelet: in which the ego vehicle is; None: in none, or between two.
        due: the routes are to be built anew.
        reason: why, or why not, in words.
        overlaps: centre lines that overlap the reference ahead; None: it was not asked.
    """

    lanelet: int | None
    due: bool
    reason: str
    overlaps: int | None = None

    def as_dict(self) -> dict[str, Any]:
        """For the trace."""
        return {
            "lanelet": self.lanelet,
            "reassociated": self.due,
            "overlaps": self.overlaps,
            "reason": self.reason,
        }


class Association:
    """Follows the ego vehicle from lane to lane; see the module."""

    def __init__(self, network: LaneletNetwork, config: AssociationConfig, dt: float) -> None:
        self._network, self._config, self._dt = network, config, dt
        self._lines = CentreLines(network)
        self._begin: int | None = None  # the lanelet in which the routes begin
        self._onward: tuple[int, ...] = ()  # lanelets of their references, where they are new
        self._other: tuple[int, int] | None = None  # another lane, and since when it is there

    def begin_in(self, lanelet: int | None, roads: Sequence[Road] = ()) -> None:
        """The routes begin, or are taken to begin, in a lanelet; with the roads built from it."""
        self._begin, self._other = lanelet, None
        lanes = {i for road in roads for i in reference_lanes(self._network, road.route)}
        self._onward = tuple(sorted(lanes))

    def judge(self, step: int, state: Array, road: Road) -> Judgement:
        """Whether the routes are to be built anew.

        Args:
            step: present time step.
            state: (5,) own state at the rear axle.
            road: that is driven on.
        """
        if self._begin is None:
            self.begin_in(road.route.lanelets[0])
        lanes = reference_lanes(self._network, road.route)
        own = reachable(self._network, lanes[-1], road.frame.length) | set(lanes)
        place = self._place(state, own)
        if not self._settles(place):
            self._other = None
            return Judgement(None, False, self._between(place))
        assert place is not None
        if place.lanelet in own:
            self._other = None
            return Judgement(place.lanelet, False, "in the reference's lane")
        if self._goes_on(place.lanelet, lanes):
            self._begin, self._other = place.lanelet, None
            return Judgement(place.lanelet, False, "in the lane in which the routes begin")
        return self._elsewhere(step, state, road, place, lanes)

    def _place(self, state: Array, own: set[int]) -> Place | None:
        """The lanelet that holds the body's centre and is best aligned with it; of several in
        which it settles one of its own, so that overlapping lanes make no change."""
        psi = float(state[State.PSI])
        ahead = CAR.rear_to_centre * np.array([np.cos(psi), np.sin(psi)])
        centre = state[[State.X, State.Y]] + ahead
        held = self._network.find_lanelet_by_position([centre])[0]
        lanes = [self._network.find_lanelet_by_id(i) for i in sorted(held)]
        lanes = [lane for lane in lanes if not lane.lanelet_type & NOT_FOR_CARS]
        places = [_at(lane.lanelet_id, lane.center_vertices, centre, psi) for lane in lanes]
        return min(places, key=lambda p: self._mismatch(p, own), default=None)

    def _mismatch(self, place: Place, own: set[int]) -> tuple[bool, bool, float]:
        far = place.offset / self._config.offset + place.turn / self._config.heading
        mine = place.lanelet in own or place.lanelet == self._begin
        return not self._settles(place), not mine, round(far, 6)

    def _settles(self, place: Place | None) -> bool:
        config = self._config
        return place is not None and place.offset <= config.offset and place.turn <= config.heading

    def _between(self, place: Place | None) -> str:
        if place is None:
            return "in no lane"
        return (
            f"settled in no lane: {place.offset:.1f} m and {place.turn:.2f} rad from the centre of "
            f"lanelet {place.lanelet}"
        )

    def _goes_on(self, lanelet: int, lanes: list[int]) -> bool:
        """Whether a lanelet is where the routes begin, or that lane's way on: beside the reference,
        or one of the new roads, where the last plan still stays on its own."""
        if self._begin is None or lanelet == self._begin:
            return True
        onward = reachable(self._network, self._begin, self._config.look)
        return lanelet in onward and lanelet in beside(self._network, [*lanes, *self._onward])

    def _elsewhere(
        self, step: int, state: Array, road: Road, place: Place, lanes: list[int]
    ) -> Judgement:
        """The ego vehicle is in another lane: for long enough, and with nothing that overlaps?"""
        lanelet = place.lanelet
        since = step
        if self._other is not None:
            before, began = self._other
            if lanelet in reachable(self._network, before, self._config.look):
                since = began
        self._other = lanelet, since
        seconds = (step - since) * self._dt
        told = f"in another lane, lanelet {lanelet}, for {seconds:.1f} s"
        if seconds < self._config.settled - ROUNDING:
            return Judgement(lanelet, False, f"{told} of {self._config.settled:.1f} s")
        s = float(road.frame.to_frenet(state[[State.X, State.Y]])[0])
        found = self._lines.overlap(road.frame, s, lanes, self._config)
        if found.count >= self._config.overlaps:
            where = f"complex intersection within {found.ahead:.0f} m: {found}"
            return Judgement(lanelet, False, where, found.count)
        return Judgement(lanelet, True, told, found.count)


def _at(lanelet: int, centre: Array, point: Array, psi: float) -> Place:
    """A point [m] and heading [rad] against a lanelet's centre line (n, 2)."""
    line = shapely.linestrings(centre)
    along = float(shapely.line_locate_point(line, shapely.points(point)))
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(centre, axis=0).T))])
    piece = min(max(int(np.searchsorted(lengths, along)) - 1, 0), len(centre) - 2)
    dx, dy = centre[piece + 1] - centre[piece]
    turn = (psi - np.arctan2(dy, dx) + np.pi) % (2 * np.pi) - np.pi
    return Place(lanelet, float(shapely.distance(line, shapely.points(point))), abs(float(turn)))
