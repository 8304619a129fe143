"""Figures of two runs against each other."""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go

from mpcplan.report.coverage import Pair
from mpcplan.report.figures import style
from mpcplan.show import colours

_BAR, _AROUND = 44, 130  # pixels of height per pair and around
_FILLED = 0.7  # of that height by the bar
_GROUPS = (
    ("both", "both", colours.GOAL),
    ("only_a", "only A", colours.PROBLEMS[0]),
    ("only_b", "only B", colours.PROBLEMS[1]),
    ("neither", "neither", "#bbbbbb"),
)
_WIDER = 1.3


def coverage_bars(pairs: Sequence[Pair]) -> go.Figure:
    """How many of the common scenarios both solved, only one of them, and neither."""
    height = max(_AROUND + _BAR * len(pairs), style.HEIGHT)
    shown = style.figure(
        "Solved of the scenarios in common",
        height=height,
        legend=[label for _, label, _ in _GROUPS],
    )
    names = [f"A: {pair.a}<br>B: {pair.b}" for pair in pairs]
    for field, label, colour in _GROUPS:
        counts = [len(getattr(pair, field)) for pair in pairs]
        shown.add_trace(
            go.Bar(
                y=names, x=counts, name=label, orientation="h", marker={"color": colour},
                text=[str(count) if count else "" for count in counts], textposition="inside",
                textangle=0, insidetextanchor="middle",
                hovertemplate=f"%{{y}}<br>{label}: %{{x}}<extra></extra>",
            )
        )  # fmt: skip
    gap = 1 - _BAR * _FILLED * len(pairs) / (height - _AROUND)
    shown.update_layout(barmode="stack", bargap=gap)
    shown.update_xaxes(title_text="scenarios")
    shown.update_yaxes(autorange="reversed", showgrid=False)
    return shown


def cost_scatter(pair: Pair, a: int, b: int) -> go.Figure:
    """TR1 of each scenario that both solved; ``a`` and ``b`` are the runs' numbers."""
    shown = style.figure(f"TR1 where both solved: {pair.b} cheaper below the line")
    costs = [[max(one, style.LEAST) for one in both] for both in pair.costs]
    every = [one for both in costs for one in both]
    low, high = min(every) / _WIDER, max(every) * _WIDER
    line = {"color": colours.LIMIT, "dash": "dash", "width": 1}
    shown.add_trace(
        go.Scatter(x=[low, high], y=[low, high], mode="lines", line=line, hoverinfo="skip")
    )
    shown.add_trace(
        go.Scatter(
            x=style.rounded(x for x, _ in costs), y=style.rounded(y for _, y in costs),
            text=list(pair.costed), mode="markers",
            marker={"size": 6, "opacity": 0.65, "color": style.colour(b)},
            hovertemplate=f"%{{text}}<br>{pair.a}: %{{x:.3~g}}<br>{pair.b}: %{{y:.3~g}}"
            "<extra></extra>",
        )
    )  # fmt: skip
    shown.update_xaxes(title_text=f"TR1, {pair.a}", **style.logarithmic(low, high))
    shown.update_yaxes(title_text=f"TR1, {pair.b}", **style.logarithmic(low, high))
    return shown


def ratios(pairs: Sequence[Pair]) -> go.Figure | None:
    """The distribution of the ratio of costs, for every pair that has one."""
    found = [pair for pair in pairs if pair.ratios]
    if not found:
        return None
    labels = [f"{pair.b} / {pair.a}" for pair in found]
    shown = style.figure("Ratio of TR1 where both solved", legend=labels)
    low, high = 1.0, 1.0
    for index, pair in enumerate(found):
        values = [max(ratio, style.LEAST) for ratio in pair.ratios]
        names = [n for n, (a, _) in zip(pair.costed, pair.costs, strict=True) if a > 0]
        shown.add_trace(style.distribution(values, names, labels[index], index, ""))
        low, high = min(low, *values), max(high, *values)
    shown.add_vline(x=1, line={"color": colours.LIMIT, "dash": "dash", "width": 1})
    shown.update_xaxes(
        title_text="TR1 of B / TR1 of A", **style.logarithmic(low / _WIDER, high * _WIDER)
    )
    shown.update_yaxes(**style.share_axis())
    return shown
