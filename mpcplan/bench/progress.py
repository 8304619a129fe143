"""Progress of many scenarios on stderr: a bar on a terminal, otherwise a line per scenario."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from mpcplan.bench.store import Row


@contextmanager
def progress(total: int, done: int) -> Iterator[Callable[[Row], None]]:
    """Yields what is to be called with every new row.

    Args:
        total: number of scenarios.
        done: how many of them have their rows already.
    """
    if sys.stderr.isatty():
        with _bar(total, done) as tell:
            yield tell
        return
    count = done

    def line(row: Row) -> None:
        nonlocal count
        count += 1
        print(f"[{count}/{total}] {short(row)}", file=sys.stderr, flush=True)

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
                bar.write(short(row), file=sys.stderr)

        yield step


def short(row: Row) -> str:
    """One line for one row."""
    if row["valid"]:
        cost = f"TR1 {row['TR1']:.3f}" if isinstance(row["TR1"], float) else "no cost"
        return f"{row['scenario']}: solved, {cost}, {row['wall_s']:.1f} s"
    return f"{row['scenario']}: {row['status']}: {row['cause']}"
