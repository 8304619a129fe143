"""Figures of planning times and of the traffic rules."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import plotly.graph_objects as go

from mpcplan.report.figures import style
from mpcplan.report.read import Results
from mpcplan.report.tables import RULES, Rule, keeping
from mpcplan.report.traces import percentiles, stages_of
from mpcplan.rules.keeping import KEEPING
from mpcplan.show import colours
from mpcplan.trajectory import Array

_WIDER = 1.2
_LEAST_MS = 0.01
_PER_STAGE, _AROUND = 30, 130  # pixels of height
_BETWEEN = 0.7  # of the distance of two stages, for the runs
_SYMBOLS = (("p50", "circle"), ("p95", "circle-open"), ("longest", "line-ns-open"))
_KEEPING_COLOURS = dict(
    zip(KEEPING, (colours.GOAL, "#56B4E9", "#E69F00", colours.ALARM), strict=True)
)
_CYCLE = (("plan_p50_ms", "p50", 2.0), ("plan_p95_ms", "p95", 1.2))


def cycle_times(runs: Sequence[Results]) -> go.Figure | None:
    """The distribution over the scenarios of the percentiles of their cycles' times."""
    found = [(i, run) for i, run in enumerate(runs) if run.numbers("plan_p95_ms", solved=False)]
    if not found:
        return None
    told = _labels([run.name for _, run in found], [label for _, label, _ in _CYCLE], runs)
    shown = style.figure("Time of a planning cycle, by scenario", legend=told)
    every: list[float] = []
    for index, run in found:
        for column, label, width in _CYCLE:
            entries = [entry for entry in run.entries if column in entry.numbers]
            values = [max(entry.numbers[column], _LEAST_MS) for entry in entries]
            names = [entry.scenario for entry in entries]
            pattern = {"width": width} if label == "p50" else {"width": width, "dash": "dot"}
            name = f"{run.name}, {label}" if len(runs) > 1 else label
            shown.add_trace(style.distribution(values, names, name, index, "ms", **pattern))
            every += values
    shown.update_xaxes(
        title_text="time [ms]", **style.logarithmic(min(every) / _WIDER, max(every) * _WIDER)
    )
    shown.update_yaxes(**style.share_axis())
    return shown


def _labels(names: Sequence[str], percentiles: Sequence[str], runs: Sequence[Results]) -> list[str]:
    """Of the lines, one per run and percentile; the run is named where there are several."""
    return [f"{name}, {p}" if len(runs) > 1 else p for name in names for p in percentiles]


def stage_times(runs: Sequence[Results], times: Sequence[Mapping[str, Array]]) -> go.Figure | None:
    """Median, 95th percentile and longest time of every stage, of each run."""
    found = [
        (i, run.name, one) for i, (run, one) in enumerate(zip(runs, times, strict=True)) if one
    ]
    if not found:
        return None
    stages = stages_of(times)
    height = max(_AROUND + len(stages) * max(_PER_STAGE, 14 * len(found)), style.HEIGHT)
    told = _labels([name for _, name, _ in found], [label for label, _ in _SYMBOLS], runs)
    shown = style.figure("Time of the stages of a cycle", height=height, legend=told)
    every: list[float] = []
    for place, (index, name, one) in enumerate(found):
        offset = _BETWEEN * ((place + 0.5) / len(found) - 0.5)
        known = [(row + offset, percentiles(one[s])) for row, s in enumerate(stages) if s in one]
        for which, (label, symbol) in enumerate(_SYMBOLS):
            values = [max(figures[which], _LEAST_MS) for _, figures in known]
            every += values
            shown.add_trace(
                go.Scatter(
                    x=style.rounded(values), y=[y for y, _ in known], mode="markers",
                    name=f"{name}, {label}" if len(runs) > 1 else label,
                    marker={"symbol": symbol, "size": 9, "color": style.colour(index),
                            "line": {"width": 2, "color": style.colour(index)}},
                    hovertemplate=f"%{{x:.3~g}} ms<extra>{label}</extra>",
                )
            )  # fmt: skip
    shown.update_xaxes(
        title_text="time [ms]", **style.logarithmic(min(every) / _WIDER, max(every) * _WIDER)
    )
    shown.update_yaxes(
        tickvals=list(range(len(stages))), ticktext=stages, range=[len(stages) - 0.5, -0.5]
    )
    return shown


def rules_kept(runs: Sequence[Results]) -> go.Figure | None:
    """The shares of the drives that kept each rule, and how the others did not."""
    found = [
        (f"{run.name}, {rule.column}" if len(runs) > 1 else rule.column, keeping(run, rule))
        for rule in RULES
        for run in runs
        if rule.column in run.columns
    ]
    found = [(name, counts) for name, counts in found if sum(counts.values())]
    if not found:
        return None
    shown = style.figure("Rules kept", legend=KEEPING)
    names = [name for name, _ in found]
    for word in KEEPING:
        counts = [one.get(word, 0) for _, one in found]
        shares = [n / sum(one.values()) for n, (_, one) in zip(counts, found, strict=True)]
        shown.add_trace(
            go.Bar(
                y=names, x=style.rounded(shares), name=word, orientation="h",
                marker={"color": _KEEPING_COLOURS[word]}, customdata=counts,
                text=[str(count) if count else "" for count in counts], textposition="inside",
                textangle=0, insidetextanchor="middle",
                hovertemplate=f"%{{y}}<br>{word}: %{{customdata}} (%{{x:.1%}})<extra></extra>",
            )
        )  # fmt: skip
    shown.update_layout(barmode="stack", bargap=0.35)
    shown.update_xaxes(title_text="share of the drives", tickformat=".0%", range=[0, 1.02])
    shown.update_yaxes(autorange="reversed", showgrid=False)
    return shown


def robustness(runs: Sequence[Results], rule: Rule) -> go.Figure | None:
    """The distribution of a rule's lowest robustness; negative where it is violated."""
    found = [
        (index, run.name, [e for e in run.entries if rule.column in e.numbers])
        for index, run in enumerate(runs)
    ]
    found = [one for one in found if one[2]]
    if not found:
        return None
    title = f"{rule.column}, {rule.text}: lowest robustness"
    shown = style.figure(title, legend=[name for _, name, _ in found] if len(runs) > 1 else ())
    for index, name, entries in found:
        values = [entry.numbers[rule.column] for entry in entries]
        names = [entry.scenario for entry in entries]
        shown.add_trace(style.distribution(values, names, name, index, rule.unit))
    shown.add_vline(x=0, line={"color": colours.ALARM, "dash": "dash", "width": 1.5})
    shown.update_xaxes(title_text=f"robustness [{rule.unit}], negative: violated")
    shown.update_yaxes(**style.share_axis())
    return shown
