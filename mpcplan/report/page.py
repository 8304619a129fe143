"""The page: tables, figures and the data of its scripts, filled into the template."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import jinja2
import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

from mpcplan import __version__
from mpcplan.report import coverage, tables
from mpcplan.report.causes import causes
from mpcplan.report.figures import costs, others, pairs, style
from mpcplan.report.picks import Picks
from mpcplan.report.read import Results
from mpcplan.report.rows import Row, rows_of, table_data
from mpcplan.report.settings import differences
from mpcplan.report.tables import RULES, Table
from mpcplan.report.traces import stage_table, stage_times

_FOLDER = Path(__file__).parent / "assets"
_COUNTS = "Counts lead to the scenarios."
_SCATTERS = 6  # pairs of runs whose costs are drawn against each other


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes:
        id: for links to it.
        title: its heading.
        text: a paragraph on how to read it.
        tables: with a caption each.
        figures: in their order.
        missing: why there is nothing, where there is nothing.
        hint: what a click does, which a printed page does not tell.
    """

    id: str
    title: str
    text: str
    tables: tuple[tuple[str, Table], ...]
    figures: tuple[go.Figure, ...]
    missing: str = ""
    hint: str = ""


def page_of(
    runs: Sequence[Results], page: Path, title: str, embed: bool, doing: Callable[[str], None]
) -> str:
    """The whole page as text.

    Args:
        runs: what to report on.
        page: file that the page will be, to which links are relative.
        title: its heading.
        embed: put the pictures into the page.
        doing: told what is being done.
    """
    rows, picks = rows_of(runs, doing), Picks(runs)
    doing("tables and figures")
    sections = _sections(runs, rows, picks)
    data = table_data(rows, page, embed) | {"picks": picks.as_lists()}
    figures = [figure for section in sections for figure in section.figures]
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_FOLDER),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html.jinja").render(
        title=title,
        version=__version__,
        runs=runs,
        sections=sections,
        pictures=sum(row.files.picture is not None for row in rows),
        count=len(rows),
        embed=embed,
        data=style.safe_json(data),
        figures=f"[{','.join(map(style.as_json, figures))}]",
        plotly=get_plotlyjs(),
        style=_source("style.css"),
        scripts=[_source("table.js"), _source("figures.js")],
    )


def _source(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")


def _sections(runs: Sequence[Results], rows: Sequence[Row], picks: Picks) -> list[Section]:
    against = [_against(runs, picks)] if len(runs) > 1 else []
    return [
        _summary(runs),
        *against,
        _maps(runs, picks),
        _costs(runs),
        _gap(runs),
        _times(runs, rows),
        _causes(runs, picks),
        _rules(runs),
    ]


def _present(*found: Any) -> tuple[Any, ...]:
    return tuple(one for one in found if one is not None)


def _captioned(*found: tuple[str, Table | None]) -> tuple[tuple[str, Table], ...]:
    return tuple((caption, table) for caption, table in found if table is not None)


def _summary(runs: Sequence[Results]) -> Section:
    text = (
        "TR1 is over valid solutions, under the checker's weights; the report mean has the lane "
        "offset weighted as in the competition report. Cycle times: medians over the scenarios of "
        "their p50 and p95, and the longest of all."
    )
    different = differences(runs) if len(runs) > 1 else None
    shown = _captioned(("", tables.summary(runs)), ("What the configurations differ in", different))
    return Section("summary", "Summary", text, shown, ())


def _against(runs: Sequence[Results], picks: Picks) -> Section:
    found = coverage.pairs_of(runs)
    title, text = "Against each other", "TR1 is compared where both have one."
    covered = picks.of_pairs(coverage.coverage(found), found)
    if not any(pair.common for pair in found):
        return Section("against", title, "", (), (), "The runs have no scenario in common.")
    numbers = list(combinations(range(len(runs)), 2))
    drawn = [(pair, which) for pair, which in zip(found, numbers, strict=True) if pair.costs]
    if len(drawn) > _SCATTERS:
        text += f" Costs are drawn of the first {_SCATTERS} of {len(drawn)} pairs."
    figures = _present(
        pairs.coverage_bars([pair for pair in found if pair.common]),
        *(pairs.cost_scatter(pair, a, b) for pair, (a, b) in drawn[:_SCATTERS]),
        pairs.ratios([pair for pair, _ in drawn[:_SCATTERS]]),
    )
    shown = _captioned(
        ("Solved, of the scenarios in common", covered),
        ("TR1 on the scenarios that both solved", coverage.costs(found) if drawn else None),
    )
    return Section("against", title, text, shown, figures, hint=_COUNTS)


def _maps(runs: Sequence[Results], picks: Picks) -> Section:
    shown = _captioned(("", picks.of_maps(tables.maps(runs))))
    text, hint = "TR1 is over each run's own valid solutions.", "A map leads to its scenarios."
    return Section("maps", "By map", text, shown, (), hint=hint)


def _costs(runs: Sequence[Results]) -> Section:
    figures = _present(
        costs.cost_distribution(runs), costs.mean_parts(runs), costs.parts_distribution(runs)
    )
    missing = "" if figures else "No scenario is solved with a cost."
    text = (
        f"Over each run's own valid solutions. On logarithmic axes costs below {style.LEAST:g} are "
        f"drawn as {style.LEAST:g}."
    )
    shown = _captioned(("", tables.parts(runs))) if figures else ()
    return Section("costs", "TR1 and its parts", text if figures else "", shown, figures, missing)


def _gap(runs: Sequence[Results]) -> Section:
    shown = _captioned(("", tables.gaps(runs)))
    figures = _present(costs.gap_distribution(runs))
    text = "TR1 as a multiple of the best known solution on the same traffic."
    missing = "" if shown else "No bounds were sought: mpcplan bench --bound does so."
    return Section("gap", "Gap to the bound", text if shown else "", shown, figures, missing)


def _times(runs: Sequence[Results], rows: Sequence[Row]) -> Section:
    times = [stage_times([row.told for row in rows if row.run is run]) for run in runs]
    figures = _present(others.cycle_times(runs), others.stage_times(runs, times))
    shown = _captioned(("Stages, over all cycles of all traces", stage_table(runs, times)))
    missing = "" if figures else "The tables have no planning times, and there are no traces."
    if figures and not shown:
        missing = "There are no traces, which tell the times of the stages."
    text = "Wall-clock times of the machine on which each run was made." if figures else ""
    return Section("times", "Planning times", text, shown, figures, missing)


def _causes(runs: Sequence[Results], picks: Picks) -> Section:
    found = causes(runs)
    shown = _captioned(("", picks.causes(found) if found else None))
    missing = "" if found else "Every scenario is solved."
    text, hint = ("Causes that differ in numbers only are one.", _COUNTS) if found else ("", "")
    return Section("causes", "What was not solved", text, shown, (), missing, hint)


def _rules(runs: Sequence[Results]) -> Section:
    shown = _captioned(("", tables.rules(runs)))
    figures = _present(others.rules_kept(runs), *(others.robustness(runs, r) for r in RULES))
    text = (
        "Of everything that was driven, valid or not. Robustness is negative where a rule is "
        "violated. Regained: violated at the start, which is not the planner's doing, but kept "
        "soon after."
    )
    missing = "" if shown else "The tables have no columns of traffic rules."
    return Section("rules", "Traffic rules", text if shown else "", shown, figures, missing)
