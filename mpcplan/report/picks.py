"""Scenarios that a cell of some table leads to: lists of rows of the table of all scenarios."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from mpcplan.report.causes import Cause
from mpcplan.report.coverage import Pair
from mpcplan.report.read import Results
from mpcplan.report.tables import ALL, Table

_PAIR_COLUMNS = {3: "both", 4: "only_a", 5: "only_b", 6: "neither"}  # of the table of coverage


class Picks:
    """Numbered lists of rows, each with a label that says what they are."""

    def __init__(self, runs: Sequence[Results]) -> None:
        """The rows are all entries of all runs, one run after the other."""
        self._runs = runs
        self._rows: dict[tuple[str, str], int] = {}
        for run in runs:
            for entry in run.entries:
                self._rows[run.name, entry.scenario] = len(self._rows)
        self._lists: list[dict[str, Any]] = []

    def add(self, label: str, chosen: Iterable[tuple[str, str]]) -> int:
        """Keep a list of (run, scenario); returns its number."""
        rows = sorted(self._rows[one] for one in chosen)
        self._lists.append({"label": label, "rows": rows})
        return len(self._lists) - 1

    def as_lists(self) -> list[dict[str, Any]]:
        """All lists in their order: label and row numbers."""
        return self._lists

    def of_maps(self, table: Table) -> Table:
        """The table by map, whose first column leads to the map's scenarios."""
        found = {}
        for index, row in enumerate(table.rows):
            if row[0] != ALL:
                chosen = [
                    (run.name, entry.scenario)
                    for run in self._runs
                    for entry in run.entries
                    if entry.cluster == row[0]
                ]
                found[index, 0] = self.add(f"map {row[0]}", chosen)
        return replace(table, picks=found)

    def of_pairs(self, table: Table, pairs: Sequence[Pair]) -> Table:
        """The table of coverage, whose counts lead to the scenarios in both runs."""
        found = {}
        for index, pair in enumerate(pairs):
            for column, name in _PAIR_COLUMNS.items():
                scenarios = getattr(pair, name)
                if scenarios:
                    label = f"{table.head[column]}; A: {pair.a}, B: {pair.b}"
                    chosen = [(run, one) for one in scenarios for run in (pair.a, pair.b)]
                    found[index, column] = self.add(label, chosen)
        return replace(table, picks=found)

    def causes(self, causes: Sequence[Cause]) -> Table:
        """The table of causes, whose counts lead to the scenarios of each run."""
        rows, found = [], {}
        for index, cause in enumerate(causes):
            first = [cause.status, cause.what, cause.before]
            counts = [str(len(one)) for one in cause.scenarios]
            rows.append((*first, *counts))
            for place, (run, scenarios) in enumerate(
                zip(self._runs, cause.scenarios, strict=True), start=len(first)
            ):
                if scenarios:
                    label = f"{run.name}: {cause.what}"
                    found[index, place] = self.add(label, [(run.name, one) for one in scenarios])
        several = [run.name for run in self._runs] if len(self._runs) > 1 else ["scenarios"]
        head = ("status", "what went wrong", "before that", *several)
        return Table(head, tuple(rows), left=3, picks=found)
