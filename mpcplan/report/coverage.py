"""Several runs against each other, two by two: who solved what, and TR1 where both did."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from mpcplan.report.read import Results
from mpcplan.report.tables import Table, told

_TIE = 1e-6  # relative difference of costs below which nobody is cheaper


@dataclass(frozen=True)
class Pair:
    """Two runs on the scenarios that both have.

    Attributes:
        a, b: their names.
        both, only_a, only_b, neither: ids of the scenarios solved by both, by one only, by none.
        costed: those of ``both`` whose costs are known.
        costs: (a's, b's) TR1 on these, in their order.
    """

    a: str
    b: str
    both: tuple[str, ...]
    only_a: tuple[str, ...]
    only_b: tuple[str, ...]
    neither: tuple[str, ...]
    costed: tuple[str, ...]
    costs: tuple[tuple[float, float], ...]

    @property
    def common(self) -> int:
        """How many scenarios both have."""
        return sum(map(len, (self.both, self.only_a, self.only_b, self.neither)))

    @property
    def ratios(self) -> list[float]:
        """TR1 of b / TR1 of a where the latter is not 0."""
        return [b / a for a, b in self.costs if a > 0]

    @property
    def cheaper(self) -> tuple[int, int, int]:
        """On how many a is cheaper, b is, and neither."""
        ties = [math.isclose(a, b, rel_tol=_TIE) for a, b in self.costs]
        first = sum(a < b and not tie for (a, b), tie in zip(self.costs, ties, strict=True))
        return first, len(ties) - first - sum(ties), sum(ties)


def pairs_of(runs: Sequence[Results]) -> list[Pair]:
    """Every two of the runs, the earlier one first."""
    return [_pair(a, b) for a, b in combinations(runs, 2)]


def _pair(a: Results, b: Results) -> Pair:
    ours, theirs = a.by_scenario, b.by_scenario
    common = sorted(set(ours) & set(theirs))
    groups: dict[tuple[bool, bool], list[str]] = {}
    for name in common:
        groups.setdefault((ours[name].valid, theirs[name].valid), []).append(name)
    both = groups.get((True, True), [])
    costed = [n for n in both if "TR1" in ours[n].numbers and "TR1" in theirs[n].numbers]
    costs = tuple((ours[name].numbers["TR1"], theirs[name].numbers["TR1"]) for name in costed)
    only_a, only_b, neither = (
        tuple(groups.get(which, ())) for which in ((True, False), (False, True), (False, False))
    )
    return Pair(a.name, b.name, tuple(both), only_a, only_b, neither, tuple(costed), costs)


def coverage(pairs: Sequence[Pair]) -> Table:
    """One row per pair: how many scenarios both solved, only one of them, and neither."""
    head = ("A", "B", "in common", "both", "only A", "only B", "neither")
    rows = []
    for pair in pairs:
        counts = map(len, (pair.both, pair.only_a, pair.only_b, pair.neither))
        rows.append((pair.a, pair.b, str(pair.common), *map(str, counts)))
    return Table(head, tuple(rows), left=2)


def costs(pairs: Sequence[Pair]) -> Table:
    """One row per pair: TR1 of both on the scenarios that both solved."""
    head = (
        *("A", "B", "compared", "A mean", "B mean", "A median", "B median", "A worst", "B worst"),
        *("median of B / A", "A cheaper", "B cheaper", "equal"),
    )
    return Table(head, tuple(_costs_row(pair) for pair in pairs), left=2)


def _costs_row(pair: Pair) -> tuple[str, ...]:
    columns = [[one[side] for one in pair.costs] for side in (0, 1)]
    stats = (statistics.fmean, statistics.median, max)
    figures = [told(column, f) for f in stats for column in columns]
    ratio = told(pair.ratios, statistics.median, 3)
    wins = map(str, pair.cheaper)
    return (pair.a, pair.b, str(len(pair.costs)), *figures, ratio, *wins)
