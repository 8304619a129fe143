"""The ways ahead of every lane: sampled centre lines with speed profiles, one per branch.

All ways of all lanes lie in flat arrays, sampled at one spacing, so that many vehicles on many
ways are looked up at once. Arc length 0 is the beginning of the way's first lane; BEHIND metres
before it and a straight continuation past its end belong to it.
"""

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mpcplan.predict.kinds import DECELERATIONS
from mpcplan.predict.lanes import Lane, Lanes
from mpcplan.road.reference import drop_repeated
from mpcplan.trajectory import Array

SPACING = 1.0  # m, between samples
BEHIND = 20.0  # m, longer than any vehicle
AHEAD = 250.0  # m, past the end of the first lane
BRANCHES = 6  # ways per lane, the most likely ones
TURN_SCALE = 0.6  # rad, a branch that turns by this much more is less likely by e
SMALL_TURN = math.radians(15.0)  # turns by less do not slow SUMO's cars
APART = 8.0  # m, after a fork: its branches do not overlap any more
FREE = 0  # profile without any limit:
FAST = 200.0  # m/s, faster than any vehicle


@dataclass(frozen=True, eq=False)
class Path:
    """One way ahead.

    Attributes:
        lanes: indices of its lanes.
        starts: arc length [m] at which each of them begins.
        weight: probability among the ways of the first lane.
    """

    lanes: tuple[int, ...]
    starts: tuple[float, ...]
    weight: float

    def shared(self, other: "Path") -> float:
        """Arc length [m] up to which two ways with the same first lane are the same."""
        for own, theirs, start in zip(self.lanes, other.lanes, self.starts, strict=False):
            if own != theirs:
                return start
        return math.inf


class Paths:
    """All ways ahead of all lanes of a map.

    Attributes:
        paths: the ways, those of one lane in a row, the most likely first.
        of_lane: for each lane the indices of its ways.
        starts: (p, m) arc length [m] at which each lane begins on each way; NaN where it is not
            on it.
        share: (m,) probability of each lane at the fork before it.
    """

    def __init__(self, lanes: Lanes, lateral_acceleration: float) -> None:
        """For the lanes of a map, in whose turns all drive at a lateral acceleration [m/s^2]."""
        self._lanes = lanes.lanes
        self.paths: list[Path] = []
        self.of_lane: list[range] = []
        for i in range(len(self._lanes)):
            found = self._branches(i)
            self.of_lane.append(range(len(self.paths), len(self.paths) + len(found)))
            self.paths += found
        self.starts = np.full((len(self.paths), len(self._lanes)), np.nan, np.float32)
        for p, path in enumerate(self.paths):
            self.starts[p, path.lanes] = path.starts
        self.share = np.zeros(len(self._lanes))
        for i, lane in enumerate(self._lanes):
            for follower, share in self.shares(i):
                self.share[follower] = max(self.share[follower], share)
            self.share[i] = self.share[i] if lane.predecessors else 1.0
        pieces = [self._line(path) for path in self.paths]
        sizes = np.array([len(piece) for piece in pieces])
        self._base = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        self._last = sizes - 2
        self._points = np.vstack(pieces)
        speeds = [(_turn_speed(lane, lateral_acceleration), lane.limit) for lane in self._lanes]
        caps = [
            self._caps(path, size, speeds) for path, size in zip(self.paths, sizes, strict=True)
        ]
        self._caps_flat, self._width = np.hstack(caps).ravel(), int(sizes.sum())

    def _branches(self, first: int) -> list[Path]:
        """The most likely ways ahead of a lane: best first."""
        length = self._lanes[first].length
        heap: list[tuple[float, tuple[int, ...], tuple[float, ...], float]] = [
            (-1.0, (first,), (0.0,), length)
        ]
        found: list[Path] = []
        while heap and len(found) < BRANCHES:
            minus, lanes, starts, end = heapq.heappop(heap)
            # nobody is predicted to drive round in circles
            shares = [(i, share) for i, share in self.shares(lanes[-1]) if i not in lanes]
            if end >= length + AHEAD or not shares:
                found.append(Path(lanes, starts, -minus))
                continue
            for lane, share in shares:
                after = end + self._lanes[lane].length
                heapq.heappush(heap, (minus * share, (*lanes, lane), (*starts, end), after))
        total = sum(path.weight for path in found)
        return [Path(path.lanes, path.starts, path.weight / total) for path in found]

    def shares(self, lane: int) -> list[tuple[int, float]]:
        """The lanes that follow a lane with their probabilities: the straighter, the likelier."""
        followers = self._lanes[lane].successors
        raw = [math.exp(-abs(self._lanes[i].turn) / TURN_SCALE) for i in followers]
        return [(i, value / sum(raw)) for i, value in zip(followers, raw, strict=True)]

    def _line(self, path: Path) -> Array:
        """(n, 2) samples of a way."""
        line = np.vstack([self._lanes[i].points for i in path.lanes])
        behind, lane, known = 0.0, self._lanes[path.lanes[0]], set(path.lanes)
        while behind < BEHIND:
            before = [i for i in lane.predecessors if i not in known]
            if not before:
                break
            best = min(before, key=lambda i: (abs(self._lanes[i].turn), i))
            lane = self._lanes[best]
            known.add(best)
            line = np.vstack([lane.points, line])
            behind += lane.length
        line = drop_repeated(line)
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))]) - behind
        count = max(math.ceil((along[-1] + BEHIND) / SPACING) + 1, 3)
        s = SPACING * np.arange(count) - BEHIND
        points = np.column_stack([np.interp(s, along, line[:, axis]) for axis in range(2)])
        for where, a, b in ((s < along[0], 0, 1), (s > along[-1], -1, -2)):
            away = (line[a] - line[b]) / np.hypot(*(line[a] - line[b]))
            points[where] = line[a] + np.abs(s[where, None] - along[a]) * away
        return points

    def _caps(self, path: Path, size: int, speeds: list[tuple[float, float]]) -> Array:
        """(profiles, n) largest speed [m/s] at the samples from which the limits ahead can be met.

        Rows: :data:`FREE`, then for each of DECELERATIONS that with the curves' limits and that
        with the posted ones too.
        """
        s = SPACING * np.arange(size) - BEHIND
        lane = np.clip(np.searchsorted(path.starts, s, side="right") - 1, 0, None)
        curve, posted = np.array([speeds[i] for i in path.lanes]).T
        rows = [np.full(size, FAST)]
        for b in DECELERATIONS:
            for limit in (curve[lane], np.minimum(curve, posted)[lane]):
                reach = limit**2 + 2 * b * s
                met = np.minimum.accumulate(reach[::-1])[::-1] - 2 * b * s
                rows.append(np.sqrt(np.clip(met, 0.0, FAST**2)))
        return np.array(rows, np.float32)

    def branches(self, lane: int, s: float, reach: float) -> list[tuple[int, float]]:
        """The ways that differ within ``reach`` [m] of s on a lane: (way, probability)."""
        ways = self.of_lane[lane]
        if len(ways) == 1:
            return [(ways[0], 1.0)]
        found: list[tuple[int, float]] = []
        for p in ways:
            path = self.paths[p]
            for k, (known, weight) in enumerate(found):
                if path.shared(self.paths[known]) >= s + reach:
                    found[k] = (known, weight + path.weight)
                    break
            else:
                found.append((p, path.weight))
        return found

    def parting(self, leader: int, follower: int, lane: int) -> float:
        """Arc length [m] on a leader's way at which it leaves a follower's; infinity: never.

        ``lane`` is a lane of the follower's way on which the leader is at present, at least in
        part. Where it is not on the leader's own way, both part soon, or they meet again.
        """
        one, other = self.paths[leader], self.paths[follower]
        if leader == follower or lane not in one.lanes:
            again = leader == follower or not {*one.lanes}.isdisjoint(other.lanes)
            return math.inf if again else APART
        i, j = one.lanes.index(lane), other.lanes.index(lane)
        for own, theirs, start in zip(one.lanes[i:], other.lanes[j:], one.starts[i:], strict=False):
            if own != theirs:
                return start
        return math.inf

    def at(self, path: Array, s: Array) -> Array:
        """(..., 2) points [m] of ways at arc lengths [m]; straight on beyond the ends."""
        u = (s + BEHIND) / SPACING
        i = np.minimum(np.maximum(u.astype(int), 0), self._last[path])
        share = (u - i)[..., None]
        at = self._base[path] + i
        return (1 - share) * self._points[at] + share * self._points[at + 1]

    def limits(self, path: Array, profile: Array) -> Callable[[Array], Array]:
        """What gives the speeds [m/s] by profiles (n,) at arc lengths (n,) >= 0 [m] of ways (n,).

        This is the inner loop of the prediction.
        """
        begin = profile * self._width + self._base[path]
        last = self._last[path]

        def at(s: Array) -> Array:
            u = np.minimum((s + BEHIND) * (1 / SPACING), last)
            i = u.astype(int)
            cap = self._caps_flat[begin + i]
            return cap + (u - i) * (self._caps_flat[begin + i + 1] - cap)

        return at


def profiles(deceleration: Array, signs: bool) -> Array:
    """(n,) profiles for decelerations [m/s^2], with or without the posted speeds."""
    nearest = np.abs(deceleration[:, None] - np.array(DECELERATIONS)).argmin(axis=1)
    rows: Array = 1 + 2 * nearest + signs
    return rows


def _turn_speed(lane: Lane, lateral_acceleration: float) -> float:
    """Speed [m/s] at which SUMO's cars drive through a lane; only turns in intersections slow them.

    The radius is that of SUMO's netconvert: the length over the turn beyond 15 degrees.
    """
    bend = abs(lane.turn) - SMALL_TURN
    if not lane.crossing or bend <= 0:
        return math.inf
    return math.sqrt(lateral_acceleration * lane.length / bend)
