"""Reading traces: of `solve` (trace.json) and of `bench` (traces/<scenario>.json.gz)."""

import gzip
import json
from pathlib import Path
from typing import Any

from mpcplan.errors import InputError

Trace = dict[str, Any]


def trace_file(path: Path) -> Path:
    """The trace's file in a folder of ``solve``, or the path itself."""
    return path / "trace.json" if path.is_dir() else path


def read_trace(path: Path) -> Trace:
    """The trace of a run.

    Args:
        path: a folder that ``solve`` wrote, or a trace.

    Raises:
        InputError: there is none, or it is not a trace.
    """
    file = trace_file(path)
    try:
        raw = file.read_bytes()
        text = gzip.decompress(raw) if file.suffix == ".gz" else raw
        trace = json.loads(text)
    except FileNotFoundError as error:
        raise InputError(
            f"{file}: no such file; give the folder that `mpcplan solve` wrote, or one of the "
            "traces that `mpcplan bench` did"
        ) from error
    except (OSError, EOFError, ValueError) as error:
        raise InputError(f"{file} cannot be read as a trace: {error}") from error
    known = isinstance(trace, dict) and isinstance(trace.get("drives"), list)
    if not known or not all(isinstance(d, dict) and "cycles" in d for d in trace["drives"]):
        raise InputError(f"{file} is no trace: it has no drives with cycles")
    return trace
