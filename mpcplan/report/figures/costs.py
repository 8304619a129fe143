"""Figures of costs: TR1 and its parts, the gap to the bound."""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go

from mpcplan.report.figures import style
from mpcplan.report.read import Results
from mpcplan.score.tr1 import PARTS
from mpcplan.show import colours

_WIDER = 1.3  # the logarithmic axes reach this factor beyond what they show
_PART_NAMES = {
    "Jlon": "jerk (Jlon)", "SR": "steering rate (SR)", "D": "distance (D)",
    "LC": "lane offset (LC)",
}  # fmt: skip


def cost_distribution(runs: Sequence[Results]) -> go.Figure | None:
    """TR1 of the solved scenarios."""
    return _distribution(runs, "TR1", "TR1 of the solved scenarios", "TR1", style.LEAST)


def gap_distribution(runs: Sequence[Results]) -> go.Figure | None:
    """TR1 as a multiple of the bound."""
    return _distribution(runs, "gap", "Gap to the bound", "TR1 / bound", 1.0)


def _distribution(
    runs: Sequence[Results], column: str, title: str, label: str, least: float
) -> go.Figure | None:
    found = [
        (
            index,
            run.name,
            [(e.numbers[column], e.scenario) for e in run.solved if column in e.numbers],
        )
        for index, run in enumerate(runs)
    ]
    found = [one for one in found if one[2]]
    if not found:
        return None
    shown = style.figure(title, legend=[name for _, name, _ in found])
    for index, name, pairs in found:
        values = [max(value, least) for value, _ in pairs]
        names = [scenario for _, scenario in pairs]
        shown.add_trace(style.distribution(values, names, name, index, ""))
    every = [max(value, least) for _, _, pairs in found for value, _ in pairs]
    shown.update_xaxes(
        title_text=label, **style.logarithmic(min(every) / 1.05, max(every) * _WIDER)
    )
    shown.update_yaxes(**style.share_axis())
    return shown


def parts_distribution(runs: Sequence[Results]) -> go.Figure | None:
    """The weighted parts of TR1 as boxes: quartiles, whiskers to the 5th and 95th percentile."""
    found = [(index, run) for index, run in enumerate(runs) if any(e.parts for e in run.solved)]
    if not found:
        return None
    shown = style.figure(
        "Weighted parts of TR1: 5, 25, 50, 75, 95 %", legend=[run.name for _, run in found]
    )
    highest = style.LEAST * 10
    for index, run in found:
        boxes = [
            style.box([max(e.parts.get(part, 0.0), style.LEAST) for e in run.solved if e.parts])
            for part in PARTS
        ]
        highest = max(highest, *(box["upperfence"] for box in boxes))
        shown.add_trace(style.boxes([_PART_NAMES[part] for part in PARTS], boxes, run.name, index))
    shown.update_layout(boxmode="group")
    shown.update_yaxes(title_text="cost", **style.logarithmic(style.LEAST, highest * _WIDER))
    return shown


def mean_parts(runs: Sequence[Results]) -> go.Figure | None:
    """The means of the weighted parts, one upon the other."""
    found = [run for run in runs if any(e.parts for e in run.solved)]
    if not found:
        return None
    shown = style.figure("Mean of TR1 by its weighted parts", legend=list(_PART_NAMES.values()))
    names = [run.name for run in found]
    for part, colour in zip(PARTS, colours.COSTS, strict=True):
        means = []
        for run in found:
            values = [e.parts.get(part, 0.0) for e in run.solved if e.parts]
            means.append(sum(values) / len(values))
        shown.add_trace(
            go.Bar(
                y=names, x=style.rounded(means), name=_PART_NAMES[part], orientation="h",
                marker={"color": colour}, hovertemplate=f"%{{y}}: %{{x:.3f}}<extra>{part}</extra>",
                texttemplate="%{x:.2f}", textposition="inside", insidetextanchor="middle",
                textangle=0,
            )
        )  # fmt: skip
    shown.update_layout(barmode="stack", bargap=0.35, legend_entrywidth=140)
    shown.update_xaxes(title_text="mean cost of the solved scenarios")
    shown.update_yaxes(autorange="reversed", showgrid=False)
    return shown
