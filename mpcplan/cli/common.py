"""Exit codes, and what several commands do."""

import os
from pathlib import Path

from mpcplan.errors import InputError

OK, FAILED, BAD_INPUT, INTERNAL, INTERRUPTED = 0, 1, 2, 3, 130


def made_folder(folder: Path) -> Path:
    """The folder, made where it is missing.

    Raises:
        InputError: it cannot be made, or not be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {folder}: {error.strerror}") from error
    if not os.access(folder, os.W_OK):
        raise InputError(f"cannot write to the folder {folder}")
    return folder
