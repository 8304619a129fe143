"""The benchmark: every scenario in a process of its own, resumable."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path

from mpcplan.bench.attempt import Attempt
from mpcplan.bench.engine import Engine, open_engine, run_all
from mpcplan.bench.files import writing_to
from mpcplan.bench.find import benchmark_id, find_scenarios, kind_of
from mpcplan.bench.job import OWN_PLANNER, Command, Limits, worker_command
from mpcplan.bench.progress import progress
from mpcplan.bench.store import Row, Store
from mpcplan.errors import InputError


def bench(
    paths: Iterable[str | Path],
    out: str | Path,
    jobs: int = 1,
    timeout_s: float = 600.0,
    config_path: str | Path | None = None,
    overrides: Sequence[str] = (),
    memory_mb: float = 4000.0,
    planner: str = OWN_PLANNER,
    bound: bool = False,
    engine: Engine | None = None,
    command: Command = worker_command,
) -> tuple[Path, list[Row]]:
    """Run scenarios and keep one row each; rows that exist already are not run again.

    Whatever happens to a scenario's process costs this scenario's row only, whose ``status`` and
    ``cause`` then say what it was. To repeat a scenario delete its file in ``out/rows``.

    Args:
        paths: scenario files, interactive scenarios' folders, or folders to be searched.
        out: folder for the results, see :mod:`mpcplan.bench.store`.
        jobs: processes at a time, where no engine is given.
        timeout_s: time limit per scenario [s].
        config_path: configuration file, None for the defaults.
        overrides: 'section.key=value'.
        memory_mb: limit of each process's address space [MB].
        planner: 'package.module:Class', or this package's own.
        bound: seek the clairvoyant optimum of every solved scenario too (:mod:`mpcplan.bound`).
        engine: where the scenarios run, see :mod:`mpcplan.bench.engine`; it is closed at the end.
        command: makes the worker's command line (replaced in tests).

    Returns:
        The path of results.csv and its rows.

    Raises:
        InputError: bad paths, configuration or limits, ``out`` cannot be written, or holds results
            of another planner or configuration.
    """
    from mpcplan.config.files import dump_config, load_config

    with closing(engine or open_engine(jobs=jobs)) as running:
        if timeout_s <= 0 or memory_mb <= 0:
            raise InputError("timeout and memory must be positive")
        scenarios = find_scenarios(paths, exclude=out)
        config = dump_config(load_config(config_path, overrides))
        store = Store(Path(out).resolve(), config, f"{planner}, with bounds" if bound else planner)
        missing = {name for name in scenarios if store.read(name) is None}
        limits = Limits(timeout_s, memory_mb)
        attempts = (
            Attempt(
                name,
                benchmark_id(path),
                path,
                kind_of(path),
                config,
                planner,
                limits,
                bound,
                command,
            )
            for name, path in scenarios.items()
            if name in missing
        )
        with progress(len(scenarios), len(scenarios) - len(missing)) as tell:
            for row in _rows(running, attempts, store):
                tell(row)
        return store.assemble(scenarios)


def _rows(engine: Engine, attempts: Iterator[Attempt], store: Store) -> Iterator[Row]:
    """Rows as they come in and have been kept."""
    with closing(run_all(engine, lambda: next(attempts, None))) as outcomes:
        for outcome in outcomes:
            if outcome.stopped:  # no row: it is run next time
                continue
            with writing_to(store.folder):
                store.keep_files(outcome)
                store.write(outcome.name, outcome.row)
            yield outcome.row
