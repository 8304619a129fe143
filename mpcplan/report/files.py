"""The files of a run that its row leads to: picture, animation, solution, trace."""

from __future__ import annotations

import base64
import io
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from mpcplan.report.read import Results
from mpcplan.review.places import FILMS, PICTURES, SOLUTIONS, TRACE, TRACES

IMAGES = (".png", ".webp", ".jpg", ".svg")
ANIMATIONS = (".mp4", ".webm", ".gif")
_PLACES = ("", PICTURES, SOLUTIONS, FILMS)
"""Folders of the results in which a picture may lie, besides one of the scenario's own."""

_EMBEDDED_WIDTH = 900  # pixels
_EMBEDDED_QUALITY = 60  # of WebP, in per cent


@dataclass(frozen=True)
class Files:
    """The files of one scenario in one run, None for those that do not exist.

    Attributes:
        picture: of the drive.
        animation: of the drive, beside the picture or where one would lie.
        solution: in CommonRoad's format.
        trace: see docs/trace.md.
    """

    picture: Path | None
    animation: Path | None
    solution: Path | None
    trace: Path | None


def files_of(run: Results, scenario: str) -> Files:
    """What there is of a scenario in the folder of its run."""
    folder = run.folder
    places = [folder / scenario, *(folder / place for place in _PLACES)]
    traces = [folder / TRACES / f"{scenario}{TRACE}", folder / scenario / "trace.json"]
    names = (f"solution_KS1:TR1:{scenario}:2020a.xml",)
    return Files(
        picture=_first(place / f"{scenario}{end}" for end in IMAGES for place in places),
        animation=_first(place / f"{scenario}{end}" for end in ANIMATIONS for place in places),
        solution=_first(place / name for name in names for place in places),
        trace=_first(iter(traces)),
    )


def _first(paths: Iterator[Path]) -> Path | None:
    return next((path for path in paths if path.is_file()), None)


def link(path: Path | None, page: Path) -> str:
    """The address of a file relative to the page, '' of none.

    Colons are quoted, or a browser would take what stands before the first one for a protocol.
    """
    if path is None:
        return ""
    return quote(Path(os.path.relpath(path.resolve(), page.resolve().parent)).as_posix())


def embedded(path: Path) -> str:
    """A picture as an address that holds it all, made smaller; '' where it cannot be read."""
    from PIL import Image

    if path.suffix == ".svg":
        return ""
    try:
        with Image.open(path) as picture:
            shown = picture.convert("RGB")
    except (OSError, ValueError, Image.DecompressionBombError):
        return ""
    shown.thumbnail((_EMBEDDED_WIDTH, _EMBEDDED_WIDTH * shown.height))
    data = io.BytesIO()
    shown.save(data, "WEBP", quality=_EMBEDDED_QUALITY)
    return f"data:image/webp;base64,{base64.b64encode(data.getvalue()).decode()}"
