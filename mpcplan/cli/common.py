"""Exit codes, and what several commands do."""

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from mpcplan.console import quiet
from mpcplan.errors import InputError

if TYPE_CHECKING:
    from mpcplan.config import Config

OK, FAILED, BAD_INPUT, INTERNAL, INTERRUPTED = 0, 1, 2, 3, 130
NOTE = "note"  # name of a line that tells what a user should know of a result


def configured(args: argparse.Namespace) -> "Config":
    """The configuration that a command is given, with every class that it names looked up.

    Raises:
        ConfigError: a key or value is at fault.
        InputError: a class that is named cannot be used.
    """
    from mpcplan.cli.classes import check_classes
    from mpcplan.config.files import load_config

    config = load_config(args.config, args.set)
    with quiet():
        check_classes(config)
    return config


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


def line(name: str, what: object) -> str:
    """A line of output: the name of what is told, in a column of its own, and what there is."""
    return f"{name:<10}{what}"
