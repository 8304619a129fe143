"""Folders of results as `bench` writes them, made without driving anything."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

from mpcplan.bench.store import COLUMNS, cluster_of

Cells = Mapping[str, object]


def solved(scenario: str, cost: float, **cells: object) -> Cells:
    """A row of a scenario with a valid solution."""
    parts = {"Jlon": cost / 4, "SR": cost / 8, "D": cost / 2, "LC": cost / 8}
    return _row(scenario, status="solved", valid=True, valid_late=True, TR1=cost, **parts, **cells)


def failed(scenario: str, cause: str, status: str = "invalid", **cells: object) -> Cells:
    """A row of a scenario without one."""
    return _row(scenario, status=status, valid=False, valid_late=False, cause=cause, **cells)


def _row(scenario: str, **cells: object) -> Cells:
    times = {"cycles": 11, "plan_p50_ms": 40, "plan_p95_ms": 90, "plan_max_ms": 120}
    first = {"scenario": scenario, "cluster": cluster_of(scenario), "planner": "mpcplan"}
    return {**first, "kind": "recorded", "duration_s": 3.3, **times, **cells}


def write(folder: Path, rows: Sequence[Cells]) -> Path:
    """A folder with a results.csv of these rows; returns the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "results.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        table.writerows(rows)
    return folder


def id_of(number: int, place: str = "Town") -> str:
    """A scenario's id."""
    return f"DEU_{place}-{number}_1_T-1"


def two_runs(folder: Path) -> tuple[Path, Path]:
    """Two folders with five scenarios in common, and one more in the second.

    Of the five both solve 1 and 2, only the first 3, only the second 4, none 5.
    """
    first = write(
        folder / "first",
        [
            solved(id_of(1), 2.0),
            solved(id_of(2), 10.0),
            solved(id_of(3, "Village"), 1.0),
            failed(id_of(4), "collided at step 64"),
            failed(id_of(5), "collided at step 7"),
        ],
    )
    second = write(
        folder / "second",
        [
            solved(id_of(1), 1.0),
            solved(id_of(2), 10.0),
            failed(id_of(3, "Village"), "the goal was not reached at step 30"),
            solved(id_of(4), 4.0),
            failed(id_of(5), "collided at step 9; first fallback at step 3: braking: no plan"),
            solved(id_of(6), 100.0),
        ],
    )
    return first, second
