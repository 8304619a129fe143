"""What the traces of a run tell: each in words, and the times of the stages over all of them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mpcplan.errors import InputError
from mpcplan.explain.read import Trace, read_trace
from mpcplan.explain.run import run_lines
from mpcplan.report.read import Results
from mpcplan.report.tables import NOTHING, Table
from mpcplan.trajectory import Array

TOTAL = "total"
PERCENTILES = (50, 95, 100)
_CAUSE = "cause "
_LONGEST = 320  # characters of a line; `explain` tells all of it


@dataclass(frozen=True)
class Told:
    """One trace.

    Attributes:
        words: what `explain` says of the run without its cause, which the row tells, and with long
            lines cut; or why it cannot be told.
        times: [ms] of every cycle by stage.
    """

    words: str
    times: Mapping[str, Sequence[float]]


def tell(path: Path) -> Told:
    """A trace in words, with its times; one that is broken is told as such."""
    try:
        trace = read_trace(path)
        lines = [line for line in run_lines(trace)[1:] if not line.startswith(_CAUSE)]
        return Told("\n".join(map(_cut, lines)), _times(trace))
    except InputError as error:
        return Told(str(error), {})
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        return Told(f"{path} is a trace of another version: {type(error).__name__}: {error}", {})


def _cut(line: str) -> str:
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 2]} …"


def _times(trace: Trace) -> dict[str, list[float]]:
    times: dict[str, list[float]] = defaultdict(list)
    for drive in trace["drives"]:
        for cycle in drive["cycles"]:
            for stage, spent in cycle["times_ms"].items():
                times[stage].append(float(spent))
    return dict(times)


def stage_times(told: Sequence[Told]) -> dict[str, Array]:
    """Times [ms] by stage over all cycles of some traces, each (n,), those of whole cycles last."""
    found: dict[str, list[float]] = defaultdict(list)
    for one in told:
        for stage, times in one.times.items():
            found[stage] += times
    total = found.pop(TOTAL, [])
    whole = {**found, TOTAL: total} if total else found
    return {stage: np.array(times) for stage, times in whole.items() if times}


def percentiles(times: Array) -> tuple[float, ...]:
    """The median, the 95th percentile and the longest [ms]."""
    return tuple(float(value) for value in np.percentile(times, PERCENTILES))


def stages_of(times: Sequence[Mapping[str, Array]]) -> list[str]:
    """The stages of all runs in the order in which a cycle works, whole cycles last."""
    known = dict.fromkeys(stage for one in times for stage in one if stage != TOTAL)
    return [*known, TOTAL] if any(TOTAL in one for one in times) else list(known)


def stage_table(runs: Sequence[Results], times: Sequence[Mapping[str, Array]]) -> Table | None:
    """One row per stage, for each run cycles and percentiles; None where there is no trace."""
    shown = [(run.name, one) for run, one in zip(runs, times, strict=True) if one]
    if not shown:
        return None
    rows = []
    for stage in stages_of(times):
        cells = [stage]
        for _, one in shown:
            cells += _stage_cells(one.get(stage))
        rows.append(tuple(cells))
    names = ("cycles", "p50 [ms]", "p95 [ms]", "longest [ms]")
    groups = tuple((name, len(names)) for name, _ in shown) if len(runs) > 1 else ()
    head = ("stage", *names * len(shown))
    return Table(head, tuple(rows), groups, last_is_all=stages_of(times)[-1] == TOTAL)


def _stage_cells(times: Array | None) -> list[str]:
    if times is None:
        return [NOTHING] * (1 + len(PERCENTILES))
    return [str(len(times)), *(f"{value:.1f}" for value in percentiles(times))]
