"""show for the folder of a benchmark: a picture, or a film, of every run in it.

Each run is drawn in a process of its own, so that one that fails, or even crashes in a library,
costs the others nothing, and its memory is free afterwards.
"""

import argparse
import multiprocessing
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.context import ForkServerContext
from pathlib import Path

from mpcplan.cli.common import FAILED, NOTE, OK, line, made_folder
from mpcplan.console import bar, quiet
from mpcplan.errors import InputError, MpcplanError
from mpcplan.review.places import FILMS, PICTURES, TRACE, TRACES

OF_ONE = ("step", "problem")
"""Options that make no sense for many runs."""
OF_MANY = ("failed", "again", "jobs")
"""Options that make no sense for one."""
_LOADED = ("mpcplan.show.plots", "mpcplan.show.screen", "mpcplan.show.film", "mpcplan.review.again",
           "mpcplan.review.replan", "mpcplan.simulate.rules")  # fmt: skip
"""What every process needs: it is loaded once, before any of them begins."""


@dataclass(frozen=True)
class Drawn:
    """What came of one run: notes on what was drawn, or why it was not."""

    notes: tuple[str, ...] = ()
    failure: str = ""


def holds_traces(path: Path) -> bool:
    """Whether this is the folder of a benchmark, and not one run."""
    return (path / TRACES).is_dir()


def refuse(args: argparse.Namespace, options: Sequence[str], why: str) -> None:
    """Refuse options that are given but make no sense here; raises InputError."""
    for name in options:
        given = getattr(args, name)
        if given is not None and given is not False:  # a problem's id may be 0
            raise InputError(f"--{name} {why}")


def show_all(args: argparse.Namespace) -> int:
    """Draw the runs of a benchmark; returns FAILED where one of them could not be drawn."""
    refuse(args, OF_ONE, f"is for one run, and {args.run_folder} holds many: name one of its "
           f"{TRACES}")  # fmt: skip
    if args.jobs is not None and args.jobs < 1:
        raise InputError(f"--jobs {args.jobs}: expected at least 1")
    with quiet() as terminal:
        suffix = _suffix(args.animate)
        traces = _traces(args.run_folder, args.failed)
        scenarios = _scenarios(args.scenario)
        films = args.animate is not None
        folder = made_folder(args.out or args.run_folder / (FILMS if films else PICTURES))
        files = {folder / f"{name}{suffix}": trace for name, trace in traces.items()}
        todo = {file: trace for file, trace in files.items() if args.again or not file.exists()}
        found: dict[str, Drawn] = {}
        runs = [_of_one(args, trace, file, scenarios) for file, trace in todo.items()]
        with bar(terminal, len(runs), "drawing") as done, _drawing(runs, args.jobs) as drawn:
            for name, one in drawn:
                found[name] = one
                done()
    print("\n".join(_told("films" if films else "pictures", folder, len(files), found)))
    return FAILED if any(one.failure for one in found.values()) else OK


def _suffix(animate: Path | None) -> str:
    """That of the files to make; raises InputError where no film can be written in this way."""
    if animate is None:
        return ".png"
    from mpcplan.show.film import KINDS, check_kind

    suffix = f".{animate}"
    if suffix not in KINDS:
        kinds = " or ".join(kind.removeprefix(".") for kind in KINDS)
        raise InputError(f"--animate {animate}: of many runs expected just {kinds}")
    check_kind(Path(f"film{suffix}"))
    return suffix


def _traces(folder: Path, failed: bool) -> dict[str, Path]:
    """The traces by their scenarios' ids; raises InputError where there is none."""
    found = {
        path.name.removesuffix(TRACE): path for path in sorted((folder / TRACES).glob(f"*{TRACE}"))
    }
    if not found:
        raise InputError(f"{folder / TRACES} holds no traces (*{TRACE})")
    if not failed:
        return found
    from mpcplan.bench.csv_rows import read_rows, truth

    rows = read_rows(folder, ("scenario", "valid"))[1]
    kept = {row.cells["scenario"] for row in rows
            if not truth(row.cells["valid"], f"{row.place}: valid")}  # fmt: skip
    return {name: path for name, path in found.items() if name in kept}


def _scenarios(folder: Path | None) -> Mapping[str, Path]:
    """The scenarios in a folder by their ids; none where the user names no folder."""
    if folder is None:
        return {}
    from mpcplan.bench.find import benchmark_id, find_scenarios

    return {benchmark_id(path): path for path in find_scenarios([folder]).values()}


def _of_one(
    args: argparse.Namespace, trace: Path, file: Path, scenarios: Mapping[str, Path]
) -> argparse.Namespace:
    """The arguments of `show` for one of the runs, which is to be drawn into a file."""
    given = {name: value for name, value in vars(args).items() if name != "run"} | {
        "run_folder": trace,
        "animate": file if args.animate is not None else None,
        "out": file.parent,
        "scenario": scenarios.get(file.stem),
    }
    return argparse.Namespace(**given)


@contextmanager
def _drawing(
    runs: Sequence[argparse.Namespace], jobs: int | None
) -> Iterator[Iterator[tuple[str, Drawn]]]:
    """Yields the runs as they are finished, by their scenarios' ids."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(_LOADED))
    with ThreadPoolExecutor(jobs or 1) as threads:
        futures = {
            threads.submit(_apart, context, run): run.run_folder.name.removesuffix(TRACE)
            for run in runs
        }
        try:
            yield ((futures[future], future.result()) for future in as_completed(futures))
        except BaseException:  # interrupted: what has not begun shall not begin
            threads.shutdown(wait=False, cancel_futures=True)
            raise


def _apart(context: ForkServerContext, args: argparse.Namespace) -> Drawn:
    """One run, drawn in a process of its own."""
    try:
        with ProcessPoolExecutor(1, mp_context=context) as process:
            return process.submit(draw_one, args).result()
    except BrokenProcessPool:
        return Drawn(failure="the process that drew it crashed")


def draw_one(args: argparse.Namespace) -> Drawn:
    """One run, in the process that draws it; an error is its failure."""
    from mpcplan.cli.show import draw

    try:
        with quiet() as terminal:
            lines = draw(args, terminal)
    except MpcplanError as error:
        return Drawn(failure=str(error))
    except Exception as error:  # a mistake of ours costs one picture, and is told with its kind
        return Drawn(failure=" ".join(f"unexpected {type(error).__name__}: {error}".split()))
    begin = line(NOTE, "")
    return Drawn(tuple(one.removeprefix(begin) for one in lines if one.startswith(begin)))


def _told(what: str, folder: Path, count: int, found: Mapping[str, Drawn]) -> list[str]:
    """How many there are and where, notes that several runs share once, and who failed and why."""
    failed = {name: one.failure for name, one in sorted(found.items()) if one.failure}
    kept = count - len(found)
    there = f", {kept} were there already" if kept else ""
    lines = [line(what, f"{len(found) - len(failed)} drawn{there}: {folder}")]
    notes = Counter(note for one in found.values() for note in one.notes)
    of = {note: name for name, one in found.items() for note in one.notes}
    for note, times in notes.most_common():
        lines.append(line(NOTE, f"{of[note] if times == 1 else f'{times} of them'}: {note}"))
    return lines + [line("failed", f"{name}: {failure}") for name, failure in failed.items()]
