"""The benchmark's table: counts and TR1 per map cluster, planning times, causes of failure."""

import re
import statistics
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence

from mpcplan.bench.store import Row

_HEAD = ("cluster", "total", "solved", "TR1 mean", "std", "median", "worst", "report mean")


def summary(rows: Sequence[Row]) -> str:
    """The whole table as text.

    TR1 figures are over valid solutions and under the checker's weights; 'report mean' has the
    competition report's weights. The standard deviation is the population's.
    """
    clusters: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        clusters[row["cluster"]].append(row)
    lines = [_cells(name, group) for name, group in sorted(clusters.items())]
    text = align([_HEAD, *lines, _cells("all", rows)])
    return "\n".join([text, "", *planning_lines(rows), *cause_lines(rows)]).rstrip()


def _cells(name: str, rows: Sequence[Row]) -> tuple[str, ...]:
    """One line of the table."""
    solved = [row for row in rows if row["valid"]]
    costs, report = numbers(solved, "TR1"), numbers(solved, "TR1_report")
    return (
        name,
        str(len(rows)),
        str(len(solved)),
        *(figure(costs, f) for f in (statistics.fmean, statistics.pstdev)),
        *(figure(costs, f) for f in (statistics.median, max)),
        figure(report, statistics.fmean),
    )


def numbers(rows: Iterable[Row], column: str) -> list[float]:
    """The column's values where there are any."""
    return [float(row[column]) for row in rows if row[column] not in ("", None)]


def figure(values: Sequence[float], f: Callable[[Sequence[float]], float], digits: int = 3) -> str:
    """A statistic as text, '-' of nothing."""
    return f"{f(values):.{digits}f}" if values else "-"


def align(lines: Sequence[Sequence[str]]) -> str:
    """Columns of equal width, the first one flush left, the others flush right."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if i else cell.ljust(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    )


def planning_lines(rows: Sequence[Row]) -> list[str]:
    """Planning time per cycle and memory over all scenarios."""
    if not numbers(rows, "plan_max_ms"):
        return []
    p50 = figure(numbers(rows, "plan_p50_ms"), statistics.median, 1)
    p95, p95s = numbers(rows, "plan_p95_ms"), "plan_p95_ms"
    lines = [
        f"planning per cycle: p50 {p50} ms, p95 {figure(p95, statistics.median, 1)} ms "
        f"(medians over the scenarios; worst p95 {figure(numbers(rows, p95s), max, 1)} ms), "
        f"longest {figure(numbers(rows, 'plan_max_ms'), max, 1)} ms"
    ]
    peak = numbers(rows, "peak_mb")
    return [*lines, f"memory: at most {figure(peak, max, 0)} MB"] if peak else lines


def cause_lines(rows: Sequence[Row]) -> list[str]:
    """Causes of failure with counts, the most frequent first; numbers do not distinguish them."""
    groups: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for row in rows:
        if not row["valid"]:
            groups[row["status"], _kind(row)].append(row)
    if not groups:
        return []
    lines = ["", f"not solved: {sum(map(len, groups.values()))} of {len(rows)}"]
    for (status, _), group in sorted(groups.items(), key=lambda item: (-len(item[1]), item[0])):
        example = group[0]
        lines.append(f"  {len(group)} x {status}: {example['cause']} ({example['scenario']})")
    return lines


def _kind(row: Row) -> str:
    """The cause without the scenario's name and numbers."""
    cause = str(row["cause"]).replace(str(row["scenario"]), "")
    return re.sub(r"-?\d+(\.\d+)?(e-?\d+)?", "#", cause)
