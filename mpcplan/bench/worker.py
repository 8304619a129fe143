"""Worker of the benchmark: plans, drives and judges one scenario, and writes its row.

Usage: python -m mpcplan.bench.worker SCENARIO OUT ROW --config FILE

Everything printed goes to the scenario's log. A failure of the planner that it foresees (and any
other exception) becomes a row here; a crash, a hang or lack of memory leaves no row, and the
parent process writes one.
"""

import argparse
import gzip
import json
import os
import resource
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpcplan.bench.find import scenario_name
from mpcplan.bench.store import Row, empty_row, write_atomically
from mpcplan.errors import InputError, MpcplanError, RefereeError
from mpcplan.score.referee import Verdict, evaluate
from mpcplan.score.tr1 import PARTS

if TYPE_CHECKING:
    from mpcplan.simulate.run import Run


def work(scenario: Path, out: Path, config_path: Path) -> Row:
    """The row of one scenario; an exception becomes its status and cause."""
    name = scenario_name(scenario)
    try:
        return _work(scenario, out, config_path)
    except MemoryError:
        return empty_row(name, "memory", "ran out of memory")
    except InputError as error:
        return empty_row(name, "bad_input", str(error))
    except RefereeError as error:
        return empty_row(name, "crash", str(error))
    except MpcplanError as error:
        return empty_row(name, "not_solved", str(error))
    except Exception as error:  # a mistake in the planner costs one row, told with its place
        traceback.print_exc()
        return empty_row(name, "crash", f"{_brief(error)} ({_place(error)})")


def _work(scenario: Path, out: Path, config_path: Path) -> Row:
    from mpcplan.config_io import load_config
    from mpcplan.scenario import load

    loaded = load(scenario)  # bad input is found before the solvers are imported
    from mpcplan.simulate.loop import drive

    run = drive(loaded, load_config(config_path))
    row = empty_row(run.loaded.id) | planning_cells(run)
    row["peak_mb"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1)
    write_trace(run.trace(), out / "traces" / f"{run.loaded.id}.json.gz")
    verdict = _judge(run, out / "solutions")
    if verdict is not None:
        row |= verdict_cells(verdict)
    return row | _outcome(run, verdict)


def _judge(run: "Run", folder: Path) -> Verdict | None:
    """The official verdict; a run that is not solved may well have no solution to judge."""
    try:
        return evaluate(run.loaded.path, run.write_solution(folder))
    except Exception:
        if run.solved:
            raise
        traceback.print_exc()
        return None


def _outcome(run: "Run", verdict: Verdict | None) -> Row:
    """Status, validity and cause."""
    if not run.solved or verdict is None:
        return {"status": "not_solved", "valid": False, "cause": run.cause}
    status = "solved" if verdict.valid else "invalid"
    return {"status": status, "valid": verdict.valid, "cause": verdict.cause}


def planning_cells(run: "Run") -> Row:
    """Number of cycles and their times."""
    import numpy as np

    times_ms = np.asarray(run.planning_ms, dtype=float)
    cells: Row = {"cycles": len(times_ms)}
    if len(times_ms):
        for name, value in zip(
            ("plan_p50_ms", "plan_p95_ms", "plan_max_ms"),
            np.percentile(times_ms, (50, 95, 100)),
            strict=True,
        ):
            cells[name] = round(float(value), 3)
    return cells


def verdict_cells(verdict: Verdict) -> Row:
    """The checks and the cost."""
    cells: Row = {**verdict.checks, "duration_s": round(verdict.duration_s, 3)}
    if verdict.parts is not None:
        cells |= {part: verdict.parts[part] for part in PARTS}
        cells |= {"TR1": verdict.tr1, "TR1_report": verdict.tr1_report}
    return cells


def write_trace(trace: dict[str, Any], path: Path) -> None:
    """A trace as compressed JSON, the same bytes for the same trace."""
    text = json.dumps(trace, sort_keys=True)
    path.write_bytes(gzip.compress(text.encode(), mtime=0))


def _brief(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:300]


def _place(error: BaseException) -> str:
    """File and line of the innermost frame within this package."""
    package = str(Path(__file__).resolve().parents[1])
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if frame.filename.startswith(package)] or frames
    return f"{Path(ours[-1].filename).name}, line {ours[-1].lineno}" if ours else "unknown place"


def main() -> None:
    """Read the command line, work, write the row."""
    parser = argparse.ArgumentParser(prog="mpcplan.bench.worker")
    for name in ("scenario", "out", "row"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--config", type=Path, required=True)
    args = parser.parse_args()
    row = work(args.scenario, args.out, args.config)
    write_atomically(args.row, json.dumps(row))


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # skips the extension modules' leak reports
