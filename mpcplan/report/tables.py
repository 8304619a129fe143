"""Tables of the report: of the runs as a whole, by map, of the rules, the bound and the times."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate

import numpy as np

from mpcplan.bench.table import figure
from mpcplan.report.read import Results
from mpcplan.rules.keeping import KEEPING
from mpcplan.score.tr1 import PARTS

ALL = "all"
NOTHING = "-"
_P90 = 90
_DENSE = 13  # columns that have room beside each other
_SHORT = 20  # rows that fit on a printed page together with a heading
Statistic = Callable[[Sequence[float]], float]
_MAP_FIGURES: tuple[tuple[str, Statistic], ...] = (
    ("TR1 mean", statistics.fmean),
    ("median", statistics.median),
    ("worst", max),
    ("std", statistics.pstdev),
)
_MAP_WIDTHS = {1: 4, 2: 3, 3: 2}  # how many of these by the number of runs,
_MAP_LEAST = 1  # and with more runs


@dataclass(frozen=True)
class Table:
    """Text in rows; the first columns are flush left, the others flush right.

    Attributes:
        head: names of the columns.
        rows: as long as the head.
        groups: (name, number of columns) above the head, beginning with the second column.
        last_is_all: the last row is about all that is above.
        left: how many columns are flush left.
        picks: cells, by row and column, that lead to scenarios of the table of all; see
            :class:`mpcplan.report.picks.Picks`.
    """

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    groups: tuple[tuple[str, int], ...] = ()
    last_is_all: bool = False
    left: int = 1
    picks: Mapping[tuple[int, int], int] = field(default_factory=dict)

    @property
    def dense(self) -> bool:
        """Whether there are so many columns that they must stand close together."""
        return len(self.head) > _DENSE

    @property
    def short(self) -> bool:
        """Whether it can be kept on one printed page."""
        return len(self.rows) <= _SHORT

    @property
    def starts(self) -> set[int]:
        """The columns with which groups begin."""
        return (
            set(accumulate((span for _, span in self.groups[:-1]), initial=1))
            if self.groups
            else set()
        )


@dataclass(frozen=True)
class Rule:
    """A traffic rule as the report tells it: its column, what it asks for, its unit."""

    column: str
    text: str
    unit: str


RULES = (Rule("R_G1", "safe distance", "m"), Rule("R_G4", "traffic flow", "m/s"))


def told(values: Sequence[float], f: Statistic, digits: int = 2) -> str:
    """A statistic as text, a dash of nothing."""
    return figure(values, f, digits) if values else NOTHING


def share(some: int, whole: int) -> str:
    """'3 of 4 (75.0 %)', a dash of nothing."""
    return f"{some} of {whole} ({some / whole:.1%})".replace("%", " %") if whole else NOTHING


def summary(runs: Sequence[Results]) -> Table:
    """One row per run: how many are solved, TR1 of those, late, planning times of all cycles."""
    head = (
        *("run", "scenarios", "solved", "valid one step late", "TR1 mean", "median", "std"),
        *("worst", "report mean", "cycle p50 [ms]", "p95 [ms]", "longest [ms]"),
    )
    return Table(head, tuple(_summary_row(run) for run in runs))


def _summary_row(run: Results) -> tuple[str, ...]:
    costs = run.numbers("TR1")
    late = [entry for entry in run.solved if entry.texts.get("valid_late")]
    kept = sum(entry.texts["valid_late"].lower() == "true" for entry in late)
    interactive = sum(entry.texts.get("kind") == "interactive" for entry in run.entries)
    return (
        run.name,
        str(len(run.entries)),
        share(len(run.solved), len(run.entries)),
        share(kept, interactive) if late else NOTHING,
        *(told(costs, f) for f in (statistics.fmean, statistics.median, statistics.pstdev, max)),
        told(run.numbers("TR1_report"), statistics.fmean),
        told(run.numbers("plan_p50_ms", solved=False), statistics.median, 0),
        told(run.numbers("plan_p95_ms", solved=False), statistics.median, 0),
        told(run.numbers("plan_max_ms", solved=False), max, 0),
    )


def maps(runs: Sequence[Results]) -> Table:
    """One row per map: for every run how many are solved, and TR1 of those; of several runs also
    the means on the scenarios that all of them solved.

    The more runs there are, the fewer figures of each fit beside each other.
    """
    chosen = _MAP_FIGURES[: _MAP_WIDTHS.get(len(runs), _MAP_LEAST)]
    clusters = sorted({entry.cluster for run in runs for entry in run.entries})
    rows = [_map_row(name, runs, chosen) for name in [*clusters, ALL]]
    names = ("solved", *(name for name, _ in chosen))
    if len(runs) == 1:
        return Table(("map", *names), tuple(rows), last_is_all=True)
    head = ("map", *names * len(runs), "scenarios", *(run.name for run in runs))
    groups = [(run.name, len(names)) for run in runs]
    groups.append(("TR1 mean where all runs solved", 1 + len(runs)))
    return Table(head, tuple(rows), tuple(groups), last_is_all=True)


def _map_row(
    name: str, runs: Sequence[Results], chosen: Sequence[tuple[str, Statistic]]
) -> tuple[str, ...]:
    cells, costs = [name], []
    for run in runs:
        entries = [entry for entry in run.entries if name in (ALL, entry.cluster)]
        solved = [entry for entry in entries if entry.valid]
        costs.append({e.scenario: e.numbers["TR1"] for e in solved if "TR1" in e.numbers})
        cells.append(f"{len(solved)} of {len(entries)}" if entries else NOTHING)
        cells += [told(list(costs[-1].values()), f) for _, f in chosen]
    if len(runs) > 1:
        common = set.intersection(*map(set, costs))
        cells.append(str(len(common)))
        cells += [
            told([c for n, c in cost.items() if n in common], statistics.fmean) for cost in costs
        ]
    return tuple(cells)


def parts(runs: Sequence[Results]) -> Table:
    """TR1 and its weighted parts over the solved scenarios of every run: mean, median, worst."""
    names, stats = ("mean", "median", "worst"), (statistics.fmean, statistics.median, max)
    rows = []
    for part in ("TR1", *PARTS):
        cells = [part if part == "TR1" else f"{part}, weighted"]
        for run in runs:
            values = _part(run, part)
            cells += [told(values, f, 3) for f in stats]
        rows.append(tuple(cells))
    groups = tuple((run.name, len(names)) for run in runs) if len(runs) > 1 else ()
    return Table(("cost", *names * len(runs)), tuple(rows), groups)


def _part(run: Results, part: str) -> list[float]:
    """TR1, or a weighted part of it, over the solved scenarios where it is known."""
    if part == "TR1":
        return run.numbers("TR1")
    return [entry.parts[part] for entry in run.solved if part in entry.parts]


def gaps(runs: Sequence[Results]) -> Table | None:
    """TR1 as a multiple of the bound; None where no run has one."""
    rows = [
        (
            run.name,
            str(len(values)),
            told(values, statistics.median),
            told(values, lambda v: float(np.percentile(v, _P90))),
            told(values, max),
            str(sum(e.texts.get("bound_by", "").startswith("the drive") for e in run.solved)),
            told(run.numbers("bound"), statistics.fmean),
        )
        for run in runs
        if (values := run.numbers("gap"))
    ]
    head = (
        *("run", "with a bound", "gap median", f"{_P90}th percentile", "worst"),
        *("none better known", "bound mean"),
    )
    return Table(head, tuple(rows)) if rows else None


def rules(runs: Sequence[Results]) -> Table | None:
    """One row per run and rule; None where no run has been judged by rules."""
    rows = [row for run in runs for rule in RULES if (row := _rule_row(run, rule)) is not None]
    head = ("run", "rule", "judged", *KEEPING, "robustness median", "5th percentile", "worst")
    return Table(head, tuple(rows), left=2) if rows else None


def _rule_row(run: Results, rule: Rule) -> tuple[str, ...] | None:
    if rule.column not in run.columns:
        return None
    counts = keeping(run, rule)
    values = run.numbers(rule.column, solved=False)
    words = [str(counts[word]) if word in counts else NOTHING for word in KEEPING]
    stats = (statistics.median, lambda v: float(np.percentile(v, 5)), min)
    figures = [told(values, f) for f in stats]
    units = [f"{text} {rule.unit}" if values else text for text in figures]
    judged = str(sum(counts.values()))
    return (run.name, f"{rule.column}, {rule.text}", judged, *words, *units)


def keeping(run: Results, rule: Rule) -> Mapping[str, int]:
    """How many drives kept a rule, and how not, over all that were judged.

    Where the table does not tell this by a column of words, robustness does: kept or violated. A
    drive to which the rule never applied kept it.
    """
    words = [entry.texts.get(f"{rule.column}_kept", "") for entry in run.entries]
    if any(words):
        return {word: words.count(word) for word in KEEPING}
    judged = [e for e in run.entries if rule.column in e.numbers or e.texts.get("R_G1_kept")]
    violated = sum(e.numbers.get(rule.column, 0.0) < 0 for e in judged)
    return {KEEPING[0]: len(judged) - violated, KEEPING[-1]: violated}
