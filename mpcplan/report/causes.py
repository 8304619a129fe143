"""Why scenarios are not solved: causes of one kind together, whatever numbers they name."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from mpcplan.report.read import Entry, Results

_NUMBER = re.compile(r"-?\d+(\.\d+)?(e[+-]?\d+)?")
_PLACES = re.compile(r",? (?:near|at|of|by|to)(?: (?:step|problem|x|y|obstacle))? …[^;:]*$")
_FIRST_FALLBACK = "first fallback"
_PROBLEM = re.compile(r"^problem -?\d+: ")
UNKNOWN = "no cause told"


@dataclass(frozen=True)
class Cause:
    """One kind of cause.

    Attributes:
        status: how the runs ended.
        what: what went wrong, without numbers.
        before: what the planner said of it: the first fallback, or why no plan was found; or ''.
        scenarios: the ids of every run, in the order of the runs.
        example: one cause as it was told.
    """

    status: str
    what: str
    before: str
    scenarios: tuple[tuple[str, ...], ...]
    example: str

    @property
    def count(self) -> int:
        """Of all runs together."""
        return sum(map(len, self.scenarios))


def causes(runs: Sequence[Results]) -> list[Cause]:
    """The kinds of causes in all runs, the most frequent first."""
    found: dict[tuple[str, str, str], list[list[Entry]]] = defaultdict(lambda: [[] for _ in runs])
    for index, run in enumerate(runs):
        for entry in run.entries:
            if not entry.valid:
                kind = (entry.status, *kind_of(entry.texts.get("cause", "")))
                found[kind][index].append(entry)
    told = [_cause(*kind, groups) for kind, groups in found.items()]
    return sorted(told, key=lambda one: (-one.count, one.status, one.what, one.before))


def _cause(status: str, what: str, before: str, groups: list[list[Entry]]) -> Cause:
    example = next(entry for group in groups for entry in group).texts.get("cause", "")
    scenarios = tuple(tuple(entry.scenario for entry in group) for group in groups)
    return Cause(status, what, before, scenarios, example)


def kind_of(cause: str) -> tuple[str, str]:
    """What went wrong and what came before it, both without numbers and places.

    A cause is a sentence in clauses: 'the goal was not reached at step 165; first fallback at step
    138: a plan that can still be broken off is driven: ...'.
    """
    clauses = [_PROBLEM.sub("", clause.strip()) for clause in cause.split(";")]
    what = _without_places(clauses[0]) or UNKNOWN
    if len(clauses) < 2 or what.startswith("the scenario has no solution"):
        return what, ""
    head, *rest = clauses[1].split(": ")
    if head.startswith(_FIRST_FALLBACK) and rest:
        return what, f"{_FIRST_FALLBACK}: {_without_places(rest[0])}"
    return what, _without_places(head)


def _without_places(clause: str) -> str:
    """'collided' of 'collided at step 64'."""
    text = _PLACES.sub("", _NUMBER.sub("…", clause))
    return re.sub(r"\s+", " ", text).strip()
