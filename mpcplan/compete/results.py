"""The output folder of a competition run.

Layout::

    solution_KS1:TR1:<id>:2020a.xml   one per solved scenario, whole at any moment
    report.csv                        a line for every scenario, whole at any moment
    .mpcplan/                         a benchmark's folder (mpcplan.bench.store): rows, traces,
                                      logs, simulated traffic, and the invalid solutions too
"""

import fcntl
import os
from collections.abc import Mapping
from pathlib import Path

from mpcplan.bench.attempt import Outcome
from mpcplan.bench.files import write_whole, writing_to
from mpcplan.bench.store import COLUMNS, UNJUDGED, Row, Store, csv_text
from mpcplan.compete.schedule import Turn
from mpcplan.errors import InputError

WORK = ".mpcplan"
REPORT_COLUMNS = (*COLUMNS, "solution", "pass", "limit_s", "estimate_s")
"""Columns of report.csv: a benchmark's, the solution file, the pass and its time limit."""

_PUBLISHED = ("solved", UNJUDGED)


class Results:
    """What lies in the output folder."""

    def __init__(self, out: Path, config: str, planner: str) -> None:
        """Open or create the folder.

        Raises:
            InputError: it cannot be written, another run writes to it, or it holds results of
                another planner or configuration.
        """
        self.out, self._work = out, out / WORK
        with writing_to(out):
            (self._work / "tmp").mkdir(parents=True, exist_ok=True)
            self._lock()
        try:
            self._sweep()
            self._store = Store(self._work, config, planner, REPORT_COLUMNS)
        except BaseException:
            self.close()
            raise

    def _lock(self) -> None:
        """One run at a time; the lock goes with the process."""
        self._lock_file = os.open(self._work / "lock", os.O_RDWR | os.O_CREAT)
        try:
            fcntl.flock(self._lock_file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._lock_file)
            raise InputError(
                f"another run of mpcplan writes to {self.out}: wait for its end, or stop it"
            ) from None

    def _sweep(self) -> None:
        """Remove files that an earlier run was writing when it was killed."""
        with writing_to(self.out):
            for part in self._work.rglob(".*.part"):
                part.unlink(missing_ok=True)

    def close(self) -> None:
        """Give the folder to other runs."""
        os.close(self._lock_file)

    def row(self, name: str) -> Row | None:
        """The row of an earlier attempt; None: there is none, or its solution file is gone."""
        row = self._store.read(name)
        if row is not None and row["solution"] and not (self.out / row["solution"]).is_file():
            return None
        return row

    def accept(self, outcome: Outcome, turn: Turn) -> Row | None:
        """Keep an attempt's files and row, and publish its solution; None when nothing came of it.

        A solution that is not judged yet is given up for a judged one only.

        Raises:
            InputError: there is no room, or no right to write.
        """
        row, before = outcome.row, self.row(outcome.name)
        if outcome.stopped and row["status"] != UNJUDGED:
            return None
        attempt = {
            "pass": turn.round,
            "limit_s": outcome.limits.timeout_s,
            "estimate_s": round(turn.estimate_s, 1),
        }
        with writing_to(self.out):
            if before is None or not _keeps(before, row):
                self._store.keep_files(outcome)
                before = row | {"solution": self._publish(outcome, before)}
            row = {name: (before | attempt)[name] for name in REPORT_COLUMNS}
            self._store.write(outcome.name, row)
        return row

    def _publish(self, outcome: Outcome, before: Row | None) -> str:
        """Place a solution in the output folder, or take one back that turned out invalid."""
        if outcome.row["status"] in _PUBLISHED:
            for name, content in outcome.files.items():
                path = Path(name)
                if path.name.startswith("solution_"):
                    write_whole(self.out / path.name, content, scratch=self._work / "tmp")
                    return path.name
        elif before is not None and before["solution"]:
            (self.out / before["solution"]).unlink(missing_ok=True)
        return ""

    def report(self, rows: Mapping[str, Row]) -> Path:
        """Write report.csv with the rows given, in the order of their names; raises InputError."""
        path = self.out / "report.csv"
        text = csv_text((rows[name] for name in sorted(rows)), REPORT_COLUMNS)
        with writing_to(self.out):
            write_whole(path, text, scratch=self._work / "tmp")
        return path


def _keeps(before: Row, row: Row) -> bool:
    """Whether an earlier solution that was not judged stays, as the new attempt says nothing."""
    told = ("solved", "invalid", UNJUDGED)
    return before["status"] == UNJUDGED and row["status"] not in told
