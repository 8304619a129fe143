"""A whole run in words: what was driven, which fallbacks acted, what surprised, what was slow."""

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from mpcplan.explain.fault import fault_line
from mpcplan.explain.feared import candidates_line, feared_lines, once
from mpcplan.explain.read import Trace

TOLD_FALLBACKS = 8
RISE = 2.0  # of cost from one cycle to the next that is told
TOLD_RISES = 5


def run_lines(trace: Trace, verdict: str = "", scenario: str = "") -> list[str]:
    """The run: one paragraph per planning problem, then its notes.

    Args:
        trace: the trace.
        verdict: what the official checker said, '' where that is not known.
        scenario: why nobody can solve the scenario, '' where that is not known.
    """
    lines = [str(trace.get("scenario", ""))]
    lines += [f"verdict   {verdict}"] if verdict else []
    for drive in trace["drives"]:
        lines += _drive_lines(drive, scenario)
    lines += [f"note      {note}" for note in trace.get("notes", ())]
    return lines


def _drive_lines(drive: dict[str, Any], scenario: str) -> list[str]:
    cycles = drive["cycles"]
    reached = drive.get("reached_step")
    end = f"reached the goal at step {reached}" if reached is not None else "did not reach the goal"
    if drive.get("collided"):
        end = "collided"
    lines = [f"problem {drive['problem']}: {end}"]
    fault = fault_line(drive, scenario)
    lines += [fault] if fault else []
    if drive.get("cause"):
        lines.append(f"cause     {once(drive['cause'])}")
    if not cycles:
        return [*lines, "cycles    none"]
    lines += [
        f"cycles    {len(cycles)}, planned by: {_counted(c['source'] for c in cycles)}",
        f"gained    {_gained(cycles)}",
        *_to_goal(cycles),
        candidates_line(cycles),
        *feared_lines(cycles),
        *_fallbacks(cycles),
        *_rises(cycles),
        *_lanes(cycles),
        *_game(cycles),
        f"times     {_times(cycles)}",
    ]
    return lines


def _counted(names: Iterable[str]) -> str:
    """'3 x a, 1 x b', the most frequent first."""
    return ", ".join(f"{count} x {name}" for name, count in Counter(names).most_common())


def _gained(cycles: Sequence[dict[str, Any]]) -> str:
    """What refinement gained over the seeds that it was given."""
    refined = [c["refine"] for c in cycles if c.get("refine")]
    if not refined:
        return "no plan is a refined one"
    before, after = (sum(r[key] for r in refined) for key in ("tr1_before", "tr1_after"))
    shorter = sum(r["status"] != "converged" for r in refined)
    told = f"refinement lowered the plans' TR1 from {before:.3f} to {after:.3f} in all"
    return told + (f"; {shorter} of {len(refined)} stopped early" if shorter else "")


def _to_goal(cycles: Sequence[dict[str, Any]]) -> list[str]:
    """The cycles whose plan does not reach the goal."""
    missing = [c["step"] for c in cycles if not c["chosen"]["reaches_goal"]]
    if not missing:
        return ["goal      every plan reached it"]
    return [f"goal      not reached by the plans of {_runs(missing, cycles)}"]


def _runs(steps: Sequence[int], cycles: Sequence[dict[str, Any]]) -> str:
    """Steps as ranges of successive cycles."""
    order = {c["step"]: i for i, c in enumerate(cycles)}
    ranges: list[list[int]] = []
    for step in steps:
        if ranges and order[step] == order[ranges[-1][1]] + 1:
            ranges[-1][1] = step
        else:
            ranges.append([step, step])
    told = [f"step {a}" if a == b else f"steps {a} to {b}" for a, b in ranges]
    return ", ".join(told)


def _fallbacks(cycles: Sequence[dict[str, Any]]) -> list[str]:
    """Which fallbacks acted how often, then the first of them with what refused better plans."""
    fell = [c for c in cycles if c.get("fallback")]
    kinds = _counted(c["fallback"].partition(":")[0] for c in fell)
    lines = [f"fallbacks {kinds}"] if len(fell) > 1 else []
    lines += [f"fallback  step {c['step']}: {once(c['fallback'])}" for c in fell[:TOLD_FALLBACKS]]
    if len(fell) > TOLD_FALLBACKS:
        lines.append(f"          and {len(fell) - TOLD_FALLBACKS} more, see --step")
    return lines or ["fallback  none was needed"]


def _rises(cycles: Sequence[dict[str, Any]]) -> list[str]:
    """Where the plan became dearer at once: something came that had not been expected."""
    lines = []
    for before, now in pairwise(cycles):
        a, b = before["chosen"]["cost"], now["chosen"]["cost"]
        if a is not None and b is not None and b > a + RISE:
            told = f"step {now['step']}: the plan's cost rose from {a:.1f} to {b:.1f}"
            lines.append(f"surprise  {told}; {now['refusals'] or 'no new seeds were sought'}")
    return lines[:TOLD_RISES]


def _game(cycles: Sequence[dict[str, Any]]) -> list[str]:
    played = [c["step"] for c in cycles if (c.get("game") or {}).get("actions")]
    if not played:
        return []
    return [f"game      played at {_runs(played, cycles)}; --step tells it"]


def _lanes(cycles: Sequence[dict[str, Any]]) -> list[str]:
    """Where the routes were built anew, from another lane."""
    found = [c for c in cycles if (c.get("association") or {}).get("reassociated")]
    return [f"lane      step {c['step']}: {c['association']['reason']}" for c in found]


def _times(cycles: Sequence[dict[str, Any]]) -> str:
    total = np.array([c["times_ms"]["total"] for c in cycles])
    slowest = cycles[int(total.argmax())]
    stages = {k: v for k, v in slowest["times_ms"].items() if k != "total"}
    stage = max(stages, key=lambda name: stages[name]) if stages else "nothing"
    p50, p95 = np.percentile(total, (50, 95))
    return (
        f"p50 {p50:.0f} ms, p95 {p95:.0f} ms, longest {total.max():.0f} ms at step "
        f"{slowest['step']}, there most of it for {stage}"
    )
