"""What all figures of the report have in common."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from mpcplan.show import colours

WIDTH, HEIGHT = 590, 340  # pixels; two of these fit beside each other on a laptop and on paper
LEAST = 1e-3  # of costs on logarithmic axes: a drive may cost nothing
_DASHES = ("solid", "dash", "dot", "dashdot")
_FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Liberation Sans', Arial, sans-serif"
_STEPS: tuple[tuple[float, tuple[float, ...]], ...] = (
    (1.0, (1, 1.5, 2, 3, 5, 7)),
    (2.5, (1, 2, 5)),
    (math.inf, (1,)),
)  # ticks within a decade where at most so many are shown
_DIGITS = 5  # significant ones of what is drawn
_HEAD, _LEGEND_LINE, _FOOT, _LEFT, _RIGHT = 40, 20, 52, 58, 14  # pixels
_ENTRY, _CHARACTER = 46, 6.0  # pixels of an entry of the legend, besides its characters


def colour(index: int) -> str:
    """Of the index-th run."""
    return colours.of_variant(index)


def dash(index: int) -> str:
    """Of the index-th run: tells runs apart whose colours are equal."""
    return _DASHES[index // len(colours.VARIANTS) % len(_DASHES)]


def figure(title: str, height: int = HEIGHT, legend: Sequence[str] = ()) -> go.Figure:
    """An empty figure; ``legend`` has the names in the legend above the axes, none without one."""
    margin = {"t": _HEAD + _lines(legend) * _LEGEND_LINE, "b": _FOOT, "l": _LEFT, "r": _RIGHT}
    top = {"text": title, "x": 0.01, "xanchor": "left", "y": 1 - 8 / height, "yanchor": "top"}
    return go.Figure(
        layout={
            "template": "none", "width": WIDTH, "height": height, "margin": margin,
            "title": {**top, "font": {"size": 14}},
            "font": {"family": _FONT, "size": 12, "color": "#222"},
            "paper_bgcolor": "#fff", "plot_bgcolor": "#fff", "showlegend": len(legend) > 0,
            "legend": {"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom",
                       "font": {"size": 11}, "traceorder": "normal"},
            "xaxis": _axis(), "yaxis": _axis(), "hoverlabel": {"namelength": -1},
        }
    )  # fmt: skip


def _lines(legend: Sequence[str]) -> int:
    """How many lines the legend takes: its entries are as wide as the longest of them."""
    if not legend:
        return 0
    entry = _ENTRY + _CHARACTER * max(map(len, legend))
    return math.ceil(len(legend) / max((WIDTH - _LEFT - _RIGHT) // entry, 1))


def _axis() -> dict[str, Any]:
    return {
        "gridcolor": colours.GRID, "linecolor": colours.EDGE, "zeroline": False, "ticks": "outside",
        "tickcolor": colours.EDGE, "automargin": True, "title": {"standoff": 8},
    }  # fmt: skip


def logarithmic(low: float, high: float) -> dict[str, Any]:
    """A logarithmic axis between two values, with more ticks where few decades are shown."""
    decades = math.log10(high / low)
    steps = next(steps for most, steps in _STEPS if decades <= most)
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    ticks = [step * 10.0**exponent for exponent in exponents for step in steps]
    return {
        "type": "log", "range": [math.log10(low), math.log10(high)],
        "tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks],
    }  # fmt: skip


def share_axis() -> dict[str, Any]:
    """An axis of shares from none to all."""
    return {"range": [0, 1.02], "tickformat": ".0%", "title": {"text": "share of the scenarios"}}


def distribution(
    values: Sequence[float], names: Sequence[str], label: str, index: int, unit: str, **line: Any
) -> go.Scatter:
    """The share of the scenarios whose value is at most so much, as steps."""
    order = np.argsort(values, kind="stable")
    ordered = [values[i] for i in order]
    shares = (np.arange(len(ordered)) + 1) / max(len(ordered), 1)
    return go.Scatter(
        x=rounded(ordered), y=rounded(shares), text=[names[i] for i in order], name=label,
        mode="lines", line={"shape": "hv", "color": colour(index), "dash": dash(index), **line},
        hovertemplate=f"%{{text}}<br>%{{x:.3~g}} {unit}<extra>{label}</extra>",
    )  # fmt: skip


def rounded(values: Any) -> list[float]:
    """Numbers with as many digits as can be seen."""
    return [float(f"{value:.{_DIGITS}g}") for value in values]


def as_json(shown: go.Figure) -> str:
    """A figure for plotly.js, safe within a script element."""
    return safe_json(json.loads(shown.to_json()))


def safe_json(value: Any) -> str:
    """JSON that ends no script element, whatever texts it holds."""
    text = json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


_BOX = {"lowerfence": 5, "q1": 25, "median": 50, "q3": 75, "upperfence": 95}


def box(values: Sequence[float]) -> dict[str, float]:
    """What a box shows of some values: quartiles, 5th and 95th percentile."""
    return {name: float(np.percentile(values, at)) for name, at in _BOX.items()}


def boxes(
    names: Sequence[str], shown: Sequence[dict[str, float]], label: str, index: int
) -> go.Box:
    """Boxes of one run side by side."""
    fields = {name: rounded(one[name] for one in shown) for name in _BOX}
    return go.Box(x=list(names), name=label, marker_color=colour(index), line_width=1.5, **fields)
