"""What the configurations of several runs differ in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from mpcplan.report.read import Results
from mpcplan.report.tables import NOTHING, Table

FILE = "config.yaml"


def differences(runs: Sequence[Results]) -> Table | None:
    """One row per parameter that is not the same in all runs; None where there is none.

    Runs without a readable configuration (of other planners, say) have a dash.
    """
    found = [_parameters(run) for run in runs]
    known = dict.fromkeys(name for one in found for name in one)
    rows = []
    for name in known:
        values = [one.get(name, NOTHING) if one else NOTHING for one in found]
        told = {value for value, one in zip(values, found, strict=True) if one}
        if len(told) > 1:
            rows.append((name, *values))
    return Table(("parameter", *(run.name for run in runs)), tuple(rows)) if rows else None


def _parameters(run: Results) -> dict[str, str]:
    """The parameters of a run by their full names; nothing where they cannot be read."""
    try:
        read = yaml.safe_load((run.folder / FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError):
        return {}
    return dict(_flat(read, "")) if isinstance(read, dict) else {}


def _flat(value: Mapping[str, Any], above: str) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    for key, below in value.items():
        name = f"{above}{key}"
        found += _flat(below, f"{name}.") if isinstance(below, dict) else [(name, str(below))]
    return found
