"""Finding scenarios in folders: recorded ones are files, interactive ones are folders."""

import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from mpcplan.errors import InputError

_ROOT = re.compile(rb"<(?![?!])\s*([\w:.-]+)")
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_ID = re.compile(rb"""<commonRoad\s[^>]*\bbenchmarkID\s*=\s*["']([\w.-]+)["']""")
_HEAD_BYTES = 16384


def find_scenarios(
    paths: Iterable[str | Path], exclude: str | Path | None = None
) -> dict[str, Path]:
    """Scenarios by name (the file name without its extension), sorted.

    Folders are searched at any depth for interactive scenarios (folders with a SUMO network, see
    :mod:`mpcplan.sumo.folder`) and for ``*.xml``. Files with another root element (solutions, SUMO
    networks), what lies in an interactive scenario's folder, and hidden folders are passed over;
    broken files are kept, so that they get their row.

    Args:
        paths: scenario files, interactive folders, or folders to be searched.
        exclude: a folder that is not searched (the results' own).

    Raises:
        InputError: a path does not exist, there is no scenario, or two have the same name.
    """
    given_paths = [Path(path) for path in paths]
    found: dict[str, Path] = {}
    without = Path(exclude).resolve() if exclude is not None else None
    for path in (p.resolve() for given in given_paths for p in _expand(given, without)):
        if found.setdefault(scenario_name(path), path) != path:
            other = found[scenario_name(path)]
            raise InputError(f"two scenarios have the same file name: {other} and {path}")
    if not found:
        raise InputError("no scenario found in " + ", ".join(map(str, given_paths)))
    return dict(sorted(found.items()))


def scenario_name(path: Path) -> str:
    """'DEU_X-1_1_I-1' of 'DEU_X-1_1_I-1.cr.xml', of 'DEU_X-1_1_I-1.xml' and of a folder of both."""
    return main_file(path).name.removesuffix(".xml").removesuffix(".cr")


def benchmark_id(path: Path) -> str:
    """The id in the scenario's file, by which results of all planners are matched.

    The file's name where there is none; a look at the first bytes, as the file may be broken.
    """
    try:
        with main_file(path).open("rb") as file:
            found = _ID.search(file.read(_HEAD_BYTES))
    except OSError:
        found = None
    return found.group(1).decode() if found else scenario_name(path)


def main_file(path: Path) -> Path:
    """The CommonRoad file of a scenario: the file itself, or the one in an interactive folder."""
    inside = sorted(path.glob("*.cr.xml")) if path.is_dir() else []
    return inside[0] if inside else path


def kind_of(path: Path) -> str:
    """'interactive' for a folder, 'recorded' for a file."""
    return "interactive" if path.is_dir() else "recorded"


def _expand(path: Path, exclude: Path | None) -> Iterator[Path]:
    """The file or interactive folder itself, or the scenarios below a folder."""
    if path.is_dir():
        yield from _search(path, exclude)
    elif path.exists():
        yield path
    else:
        raise InputError(f"no such file or folder: {path}")


def _search(folder: Path, exclude: Path | None) -> Iterator[Path]:
    """Scenarios at any depth, in the order of their paths."""
    from mpcplan.sumo.folder import is_folder

    if is_folder(folder):
        yield folder
        return
    for path in _entries(folder):
        if path.is_dir():
            loop = path.is_symlink() and folder.resolve().is_relative_to(path.resolve())
            if not loop and path.resolve() != exclude:
                yield from _search(path, exclude)
        elif path.suffix == ".xml" and may_be_scenario(path):
            yield path


def _entries(folder: Path) -> list[Path]:
    """What lies in a folder and is not hidden, sorted; raises InputError."""
    try:
        names = sorted(os.listdir(folder))
    except OSError as error:
        raise InputError(f"cannot read the folder {folder}: {error.strerror}") from error
    return [folder / name for name in names if not name.startswith(".")]


def may_be_scenario(path: Path) -> bool:
    """Whether the root element is <commonRoad>, or there is none because the file is broken."""
    try:
        with path.open("rb") as file:
            head = _COMMENT.sub(b"", file.read(_HEAD_BYTES))
    except OSError:
        return True
    root = _ROOT.search(head)
    return root is None or root.group(1) == b"commonRoad"
