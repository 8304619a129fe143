"""The budget of time, and each scenario's share of it.

A scenario's share is what it would have if all that wait were given the same,

    share = remaining * slots / waiting,

where ``slots`` attempts run at a time. Most scenarios take a small part of theirs, and what they
leave raises the shares of the later ones, which are the harder ones. Two passes:

1. every scenario, easiest first: limit = ``first_share * share`` within [``floor_s``,
   ``first_cap_s``]; so half of the budget is left for the second pass even if nothing finishes;
2. those that ran out of time: limit = their share, at most ``second_cap_s``, but at least
   ``growth`` times what they had before; with little more time they would end as they did.

No limit is longer than what remains, less ``reserve_s`` for the end of the last processes.
"""

import math
import re
from dataclasses import dataclass

from mpcplan.errors import InputError

_BUDGET = re.compile(r"(?:([\d.]+)h)?(?:([\d.]+)m(?:in)?)?(?:([\d.]+)s?)?")
_SECONDS = (3600.0, 60.0, 1.0)


@dataclass(frozen=True)
class Rule:
    """Parameters of the time limits.

    Attributes:
        first_share: part of its share that a scenario has in the first pass.
        floor_s: the shortest limit, while there is as much: start, map and verdict alone take
            about 3 s on an idle machine [s].
        first_cap_s: the longest limit of the first pass [s].
        second_cap_s: the longest limit of the second pass [s].
        growth: a second limit is at least this many times the first.
        reserve_s: kept at the end [s].
        least_s: nothing is begun with less [s].
    """

    first_share: float = 0.5
    floor_s: float = 30.0
    first_cap_s: float = 300.0
    second_cap_s: float = 1800.0
    growth: float = 2.0
    reserve_s: float = 5.0
    least_s: float = 5.0

    def first(self, remaining_s: float, slots: int, waiting: int) -> float | None:
        """Limit [s] of an attempt of the first pass; None: too little time is left."""
        usable = remaining_s - self.reserve_s
        if usable < self.least_s:
            return None
        share = self.first_share * usable * slots / waiting
        return min(max(share, self.floor_s), self.first_cap_s, usable)

    def second(
        self, remaining_s: float, slots: int, waiting: int, previous_s: float
    ) -> float | None:
        """Limit [s] of an attempt of the second pass; None: no more time than it had before.

        Args:
            remaining_s: of the budget [s].
            slots: attempts that run at a time.
            waiting: scenarios of this pass that wait, this one included.
            previous_s: the limit at which it ended before [s], 0 if it did not end for time.
        """
        usable = remaining_s - self.reserve_s
        share = min(usable * slots / waiting, self.second_cap_s)
        limit = min(max(share, self.floor_s, self.growth * previous_s), usable)
        return limit if limit > max(previous_s, self.least_s) else None


def parse_budget(text: str) -> float:
    """Seconds of '6h', '90m', '1h30m', '45s' or '3600'; raises InputError."""
    match = _BUDGET.fullmatch(text.strip().lower().replace(" ", ""))
    try:
        parts = [float(part or 0) for part in match.groups()] if match else []
    except ValueError:  # '1.2.3h'
        parts = []
    seconds = sum(part * unit for part, unit in zip(parts, _SECONDS, strict=False))
    if not (math.isfinite(seconds) and seconds > 0):
        raise InputError(f"the budget {text!r} is no time; expected e.g. 6h, 1h30m, 45s or 600")
    return seconds
