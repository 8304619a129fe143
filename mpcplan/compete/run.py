"""The competition run: every scenario of a folder, easiest first, within a budget of time."""

import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from mpcplan.bench.attempt import Attempt
from mpcplan.bench.engine import Engine, open_engine, run_all
from mpcplan.bench.find import benchmark_id, find_scenarios, kind_of
from mpcplan.bench.job import OWN_PLANNER, Command, Limits, worker_command
from mpcplan.bench.progress import short
from mpcplan.bench.store import UNJUDGED, Row, empty_row
from mpcplan.compete.budget import Rule
from mpcplan.compete.estimate import Estimate, estimate
from mpcplan.compete.results import REPORT_COLUMNS, Results
from mpcplan.compete.schedule import RETRIED, Schedule, Turn, second_turn
from mpcplan.errors import InputError

BUDGET_S = 6 * 3600.0
"""The competition's time [s]."""


@dataclass(frozen=True)
class Result:
    """What a run leaves.

    Attributes:
        report: path of report.csv.
        rows: one per scenario, those that were not run included.
        interrupted: it was asked to stop.
    """

    report: Path
    rows: list[Row]
    interrupted: bool

    @property
    def solutions(self) -> int:
        """Number of solution files."""
        return sum(bool(row["solution"]) for row in self.rows)

    @property
    def unjudged(self) -> int:
        """How many of them the official checker has not seen."""
        return sum(row["status"] == UNJUDGED for row in self.rows)


def compete(
    scenarios: str | Path,
    out: str | Path,
    jobs: int = 2,
    budget_s: float = BUDGET_S,
    config_path: str | Path | None = None,
    overrides: Sequence[str] = (),
    memory_mb: float = 4000.0,
    planner: str = OWN_PLANNER,
    engine: Engine | None = None,
    rule: Rule | None = None,
    stop: Callable[[], bool] = lambda: False,
    command: Command = worker_command,
) -> Result:
    """Solve as many scenarios as the budget buys; a run that was stopped goes on where it was.

    Solutions appear in ``out`` as soon as they are found, whole. What an earlier run finished is
    not run again; what ended for lack of time, or was ended from outside, is.

    Args:
        scenarios: folder of scenarios, recorded (files) and interactive (folders).
        out: folder for the solutions, see :mod:`mpcplan.compete.results`.
        jobs: processes at a time, where no engine is given.
        budget_s: time for all [s].
        config_path: configuration file, None for the defaults.
        overrides: 'section.key=value'.
        memory_mb: limit of each process's address space [MB].
        planner: 'package.module:Class', or this package's own.
        engine: where the scenarios run, see :mod:`mpcplan.bench.engine`; it is closed at the end.
        rule: time limits, see :mod:`mpcplan.compete.budget`.
        stop: looked at several times a second; all that runs is stopped when it says so.
        command: makes the worker's command line (replaced in tests).

    Raises:
        InputError: bad paths, configuration or limits, or ``out`` cannot be written; what is
            finished is kept.
    """
    from mpcplan.config.files import dump_config, load_config

    deadline = time.monotonic() + budget_s
    with closing(engine or open_engine(jobs=jobs)) as running:
        if budget_s <= 0 or memory_mb <= 0:
            raise InputError("budget and memory must be positive")
        found = find_scenarios([scenarios], exclude=out)
        config = dump_config(load_config(config_path, overrides))
        with closing(Results(Path(out).resolve(), config, planner)) as results:
            task = _Task(found, config, planner, memory_mb, command)
            contest = _Contest(task, results, deadline)
            interrupted = contest.run(running, rule or Rule(), stop)
            return Result(contest.finish(), list(contest.rows.values()), interrupted)


@dataclass(frozen=True)
class _Task:
    """What is the same for all attempts."""

    scenarios: Mapping[str, Path]
    config: str
    planner: str
    memory_mb: float
    command: Command

    def attempt(self, turn: Turn) -> Attempt:
        """The attempt of a turn."""
        path, limits = self.scenarios[turn.name], Limits(turn.limit_s, self.memory_mb)
        return Attempt(
            turn.name, benchmark_id(path), path, kind_of(path),
            self.config, self.planner, limits, command=self.command,
        )  # fmt: skip

    def blank(self, name: str, status: str, cause: str) -> Row:
        """A row for a scenario that has none of its own."""
        path = self.scenarios[name]
        row = empty_row(benchmark_id(path), status, cause, kind_of(path), self.planner)
        return {column: row.get(column, "") for column in REPORT_COLUMNS}


class _Contest:
    """One run: turns, rows and the report."""

    def __init__(self, task: _Task, results: Results, deadline: float) -> None:
        """Everything that is known before the first attempt."""
        self._task, self._results, self._deadline = task, results, deadline
        self._estimates = {name: estimate(path) for name, path in task.scenarios.items()}
        twins = _twins(self._estimates)
        self.rows: dict[str, Row] = {}
        self._turns: dict[str, Turn] = {}
        for name, known in self._estimates.items():
            row = results.row(name)
            if name in twins:
                cause = f"has the same id as {twins[name]}: there is one solution file per id"
                self.rows[name] = task.blank(name, "bad_input", cause) | {"scenario": name}
                continue
            self.rows[name] = row or task.blank(name, "not_run", "its turn has not come yet")
            if row is None:
                self._turns[name] = Turn(1, False, known.seconds, name)
            elif row["status"] in RETRIED:
                self._turns[name] = second_turn(name, known.seconds, row)

    def run(self, engine: Engine, rule: Rule, stop: Callable[[], bool]) -> bool:
        """Run until all is done, the budget is used up, or ``stop``; whether it was stopped."""
        schedule = Schedule(rule, engine.slots, self._turns.values())
        self._begin()

        def next_attempt() -> Attempt | None:
            turn = schedule.next(self._remaining_s())
            if turn is None:
                return None
            self._turns[turn.name] = turn
            return self._task.attempt(turn)

        def over() -> bool:
            return stop() or self._remaining_s() <= 0

        with closing(run_all(engine, next_attempt, over)) as outcomes:
            for outcome in outcomes:
                turn = self._turns[outcome.name]
                row = self._results.accept(outcome, turn)
                if row is None:
                    continue
                self.rows[outcome.name] = row
                self._results.report(self.rows)
                schedule.again(turn, row)
                self._tell(row)
        self._name_the_rest("it was stopped" if stop() else "the budget ended")
        return stop()

    def _begin(self) -> None:
        self._results.report(self.rows)
        done = len(self.rows) - len(self._turns)
        if done:
            print(f"{done} of {len(self.rows)} scenarios have their results", file=sys.stderr)

    def _remaining_s(self) -> float:
        return self._deadline - time.monotonic()

    def _tell(self, row: Row) -> None:
        tried = sum(row["status"] != "not_run" for row in self.rows.values())
        left = f"{max(self._remaining_s(), 0.0) / 60:.0f} min left"
        print(f"[{tried}/{len(self.rows)}, {left}] {short(row)}", file=sys.stderr, flush=True)

    def _name_the_rest(self, why: str) -> None:
        """Say of scenarios without an attempt why they have none."""
        for row in self.rows.values():
            if row["status"] == "not_run":
                row["cause"] = f"{why} before it was done: start again with more time to go on"

    def finish(self) -> Path:
        """Write the last report."""
        return self._results.report(self.rows)


def _twins(estimates: Mapping[str, Estimate]) -> dict[str, str]:
    """Scenarios with the id of another one, which comes first, by name."""
    first: dict[str, str] = {}
    twins = {}
    for name, known in sorted(estimates.items()):
        if math.isfinite(known.seconds) and known.benchmark:
            other = first.setdefault(known.benchmark, name)
            if other != name:
                twins[name] = other
    return twins
