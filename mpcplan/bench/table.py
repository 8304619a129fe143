"""The benchmark's table: counts and TR1 per map cluster, times, statuses, causes of failure."""

import math
import re
import statistics
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence

from mpcplan.bench.store import Row
from mpcplan.rules.keeping import KEEPING, KEPT, NOT_REGAINED, REGAINED, VIOLATED
from mpcplan.score.tr1 import CHECKER_WEIGHTS, PARTS

_HEAD = ("cluster", "total", "solved", "TR1 mean", "std", "median", "worst", "report mean")
_PARTS_HEAD = ("of the solved", "mean", "median", "worst")


def summary(rows: Sequence[Row]) -> str:
    """The whole table as text.

    TR1 figures are over valid solutions and under the checker's weights; 'report mean' has the
    competition report's weights. The standard deviation is the population's.
    """
    clusters: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        clusters[row["cluster"]].append(row)
    lines = [_cells(name, group) for name, group in sorted(clusters.items())]
    blocks = [
        [align([_HEAD, *lines, _cells("all", rows)])],
        parts_lines(rows),
        gap_lines(rows),
        [*status_lines(rows), *late_lines(rows), *rules_lines(rows), *planning_lines(rows)],
        cause_lines(rows),
    ]
    return "\n\n".join("\n".join(block) for block in blocks if block)


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


def parts_lines(rows: Sequence[Row]) -> list[str]:
    """TR1 and its weighted parts over the valid solutions, nothing where there is none."""
    solved = [row for row in rows if row["valid"]]
    if not numbers(solved, "TR1"):
        return []
    table: list[tuple[str, ...]] = [_PARTS_HEAD]
    for name in ("TR1", *PARTS):
        weight = CHECKER_WEIGHTS.get(name, 1.0)
        values = [weight * value for value in numbers(solved, name)]
        label = name if name == "TR1" else f"{name} (weighted)"
        figures = (figure(values, f) for f in (statistics.fmean, statistics.median, max))
        table.append((label, *figures))
    return [align(table)]


def gap_lines(rows: Sequence[Row]) -> list[str]:
    """TR1 as a multiple of the clairvoyant optimum, nothing where that was not sought."""
    gaps, costs = numbers(rows, "gap"), numbers(rows, "bound")
    if not gaps:
        return []
    without = sum(1 for row in rows if row["valid"] and row["gap"] in ("", None))
    itself = sum(1 for row in rows if str(row["bound_by"]).startswith("the drive"))
    lines = [
        f"gap to the bound: median {figure(gaps, statistics.median)}, 90th percentile "
        f"{figure(gaps, _p90)}, worst {figure(gaps, max)} ({len(gaps)} scenarios; "
        f"bound: mean {figure(costs, statistics.fmean)}, median "
        f"{figure(costs, statistics.median)})",
        f"  none better than the drive was found for {itself}",
    ]
    return [*lines, f"  no bound for {without} of the solved"] if without else lines


def _p90(values: Sequence[float]) -> float:
    """The least value that nine of ten do not exceed."""
    return sorted(values)[math.ceil(0.9 * len(values)) - 1]


def status_lines(rows: Sequence[Row]) -> list[str]:
    """How many scenarios have which status; of both kinds where there are both."""
    kinds = sorted({str(row["kind"]) for row in rows})
    lines = []
    for kind in kinds:
        counts = Counter(str(row["status"]) for row in rows if row["kind"] == kind)
        told = ", ".join(f"{status} {count}" for status, count in counts.most_common())
        lines.append(f"{kind}: {counts.total()} scenarios: {told}")
    return lines


def late_lines(rows: Sequence[Row]) -> list[str]:
    """Validity on time and with the ego one step late, of the interactive scenarios."""
    interactive = [row for row in rows if row["kind"] == "interactive"]
    if not interactive:
        return []
    on_time = [row for row in interactive if row["valid"]]
    late = [row for row in on_time if row["valid_late"] is True]
    counts = Counter(_kind(row, "cause_late") for row in on_time if row["cause_late"])
    return [
        f"interactive: valid on time {_share(on_time, interactive)}, "
        f"also with the ego one step late {_share(late, interactive)}",
        *(f"  {count} x late: {cause}" for cause, count in counts.most_common()),
    ]


def rules_lines(rows: Sequence[Row]) -> list[str]:
    """How many drives kept the rules, and the robustness; nothing where none was judged.

    R_G1 of those that begin in violation of it is told apart: the start is not their doing.
    """
    judged = [row for row in rows if row["R_G1_kept"]]
    if not judged:
        return []
    by = {word: [row for row in judged if row["R_G1_kept"] == word] for word in KEEPING}
    kept, regained = by[KEPT], by[REGAINED]
    told = f"R_G1 (safe distance): kept in {_share(kept, [*kept, *by[VIOLATED]])}"
    if late := [*regained, *by[NOT_REGAINED]]:
        told += f"; violated at the start of {len(late)} others, regained in {len(regained)}"
    flowing = [row for row in judged if row["R_G4"] == "" or float(row["R_G4"]) >= 0]
    return [
        f"{told}; {_robustness(judged, 'R_G1', 'm')}",
        f"R_G4 (traffic flow): kept in {_share(flowing, judged)}; "
        f"{_robustness(judged, 'R_G4', 'm/s')}",
    ]


def _robustness(rows: Sequence[Row], column: str, unit: str) -> str:
    values = numbers(rows, column)
    median, worst = figure(values, statistics.median, 1), figure(values, min, 1)
    return f"lowest robustness: median {median}, worst {worst} {unit}"


def _share(some: Sequence[Row], whole: Sequence[Row]) -> str:
    share = f" ({len(some) / len(whole):.1%})" if whole else ""
    return f"{len(some)} of {len(whole)}{share}"


def planning_lines(rows: Sequence[Row]) -> list[str]:
    """Planning time per cycle, simulation time per step, time and memory of the processes."""
    peak, wall = numbers(rows, "peak_mb"), numbers(rows, "wall_s")
    lines = [*_cycle_lines(rows), *_step_lines(rows)]
    if wall:
        p50, longest = figure(wall, statistics.median, 1), figure(wall, max, 1)
        lines.append(f"per scenario: median {p50} s, longest {longest} s, all {sum(wall):.0f} s")
    return [*lines, f"memory: at most {figure(peak, max, 0)} MB"] if peak else lines


def _step_lines(rows: Sequence[Row]) -> list[str]:
    if not numbers(rows, "sim_ms_p50"):
        return []
    p50 = figure(numbers(rows, "sim_ms_p50"), statistics.median, 2)
    longest = figure(numbers(rows, "sim_ms_max"), max, 1)
    return [f"simulation per step: p50 {p50} ms (median over the scenarios), longest {longest} ms"]


def _cycle_lines(rows: Sequence[Row]) -> list[str]:
    if not numbers(rows, "plan_max_ms"):
        return []
    p50 = figure(numbers(rows, "plan_p50_ms"), statistics.median, 1)
    p95, p95s = numbers(rows, "plan_p95_ms"), "plan_p95_ms"
    return [
        f"planning per cycle: p50 {p50} ms, p95 {figure(p95, statistics.median, 1)} ms "
        f"(medians over the scenarios; worst p95 {figure(numbers(rows, p95s), max, 1)} ms), "
        f"longest {figure(numbers(rows, 'plan_max_ms'), max, 1)} ms"
    ]


def cause_lines(rows: Sequence[Row]) -> list[str]:
    """Causes of failure with counts, the most frequent first; numbers do not distinguish them."""
    groups: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for row in rows:
        if not row["valid"]:
            groups[row["status"], _kind(row)].append(row)
    if not groups:
        return []
    lines = [f"not solved: {sum(map(len, groups.values()))} of {len(rows)}"]
    for (status, _), group in sorted(groups.items(), key=lambda item: (-len(item[1]), item[0])):
        example = group[0]
        lines.append(f"  {len(group)} x {status}: {example['cause']} ({example['scenario']})")
    return lines


def _kind(row: Row, column: str = "cause") -> str:
    """The cause without the scenario's name and numbers."""
    cause = str(row[column]).replace(str(row["scenario"]), "")
    return re.sub(r"-?\d+(\.\d+)?(e-?\d+)?", "#", cause)
