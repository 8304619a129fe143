"""Who waits before a conflict, and until when.

From a first prediction in which nobody yields follow the times at which everybody enters and leaves
each conflict (:mod:`mpcplan.predict.right_of_way`). Who has to yield and would be there together
with another one waits before the conflict until that one has left, and the next one, if it would
meet that one instead. Who could only stop by braking hard goes on.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mpcplan.predict.hypotheses import Hypotheses
from mpcplan.predict.paths import Paths
from mpcplan.predict.right_of_way import Conflict, Rule
from mpcplan.trajectory import Array

ZONE = 3.0  # m, of a lane before and after a meeting that cannot be used together
LINE = 1.0  # m, kept to a lane's begin, or to the zone, when waiting
LOOK = 80.0  # m, within which conflicts matter
FIRM = 0.5  # of the usual deceleration: who needs more to stop goes on
SPARE = 0.5  # s, between one leaving and the next one entering
LATE = 100.0  # s, later than any prediction


@dataclass(frozen=True, eq=False)
class Road:
    """What is known of the vehicles in the first prediction, by hypothesis (h,).

    Attributes:
        found: the hypotheses.
        main: rows of the vehicles' most likely hypotheses.
        s: (k + 1, h) arc lengths of the fronts [m].
        step: between these [s].
        speed: now [m/s].
        length: of the vehicle [m].
        deceleration: the usual one [m/s^2].
        acceleration: the usual one [m/s^2].
    """

    found: Hypotheses
    main: Array
    s: Array
    step: float
    speed: Array
    length: Array
    deceleration: Array
    acceleration: Array

    def time(self, row: int, at: float) -> float:
        """When [s] a front comes to an arc length [m]; LATE: not within the prediction."""
        k = int(np.searchsorted(self.s[:, row], at))
        return k * self.step if k < len(self.s) else LATE


@dataclass(frozen=True)
class _Window:
    """When another one is in a conflict [s], and the conflict's place on the own way [m]."""

    begin: float
    end: float
    at: float
    rule: Rule


class Yielding:
    """The conflicts on every way of a map."""

    def __init__(self, paths: Paths, conflicts: Mapping[int, Sequence[Conflict]]) -> None:
        self._paths = paths
        self._conflicts = {
            lane: kept
            for lane, some in conflicts.items()
            if (kept := [conflict for conflict in some if conflict.rule is not Rule.GO])
        }
        self._entries = [
            [
                (start, lane)
                for start, lane in zip(path.starts, path.lanes, strict=True)
                if lane in self._conflicts
            ]
            for path in paths.paths
        ]

    def stops(self, road: Road, rows: Array) -> tuple[Array, Array]:
        """Arc lengths [m] at which hypotheses wait (infinity: nowhere), and until when [s].

        Only the hypotheses ``rows`` are asked to yield.
        """
        stop = np.full(len(road.found.path), np.inf)
        release = np.zeros(len(stop))
        for row in rows:
            found = self._stop(road, int(row))
            if found is not None:
                stop[row], release[row] = found
        return stop, release

    def _stop(self, road: Road, row: int) -> tuple[float, float] | None:
        """Where and until when one hypothesis waits."""
        front = float(road.found.s[row])
        braking = float(road.speed[row]) ** 2 / (2 * FIRM * float(road.deceleration[row]))
        for start, lane in self._entries[road.found.path[row]]:
            if start > front + LOOK:
                break
            windows = sorted(
                self._windows(road, row, start, lane), key=lambda w: (w.begin, w.end, w.at)
            )
            for line in sorted({_line(window, start) for window in windows}):
                here = [window for window in windows if _line(window, start) == line]
                if line - front < max(braking, -LINE):
                    continue
                until = self._wait(road, row, line, here)
                if until is not None:
                    return line, until
        return None

    def _windows(self, road: Road, row: int, start: float, lane: int) -> Iterator[_Window]:
        """When others are in the conflicts on a lane of a way."""
        ways = road.found.path[road.main]
        for conflict in self._conflicts[lane]:
            arcs = self._paths.starts[ways, conflict.other]
            for i in np.flatnonzero(np.isfinite(arcs)):
                other = int(road.main[i])
                if road.found.vehicle[other] == road.found.vehicle[row]:
                    continue
                there = float(arcs[i]) + conflict.there
                length = float(road.length[other])
                if float(road.found.s[other]) - length > there + ZONE:
                    continue
                begin = road.time(other, there - ZONE)
                if begin < LATE:
                    end = road.time(other, there + ZONE + length)
                    yield _Window(begin, end, start + conflict.at, conflict.rule)

    def _wait(self, road: Road, row: int, line: float, windows: list[_Window]) -> float | None:
        """The time [s] until which a hypothesis waits; None: it need not."""
        length, until = float(road.length[row]), None
        if road.time(row, line) >= LATE:
            return None
        for window in windows:
            begin = road.time(row, window.at - ZONE)
            end = road.time(row, window.at + ZONE + length)
            if window.rule is Rule.FIRST_COME and begin <= window.begin:
                continue
            if until is not None:
                way = window.at + ZONE + length - line
                begin = until
                end = until + float(np.sqrt(2 * way / road.acceleration[row]))
            if window.begin - SPARE < end and window.end + SPARE > begin:
                until = max(window.end, until or 0.0)
        return until


def _line(window: _Window, start: float) -> float:
    """Where [m] one waits: before the lane, or, where no rule is known, before the conflict."""
    if window.rule is Rule.YIELD:
        return start - LINE
    return window.at - ZONE - LINE
