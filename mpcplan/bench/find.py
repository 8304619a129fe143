"""Finding scenario files in folders."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from mpcplan.errors import InputError

_ROOT = re.compile(rb"<(?![?!])\s*([\w:.-]+)")
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_HEAD_BYTES = 16384


def find_scenarios(paths: Iterable[str | Path]) -> dict[str, Path]:
    """Scenario files by name (the file name without its extension), sorted.

    Folders are searched for ``*.xml`` at any depth. Files with another root element (solutions,
    SUMO networks) are passed over; broken files are kept, so that they get their row.

    Raises:
        InputError: a path does not exist, there is no scenario, or two have the same name.
    """
    found: dict[str, Path] = {}
    for path in (p.resolve() for given in paths for p in _expand(Path(given))):
        if found.setdefault(scenario_name(path), path) != path:
            other = found[scenario_name(path)]
            raise InputError(f"two scenarios have the same file name: {other} and {path}")
    if not found:
        raise InputError("no scenario found in " + ", ".join(str(path) for path in paths))
    return dict(sorted(found.items()))


def scenario_name(path: Path) -> str:
    """'DEU_X-1_1_I-1' of 'DEU_X-1_1_I-1.cr.xml' and of 'DEU_X-1_1_I-1.xml'."""
    return path.name.removesuffix(".xml").removesuffix(".cr")


def _expand(path: Path) -> Iterator[Path]:
    """The file itself, or the scenarios below a folder."""
    if path.is_dir():
        yield from (file for file in sorted(path.rglob("*.xml")) if may_be_scenario(file))
    elif path.exists():
        yield path
    else:
        raise InputError(f"no such file or folder: {path}")


def may_be_scenario(path: Path) -> bool:
    """Whether the root element is <commonRoad>, or there is none because the file is broken."""
    try:
        with path.open("rb") as file:
            head = _COMMENT.sub(b"", file.read(_HEAD_BYTES))
    except OSError:
        return True
    root = _ROOT.search(head)
    return root is None or root.group(1) == b"commonRoad"
