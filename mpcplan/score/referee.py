"""The official drivability checker, run in a child process.

The checker's extension modules can crash on some maps and print thousands of lines at exit, so it
never runs in the caller's process. The child (:mod:`mpcplan.score.referee_child`) takes a list of
tasks, the six checks and the cost, and appends one JSON line per finished task to a file. When it
dies in the middle of a task, that task has failed and a second child does those that remain. The
collision check on further traffic (a late replay) is a task of the same child: starting one takes
longer than most checks.
"""

import json
import math
import signal
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpcplan.errors import InputError, RefereeError
from mpcplan.score.referee_start import Start, as_program
from mpcplan.score.tr1 import CHECKER_WEIGHTS, REPORT_WEIGHTS, tr1
from mpcplan.score.verdict import CHECKS, Verdict

__all__ = ["Verdict", "evaluate", "evaluate_with_late"]

LATE = "no_collision_late"
"""The task of the collision check on the late traffic."""
TASKS = (*CHECKS, "cost")
_NAMES = {
    "on_road": "the boundary check",
    "cost": "the cost evaluation",
    LATE: "the check no_collision on the late traffic",
}


@dataclass
class _Answers:
    """What the children have answered so far: one result per task and the common header."""

    tasks: tuple[str, ...]
    header: dict[str, Any] = field(default_factory=dict)
    results: dict[str, dict[str, Any]] = field(default_factory=dict)

    @property
    def missing(self) -> list[str]:
        """Tasks without a result, in their order."""
        return [task for task in self.tasks if task not in self.results]


def evaluate(
    scenario: str | Path, solution: str | Path, timeout_s: float = 180.0, start: Start = as_program
) -> Verdict:
    """Judge a solution file by the official checker.

    Args:
        scenario: CommonRoad scenario file.
        solution: CommonRoad solution file.
        timeout_s: time limit of one child process [s]; there are at most two.
        start: starts a child process.

    Raises:
        InputError: a file is missing, cannot be read, or the two do not belong together.
        RefereeError: the child died twice.
    """
    return _verdict(_ask(Path(scenario), Path(solution), timeout_s, start))


def evaluate_with_late(
    scenario: str | Path,
    late: str | Path,
    solution: str | Path,
    timeout_s: float = 180.0,
    start: Start = as_program,
) -> tuple[Verdict, bool, str]:
    """As :func:`evaluate`, with the official collision check on a second scenario of traffic.

    Returns:
        the verdict, whether the solution is free of collisions in ``late``, and the reason if not.
    """
    answers = _ask(Path(scenario), Path(solution), timeout_s, start, Path(late))
    answer = answers.results[LATE]
    return _verdict(answers), bool(answer["ok"]), str(answer["reason"])


def _ask(
    scenario: Path, solution: Path, timeout_s: float, start: Start, late: Path | None = None
) -> _Answers:
    """All answers, from a second child where the first one died."""
    for what, path in (("scenario", scenario), ("solution", solution), ("late scenario", late)):
        if path is not None and not path.is_file():
            raise InputError(f"{what} file not found: {path}")
    files = [str(path) for path in (scenario, solution)]
    options = ["--late", str(late)] if late is not None else []
    answers = _Answers((*TASKS, LATE) if late is not None else TASKS)
    end = _run_child(files, options, timeout_s, start, answers)
    if end.broken:
        _give_up(end, answers)
        end = _run_child(files, options, timeout_s, start, answers)
        if end.broken:
            raise RefereeError(f"the official checker died twice, last {end}")
    return answers


@dataclass(frozen=True)
class _End:
    """How a child ended: in which task ('' before the first), how, and its last words."""

    broken: bool
    task: str = ""
    how: str = ""
    last_words: str = ""

    def __str__(self) -> str:
        place = _NAMES.get(self.task, f"the check {self.task}") if self.task else "the start"
        return f"checker {self.how} during {place}" + (
            f": {self.last_words}" if self.last_words else ""
        )


def _give_up(end: _End, answers: _Answers) -> None:
    """Count the task in which the child died as failed, so that the next child goes on after."""
    if end.task:
        answers.results[end.task] = {"ok": False, "reason": str(end)}


def _run_child(
    files: list[str], options: list[str], timeout_s: float, start: Start, answers: _Answers
) -> _End:
    """One child for the tasks that are missing; its answers are added to ``answers``."""
    with tempfile.TemporaryDirectory(prefix="mpcplan-referee-") as folder:
        answer, log = Path(folder, "answer.jsonl"), Path(folder, "log.txt")
        code = start([*files, str(answer), *answers.missing, *options], log, timeout_s)
        current, done = _read(answer, answers)
        if done:
            return _End(broken=False)
        how = f"did not finish within {timeout_s:g} s" if code is None else _death(code)
        return _End(True, current, how, _last_words(log))


def _read(answer: Path, answers: _Answers) -> tuple[str, bool]:
    """Take over the child's lines; returns the task it was at and whether it came to the end."""
    current, done = "", False
    for line in answer.read_text(encoding="utf-8").splitlines() if answer.exists() else []:
        try:
            message = json.loads(line)
        except json.JSONDecodeError:  # cut off in the middle by the child's death
            break
        if "input_error" in message:
            raise InputError(message["input_error"])
        if "begin" in message:
            current = message["begin"]
        elif "task" in message:
            answers.results[message.pop("task")] = message
            current = ""
        elif "header" in message:
            answers.header = message["header"]
        else:
            done = True
    return current, done


def _death(code: int) -> str:
    """'crashed (signal 11, SIGSEGV)' or 'ended with code 3'."""
    if code >= 0:
        return f"ended with code {code}"
    try:
        return f"crashed (signal {-code}, {signal.Signals(-code).name})"
    except ValueError:
        return f"crashed (signal {-code})"


def _last_words(log: Path) -> str:
    """The last line of a log that is not a leak report of the extension modules."""
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    words = [x.strip() for x in lines if x.strip() and not x.lstrip().startswith(("nanobind", "-"))]
    return words[-1][:200] if words else ""


def _verdict(answers: _Answers) -> Verdict:
    """The verdict from all tasks' results."""
    results = answers.results
    checks = {name: bool(results[name]["ok"]) for name in CHECKS}
    reasons = {name: results[name]["reason"] for name in CHECKS if not checks[name]}
    parts, cost_error = results["cost"].get("parts"), results["cost"].get("reason", "")
    if parts is not None and not all(math.isfinite(value) for value in parts.values()):
        parts, cost_error = None, f"the cost is not finite: {parts}"
    return Verdict(
        scenario=answers.header["scenario"],
        checks=checks,
        reasons=reasons,
        valid=all(checks.values()),
        parts=parts,
        tr1=None if parts is None else tr1(parts, CHECKER_WEIGHTS),
        tr1_report=None if parts is None else tr1(parts, REPORT_WEIGHTS),
        cost_error=cost_error,
        duration_s=answers.header["duration_s"],
    )
