"""Write all scenarios of this folder (and optionally the overview picture)."""

from __future__ import annotations

import argparse
from pathlib import Path

from generator.curved_cases import curved_cases
from generator.export import write
from generator.model import Case
from generator.overview import draw, readme
from generator.straight_cases import straight_cases

HERE = Path(__file__).resolve().parent


def all_cases() -> list[Case]:
    """Every scenario of the collection, ordered by name."""
    return sorted(straight_cases() + curved_cases(), key=lambda case: case.name)


def write_all(folder: Path) -> list[Path]:
    """Write the XML files and the README into `folder`; returns the XML paths."""
    folder.mkdir(parents=True, exist_ok=True)
    cases = all_cases()
    (folder / "README.md").write_text(readme(cases), encoding="utf-8")
    return [write(case, folder) for case in cases]


def main() -> None:
    """Command line entry."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE, help="target folder")
    parser.add_argument("--picture", action="store_true", help="draw overview.png as well")
    arguments = parser.parse_args()
    for path in write_all(arguments.out):
        print(path.name)
    if arguments.picture:
        draw(all_cases(), arguments.out / "overview.png")


if __name__ == "__main__":
    main()
