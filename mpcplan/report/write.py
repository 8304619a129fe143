"""From folders of results to a file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mpcplan.bench.files import write_whole
from mpcplan.errors import InputError
from mpcplan.report.read import Results, read_all

INSTALL = "pip install 'mpcplan[report]'"
_MEGA = 1e6


@dataclass(frozen=True)
class Written:
    """What was written: the runs, and the size of the page [MB]."""

    runs: tuple[Results, ...]
    size_mb: float


def write_report(
    paths: Sequence[Path],
    out: Path,
    names: Sequence[str] | None = None,
    title: str | None = None,
    embed: bool = False,
    doing: Callable[[str], None] = lambda what: None,
) -> Written:
    """Write one HTML page about some results.

    Args:
        paths: folders that ``bench`` wrote, or tables with its columns.
        out: the file to write; folders above it are made.
        names: for the runs, see :func:`mpcplan.report.read.read_all`.
        title: of the page; by default the names of the runs.
        embed: put the pictures into the page, made smaller, instead of links to them.
        doing: told what is being done.

    Raises:
        InputError: results cannot be read, the file cannot be written, or a package is missing.
    """
    runs = read_all(paths, names)
    if out.is_dir():
        raise InputError(f"{out} is a folder: name the file to write, such as {out}/report.html")
    try:
        from mpcplan.report.page import page_of
    except ImportError as error:
        raise InputError(f"the report needs the package {error.name}: {INSTALL}") from error
    heading = title or f"Results: {', '.join(run.name for run in runs)}"
    page = page_of(runs, out, heading, embed, doing).encode()
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        write_whole(out, page)
    except OSError as error:
        raise InputError(f"cannot write {out}: {error.strerror or error}") from error
    return Written(tuple(runs), len(page) / _MEGA)
