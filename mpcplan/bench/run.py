"""The benchmark: every scenario in a process of its own, resumable."""

import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from mpcplan.bench.find import find_scenarios
from mpcplan.bench.process import Processes, judge_end
from mpcplan.bench.store import Row, Store, empty_row, read_row
from mpcplan.errors import InputError


@dataclass(frozen=True)
class Job:
    """One scenario to be run.

    Attributes:
        name: file name without extension.
        scenario: the file.
        out: the benchmark's folder.
        row: where the worker writes its row.
        config: configuration file that holds every parameter.
    """

    name: str
    scenario: Path
    out: Path
    row: Path
    config: Path


Command = Callable[[Job], list[str]]


def worker_command(job: Job) -> list[str]:
    """The command that plans, drives and judges one scenario."""
    worker = [sys.executable, "-m", "mpcplan.bench.worker"]
    return [*worker, str(job.scenario), str(job.out), str(job.row), "--config", str(job.config)]


@dataclass(frozen=True)
class Limits:
    """Limits of one worker: time [s] and address space [MB]."""

    timeout_s: float = 600.0
    memory_mb: float = 4000.0


def bench(
    paths: Iterable[str | Path],
    out: str | Path,
    jobs: int = 1,
    timeout_s: float = 600.0,
    config_path: str | Path | None = None,
    overrides: Sequence[str] = (),
    memory_mb: float = 4000.0,
    command: Command = worker_command,
) -> tuple[Path, list[Row]]:
    """Run scenarios and keep one row each; rows that exist already are not run again.

    Whatever happens to a scenario's process costs this scenario's row only, whose ``status`` and
    ``cause`` then say what it was. To repeat a scenario delete its file in ``out/rows``.

    Args:
        paths: scenario files, or folders that are searched for them.
        out: folder for the results, see :mod:`mpcplan.bench.store`.
        jobs: processes at a time.
        timeout_s: time limit per scenario [s].
        config_path: configuration file, None for the defaults.
        overrides: 'section.key=value'.
        memory_mb: limit of each process's address space [MB].
        command: makes the worker's command line (replaced in tests).

    Returns:
        The path of results.csv and its rows.

    Raises:
        InputError: bad paths, configuration or limits, or ``out`` holds results of another
            configuration.
    """
    from mpcplan.config_io import dump_config, load_config

    if jobs < 1 or timeout_s <= 0 or memory_mb <= 0:
        raise InputError("jobs, timeout and memory must be positive")
    paths = [Path(path) for path in paths]
    scenarios = find_scenarios(paths)
    config = dump_config(load_config(config_path, overrides))
    store = Store(Path(out).resolve(), config)
    runner = _Runner(store, Limits(timeout_s, memory_mb), command)
    runner.run(scenarios, jobs)
    return store.assemble(scenarios)


@dataclass
class _Runner:
    """Runs the missing scenarios of a store."""

    store: Store
    limits: Limits
    command: Command
    processes: Processes = field(default_factory=Processes)

    def run(self, scenarios: dict[str, Path], jobs: int) -> None:
        """Run all scenarios without a row, ``jobs`` at a time."""
        missing = [name for name in scenarios if self.store.read(name) is None]
        with _progress(len(scenarios), len(scenarios) - len(missing)) as tell:
            pool = ThreadPoolExecutor(jobs)
            try:
                pending = {pool.submit(self.one, name, scenarios[name]) for name in missing}
                self._collect(pending, tell)
            finally:  # after Ctrl-C or an error: nothing keeps running in the background
                self.processes.stop()
                pool.shutdown(wait=True, cancel_futures=True)

    def _collect(self, pending: set[Future[Row]], tell: Callable[[Row], None]) -> None:
        """Report rows as they come in; errors of our own are raised."""
        while pending:
            # a timeout, so that Ctrl-C is noticed while all workers are busy
            done, pending = wait(pending, timeout=0.5, return_when=FIRST_COMPLETED)
            for future in done:
                tell(future.result())

    def one(self, name: str, scenario: Path) -> Row:
        """Run one scenario and keep its row."""
        with tempfile.TemporaryDirectory(prefix="mpcplan-bench-") as folder:
            out, row_path = self.store.folder, Path(folder, "row.json")
            job = Job(name, scenario, out, row_path, out / "config.yaml")
            log, limits = self.store.log_path(name), self.limits
            end = self.processes.run(self.command(job), log, limits.timeout_s, limits.memory_mb)
            if end.code < 0 and self.processes.stopped:
                raise InterruptedError("stopped")  # killed by us: no row, it is run next time
            row = read_row(job.row)
            if row is None:
                row = empty_row(name, *judge_end(end, log, limits.timeout_s, limits.memory_mb))
        row["wall_s"] = round(end.wall_s, 3)
        row["peak_mb"] = row["peak_mb"] or round(end.peak_mb, 1)
        self.store.write(name, row)
        return row


@contextmanager
def _progress(total: int, done: int) -> Iterator[Callable[[Row], None]]:
    """Progress on stderr: a bar on a terminal, otherwise a line per scenario."""
    if sys.stderr.isatty():
        with _bar(total, done) as tell:
            yield tell
        return
    count = done

    def line(row: Row) -> None:
        nonlocal count
        count += 1
        print(f"[{count}/{total}] {_short(row)}", file=sys.stderr, flush=True)

    if done:
        print(f"{done} of {total} scenarios have their results already", file=sys.stderr)
    yield line


@contextmanager
def _bar(total: int, done: int) -> Iterator[Callable[[Row], None]]:
    from tqdm import tqdm

    with tqdm(total=total, initial=done, unit="scenario", dynamic_ncols=True) as bar:
        valid = 0

        def step(row: Row) -> None:
            nonlocal valid
            valid += bool(row["valid"])
            bar.set_postfix_str(f"{valid} solved, last {row['scenario']}", refresh=False)
            bar.update()
            if not row["valid"]:
                bar.write(_short(row), file=sys.stderr)

        yield step


def _short(row: Row) -> str:
    """One line for one row."""
    if row["valid"]:
        cost = f"TR1 {row['TR1']:.3f}" if isinstance(row["TR1"], float) else "no cost"
        return f"{row['scenario']}: solved, {cost}, {row['wall_s']:.1f} s"
    return f"{row['scenario']}: {row['status']}: {row['cause']}"
