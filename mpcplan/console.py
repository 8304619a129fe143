"""What the user sees while a command runs: our own words, not the libraries'."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from typing import TextIO


@contextmanager
def quiet() -> Iterator[TextIO]:
    """Keep what libraries print to stdout and stderr, in Python or below it, from the user.

    Yields a stream to the real stderr for messages of our own.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(fd) for fd in (1, 2)]
    with open(os.devnull, "w") as sink, _text(os.dup(kept[1])) as terminal:
        for fd in (1, 2):
            os.dup2(sink.fileno(), fd)
        try:
            with redirect_stdout(sink), redirect_stderr(sink):
                yield terminal
        finally:
            for fd, copy in zip((1, 2), kept, strict=True):
                os.dup2(copy, fd)
                os.close(copy)


def _text(fd: int) -> TextIO:
    return os.fdopen(fd, "w", encoding="utf-8", errors="replace")


def progress(terminal: TextIO) -> Callable[[int, int], None] | None:
    """A counter of time steps on a terminal, none elsewhere."""
    if not terminal.isatty():
        return None

    def tell(step: int, last_step: int) -> None:
        end = "\r" if step < last_step else "\r\033[K"  # the last one wipes the line
        terminal.write(f"\rstep {step} of {last_step}{end}")
        terminal.flush()

    return tell


@contextmanager
def bar(terminal: TextIO, total: int, what: str) -> Iterator[Callable[[], object]]:
    """A bar of progress on a terminal, nothing elsewhere; yields what is called for each part."""
    from tqdm import tqdm

    with tqdm(
        total=total, desc=what, file=terminal, disable=not terminal.isatty(), leave=False,
        dynamic_ncols=True,
    ) as drawn:  # fmt: skip
        yield drawn.update


def doing(terminal: TextIO) -> Callable[[str], None]:
    """A line that says what is being done on a terminal, silence elsewhere."""

    def tell(what: str) -> None:
        if terminal.isatty():
            terminal.write(f"\r\033[K{what}")
            terminal.flush()

    return tell
