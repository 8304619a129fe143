"""Who meets whom where lanes conflict."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mpcplan.sumo.ways import Way

LOOK = 5.0  # s, ahead at the present speed
NEAR = 15.0  # m, looked ahead at least
SLOWEST = 3.0  # m/s, at which the slow are expected to move on


class Mover(NamedTuple):
    """A vehicle as its neighbours see it.

    Attributes:
        name: SUMO's id.
        way: its lanes.
        position: of its front on its lane [m].
        speed: [m/s].
        length: [m].
        steered: whether it can be told to yield; the ego vehicle cannot.
    """

    name: str
    way: Way
    position: float
    speed: float
    length: float
    steered: bool

    @property
    def look(self) -> float:
        """How far [m] it looks ahead."""
        return max(NEAR, LOOK * self.speed)


class Entry(NamedTuple):
    """A vehicle before or in a conflict: its way [m] to where it may wait, to where the conflict
    begins, to where it ends, and until all of it has left; when [s] it will be there, and have
    left."""

    mover: Mover
    hold: float
    begin: float
    end: float
    left: float
    arrival: float
    leaving: float


class Meeting(NamedTuple):
    """Two vehicles that are to use a conflict; ``together``: both lanes lead the same way."""

    one: Entry
    other: Entry
    together: bool


def find_meetings(movers: Sequence[Mover]) -> list[Meeting]:
    """All meetings of vehicles that look far enough ahead, but for those that drive in line, which
    SUMO knows of."""
    sides = _entries(movers)
    found = []
    for zone, together in sorted(sides):
        if zone % 2 == 0:
            found += [
                Meeting(one, other, together)
                for one in sides[zone, together]
                for other in sides.get((zone + 1, together), ())
                if not _in_line(one.mover.way, other.mover.way)
            ]
    return found


def _entries(movers: Sequence[Mover]) -> dict[tuple[int, bool], list[Entry]]:
    """The vehicles in or before each conflict that is used from both sides, by side."""
    ways = [mover.way for mover in movers]
    counts = [len(way.zones) for way in ways]
    if not any(counts):
        return {}
    of = np.repeat(np.arange(len(movers)), counts)
    position, look, length = (
        np.array(values)[of]
        for values in (
            [m.position for m in movers], [m.look for m in movers], [m.length for m in movers]
        )
    )  # fmt: skip
    zones = np.concatenate([way.zones for way in ways])
    begins = np.concatenate([way.begins for way in ways]) - position
    ends = np.concatenate([way.ends for way in ways]) - position
    holds = np.concatenate([way.holds for way in ways]) - position
    near = np.flatnonzero((begins < look) & (ends + length > 0))
    sides = 2 * (zones.max(initial=0) // 2 + 1)
    used = np.bincount(zones[near], minlength=sides).reshape(-1, 2) > 0
    both = np.repeat(used.all(axis=1), 2)
    together = np.concatenate([way.together for way in ways])
    found: dict[tuple[int, bool], list[Entry]] = {}
    for i in near[both[zones[near]]]:
        mover = movers[of[i]]
        begin, end, speed = float(begins[i]), float(ends[i]), max(mover.speed, SLOWEST)
        left, hold = end + mover.length, float(holds[i])
        entry = Entry(mover, hold, begin, end, left, begin / speed, left / speed)
        found.setdefault((int(zones[i]), bool(together[i])), []).append(entry)
    return found


def _in_line(one: Way, other: Way) -> bool:
    """Whether one vehicle drives behind the other, or is the other."""
    return one.lane in other.ids or other.lane in one.ids
