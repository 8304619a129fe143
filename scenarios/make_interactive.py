"""Write all interactive scenarios (and optionally the overview picture).

The nets are converted from the maps by `mpcplan twin`, so its extra is needed: install `.[twin]`.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from generator.export import write
from generator.interactive_cases import interactive_cases
from generator.model import Case
from generator.overview import draw, interactive_readme

from mpcplan.sumo.twin import make_twin

HERE = Path(__file__).resolve().parent


def all_interactive() -> list[Case]:
    """Every interactive scenario, ordered by name."""
    return sorted(interactive_cases(), key=lambda case: case.name)


def write_interactive(folder: Path) -> list[Path]:
    """Write one folder per scenario and the README into `folder`; returns the folders."""
    folder.mkdir(parents=True, exist_ok=True)
    cases = all_interactive()
    (folder / "README.md").write_text(interactive_readme(cases), encoding="utf-8")
    return [_write(case, folder / case.benchmark_id) for case in cases]


def _write(case: Case, folder: Path) -> Path:
    """Write one scenario's folder, in place of an earlier one."""
    for file in folder.glob("*"):
        file.unlink()
    with tempfile.TemporaryDirectory() as recorded:
        make_twin(write(case, Path(recorded)), folder)
    return folder


def main() -> None:
    """Command line entry."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE / "interactive", help="target folder")
    parser.add_argument("--picture", action="store_true", help="draw overview.png as well")
    arguments = parser.parse_args()
    for folder in write_interactive(arguments.out):
        print(folder.name)
    if arguments.picture:
        draw(all_interactive(), arguments.out / "overview.png")


if __name__ == "__main__":
    main()
