"""The table of all scenarios: what its rows and their details hold, as data for the page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpcplan.report.files import Files, embedded, files_of, link
from mpcplan.report.read import Entry, Results
from mpcplan.report.traces import Told, tell
from mpcplan.score.tr1 import CHECKER_WEIGHTS, PARTS

TEXT, CHOICE, NUMBER = "text", "choice", "number"
_NO_TRACE = Told("", {})


@dataclass(frozen=True)
class Column:
    """A column: its label, what its heading says when pointed at, and how to read a cell.

    Attributes:
        kind: text; a choice of few (which can be filtered by); or a number.
        digits: of a number after the point.
        hidden: no column, only something to filter by.
    """

    label: str
    title: str
    kind: str
    of: Callable[[Results, Entry], str | float | None]
    digits: int = 0
    hidden: bool = False


def _text(name: str) -> Callable[[Results, Entry], str]:
    return lambda _, entry: entry.texts.get(name, "")


def _number(name: str, weight: float = 1.0) -> Callable[[Results, Entry], float | None]:
    return lambda _, e: weight * e.numbers[name] if name in e.numbers else None


_COLUMNS = (
    Column("run", "folder of the results", CHOICE, lambda run, _: run.name),
    Column("scenario", "id", TEXT, lambda _, entry: entry.scenario),
    Column("map", "country and map", CHOICE, lambda _, entry: entry.cluster, hidden=True),
    Column("kind", "recorded or interactive", CHOICE, _text("kind")),
    Column("status", "how it ended", CHOICE, lambda _, entry: entry.status),
    Column("late", "valid with the ego vehicle one step late", CHOICE, _text("valid_late")),
    Column("TR1", "cost under the checker's weights", NUMBER, _number("TR1"), 3),
    *(
        Column(part, f"{part}, weighted", NUMBER, _number(part, CHECKER_WEIGHTS[part]), 3)
        for part in PARTS
    ),
    Column("gap", "TR1 / bound", NUMBER, _number("gap"), 2),
    Column("R_G1", "lowest robustness of the safe distance [m]", NUMBER, _number("R_G1"), 2),
    Column("R_G1 kept", "how the safe distance was kept", CHOICE, _text("R_G1_kept")),
    Column("R_G4", "lowest robustness of the traffic flow [m/s]", NUMBER, _number("R_G4"), 2),
    Column("p50", "median time of a planning cycle [ms]", NUMBER, _number("plan_p50_ms")),
    Column("p95", "95th percentile of the cycles [ms]", NUMBER, _number("plan_p95_ms")),
    Column("longest", "longest planning cycle [ms]", NUMBER, _number("plan_max_ms")),
    Column("driven", "driven time [s]", NUMBER, _number("duration_s"), 1),
)
_ALWAYS = ("scenario", "map", "status", "TR1")
_ONLY_IF_DIFFERENT = ("run", "kind")


@dataclass(frozen=True)
class Row:
    """One scenario of one run, with its files and its trace."""

    run: Results
    entry: Entry
    files: Files
    told: Told


def rows_of(runs: Sequence[Results], doing: Callable[[str], None]) -> list[Row]:
    """All rows, one run after the other; reads the traces."""
    rows = []
    for run in runs:
        for entry in run.entries:
            doing(f"{run.name}: {entry.scenario}")
            files = files_of(run, entry.scenario)
            told = tell(files.trace) if files.trace is not None else _NO_TRACE
            rows.append(Row(run, entry, files, told))
    return rows


def table_data(rows: Sequence[Row], page: Path, embed: bool) -> dict[str, Any]:
    """Columns, cells and details for the page's script.

    Args:
        rows: all of them.
        page: file of the page, to which links are relative.
        embed: put the pictures into the page.
    """
    columns, cells = [], []
    for column in _COLUMNS:
        values = [_rounded(column, column.of(row.run, row.entry)) for row in rows]
        if _shown(column, values):
            columns.append(column)
            cells.append(values)
    return {
        "columns": [
            {
                "label": c.label,
                "title": c.title,
                "kind": c.kind,
                "digits": c.digits,
                "hidden": c.hidden,
            }
            for c in columns
        ],
        "rows": [list(row) for row in zip(*cells, strict=True)],
        "details": [_details(row, page, embed) for row in rows],
    }


def _rounded(column: Column, value: str | float | None) -> str | float | None:
    """A number as exact as it is shown: the page shall sort by what can be read."""
    return round(value, column.digits) if isinstance(value, float) else value


def _shown(column: Column, values: Sequence[str | float | None]) -> bool:
    """Whether the column tells anything."""
    different = set(values)
    if column.label in _ONLY_IF_DIFFERENT:
        return len(different) > 1
    return column.label in _ALWAYS or bool(different - {None, ""})


def _details(row: Row, page: Path, embed: bool) -> dict[str, str]:
    """What a row tells when it is opened; nothing that is empty."""
    texts, files = row.entry.texts, row.files
    found = {
        "cause": texts.get("cause", ""),
        "late": texts.get("cause_late", ""),
        "bound": texts.get("bound_by", ""),
        "notes": texts.get("notes", ""),
        "words": row.told.words,
        "picture": link(files.picture, page),
        "embedded": embedded(files.picture) if embed and files.picture is not None else "",
        "animation": link(files.animation, page),
        "solution": link(files.solution, page),
        "trace": link(files.trace, page),
    }
    return {name: text for name, text in found.items() if text}
