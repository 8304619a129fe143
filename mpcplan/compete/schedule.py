"""Whose turn it is: the easiest scenario first, in two passes."""

import heapq
import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from mpcplan.bench.store import UNJUDGED, Row
from mpcplan.compete.budget import Rule

RETRIED = ("timeout", "aborted", UNJUDGED)
"""Statuses of attempts that something outside the scenario ended: they are worth another one."""


@dataclass(frozen=True, order=True)
class Turn:
    """A scenario that waits, in the order of its turn.

    Attributes:
        round: 1 or 2, the pass.
        has_solution: it has one that is not judged yet; those without come first.
        estimate_s: see :mod:`mpcplan.compete.estimate` [s].
        name: of the scenario.
        previous_s: the limit at which it ended before, 0 if it did not end for time [s].
        limit_s: time limit of this attempt, set when its turn comes [s].
    """

    round: int
    has_solution: bool
    estimate_s: float
    name: str
    previous_s: float = field(default=0.0, compare=False)
    limit_s: float = field(default=0.0, compare=False)


class Schedule:
    """The scenarios that wait for their attempts."""

    def __init__(self, rule: Rule, slots: int, turns: Iterable[Turn]) -> None:
        """All turns that are known at the start; ``slots`` attempts run at a time."""
        self._rule, self._slots = rule, slots
        self._waiting = list(turns)
        heapq.heapify(self._waiting)

    def next(self, remaining_s: float) -> Turn | None:
        """The next turn with its limit, None when nothing waits that the time would do for."""
        while self._waiting:
            first = self._waiting[0]
            alike = sum(turn.round == first.round for turn in self._waiting)
            if first.round == 1:
                limit = self._rule.first(remaining_s, self._slots, alike)
                if limit is None:
                    return None
            else:
                limit = self._rule.second(remaining_s, self._slots, alike, first.previous_s)
            heapq.heappop(self._waiting)
            if limit is not None:
                return replace(first, limit_s=math.floor(limit * 10) / 10)  # for the report
        return None

    def again(self, turn: Turn, row: Row) -> None:
        """Put a scenario back for the second pass, if its attempt was worth another one."""
        if turn.round == 1 and row["status"] in RETRIED:
            heapq.heappush(self._waiting, second_turn(turn.name, turn.estimate_s, row))


def second_turn(name: str, estimate_s: float, row: Row) -> Turn:
    """The turn of a scenario in the second pass, after the row of its last attempt."""
    for_time = row["status"] != "aborted"
    previous_s = float(row["limit_s"]) if for_time else 0.0
    return Turn(2, row["status"] == UNJUDGED, estimate_s, name, previous_s)
