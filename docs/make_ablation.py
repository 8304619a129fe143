"""The table of docs/ablation.md: result folders of `mpcplan bench` against the first of them.

    python docs/make_ablation.py BASE NAME=FOLDER [NAME=FOLDER ...]

Costs are compared on the scenarios that both solve. Prints Markdown.
"""

import argparse
import csv
import statistics
from pathlib import Path

HEAD = (
    "Variant", "Valid", "Only default / only variant", "TR1, default (both)", "TR1, variant (both)",
    "Cheaper on", "R_G1 kept", "R_G1 lowest, median", "Cycle p50 / p95",
)  # fmt: skip
KEPT = ("kept", "regained")

Row = dict[str, str]


def read(folder: Path) -> dict[str, Row]:
    """Rows of a results.csv by scenario."""
    with (folder / "results.csv").open(encoding="utf-8", newline="") as file:
        return {row["scenario"]: row for row in csv.DictReader(file)}


def line(name: str, base: dict[str, Row], rows: dict[str, Row]) -> tuple[str, ...]:
    """One line of the table."""
    common = sorted(set(base) & set(rows))
    good, good_base = ({k for k in common if r[k]["valid"] == "True"} for r in (rows, base))
    both = [k for k in common if k in good & good_base and base[k]["TR1"] and rows[k]["TR1"]]
    pairs = [(float(base[k]["TR1"]), float(rows[k]["TR1"])) for k in both]
    cheaper = sum(b < a for a, b in pairs)
    judged = [rows[k] for k in common if rows[k]["R_G1_kept"]]
    lowest = [float(row["R_G1"]) for row in judged if row["R_G1"] not in ("", "inf")]
    kept = sum(row["R_G1_kept"] in KEPT for row in judged)
    times = [
        statistics.median(float(rows[k][column]) for k in common if rows[k][column])
        for column in ("plan_p50_ms", "plan_p95_ms")
    ]
    return (
        name,
        f"{len(good)} of {len(common)}",
        f"{len(good_base - good)} / {len(good - good_base)}",
        f"{statistics.mean(a for a, _ in pairs):.2f}" if pairs else "",
        f"{statistics.mean(b for _, b in pairs):.2f}" if pairs else "",
        f"{cheaper} of {len(pairs)}",
        f"{kept} of {len(judged)}",
        f"{statistics.median(lowest):.1f} m" if lowest else "",
        f"{times[0]:.0f} / {times[1]:.0f} ms",
    )


def main() -> None:
    """Command line entry."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("base", type=Path, help="results of the default configuration")
    parser.add_argument("variants", nargs="+", metavar="NAME=FOLDER")
    arguments = parser.parse_args()
    base = read(arguments.base)
    variants = [given.rsplit("=", 1) for given in arguments.variants]
    wanted = set(base).intersection(*(read(Path(folder)) for _, folder in variants))
    base = {name: row for name, row in base.items() if name in wanted}
    lines = [HEAD, ("---",) * len(HEAD), line("default", base, base)]
    lines += [line(name, base, read(Path(folder))) for name, folder in variants]
    print("\n".join(f"| {' | '.join(cells)} |" for cells in lines))


if __name__ == "__main__":
    main()
