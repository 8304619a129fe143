"""Results of a benchmark on disk: one JSON file per scenario, assembled into results.csv.

Layout of the output folder::

    config.yaml            planner and configuration; others are refused
    rows/<name>.json       one finished scenario
    results.csv            all rows, sorted by scenario
    solutions/             solution files, and the traffic simulated with them
    bounds/                solution files of the clairvoyant optima, where asked for
    traces/ logs/
"""

import csv
import io
import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpcplan.bench.files import write_whole, writing_to
from mpcplan.errors import InputError

if TYPE_CHECKING:
    from mpcplan.bench.attempt import Outcome

COLUMNS = (
    *("scenario", "cluster", "planner", "kind", "status", "valid", "valid_late"),
    *("all_problems", "goal", "start", "no_collision", "on_road", "feasible"),
    *("TR1", "TR1_report", "Jlon", "SR", "D", "LC", "duration_s"),
    *("R_G1", "R_G1_step", "R_G1_kept", "R_G4", "R_G4_step"),
    *("bound", "gap", "bound_by"),
    *("cycles", "plan_p50_ms", "plan_p95_ms", "plan_max_ms", "sim_ms_p50", "sim_ms_max"),
    *("wall_s", "peak_mb", "cause", "cause_late", "notes"),
)
"""Columns of results.csv; Jlon, SR, D, LC are unweighted, TR1 has the checker's weights. Bound and
gap are empty where they were not asked for."""

UNJUDGED = "unjudged"
STATUSES = (
    *("solved", UNJUDGED, "invalid", "not_solved", "bad_input"),
    *("crash", "timeout", "memory", "aborted"),
)
CUT = "cut"
"""Status in the row of a worker that was asked to end; how it ended is for its parent to say."""

Row = dict[str, Any]


def cluster_of(scenario: str) -> str:
    """Country and map of a scenario id: 'DEU_Flensburg' of 'C-DEU_Flensburg-67_1_T-1'."""
    return re.sub(r"-\d.*$", "", scenario.removeprefix("C-"))


def empty_row(
    scenario: str,
    status: str = "crash",
    cause: str = "",
    kind: str = "recorded",
    planner: str = "mpcplan",
) -> Row:
    """A row without results; every column is there."""
    row: Row = dict.fromkeys(COLUMNS, "")
    known = {"scenario": scenario, "cluster": cluster_of(scenario), "status": status}
    return row | known | {"cause": cause, "kind": kind, "planner": planner, "valid": False}


class Store:
    """The output folder of one benchmark."""

    def __init__(
        self, folder: Path, config_text: str, planner: str, columns: Sequence[str] = COLUMNS
    ) -> None:
        """Open or create the folder.

        Args:
            folder: the output folder.
            config_text: the effective configuration, as text.
            planner: what plans.
            columns: those of a row.

        Raises:
            InputError: the folder cannot be written, or holds results of another planner or
                configuration.
        """
        self.folder, self.columns = folder, tuple(columns)
        with writing_to(folder):
            for name in ("rows", "solutions", "traces", "logs"):
                (folder / name).mkdir(parents=True, exist_ok=True)
            self._claim(f"# planner: {planner}\n{config_text}")

    def _claim(self, text: str) -> None:
        """Keep planner and configuration, or compare with those of earlier rows."""
        path = self.folder / "config.yaml"
        if not path.exists() or not any((self.folder / "rows").glob("*.json")):
            write_whole(path, text)
            return
        before, now = path.read_text(encoding="utf-8").splitlines(), text.splitlines()
        if before != now:
            changed = [line.strip(" #") for line in now if line not in before]
            raise InputError(
                f"{self.folder} holds results of another planner or another configuration"
                + (f" (now: {changed[0]})" if changed else "")
                + "; choose another folder for the results"
            )

    def row_path(self, name: str) -> Path:
        """Where the row of a scenario is kept."""
        return self.folder / "rows" / f"{name}.json"

    def read(self, name: str) -> Row | None:
        """The row of a finished scenario, None when there is none or it is unreadable."""
        return read_row(self.row_path(name), self.columns)

    def write(self, name: str, row: Row) -> None:
        """Keep the row of a finished scenario; raises OSError."""
        write_whole(self.row_path(name), json.dumps(row, indent=1) + "\n")

    def keep_files(self, outcome: "Outcome") -> None:
        """Keep an attempt's files and log; raises OSError."""
        for name, content in outcome.files.items():
            path = self.folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, content)
        write_whole(self.folder / "logs" / f"{outcome.name}.log", outcome.log)

    def assemble(self, names: Iterable[str]) -> tuple[Path, list[Row]]:
        """Write results.csv from the rows of the given scenarios; returns path and rows."""
        rows = [row for name in names if (row := self.read(name)) is not None]
        rows.sort(key=lambda row: row["scenario"])
        path = self.folder / "results.csv"
        with writing_to(self.folder):
            write_whole(path, csv_text(rows, self.columns))
        return path, rows


def csv_text(rows: Iterable[Row], columns: Sequence[str]) -> str:
    """Rows as a CSV table with a header."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def read_row(path: Path, columns: Sequence[str] = COLUMNS) -> Row | None:
    """A row file with all its columns, None when it is missing or unusable."""
    try:
        row = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(row, dict) or set(row) != set(columns):
        return None
    return {name: row[name] for name in columns}
