"""The command line: solve, explain, show, evaluate, bench, compete, bound, bench-solvers, compare,
report, forecasts, twin, config.

Exit codes: 0 done (solved, valid), 1 not solved or not valid, 2 bad input, 3 an error of the
program itself, 130 interrupted. Of many scenarios some may fail: bench ends with 0 when every one
has its row, compete when there is at least one solution. Modules that take long to import are
imported where needed.
"""

import os
import sys
import tempfile
import traceback
from collections.abc import Sequence
from typing import NoReturn

from mpcplan.cli.arguments import parser
from mpcplan.cli.common import BAD_INPUT, FAILED, INTERNAL, INTERRUPTED, OK
from mpcplan.errors import InputError, MpcplanError, RefereeError

__all__ = ["BAD_INPUT", "FAILED", "INTERNAL", "INTERRUPTED", "OK", "entry", "main"]


def entry() -> NoReturn:
    """Run the command line and end the process at once.

    The extension modules print thousands of leak reports in the interpreter's regular shutdown;
    leaving without it keeps them from the user.
    """
    code = main()
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code and raises nothing."""
    try:
        args = parser().parse_args(argv)
    except SystemExit as end:  # argparse has said what is wrong, or printed the help
        return int(end.code or 0)
    try:
        code: int = args.run(args)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # the reader (head, less) has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except MpcplanError as error:
        print(f"error: {error}", file=sys.stderr)
        return _code_of(error)
    except Exception as error:  # ours: one line for the user, the rest for the report
        return _unexpected(error)


def _code_of(error: MpcplanError) -> int:
    if isinstance(error, InputError):
        return BAD_INPUT
    return INTERNAL if isinstance(error, RefereeError) else FAILED


def _unexpected(error: Exception) -> int:
    """Keep the traceback in a file and name it."""
    with tempfile.NamedTemporaryFile(
        "w", prefix="mpcplan-error-", suffix=".txt", delete=False, encoding="utf-8"
    ) as file:
        traceback.print_exception(error, file=file)
    text = " ".join(f"{type(error).__name__}: {error}".split())
    print(f"error: unexpected {text} (traceback in {file.name})", file=sys.stderr)
    return INTERNAL
