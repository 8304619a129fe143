"""The command line: solve, evaluate, bench, compare, config.

Exit codes: 0 done (solved, valid), 1 not solved or not valid, 2 bad input, 3 an error of the
program itself, 130 interrupted. Modules that take long to import are imported where needed.
"""

import argparse
import json
import os
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from mpcplan.console import progress, quiet
from mpcplan.errors import InputError, MpcplanError, RefereeError

if TYPE_CHECKING:
    from mpcplan.score.verdict import Verdict
    from mpcplan.simulate.run import Drive, Run

OK, FAILED, BAD_INPUT, INTERNAL, INTERRUPTED = 0, 1, 2, 3, 130


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
        args = _parser().parse_args(argv)
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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="mpcplan", description="Motion planner for CommonRoad scenarios."
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    solve = _command(commands, "solve", _solve, "plan and drive one scenario, and judge the result")
    solve.add_argument("scenario", type=Path, metavar="SCENARIO", help="CommonRoad XML file")
    solve.add_argument("--out", type=Path, help="folder for the results (default: out/<id>)")
    _add_config(solve)

    judge = _command(commands, "evaluate", _evaluate, "judge a solution by the official checker")
    judge.add_argument("scenario", type=Path, metavar="SCENARIO", help="CommonRoad XML file")
    judge.add_argument("solution", type=Path, metavar="SOLUTION", help="solution XML file")
    judge.add_argument("--json", action="store_true", help="print the verdict as JSON")

    bench = _command(commands, "bench", _bench, "solve many scenarios and print the table")
    _add_bench(bench)
    _add_config(bench)

    versus = _command(commands, "compare", _compare, "compare two tables of results")
    versus.add_argument("a", metavar="A", help="results.csv or its folder")
    versus.add_argument("b", metavar="B", help="another one, perhaps with a column 'planner'")
    versus.add_argument("--planner", help="compare with this planner of B only")

    config = _command(commands, "config", _config, "print the configuration in effect")
    _add_config(config)
    return parser


def _command(
    commands: Any, name: str, run: Callable[[argparse.Namespace], int], text: str
) -> argparse.ArgumentParser:
    command: argparse.ArgumentParser = commands.add_parser(name, help=text, description=text + ".")
    command.set_defaults(run=run)
    return command


def _add_config(command: argparse.ArgumentParser) -> None:
    command.add_argument("--config", type=Path, metavar="FILE", help="configuration (YAML)")
    command.add_argument(
        "--set", action="append", default=[], metavar="SECTION.KEY=VALUE",
        help="change one parameter; may be repeated",
    )  # fmt: skip


def _add_bench(bench: argparse.ArgumentParser) -> None:
    bench.add_argument("paths", nargs="+", metavar="PATH", help="scenario files or folders of them")
    bench.add_argument("--out", type=Path, required=True, help="folder for the results; resumable")
    bench.add_argument("--jobs", type=int, default=1, help="scenarios at a time (default: 1)")
    bench.add_argument(
        "--timeout", type=float, default=600.0, metavar="S", help="seconds per scenario (600)"
    )
    bench.add_argument(
        "--memory", type=float, default=4000.0, metavar="MB",
        help="address space per scenario in MB (4000)",
    )  # fmt: skip


def _solve(args: argparse.Namespace) -> int:
    from mpcplan.config_io import load_config

    config = load_config(args.config, args.set)
    os.environ.setdefault("MPLBACKEND", "Agg")
    with quiet() as terminal:
        from mpcplan.scenario import load

        loaded = load(args.scenario)  # bad input is found before the solvers are imported
        from mpcplan.simulate.loop import drive

        folder = _make_folder(args.out or Path("out", loaded.id))
        run = drive(loaded, config, progress(terminal))
        files, verdict = _write(run, folder)
    print(_report(run, verdict))
    with quiet():
        from mpcplan.show.plots import plot_run

        picture = folder / f"{loaded.id}.png"
        plot_run(run, picture)
    print("\n".join(f"{'files' if not i else '':<10}{f}" for i, f in enumerate([*files, picture])))
    return OK if run.solved and verdict is not None and verdict.valid else FAILED


def _make_folder(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {folder}: {error.strerror}") from error
    if not os.access(folder, os.W_OK):
        raise InputError(f"cannot write to the folder {folder}")
    return folder


def _write(run: "Run", folder: Path) -> tuple[list[Path], "Verdict | None"]:
    """Trace and solution files, and the verdict (None: nothing driven that could be judged)."""
    from mpcplan.score.referee import evaluate

    trace = folder / "trace.json"
    trace.write_text(json.dumps(run.trace(), indent=1) + "\n", encoding="utf-8")
    try:
        solution = run.write_solution(folder)
        return [solution, trace], evaluate(run.loaded.path, solution)
    except Exception:
        if run.solved:
            raise
        return [trace], None  # the run's own cause says what is wrong


def _report(run: "Run", verdict: "Verdict | None") -> str:
    """The verdict, the goal, the cost and the planning times in a few lines."""
    import numpy as np

    from mpcplan.score.verdict import verdict_lines

    lines = [f"{'note':<10}{note}" for note in run.loaded.notes]
    lines += [_goal_line(drive, run.loaded.dt) for drive in run.drives]
    lines += verdict_lines(verdict) if verdict is not None else []
    times_ms = np.asarray(run.planning_ms, dtype=float)
    if len(times_ms):
        p50, p95, top = np.percentile(times_ms, (50, 95, 100))
        times = f"p50 {p50:.0f} ms, p95 {p95:.0f} ms, longest {top:.0f} ms"
        lines.append(f"{'planning':<10}{len(times_ms)} cycles, {times}")
    return "\n".join([f"{run.loaded.id}: {_outcome(run, verdict)}", *lines])


def _outcome(run: "Run", verdict: "Verdict | None") -> str:
    if not run.solved:
        return f"not solved: {run.cause}"
    return "solved, valid" if verdict is not None and verdict.valid else "driven, but not valid"


def _goal_line(drive: "Drive", dt: float) -> str:
    step, name = drive.reached_step, f"problem {drive.problem_id}: "
    reached = f"reached at step {step} ({step * dt:.1f} s)" if step is not None else drive.cause
    return f"{'goal':<10}{name}{reached.removeprefix(name)}"


def _evaluate(args: argparse.Namespace) -> int:
    from mpcplan.score.referee import evaluate
    from mpcplan.score.verdict import verdict_lines

    verdict = evaluate(args.scenario, args.solution)
    if args.json:
        print(json.dumps(asdict(verdict), indent=1))
    else:
        word = "valid" if verdict.valid else "not valid"
        print("\n".join([f"{verdict.scenario}: {word}", *verdict_lines(verdict)]))
    return OK if verdict.valid else FAILED


def _bench(args: argparse.Namespace) -> int:
    from mpcplan.bench import bench, summary

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # stops the workers, like Ctrl-C
    limits = {"timeout_s": args.timeout, "memory_mb": args.memory}
    path, rows = bench(args.paths, args.out, args.jobs, config_path=args.config,
                       overrides=args.set, **limits)  # fmt: skip
    print(f"{summary(rows)}\n\n{path}")
    return OK


def _compare(args: argparse.Namespace) -> int:
    from mpcplan.bench import compare

    print(compare(args.a, args.b, args.planner))
    return OK


def _config(args: argparse.Namespace) -> int:
    from mpcplan.config_io import dump_config, load_config

    print(dump_config(load_config(args.config, args.set)), end="")
    return OK
