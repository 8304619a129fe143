"""Child process of :mod:`mpcplan.score.referee`: the official checks, one by one.

Usage: python -m mpcplan.score.referee_child SCENARIO SOLUTION ANSWER TASK...

Appends JSON lines to ANSWER: a header, then ``{"begin": task}`` and ``{"task": task, "ok": ...,
"reason": ...}`` for each task, ``{"end": true}`` at last; or ``{"input_error": message}``.
Whatever the checker prints goes to this process's stdout and stderr, which the parent keeps.
"""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpcplan.errors import InputError
from mpcplan.score import locate, official
from mpcplan.score.official import Case


def run(scenario: Path, solution: Path, answer: Path, tasks: list[str]) -> None:
    """Do the tasks and write the answers."""
    with answer.open("a", encoding="utf-8", buffering=1) as out:

        def say(message: dict[str, Any]) -> None:
            out.write(json.dumps(message) + "\n")
            out.flush()

        try:
            case = official.read_case(scenario, solution)
        except InputError as error:
            say({"input_error": str(error)})
            return
        say({"header": {"scenario": case.id, "duration_s": case.duration_s}})
        for task in tasks:
            say({"begin": task})
            say({"task": task, **(_cost(case) if task == "cost" else _check(case, task))})
        say({"end": True})


def _check(case: Case, name: str) -> dict[str, Any]:
    """The verdict of one official check, with the place of its failure."""
    try:
        if official.CHECKS[name](case):
            return {"ok": True, "reason": ""}
        error = None
    except Exception as caught:  # the checker says 'no' by raising, and raises when it cannot say
        error = caught
    return {"ok": False, "reason": _reason(case, name, error)}


def _reason(case: Case, name: str, error: Exception | None) -> str:
    """Where the check failed; the checker's own words when that cannot be found out."""
    find: Callable[[Case], str] = locate.FINDERS[name]
    try:
        found = find(case)
    except Exception:  # the finder meets what the checker met, whose words are then the reason
        found = ""
    return found or (describe(error) if error else "failed, no place found")


def _cost(case: Case) -> dict[str, Any]:
    """The unweighted partial costs, or why there are none."""
    try:
        return {"ok": True, "parts": official.partial_costs(case)}
    except Exception as error:  # outside the projection domain and the like: no cost, no crash
        return {"ok": False, "reason": describe(error)}


def describe(error: BaseException) -> str:
    """'Type: message (from Type: message)' on one line."""
    text = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    return f"{text} (from {describe(error.__cause__)})" if error.__cause__ else text


if __name__ == "__main__":
    run(Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]), sys.argv[4:])
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # skips the extension modules' leak reports, which take a while
