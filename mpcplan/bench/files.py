"""Files that are whole or not there at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mpcplan.errors import InputError


def write_whole(path: Path, content: str | bytes, scratch: Path | None = None) -> None:
    """Write a file so that a reader, and the next run, sees it whole or not at all.

    Args:
        path: the file; it is replaced at once.
        content: text (as UTF-8) or bytes.
        scratch: folder for the file in the making, on the same file system; None: beside it.

    Raises:
        OSError: there is no room, or no right to write; nothing is left behind.
    """
    data = content.encode() if isinstance(content, str) else content
    part = (scratch or path.parent) / f".{path.name}.{os.getpid()}.part"
    try:
        with part.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())  # the name must not reach the disk before the content
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    """Make the new name itself last through a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def writing_to(folder: Path) -> Iterator[None]:
    """Turn a failure to write into one message that says what to do next."""
    try:
        yield
    except OSError as error:
        raise InputError(
            f"cannot write to {folder}: {error.strerror or error}; "
            "what is finished there is kept: make room for it, then start the same command again"
        ) from error
