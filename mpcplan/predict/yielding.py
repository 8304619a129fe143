"""Who waits before a conflict, and until when.

From a first prediction in which nobody yields follow the times at which everybody enters and leaves
each conflict (:mod:`mpcplan.predict.right_of_way`). Who has to yield and would be there together
with another one waits before the conflict until that one has left, and the next one, if it would
meet that one instead. Who cannot stop any more goes on.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from mpcplan.predict.hypotheses import Hypotheses
from mpcplan.predict.paths import Paths
from mpcplan.predict.right_of_way import Conflict, Rule
from mpcplan.trajectory import Array

ZONE = 3.0  # m, of a lane before and after a meeting that cannot be used together
LINE = 1.0  # m, kept to a lane's begin, or to the zone, when waiting
LOOK = 80.0  # m, within which conflicts matter
STANDS = 0.3  # m/s, slower stands: if that is
CLOSE = 20.0  # m, before a conflict, for somebody who comes there
SPARE = 0.5  # s, between one leaving and the next one entering
KEPT = 1.0  # m, between who merges and who stood, and then follows it
LATE = 100.0  # s, later than any prediction


@dataclass(frozen=True, eq=False)
class Traffic:
    """The vehicles in the first prediction, by hypothesis (h,).

    Attributes:
        found: the hypotheses.
        foes: rows to which others may have to yield.
        s: (k + 1, h) arc lengths of the fronts [m].
        step: between these [s].
        speed: now [m/s].
        length: of the vehicle [m].
        deceleration: that they count on [m/s^2].
        acceleration: of a free driver [m/s^2].
    """

    found: Hypotheses
    foes: Array
    s: Array
    step: float
    speed: Array
    length: Array
    deceleration: Array
    acceleration: Array

    def stands_before(self, rows: Array, at: Array) -> Array:
        """(n,) whether fronts stand close before arc lengths (n,) [m]."""
        left = at - self.found.s[rows]
        return (self.speed[rows] < STANDS) & (left > 0) & (left < CLOSE)

    def times(self, rows: Array, at: Array) -> Array:
        """(n,) when [s] fronts come to arc lengths (n,) [m]; LATE: not within the prediction."""
        k = (self.s[:, rows] < at).sum(axis=0)
        return np.where(k < len(self.s), k * self.step, LATE)


class _Entry(IntEnum):
    """Columns of the conflicts on a way: where one waits, where it lies [m], the other lane and
    the arc length there [m], whether who comes first goes first, whether both go on as one."""

    LINE = 0
    AT = 1
    OTHER = 2
    THERE = 3
    FIRST_COME = 4
    MERGES = 5


@dataclass(frozen=True, eq=False)
class _Meetings:
    """Who meets whom, in the order of ``row`` and ``line`` (all (n,)).

    Attributes:
        row: hypothesis that has to yield.
        line: arc length [m] before which it waits.
        own: times [s] at which it enters and leaves the conflict, (n, 2).
        foe: times [s] at which the other one does, (n, 2).
        way: from the line to having left the conflict [m].
    """

    row: Array
    line: Array
    own: Array
    foe: Array
    way: Array


class Yielding:
    """The conflicts on every way of a map."""

    def __init__(self, paths: Paths, conflicts: Mapping[int, Sequence[Conflict]]) -> None:
        self._paths = paths
        tables = []
        for path in paths.paths:
            entries = [
                _entry(start, conflict)
                for start, lane in zip(path.starts, path.lanes, strict=True)
                for conflict in conflicts.get(lane, ())
                if conflict.rule is not Rule.GO
            ]
            tables.append(np.array(sorted(entries), float).reshape(-1, len(_Entry)))
        self._count = np.array([len(table) for table in tables])
        self._begin = np.cumsum(self._count) - self._count
        self._entries = np.vstack(tables)

    def stops(self, traffic: Traffic, rows: Array) -> tuple[Array, Array]:
        """Arc lengths [m] at which hypotheses wait (infinity: nowhere), and until when [s].

        Only the hypotheses ``rows`` are asked to yield.
        """
        stop = np.full(len(traffic.found.path), np.inf)
        release = np.zeros(len(stop))
        met = self._meetings(traffic, rows)
        together = (met.foe[:, 0] - SPARE < met.own[:, 1]) & (met.foe[:, 1] + SPARE > met.own[:, 0])
        for row in np.unique(met.row[together]):
            lines = met.line[together & (met.row == row)]
            here = (met.row == row) & (met.line == lines.min())
            stop[row] = lines.min()
            release[row] = _wait(met, np.flatnonzero(here), float(traffic.acceleration[row]))
        return stop, release

    def _meetings(self, traffic: Traffic, rows: Array) -> _Meetings:
        """All meetings with others for which one may have to wait."""
        found = traffic.found
        row, entry = self._ahead(traffic, rows)
        foes = traffic.foes
        arcs = self._paths.starts[found.path[foes][:, None], entry[:, _Entry.OTHER].astype(int)]
        other = found.vehicle[foes][:, None] != found.vehicle[row]
        j, i = np.nonzero(np.isfinite(arcs) & other)
        foe, there = foes[j], arcs[j, i] + entry[i, _Entry.THERE]
        length = traffic.length
        begin = traffic.times(foe, there - ZONE)
        end = traffic.times(foe, there + ZONE + length[foe])
        row, entry = row[i], entry[i]
        at = entry[:, _Entry.AT]
        own = traffic.times(row, at - ZONE)
        waits = traffic.stands_before(row, at)
        matters = (begin < LATE) & (end > 0) & (own < LATE)
        matters &= (entry[:, _Entry.FIRST_COME] == 0) | (begin < own) | waits
        own = np.where(waits, 0.0, own)
        behind = there - (at - traffic.found.s[row]) + length[foe] + KEPT
        merges = waits & (entry[:, _Entry.MERGES] > 0)
        end = np.where(merges, np.minimum(end, traffic.times(foe, behind)), end)
        kept = np.flatnonzero(matters)
        row, at, line = row[kept], at[kept], entry[kept, _Entry.LINE]
        left = at + ZONE + length[row]
        return _Meetings(
            row=row,
            line=line,
            own=np.column_stack([own[kept], traffic.times(row, left)]),
            foe=np.column_stack([begin[kept], end[kept]]),
            way=left - line,
        )

    def _ahead(self, traffic: Traffic, rows: Array) -> tuple[Array, Array]:
        """Rows and entries (n, 6) of conflicts that hypotheses come to and can still stop for."""
        path = traffic.found.path[rows]
        count = self._count[path]
        row = np.repeat(rows, count)
        nth = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
        entry = self._entries[np.repeat(self._begin[path], count) + nth]
        waits = traffic.stands_before(row, entry[:, _Entry.AT])
        s = traffic.found.s[row]
        entry[waits, _Entry.LINE] = s[waits]
        way = entry[:, _Entry.LINE] - s
        braking = traffic.speed[row] ** 2 / (2 * traffic.deceleration[row])
        kept = (way < LOOK) & (way >= np.where(braking > LINE, braking, -LINE))
        return row[kept], entry[kept]


def _entry(start: float, conflict: Conflict) -> tuple[float, ...]:
    """A conflict on a lane that begins at an arc length [m]; columns :class:`_Entry`.

    One waits before the lane, or, where no rule is known, before the conflict.
    """
    at = start + conflict.at
    first_come = conflict.rule is Rule.FIRST_COME
    line = at - ZONE - LINE if first_come else start - LINE
    other = float(conflict.other)
    return line, at, other, conflict.there, float(first_come), float(conflict.merges)


def _wait(met: _Meetings, here: Array, acceleration: float) -> float:
    """The time [s] until which a hypothesis waits at a line; ``here`` are the meetings after it."""
    until = 0.0
    waits = False
    for i in here[np.argsort(met.foe[here, 0], kind="stable")]:
        begin, end = met.own[i]
        if waits:
            begin, end = until, until + float(np.sqrt(2 * met.way[i] / acceleration))
        if met.foe[i, 0] - SPARE < end and met.foe[i, 1] + SPARE > begin:
            until, waits = max(float(met.foe[i, 1]), until), True
    return until
