"""Worker of the benchmark: plans, drives and judges one scenario, and writes its row.

Usage: python -m mpcplan.bench.worker SCENARIO OUT ROW --config FILE

Everything printed goes to the scenario's log. A failure of the planner that it foresees (and any
other exception) becomes a row here; a crash, a hang or lack of memory leaves no row, and the
parent process writes one. A solution that passes our own verification is written, with a row that
says ``unjudged``, before the official check begins, so that what ends the worker then costs the
verdict only.
"""

import argparse
import errno
import gzip
import json
import os
import resource
import select
import signal
import sys
import threading
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpcplan.bench.cells import bound_cells, judgement_cells, rules_cells, run_cells, with_cells
from mpcplan.bench.files import write_whole
from mpcplan.bench.find import benchmark_id, kind_of
from mpcplan.bench.job import OWN_PLANNER
from mpcplan.bench.store import CUT, UNJUDGED, Row, empty_row, read_row
from mpcplan.errors import InputError, MpcplanError, RefereeError

if TYPE_CHECKING:
    from mpcplan.score.judge import Judgement
    from mpcplan.simulate.run import Run

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT)


class Worker:
    """One scenario's work, and what is known of it so far."""

    def __init__(
        self, scenario: Path, out: Path, row: Path, config: Path, planner: str = OWN_PLANNER,
        bound: bool = False,
    ) -> None:  # fmt: skip
        """See :class:`mpcplan.bench.job.Job`."""
        self._scenario, self._out, self._row_path, self._config = scenario, out, row, config
        self._planner, self._bound = planner, bound
        self._where = "before the drive"

    def work(self) -> Row:
        """The row; an exception becomes its status and cause."""
        try:
            return self._work()
        except MemoryError:
            return self._failed("memory", "ran out of memory")
        except InputError as error:
            return self._failed("bad_input", str(error))
        except RefereeError as error:
            return self._failed("crash", str(error))
        except MpcplanError as error:
            return self._failed("not_solved", str(error))
        except Exception as error:  # a mistake in the planner costs one row, told with its place
            traceback.print_exc()
            no_room = isinstance(error, OSError) and error.errno in _NO_ROOM
            cause = f"{_brief(error)} ({_place(error)})"
            return self._failed("aborted" if no_room else "crash", cause)

    def _failed(self, status: str, cause: str) -> Row:
        """The row of a failure: the candidate's, when there is one that could not be judged."""
        candidate = read_row(self._row_path)
        if candidate is not None:
            return candidate | {"cause": f"not judged: {cause}"}
        return self._row(status, cause)

    def _work(self) -> Row:
        from mpcplan.config.files import load_config
        from mpcplan.scenario import load

        config, loaded = load_config(self._config), load(self._scenario)
        from mpcplan.simulate.loop import drive  # bad input is found before the solvers come in

        run = drive(loaded, config, self._progress, **self._foreign())
        row = self._row("not_solved") | {"scenario": loaded.id}
        row = with_cells(row, run_cells(run), rules_cells(run))
        row["peak_mb"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1)
        write_trace(run.trace(), self._out / "traces" / f"{loaded.id}.json.gz")
        self._keep_candidate(run, row)
        judgement = _judge(run, self._out / "solutions")
        row = with_cells(row, judgement_cells(run, judgement))
        if not row["valid"]:
            from mpcplan.road.passable import fault_of

            row["cause"] = "; ".join(filter(None, (fault_of(loaded), str(row["cause"]))))
        if self._bound and judgement is not None and row["valid"]:
            # what ends the worker from here on costs the bound only
            self._write(row | {"bound_by": "no bound: not finished"})
            row |= bound_cells(run, judgement, self._out / "bounds")
        return row

    def _foreign(self) -> dict[str, Any]:
        """The argument for another planner than our own."""
        if self._planner == OWN_PLANNER:
            return {}
        from mpcplan.simulate.foreign import load_planner

        return {"planner": load_planner(self._planner)}

    def _keep_candidate(self, run: "Run", row: Row) -> None:
        """Write the solution and a row for it, if it passes our own verification."""
        if _verified(run):
            run.write_solution(self._out / "solutions")
            self._write(row | {"status": UNJUDGED, "cause": "not judged"})

    def _progress(self, step: int, last_step: int) -> None:
        self._where = f"in the drive, at step {step} of at most {last_step}"

    def cut(self, number: int, _: object) -> None:
        """End on a signal, with a row that says how far the work has come."""
        if read_row(self._row_path) is None:
            self._write(self._row(CUT, self._where))
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)

    def _row(self, status: str, cause: str = "") -> Row:
        name, kind = benchmark_id(self._scenario), kind_of(self._scenario)
        return empty_row(name, status, cause, kind, self._planner)

    def _write(self, row: Row) -> None:
        write_whole(self._row_path, json.dumps(row))

    def finish(self) -> None:
        """Work, and write the row."""
        row = self.work()
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # too late to be cut
        self._write(row)


def _verified(run: "Run") -> bool:
    """Our own verification; the official one is asked also where this one refuses or fails."""
    from mpcplan.bench.candidate import verify_run

    try:
        finding = verify_run(run)
    except Exception:
        traceback.print_exc()
        return False
    print(f"own verification: {finding}", flush=True)
    return finding.ok


def _judge(run: "Run", folder: Path) -> "Judgement | None":
    """The verdicts; a run that is not solved may well have no solution to judge."""
    from mpcplan.score.judge import judge_run
    from mpcplan.score.referee_start import as_fork

    try:
        return judge_run(run, folder, start=as_fork)
    except Exception:
        if run.solved:
            raise
        traceback.print_exc()
        return None


def write_trace(trace: dict[str, Any], path: Path) -> None:
    """A trace as compressed JSON, the same bytes for the same trace."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(gzip.compress(json.dumps(trace, sort_keys=True).encode(), mtime=0))


def _brief(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:300]


def _place(error: BaseException) -> str:
    """File and line of the innermost frame within this package."""
    package = str(Path(__file__).resolve().parents[1])
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if frame.filename.startswith(package)] or frames
    return f"{Path(ours[-1].filename).name}, line {ours[-1].lineno}" if ours else "unknown place"


def end_with_parent() -> None:
    """Kill this process's group when standard input, a pipe from the parent, comes to its end.

    A parent that was killed can limit and stop nobody any more. Nothing is read: what comes through
    the pipe is for the nursery, where there is one.
    """
    pipe = select.poll()
    pipe.register(0, 0)  # the pipe's end is told whatever is asked for

    def wait() -> None:
        pipe.poll()
        os.killpg(0, signal.SIGKILL)

    threading.Thread(target=wait, daemon=True).start()


def main(arguments: Sequence[str] | None = None) -> None:
    """Work and write the row; without arguments those of the command line."""
    parser = argparse.ArgumentParser(prog="mpcplan.bench.worker")
    for name in ("scenario", "out", "row"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--config", type=Path, required=True)
    parser.add_argument("--planner", default=OWN_PLANNER)
    parser.add_argument("--bound", action="store_true")
    parser.add_argument("--end-with-parent", action="store_true")
    args = parser.parse_args(arguments)
    worker = Worker(args.scenario, args.out, args.row, args.config, args.planner, args.bound)
    signal.signal(signal.SIGTERM, worker.cut)
    if args.end_with_parent:
        end_with_parent()
    worker.finish()


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # skips the extension modules' leak reports
