"""Tables of results, read for the report: one per folder, or one per planner that a table names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from mpcplan.bench.csv_rows import CsvRow, number, read_rows, truth
from mpcplan.bench.store import cluster_of
from mpcplan.errors import InputError
from mpcplan.score.tr1 import CHECKER_WEIGHTS, PARTS

_NEEDED = ("scenario", "valid", "TR1")
NUMBERS = (
    *("TR1", "TR1_report", *PARTS, "duration_s", "R_G1", "R_G1_step", "R_G4", "R_G4_step"),
    *("bound", "gap", "cycles", "plan_p50_ms", "plan_p95_ms", "plan_max_ms"),
    *("sim_ms_p50", "sim_ms_max", "wall_s", "peak_mb"),
)
"""Columns that hold numbers; others are text."""

SOLVED, NOT_SOLVED = "solved", "not_solved"


@dataclass(frozen=True)
class Entry:
    """One scenario as one run drove it.

    Attributes:
        scenario: its id.
        cluster: country and map, 'DEU_Flensburg'.
        valid: whether there is a valid solution; TR1 of others says nothing.
        texts: the cells of the columns that are no numbers.
        numbers: those that are, where they are known and finite; units as in results.csv.
    """

    scenario: str
    cluster: str
    valid: bool
    texts: Mapping[str, str]
    numbers: Mapping[str, float]

    @property
    def status(self) -> str:
        """How it ended; of tables without that column whether it is solved."""
        return self.texts.get("status") or (SOLVED if self.valid else NOT_SOLVED)

    @property
    def parts(self) -> dict[str, float]:
        """The weighted parts of TR1 that are known."""
        return {n: CHECKER_WEIGHTS[n] * self.numbers[n] for n in PARTS if n in self.numbers}


@dataclass(frozen=True)
class Results:
    """What one run, a planner with a configuration, made of its scenarios.

    Attributes:
        name: by which the report calls it; no two of a report are equal.
        folder: where the table lies.
        columns: those of its table.
        entries: one per scenario, in the order of the table.
    """

    name: str
    folder: Path
    columns: frozenset[str]
    entries: tuple[Entry, ...]

    @cached_property
    def by_scenario(self) -> dict[str, Entry]:
        """The entries by their scenarios' ids."""
        return {entry.scenario: entry for entry in self.entries}

    @cached_property
    def solved(self) -> tuple[Entry, ...]:
        """The entries with a valid solution."""
        return tuple(entry for entry in self.entries if entry.valid)

    def numbers(self, column: str, solved: bool = True) -> list[float]:
        """The known numbers of a column, of the solved scenarios or of all."""
        entries = self.solved if solved else self.entries
        return [entry.numbers[column] for entry in entries if column in entry.numbers]


def read_all(paths: Sequence[Path], names: Sequence[str] | None = None) -> list[Results]:
    """The results in some folders or tables, each with a name of its own.

    Args:
        paths: folders that ``bench`` wrote, or tables with its columns of which at least scenario,
            valid and TR1 are there.
        names: for the runs, in their order; by default those of the folders, or of the planners
            where a table holds several.

    Raises:
        InputError: a table cannot be read, a cell is not what it should be, a scenario is there
            twice, or there are more or fewer names than runs.
    """
    found = [results for path in paths for results in _read(path)]
    if names is None:
        return [_renamed(r, n) for r, n in zip(found, _told_apart(found), strict=True)]
    if len(names) != len(found) or len(set(names)) != len(names) or not all(names):
        told = ", ".join(results.name for results in found)
        raise InputError(
            f"{len(found)} different names are needed, for {told}; given: {', '.join(names)}"
        )
    return [_renamed(r, n) for r, n in zip(found, names, strict=True)]


def _renamed(results: Results, name: str) -> Results:
    return Results(name, results.folder, results.columns, results.entries)


def _told_apart(found: Sequence[Results]) -> list[str]:
    """Names of which no two are equal: with the folder above, then numbered."""
    same = Counter(results.name for results in found)
    above = [
        f"{r.folder.resolve().parent.name}/{r.name}" if same[r.name] > 1 else r.name for r in found
    ]
    names: list[str] = []
    for name in above:
        others = sum(one == name or one.startswith(f"{name} (") for one in names)
        names.append(f"{name} ({others + 1})" if others else name)
    return names


def _read(path: Path) -> list[Results]:
    """The runs of one table."""
    columns, rows = read_rows(path, _NEEDED)
    folder = path if path.is_dir() else path.parent
    base = path.resolve().name if path.is_dir() else path.stem
    if base == "results":  # a table as bench calls it: its folder tells more
        base = path.resolve().parent.name
    by_planner: dict[str, dict[str, Entry]] = {}
    for row in rows:
        entries = by_planner.setdefault(row.cells.get("planner", ""), {})
        entry = _entry(row)
        if entry.scenario in entries:
            raise InputError(f"{row.place}: the scenario {entry.scenario} is there twice")
        entries[entry.scenario] = entry
    several = len(by_planner) > 1
    return [
        Results(
            planner if several and planner else base,
            folder,
            frozenset(columns),
            tuple(found.values()),
        )
        for planner, found in by_planner.items()
    ]


def _entry(row: CsvRow) -> Entry:
    cells, place = row.cells, row.place
    valid = truth(cells["valid"], f"{place}: valid")
    known = {name: number(cells.get(name), f"{place}: {name}") for name in NUMBERS}
    numbers = {name: value for name, value in known.items() if value is not None}
    texts = {name: text for name, text in cells.items() if name not in NUMBERS}
    cluster = cells.get("cluster") or cluster_of(cells["scenario"])
    return Entry(cells["scenario"], cluster, valid, texts, numbers)
