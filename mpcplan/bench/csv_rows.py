"""Reading tables of results: rows of a CSV file with their places, numbers, and yes or no."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mpcplan.errors import InputError

FILE = "results.csv"
_YES, _NO = ("true", "1"), ("false", "0", "")


@dataclass(frozen=True)
class CsvRow:
    """One line of a table: the cells by column, and the place for messages ('FILE, line 3')."""

    cells: dict[str, str]
    place: str


def read_rows(path: str | Path, needed: Sequence[str]) -> tuple[tuple[str, ...], list[CsvRow]]:
    """The columns and rows of a table.

    Args:
        path: a CSV file, or a folder with a results.csv.
        needed: columns that must be there, with a cell in every row.

    Raises:
        InputError: the file is missing or broken, a needed column is missing, a row is incomplete
            or too long, or there is none.
    """
    path = Path(path)
    if path.is_dir():
        path = path / FILE
        if not path.exists():
            raise InputError(f"{path.parent} has no {FILE}: give a folder that `bench` wrote")
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file, strict=True)
            columns = tuple(reader.fieldnames or ())
            missing = [name for name in needed if name not in columns]
            if missing:
                raise InputError(f"{path} has no column {', '.join(missing)}: not a results table")
            rows = [_row(row, f"{path}, line {reader.line_num}", needed) for row in reader]
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path} is not a CSV table: {error}") from error
    if not rows:
        raise InputError(f"{path} has no rows")
    return columns, rows


def _row(cells: dict[str | None, str | None], place: str, needed: Sequence[str]) -> CsvRow:
    """One line, checked; cells that are missing at its end become empty ones."""
    if None in cells:
        raise InputError(f"{place}: the row has more cells than there are columns")
    if any(cells[name] is None for name in needed) or not cells[needed[0]]:
        raise InputError(f"{place}: the row is incomplete")
    return CsvRow({str(name): text or "" for name, text in cells.items()}, place)


def number(text: str | None, what: str) -> float | None:
    """A finite number, None for an empty cell or one that is not finite; raises InputError."""
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{what} is {text!r}, not a number") from None
    return value if math.isfinite(value) else None


def truth(text: str, what: str) -> bool:
    """True or False, the latter of an empty cell too; raises InputError."""
    if text.lower() not in (*_YES, *_NO):
        raise InputError(f"{what} is {text!r}, expected True or False")
    return text.lower() in _YES
