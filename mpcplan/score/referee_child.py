"""Child process of :mod:`mpcplan.score.referee`: the official checks, one by one.

Usage: python -m mpcplan.score.referee_child SCENARIO SOLUTION ANSWER TASK... [--late SCENARIO]

Appends JSON lines to ANSWER: a header, then ``{"begin": task}`` and ``{"task": task, "ok": ...,
"reason": ...}`` for each task, ``{"end": true}`` at last; or ``{"input_error": message}``. The task
:data:`LATE` is the collision check on the scenario of ``--late``.
Whatever the checker prints goes to this process's stdout and stderr, which the parent keeps.
"""

import argparse
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpcplan.errors import InputError
from mpcplan.score import locate, official
from mpcplan.score.official import Case
from mpcplan.score.referee import LATE


def run(
    scenario: Path, solution: Path, answer: Path, tasks: list[str], late: Path | None = None
) -> None:
    """Do the tasks and write the answers."""
    with answer.open("a", encoding="utf-8", buffering=1) as out:

        def say(message: dict[str, Any]) -> None:
            out.write(json.dumps(message) + "\n")
            out.flush()

        try:
            case = official.read_case(scenario, solution)
            late_case = official.read_case(late, solution) if late is not None else None
        except InputError as error:
            say({"input_error": str(error)})
            return
        say({"header": {"scenario": case.id, "duration_s": case.duration_s}})
        for task in tasks:
            say({"begin": task})
            say({"task": task, **_answer(case, late_case, task)})
        say({"end": True})


def _answer(case: Case, late: Case | None, task: str) -> dict[str, Any]:
    """What is said of one task."""
    if task == "cost":
        return _cost(case)
    if task == LATE and late is not None:
        return _check(late, "no_collision")
    return _check(case, task)


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
    parser = argparse.ArgumentParser(prog="mpcplan.score.referee_child")
    for name in ("scenario", "solution", "answer"):
        parser.add_argument(name, type=Path)
    parser.add_argument("tasks", nargs="+")
    parser.add_argument("--late", type=Path)
    run(**vars(parser.parse_args()))
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # skips the extension modules' leak reports, which take a while
