"""show: what a run did, as pictures and as a film."""

import argparse
import io
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING, TextIO

from mpcplan.cli.common import NOTE, OK, line, made_folder
from mpcplan.cli.show_all import OF_MANY, holds_traces, refuse, show_all
from mpcplan.console import bar, quiet
from mpcplan.errors import InputError

if TYPE_CHECKING:
    from mpcplan.review.files import RunFiles
    from mpcplan.review.replan import Replanned
    from mpcplan.show.screen import Screen
    from mpcplan.simulate.run import Run
    from mpcplan.trajectory import Array

ALL = "all"
FINER = 1.5  # pixels of a picture per pixel of a film


def show(args: argparse.Namespace) -> int:
    """Draw a run, a planning cycle, or a film of all; or every run of a benchmark."""
    os.environ.setdefault("MPLBACKEND", "Agg")
    _check_view(args)
    if holds_traces(args.run_folder):
        return show_all(args)
    refuse(args, OF_MANY, f"is for the folder of a benchmark, and {args.run_folder} is one run")
    with quiet() as terminal:
        lines = draw(args, terminal)
    print("\n".join(lines))
    return OK


def _check_view(args: argparse.Namespace) -> None:
    """Raises InputError for numbers with which nothing can be drawn, of one run or of many."""
    if args.animate is not None:
        from mpcplan.show.film import MOST_FPS

        if not 0 < args.fps <= MOST_FPS:
            raise InputError(f"--fps {args.fps:g}: expected more than 0 and at most {MOST_FPS:g}")
    if args.radius is not None:
        from mpcplan.show.screen import LEAST_RADIUS, MOST_RADIUS

        if not LEAST_RADIUS <= args.radius <= MOST_RADIUS:
            expected = f"expected {LEAST_RADIUS:g} to {MOST_RADIUS:g} m"
            raise InputError(f"--radius {args.radius:g}: {expected}")


def draw(args: argparse.Namespace, terminal: TextIO) -> list[str]:
    """Draw one run; returns what is to be said of it: files, then notes."""
    if args.animate is not None:
        from mpcplan.show.film import check_kind

        check_kind(args.animate)
    from mpcplan.review.again import run_again
    from mpcplan.review.files import find_files

    files = find_files(args.run_folder, args.scenario)
    run = run_again(files)
    if args.animate is not None:
        return _film(run, files, args, terminal)
    if args.step is not None:
        return _cycles(run, files, args, terminal)
    return _whole(run, files, args, terminal)


def _whole(run: "Run", files: "RunFiles", args: argparse.Namespace, terminal: TextIO) -> list[str]:
    """The picture that `solve` draws."""
    from dataclasses import replace

    from mpcplan.bench.files import write_whole, writing_to
    from mpcplan.cli.solve import rules_told
    from mpcplan.review.replan import with_plans
    from mpcplan.show.plots import plot_run

    picture = made_folder(args.out or files.pictures) / f"{run.loaded.id}.png"
    again = [_replan(run, index, files, None, terminal) for index in range(len(run.drives))]
    drives = tuple(with_plans(*pair) for pair in zip(run.drives, again, strict=True))
    run = replace(run, drives=drives)
    image = io.BytesIO()
    plot_run(run, rules=rules_told(run)[0]).savefig(image, format="png")
    with writing_to(picture.parent):  # whole or not at all: what is there is not drawn again
        write_whole(picture, image.getvalue())
    return [line("picture", picture), *(line(NOTE, a.missing) for a in again if a.missing)]


def _cycles(run: "Run", files: "RunFiles", args: argparse.Namespace, terminal: TextIO) -> list[str]:
    """One picture for each of some time steps."""
    from PIL import Image

    index = _drive_of(run, args.problem)
    steps = steps_of(args.step, run, index)
    folder = made_folder(args.out or files.pictures)
    again = _replan(run, index, files, max(steps), terminal)
    screen = _screen(run, index, again, args, FINER)
    lines: list[str] = []
    with bar(terminal, len(steps), "drawing") as done:
        for step in steps:
            of = f".problem{run.drives[index].problem_id}" if len(run.drives) > 1 else ""
            path = folder / f"{run.loaded.id}{of}.step{step:04d}.png"
            Image.fromarray(screen.draw(step)).save(path)
            lines.append(line("" if lines else "picture", path))
            done()
    return lines + ([line(NOTE, again.missing)] if again.missing else [])


def _film(run: "Run", files: "RunFiles", args: argparse.Namespace, terminal: TextIO) -> list[str]:
    """All time steps, one frame each."""
    from mpcplan.show.film import write_film

    index = _drive_of(run, args.problem)
    steps = [int(step) for step in run.drives[index].trajectory.steps]
    _check_driven(run, index)
    made_folder(args.animate.parent)
    again = _replan(run, index, files, None, terminal)
    screen = _screen(run, index, again, args)

    def frames() -> "Iterator[Array]":
        with bar(terminal, len(steps), "drawing") as done:
            for step in steps:
                yield screen.draw(step)
                done()

    typical = [screen.draw(step) for step in (steps[0], steps[len(steps) // 2], steps[-1])]
    write_film(frames(), args.animate, args.fps, typical)
    told = f"{len(steps)} frames, {len(steps) / args.fps:.1f} s"
    notes = [line(NOTE, again.missing)] if again.missing else []
    return [line("film", f"{args.animate} ({told})"), *notes]


def steps_of(text: str, run: "Run", index: int) -> list[int]:
    """The time steps that a user asks for: one, 'first:last:stride', or all planning cycles.

    Raises:
        InputError: it is none of these, or a step that was not driven.
    """
    _check_driven(run, index)
    driven = run.drives[index].trajectory
    if text == ALL:
        return [cycle.step for cycle in run.drives[index].cycles]
    try:
        numbers = [int(part) for part in text.split(":")]
    except ValueError:
        numbers = []
    if not 1 <= len(numbers) <= 3 or (len(numbers) == 3 and numbers[2] < 1):
        raise InputError(f"--step {text}: expected a time step, first:last:stride, or {ALL!r}")
    first, last, stride = (*numbers, *(numbers[0], 1)[len(numbers) - 1 :])[:3]
    steps = list(range(first, last + 1, stride))
    missing = [k for k in (first, last) if not driven.first_step <= k <= driven.last_step]
    if missing or not steps:
        raise InputError(
            f"--step {text}: {run.loaded.id} was driven from step {driven.first_step} to "
            f"{driven.last_step}"
        )
    return steps


def _check_driven(run: "Run", index: int) -> None:
    drive = run.drives[index]
    if not drive.cycles:
        raise InputError(f"nothing of {run.loaded.id} was driven: {drive.cause}")


def _drive_of(run: "Run", problem: int | None) -> int:
    """The drive of a planning problem; without one the first."""
    known = [drive.problem_id for drive in run.drives]
    if problem is None and known:
        return 0
    if problem not in known:
        raise InputError(
            f"--problem {problem}: {run.loaded.id} has {', '.join(map(str, known)) or 'none'}"
        )
    return known.index(problem)


def _replan(
    run: "Run", index: int, files: "RunFiles", until: int | None, terminal: TextIO
) -> "Replanned":
    from mpcplan.review.replan import replan

    cycles = [c for c in run.drives[index].cycles if until is None or c.step <= until]
    with bar(terminal, len(cycles), "planning again") as done:
        return replan(run, index, files.simulated, until, done)


def _screen(
    run: "Run", index: int, again: "Replanned", args: argparse.Namespace, finer: float = 1.0
) -> "Screen":
    from mpcplan.show.screen import Screen, usual_radius

    radius = usual_radius(run.drives[index]) if args.radius is None else args.radius
    return Screen(run, index, again, radius, args.labels, finer)
