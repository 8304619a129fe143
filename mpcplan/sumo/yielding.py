"""Vehicles yield where SUMO does not know that they have to.

Two cases. Where lanes conflict unknown to SUMO (:mod:`mpcplan.sumo.crossings`), who comes first
drives first, as at a crossing without signs; where both run the same way, who is behind follows.
And where a body reaches into a lane on which SUMO does not have it (the ego vehicle between lanes,
pedestrians, what stands beside a lane), who drives there follows or stops.

Either way a vehicle gets an upper bound of its speed from which it can still stop, or follow
(Krauss, "Microscopic modeling of traffic flow", 1998),

    v = -b t + sqrt((b t)^2 + v_leader^2 + 2 b gap),

and goes over to it by b, or by what it takes not to collide, (v - v_leader)^2 / (2 gap).
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from mpcplan.sumo.meetings import Entry, Meeting, Mover, find_meetings

COMFORT = 3.0  # m/s^2, deceleration of those who yield
FIRM = 4.5  # m/s^2, deceleration by which one may still be asked to stop
HARD = 7.0  # m/s^2, highest deceleration for others
GAP = 1.5  # m, kept to a conflict and to others when standing
HEADWAY = 1.0  # s, kept to those who are followed
CLEARANCE = 1.0  # s, between one leaving a conflict and the next entering it
STANDING = 0.1  # m/s
PASSED = 1.0  # m, by which one may stand beside a body's begin and still wait for it
PATIENCE = 20  # steps, for which who may go and does not keeps its turn


@dataclass(frozen=True)
class Body:
    """What reaches into a lane.

    Attributes:
        lane: the lane.
        begin: where on the lane it begins [m].
        end: where it ends [m].
        speed: along the lane [m/s].
    """

    lane: str
    begin: float
    end: float
    speed: float


class Yielding:
    """Who has to yield, and how fast they may still go."""

    def __init__(self, dt: float) -> None:
        """For a time step [s]."""
        self._dt = dt
        self._turns: dict[str, int] = {}
        self._waited: dict[str, int] = {}
        self._yielded: frozenset[str] = frozenset()
        self._next_turn = 0

    def limits(self, movers: Sequence[Mover], bodies: Iterable[Body]) -> dict[str, float]:
        """Speeds [m/s] of the next step that those who have to yield may not exceed."""
        limits: dict[str, float] = {}
        on_lane: dict[str, list[Body]] = {}
        for body in bodies:
            on_lane.setdefault(body.lane, []).append(body)
        for mover in movers:
            if mover.steered and not on_lane.keys().isdisjoint(mover.way.ids):
                for gap, speed in _bodies_ahead(mover, on_lane):
                    self._limit(limits, mover, gap, speed)
        meetings = find_meetings(movers)
        self._take_turns(meetings)
        for one, other, together in meetings:
            found = _follow(one, other) if together else self._cross(one, other)
            if found is not None and found[0].steered:
                self._limit(limits, *found)
        self._yielded = frozenset(limits)
        return limits

    def _limit(
        self, limits: dict[str, float], mover: Mover, gap: float, leader_speed: float
    ) -> None:
        """Lowers a vehicle's limit, given the gap [m] to a stop or to who is followed, and the
        latter's speed [m/s]."""
        safe = safe_speed(gap, leader_speed, HEADWAY if leader_speed > 0 else 0.0)
        closing = max(mover.speed - leader_speed, 0.0)
        needed = closing * closing / (2 * gap) if gap > 0 else HARD
        slowing = min(max(COMFORT, needed), HARD)
        bound = max(safe, mover.speed - slowing * self._dt, 0.0)
        limits[mover.name] = min(bound, limits.get(mover.name, math.inf))

    def _take_turns(self, meetings: list[Meeting]) -> None:
        """Gives turns to those who came into a conflict, the nearest in time first; who does not
        go in its turn gets a new one."""
        arrival: dict[str, float] = {}
        for entry in (entry for one, other, _ in meetings for entry in (one, other)):
            name = entry.mover.name
            arrival[name] = min(arrival.get(name, math.inf), entry.arrival)
            if entry.mover.speed > STANDING or name in self._yielded:
                self._waited.pop(name, None)
        self._turns = {name: turn for name, turn in self._turns.items() if name in arrival}
        self._waited = {name: self._waited.get(name, -1) + 1 for name in self._turns}
        late = {name for name, steps in self._waited.items() if steps > PATIENCE}
        for name in sorted(arrival, key=lambda name: (name in late, arrival[name], name)):
            if name in late or name not in self._turns:
                self._turns[name] = self._next_turn
                self._next_turn += 1
                self._waited[name] = 0

    def _cross(self, one: Entry, other: Entry) -> tuple[Mover, float, float] | None:
        """Who yields where two ways cross, and the gap to where it has to stop."""
        if one.begin <= 0 and other.begin <= 0:
            return None
        if _apart(one, other) or _apart(other, one):
            return None
        second = max(one, other, key=self._precedence)
        wait = second.hold if second.hold > 0 else second.begin
        return second.mover, wait - GAP, 0.0

    def _precedence(self, entry: Entry) -> tuple[bool, bool, bool, int]:
        """Orders those who meet: who is inside, who is past where it could have waited, who cannot
        stop, and then by turn."""
        stops = entry.hold > entry.mover.speed**2 / (2 * FIRM)
        return entry.begin > 0, entry.hold > 0, stops, self._turns[entry.mover.name]


def safe_speed(gap: float, speed: float, headway: float) -> float:
    """The speed [m/s] from which one can still stop, or follow, by :data:`COMFORT`.

    Args:
        gap: to the stop, or to the rear of who is followed [m].
        speed: of who is followed [m/s].
        headway: time kept to it [s].
    """
    if gap <= 0:
        return 0.0
    bt = COMFORT * headway
    return math.sqrt(bt * bt + speed * speed + 2 * COMFORT * gap) - bt


def _follow(one: Entry, other: Entry) -> tuple[Mover, float, float] | None:
    """Who follows where two ways run together, the gap, and the leader's speed."""
    leader, follower = sorted((one, other), key=lambda entry: (entry.end, entry.mover.name))
    if leader.begin > 0 and leader.mover.speed < STANDING:
        return None  # it waits before the conflict
    return follower.mover, follower.end - leader.left - GAP, leader.mover.speed


def _bodies_ahead(mover: Mover, bodies: Mapping[str, list[Body]]) -> Iterator[tuple[float, float]]:
    """The gap to each body that reaches into a vehicle's lanes, and the body's speed."""
    for lane, at in mover.way.lanes:
        start = at - mover.position
        if start > mover.look:
            break
        for body in bodies.get(lane, ()):
            if start + body.begin > -PASSED:
                yield start + body.begin - GAP, max(body.speed, 0.0)


def _apart(first: Entry, second: Entry) -> bool:
    """Whether one will have left before the other enters."""
    return first.leaving + CLEARANCE < second.arrival
