"""What refused plans and candidates: collisions foreseen, and with whom, from the trace."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

_FOUND = re.compile(
    r"(?P<check>kinematics|collision|road)(?: with obstacle (?P<obstacle>-?\d+))? "
    r"at step (?P<step>\d+)(?: \((?P<size>[^)]*)\))?"
)
TOLD_OBSTACLES = 4
TOLD_CONSTRAINTS = 5
COLLISION = "collision"


@dataclass(frozen=True)
class Refused:
    """Why verification refused a plan: check, obstacle (None: nobody), time step, by how much."""

    check: str
    obstacle: int | None
    step: int
    size: str

    def __str__(self) -> str:
        who = f" with obstacle {self.obstacle}" if self.obstacle is not None else ""
        size = f", {self.size}" if self.size else ""
        return f"{self.check}{who} at step {self.step}{size}"


def refused_plans(cycle: dict[str, Any]) -> list[Refused]:
    """What verification refused in a cycle, as far as its fallback tells; equal ones once."""
    found = [
        Refused(
            m["check"], int(m["obstacle"]) if m["obstacle"] else None, int(m["step"]),
            m["size"] or "",
        )
        for m in _FOUND.finditer(cycle.get("fallback") or "")
        if "refused by" not in (cycle["fallback"] or "")[max(m.start() - 12, 0) : m.start()]
    ]  # fmt: skip
    return list(dict.fromkeys(found))


def once(text: str) -> str:
    """Reasons, each told once: a plan that is refined twice may be refused twice for the same."""
    return "; ".join(dict.fromkeys(text.split("; ")))


def obstacles_of(cycle: dict[str, Any]) -> set[int]:
    """Who was in the way of plans or candidates in a cycle."""
    plans = {r.obstacle for r in refused_plans(cycle) if r.obstacle is not None}
    rejections = (report["rejected"].get(COLLISION) for report in cycle["seeds"].values())
    known = {r["obstacle"] for r in rejections if r and r["obstacle"] is not None}
    return plans | known


def feared_lines(cycles: Sequence[dict[str, Any]]) -> list[str]:
    """Who was in the way in how many cycles, the most frequent first."""
    counts = Counter(who for cycle in cycles for who in sorted(obstacles_of(cycle)))
    if not counts:
        return ["feared    nobody: no plan or candidate met anybody"]
    told = []
    for who, count in counts.most_common(TOLD_OBSTACLES):
        steps = [cycle["step"] for cycle in cycles if who in obstacles_of(cycle)]
        told.append(f"obstacle {who} in {count} (steps {steps[0]} to {steps[-1]})")
    more = len(counts) - TOLD_OBSTACLES
    rest = f", {more} more" if more > 0 else ""
    return [f"feared    of {len(cycles)} cycles: {', '.join(told)}{rest}"]


def candidates_line(cycles: Iterable[dict[str, Any]]) -> str:
    """How many candidates of the whole run were drivable, and what refused the others."""
    tried = accepted = 0
    refused: Counter[str] = Counter()
    for cycle in cycles:
        for report in cycle["seeds"].values():
            tried += report["candidates"]
            accepted += report["accepted"]
            for name, one in report["rejected"].items():
                refused[name] += one["count"]
    if not tried:
        return "tried     no candidates"
    told = ", ".join(f"{name} {count}" for name, count in refused.most_common(TOLD_CONSTRAINTS))
    why = f"; refused by {told}" if told else ""
    return f"tried     {tried} candidates, {accepted} of them drivable{why}"
