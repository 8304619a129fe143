"""Results of a benchmark on disk: one JSON file per scenario, assembled into results.csv.

Layout of the output folder::

    config.yaml            the configuration; another one is refused
    rows/<name>.json       one finished scenario
    results.csv            all rows, sorted by scenario
    solutions/ traces/ logs/
"""

import csv
import json
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mpcplan.errors import InputError

COLUMNS = (
    *("scenario", "cluster", "status", "valid"),
    *("all_problems", "goal", "start", "no_collision", "on_road", "feasible"),
    *("TR1", "TR1_report", "Jlon", "SR", "D", "LC", "duration_s"),
    *("cycles", "plan_p50_ms", "plan_p95_ms", "plan_max_ms", "wall_s", "peak_mb", "cause"),
)
"""Columns of results.csv; Jlon, SR, D, LC are unweighted, TR1 has the checker's weights."""

STATUSES = ("solved", "invalid", "not_solved", "bad_input", "crash", "timeout", "memory")

Row = dict[str, Any]


def cluster_of(scenario: str) -> str:
    """Country and map of a scenario id: 'DEU_Flensburg' of 'C-DEU_Flensburg-67_1_T-1'."""
    return re.sub(r"-\d.*$", "", scenario.removeprefix("C-"))


def empty_row(scenario: str, status: str = "crash", cause: str = "") -> Row:
    """A row without results; every column is there."""
    row: Row = dict.fromkeys(COLUMNS, "")
    cluster = cluster_of(scenario)
    known = {"scenario": scenario, "cluster": cluster, "status": status, "cause": cause}
    return row | known | {"valid": False}


def write_atomically(path: Path, text: str) -> None:
    """Write a file so that a reader, and the next run, sees it whole or not at all."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    part.write_text(text, encoding="utf-8")
    os.replace(part, path)


class Store:
    """The output folder of one benchmark."""

    def __init__(self, folder: Path, config_text: str) -> None:
        """Open or create the folder.

        Args:
            folder: the output folder.
            config_text: the effective configuration, as text.

        Raises:
            InputError: the folder cannot be written, or holds results of another configuration.
        """
        self.folder = folder
        try:
            for name in ("rows", "solutions", "traces", "logs"):
                (folder / name).mkdir(parents=True, exist_ok=True)
            self._claim(config_text)
        except OSError as error:
            raise InputError(f"cannot write to {folder}: {error.strerror}") from error

    def _claim(self, config_text: str) -> None:
        """Keep the configuration, or compare with the one of earlier rows."""
        path = self.folder / "config.yaml"
        if not path.exists() or not any((self.folder / "rows").glob("*.json")):
            write_atomically(path, config_text)
            return
        before, now = path.read_text(encoding="utf-8").splitlines(), config_text.splitlines()
        if before != now:
            changed = [line.strip() for line in now if line not in before]
            raise InputError(
                f"{self.folder} holds results of another configuration"
                + (f" (now: {changed[0]})" if changed else "")
                + "; choose another folder with --out"
            )

    def row_path(self, name: str) -> Path:
        """Where the row of a scenario is kept."""
        return self.folder / "rows" / f"{name}.json"

    def log_path(self, name: str) -> Path:
        """Where the output of a scenario's process is kept."""
        return self.folder / "logs" / f"{name}.log"

    def read(self, name: str) -> Row | None:
        """The row of a finished scenario, None when there is none or it is unreadable."""
        return read_row(self.row_path(name))

    def write(self, name: str, row: Row) -> None:
        """Keep the row of a finished scenario."""
        write_atomically(self.row_path(name), json.dumps(row, indent=1) + "\n")

    def assemble(self, names: Iterable[str]) -> tuple[Path, list[Row]]:
        """Write results.csv from the rows of the given scenarios; returns path and rows."""
        rows = [row for name in names if (row := self.read(name)) is not None]
        rows.sort(key=lambda row: row["scenario"])
        path = self.folder / "results.csv"
        part = path.with_name(f".{path.name}.{os.getpid()}.part")
        with part.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
        os.replace(part, path)
        return path, rows


def read_row(path: Path) -> Row | None:
    """A row file with all its columns, None when it is missing or unusable."""
    try:
        row = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(row, dict) or set(row) != set(COLUMNS):
        return None
    return {name: row[name] for name in COLUMNS}
