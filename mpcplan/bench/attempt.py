"""One attempt at one scenario: a worker process with limits, in a temporary folder of its own.

An attempt takes everything with it and hands everything back as bytes, so that it runs in the same
way in this process, or on another machine that shares no file system with this one.
"""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from mpcplan.bench.job import OWN_PLANNER, Command, Job, Limits, worker_command
from mpcplan.bench.process import End, Processes, judge_end
from mpcplan.bench.store import CUT, UNJUDGED, Row, empty_row, read_row


@dataclass(frozen=True)
class Attempt:
    """One scenario with all that its worker needs.

    Attributes:
        name: file name without extension.
        id: of the scenario, for the row.
        scenario: the file, or an interactive scenario's folder.
        kind: 'recorded' or 'interactive'.
        config: the configuration's text.
        planner: 'package.module:Class', or :data:`mpcplan.bench.job.OWN_PLANNER`.
        limits: of the worker process.
        bound: whether the clairvoyant optimum is sought too.
        command: makes the worker's command line.
        shipped: the scenario's files by their names relative to its parent folder; None: the
            scenario is read where it lies.
    """

    name: str
    id: str
    scenario: Path
    kind: str
    config: str
    planner: str = OWN_PLANNER
    limits: Limits = field(default_factory=Limits)
    bound: bool = False
    command: Command = worker_command
    shipped: Mapping[str, bytes] | None = None


@dataclass(frozen=True)
class Outcome:
    """What came of an attempt.

    Attributes:
        name: the scenario's.
        row: its row; the status is never :data:`mpcplan.bench.store.CUT`.
        files: what the worker wrote, by names relative to the results' folder.
        log: what the worker printed.
        stopped: it was ended because everything is, so that its row is not final.
        limits: those of the attempt.
    """

    name: str
    row: Row
    files: Mapping[str, bytes]
    log: bytes
    stopped: bool
    limits: Limits


def ship(attempt: Attempt) -> Attempt:
    """The attempt with the scenario's files in it; raises OSError."""
    root = attempt.scenario.parent
    files = attempt.scenario.rglob("*") if attempt.scenario.is_dir() else [attempt.scenario]
    shipped = {str(f.relative_to(root)): f.read_bytes() for f in files if f.is_file()}
    return replace(attempt, shipped=shipped)


def run_attempt(attempt: Attempt, processes: Processes) -> Outcome:
    """Run a worker to its end; whatever happens to it becomes its row.

    Raises:
        InterruptedError: ``processes`` have been stopped before the start.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="mpcplan-", ignore_cleanup_errors=True) as folder:
            return _run_in(Path(folder), attempt, processes)
    except InterruptedError:
        raise
    except OSError as error:  # no room for temporary files, no more processes
        return failed(attempt, f"could not be run: {error.strerror or error}")


def failed(attempt: Attempt, cause: str) -> Outcome:
    """The outcome of an attempt that something outside it brought down."""
    row = empty_row(attempt.id, "aborted", cause, attempt.kind, attempt.planner)
    return Outcome(attempt.name, row, {}, cause.encode(), False, attempt.limits)


def _run_in(folder: Path, attempt: Attempt, processes: Processes) -> Outcome:
    out, scratch, log = folder / "out", folder / "tmp", folder / "log"
    out.mkdir()
    scratch.mkdir()
    config = folder / "config.yaml"
    config.write_text(attempt.config, encoding="utf-8")
    scenario = _unpack(attempt, folder / "input")
    row_path = folder / "row.json"
    job = Job(attempt.name, scenario, out, row_path, config, attempt.planner, attempt.bound)
    limits = attempt.limits
    command = attempt.command(job)
    end = processes.run(command, scratch, log, limits.timeout_s, limits.memory_mb)
    written = read_row(job.row)
    row = _settle(attempt, written, end, log)
    row["cause"] = str(row["cause"]).replace(str(scenario), str(attempt.scenario))
    final = written is not None and written["status"] not in (CUT, UNJUDGED)
    stopped = end.stopped and not final
    return Outcome(attempt.name, row, _whole_files(out), log.read_bytes(), stopped, limits)


def _whole_files(out: Path) -> dict[str, bytes]:
    """What a worker wrote; hidden files are those that it was still writing."""
    paths = (f for f in sorted(out.rglob("*")) if f.is_file() and not f.name.startswith("."))
    return {str(f.relative_to(out)): f.read_bytes() for f in paths}


def _unpack(attempt: Attempt, folder: Path) -> Path:
    """The scenario's path on this machine."""
    if attempt.shipped is None:
        return attempt.scenario
    for name, content in attempt.shipped.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return folder / attempt.scenario.name


def _settle(attempt: Attempt, written: Row | None, end: End, log: Path) -> Row:
    """The row: the worker's own, completed by how its process ended."""
    limits = attempt.limits
    status, cause = judge_end(end, log, limits.timeout_s, limits.memory_mb)
    if written is None:
        row = empty_row(attempt.id, status, cause, attempt.kind, attempt.planner)
    elif written["status"] == CUT:
        row = written | {"status": status, "cause": f"{cause} ({written['cause']})"}
    elif written["status"] == UNJUDGED and end.code != 0:
        row = written | {"cause": f"not judged: {cause}"}
    else:
        row = written
    row["wall_s"] = round(end.wall_s, 3)
    row["peak_mb"] = row["peak_mb"] or round(end.peak_mb, 1)
    return row
