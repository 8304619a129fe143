"""Two results tables compared on the scenarios that both solved."""

import math
import statistics
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mpcplan.bench.csv_rows import CsvRow, number, read_rows, truth
from mpcplan.bench.store import cluster_of
from mpcplan.bench.table import align, figure
from mpcplan.errors import InputError
from mpcplan.score.tr1 import CHECKER_WEIGHTS, PARTS

_NEEDED = ("scenario", "valid", "TR1")
_TIMES = ("plan_p50_ms", "plan_p95_ms")
_TIE = 1e-6  # relative difference of costs below which nobody wins


@dataclass(frozen=True)
class Result:
    """One scenario in one table: solved or not, its cost and weighted parts where known, and the
    50th and 95th percentile of its planning times [ms] by the columns' names, where known."""

    scenario: str
    solved: bool
    tr1: float | None
    parts: dict[str, float]
    times: dict[str, float] = field(default_factory=dict)


Results = dict[str, Result]


def compare(a_csv: str | Path, b_csv: str | Path, planner: str | None = None) -> str:
    """Compare a results.csv (or the folder of one) with another, as text.

    The second table may hold several planners, told apart by a column ``planner``: the first is
    then compared with each, or with the one asked for.

    Raises:
        InputError: a file is missing, broken, without a needed column or planner.
    """
    ours = read_results(a_csv)
    if len(ours) > 1:
        raise InputError(
            f"{a_csv} holds several planners ({', '.join(ours)}): give it as the second table"
        )
    theirs = read_results(b_csv)
    if planner is not None and planner not in theirs:
        known = ", ".join(name for name in theirs if name) or "no planners named"
        raise InputError(f"{b_csv} has no planner {planner!r}, it has: {known}")
    chosen = [planner] if planner is not None else list(theirs)
    (a,) = ours.values()
    head = f"A = {a_csv}"
    blocks = [_against(a, theirs[name], f"{name or ''} {b_csv}".strip()) for name in chosen]
    return "\n\n".join([head, *blocks])


def read_results(path: str | Path) -> dict[str, Results]:
    """Results by planner ('' without a column of that name) and scenario; raises InputError."""
    _, rows = read_rows(path, _NEEDED)
    results: dict[str, Results] = defaultdict(dict)
    for row in rows:
        result = _result(row)
        results[row.cells.get("planner", "")][result.scenario] = result
    return dict(results)


def _result(row: CsvRow) -> Result:
    """One line of a table."""
    cells, place = row.cells, row.place
    solved = truth(cells["valid"], f"{place}: valid")
    values = {n: number(cells.get(n), f"{place}: {n}") for n in ("TR1", *PARTS, *_TIMES)}
    parts = {n: CHECKER_WEIGHTS[n] * v for n in PARTS if (v := values[n]) is not None}
    times = {n: v for n in _TIMES if (v := values[n]) is not None}
    return Result(cells["scenario"], solved, values["TR1"], parts, times)


def _against(a: Results, b: Results, name: str) -> str:
    """The block of lines for one pair."""
    common = sorted(set(a) & set(b))
    if not common:
        return f"B = {name}\nno scenario in common"
    both = [s for s in common if a[s].solved and b[s].solved]
    only_a = [s for s in common if a[s].solved and not b[s].solved]
    only_b = [s for s in common if b[s].solved and not a[s].solved]
    neither = len(common) - len(both) - len(only_a) - len(only_b)
    lines = [
        f"B = {name}",
        f"{len(common)} scenarios in common: both solved {len(both)}, only A {len(only_a)}, "
        f"only B {len(only_b)}, neither {neither}",
        *(f"only {x}: {', '.join(ids)}" for x, ids in (("A", only_a), ("B", only_b)) if ids),
    ]
    pairs = [(a[s], b[s]) for s in both if a[s].tr1 is not None and b[s].tr1 is not None]
    return "\n".join([*lines, "", *_cost_lines(common, a, b, pairs)])


def _cost_lines(
    common: Sequence[str], a: Results, b: Results, pairs: list[tuple[Result, Result]]
) -> list[str]:
    """Costs on the scenarios that both solved, per cluster and in all."""
    if not pairs:
        return ["no scenario that both solved with a cost"]
    clusters: dict[str, list[str]] = defaultdict(list)
    for scenario in common:
        clusters[cluster_of(scenario)].append(scenario)
    groups = [*sorted(clusters.items()), ("all", list(common))]
    head = (
        *("cluster", "common", "A solved", "B solved", "both"),
        *("A mean", "B mean", "A std", "B std", "A worst", "B worst"),
    )
    table = [head, *(_cluster_cells(name, ids, a, b, pairs) for name, ids in groups)]
    return [align(table), "", align(_parts_table(pairs)), "", _ratios(pairs)]


def _cluster_cells(
    name: str, ids: Sequence[str], a: Results, b: Results, pairs: list[tuple[Result, Result]]
) -> tuple[str, ...]:
    """One line of the table per cluster."""
    inside = set(ids)
    costs = [(x.tr1 or 0.0, y.tr1 or 0.0) for x, y in pairs if x.scenario in inside]
    solved = [str(sum(results[s].solved for s in ids)) for results in (a, b)]
    columns = ([x for x, _ in costs], [y for _, y in costs])
    figures = [
        figure(column, f) for f in (statistics.fmean, statistics.pstdev, max) for column in columns
    ]
    return (name, str(len(ids)), *solved, str(len(costs)), *figures)


def _parts_table(pairs: list[tuple[Result, Result]]) -> list[tuple[str, ...]]:
    """Mean and median of TR1 and of its weighted parts."""
    table: list[tuple[str, ...]] = [
        ("on those that both solved", "A mean", "B mean", "A median", "B median")
    ]
    for part in ("TR1", *PARTS):
        columns: list[list[float]] = [[], []]
        for pair in pairs:
            values = [r.tr1 if part == "TR1" else r.parts.get(part) for r in pair]
            if values[0] is not None and values[1] is not None:
                columns[0].append(values[0])
                columns[1].append(values[1])
        cells = [figure(c, f) for f in (statistics.fmean, statistics.median) for c in columns]
        table.append((part if part == "TR1" else f"{part} (weighted)", *cells))
    return table


def _ratios(pairs: list[tuple[Result, Result]]) -> str:
    """Ratio of the means, median of the ratios, and who wins how often."""
    costs = [(x.tr1 or 0.0, y.tr1 or 0.0) for x, y in pairs]
    a_mean, b_mean = (statistics.fmean(column) for column in zip(*costs, strict=True))
    ratios = [x / y for x, y in costs if y > 0]
    tie = [math.isclose(x, y, rel_tol=_TIE) for x, y in costs]
    a_wins = sum(x < y and not t for (x, y), t in zip(costs, tie, strict=True))
    b_wins = len(costs) - a_wins - sum(tie)
    of_means = f"{a_mean / b_mean:.3f}" if b_mean > 0 else "-"
    return (
        f"A / B: ratio of the means {of_means}, "
        f"median of the ratios {figure(ratios, statistics.median)}; "
        f"A is better on {a_wins}, B on {b_wins}, equal on {sum(tie)}"
    )
