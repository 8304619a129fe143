"""The command line: solve, evaluate, bench, compete, bound, bench-solvers, compare,
forecasts, twin, config.

Exit codes: 0 done (solved, valid), 1 not solved or not valid, 2 bad input, 3 an error of the
program itself, 130 interrupted. Of many scenarios some may fail: bench ends with 0 when every one
has its row, compete when there is at least one solution. Modules that take long to import are
imported where needed.
"""

import argparse
import json
import os
import signal
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from mpcplan.console import doing, progress, quiet
from mpcplan.errors import InputError, MpcplanError, RefereeError

if TYPE_CHECKING:
    import numpy as np

    from mpcplan.score.judge import Judgement
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
    _add_planner(solve)
    _add_config(solve)

    judge = _command(commands, "evaluate", _evaluate, "judge a solution by the official checker")
    judge.add_argument("scenario", type=Path, metavar="SCENARIO", help="CommonRoad XML file")
    judge.add_argument("solution", type=Path, metavar="SOLUTION", help="solution XML file")
    judge.add_argument("--json", action="store_true", help="print the verdict as JSON")

    bench = _command(commands, "bench", _bench, "solve many scenarios and print the table")
    _add_bench(bench)
    _add_many(bench)

    contest = _command(
        commands, "compete", _compete, "solve as many scenarios as a budget of time buys"
    )
    _add_compete(contest)
    _add_many(contest)

    bound = _command(
        commands, "bound", _bound, "seek the clairvoyant optimum: what was possible with hindsight"
    )
    bound.add_argument("paths", nargs="+", metavar="PATH", help="scenario files or folders of them")
    bound.add_argument(
        "--out", type=Path, default=Path("out", "bounds"), metavar="FOLDER",
        help="folder for the solutions (default: out/bounds)",
    )  # fmt: skip
    _add_config(bound)

    solvers = _command(
        commands, "bench-solvers", _bench_solvers,
        "compare solvers of the refinement's problem on the problems of real drives",
    )  # fmt: skip
    solvers.add_argument(
        "paths", nargs="+", metavar="PATH", help="scenario files or folders of them"
    )
    solvers.add_argument(
        "--backends", metavar="A,B", help="solvers, see refine.backend (default: a choice)"
    )
    solvers.add_argument(
        "--problems", type=int, default=60, metavar="N", help="of each group at most (60)"
    )
    _add_config(solvers)

    versus = _command(commands, "compare", _compare, "compare two tables of results")
    versus.add_argument("a", metavar="A", help="results.csv or its folder")
    versus.add_argument("b", metavar="B", help="another one, perhaps with a column 'planner'")
    versus.add_argument("--planner", help="compare with this planner of B only")

    forecasts = _command(
        commands, "forecasts", _forecasts, "measure the predictions on simulated traffic"
    )
    forecasts.add_argument("results", type=Path, metavar="RESULTS", help="a benchmark's folder")
    forecasts.add_argument("--csv", type=Path, metavar="FILE", help="write the table there too")

    twin = _command(commands, "twin", _twin, "make an interactive scenario out of a recorded one")
    twin.add_argument("scenario", type=Path, metavar="SCENARIO", help="CommonRoad XML file")
    twin.add_argument(
        "--out", type=Path, required=True, metavar="FOLDER", help="folder to make; new or empty"
    )

    config = _command(commands, "config", _config, "print the configuration in effect")
    _add_config(config)
    return parser


def _command(
    commands: Any, name: str, run: Callable[[argparse.Namespace], int], text: str
) -> argparse.ArgumentParser:
    command: argparse.ArgumentParser = commands.add_parser(name, help=text, description=text + ".")
    command.set_defaults(run=run)
    return command


def _add_planner(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--planner", default="mpcplan", metavar="MODULE:CLASS",
        help="drive by this class, or by 'idm' or 'constant_velocity' (default: mpcplan)",
    )  # fmt: skip


def _add_config(command: argparse.ArgumentParser) -> None:
    command.add_argument("--config", type=Path, metavar="FILE", help="configuration (YAML)")
    command.add_argument(
        "--set", action="append", default=[], metavar="SECTION.KEY=VALUE",
        help="change one parameter; may be repeated",
    )  # fmt: skip


def _add_bench(bench: argparse.ArgumentParser) -> None:
    bench.add_argument("paths", nargs="+", metavar="PATH", help="scenario files or folders of them")
    bench.add_argument("--out", type=Path, required=True, help="folder for the results; resumable")
    bench.add_argument("--jobs", type=int, help="scenarios at a time (default: 1)")
    bench.add_argument(
        "--timeout", type=float, default=600.0, metavar="S", help="seconds per scenario (600)"
    )
    bench.add_argument(
        "--bound", action="store_true",
        help="seek the clairvoyant optimum too, and tell TR1 as a multiple of it",
    )  # fmt: skip


def _add_compete(contest: argparse.ArgumentParser) -> None:
    contest.add_argument("scenarios", metavar="IN", type=Path, help="folder of scenarios")
    contest.add_argument("out", metavar="OUT", type=Path, help="folder for solutions; resumable")
    contest.add_argument("--jobs", type=int, help="scenarios at a time (default: 2)")
    contest.add_argument("--budget", default="6h", metavar="TIME", help="6h, 90m, 45s (6h)")


def _add_many(command: argparse.ArgumentParser) -> None:
    """What all commands that run many scenarios have in common."""
    command.add_argument(
        "--memory", type=float, default=4000.0, metavar="MB",
        help="address space per scenario in MB (4000)",
    )  # fmt: skip
    command.add_argument(
        "--engine", choices=("local", "dask"), default="local",
        help="where scenarios run: processes here, or a Dask cluster with all its threads",
    )  # fmt: skip
    command.add_argument("--address", metavar="tcp://HOST:PORT", help="of the Dask scheduler")
    _add_planner(command)
    _add_config(command)


def _solve(args: argparse.Namespace) -> int:
    from mpcplan.config_io import load_config

    config = load_config(args.config, args.set)
    os.environ.setdefault("MPLBACKEND", "Agg")
    with quiet() as terminal:
        from mpcplan.scenario import load

        loaded = load(args.scenario)  # bad input is found before the solvers are imported
        from mpcplan.simulate.foreign import load_planner
        from mpcplan.simulate.loop import drive

        planner = load_planner(args.planner)
        folder = _make_folder(args.out or Path("out", loaded.id))
        run = drive(loaded, config, progress(terminal), planner)
        files, judgement = _write(run, folder)
    verdict = judgement.verdict if judgement is not None else None
    print(_report(run, judgement))
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


def _write(run: "Run", folder: Path) -> tuple[list[Path], "Judgement | None"]:
    """Files, and what is said of the run (None: nothing driven that could be judged)."""
    from mpcplan.score.judge import judge_run

    trace = folder / "trace.json"
    trace.write_text(json.dumps(run.trace(), indent=1) + "\n", encoding="utf-8")
    if not run.solved and not run.driven:
        return [trace], None
    try:
        judgement = judge_run(run, folder)
        return [*judgement.files, trace], judgement
    except Exception:
        if run.solved:
            raise
        return [trace], None  # the run's own cause says what is wrong


def _report(run: "Run", judgement: "Judgement | None") -> str:
    """The verdict, the goal, the cost and the planning times in a few lines."""
    from mpcplan.road.passable import fault_of
    from mpcplan.score.verdict import verdict_lines

    verdict = judgement.verdict if judgement is not None else None
    lines = [f"{'note':<10}{note}" for note in run.notes]
    if verdict is None or not verdict.valid:
        lines += [f"{'scenario':<10}{fault}" for fault in (fault_of(run.loaded),) if fault]
    lines += [_goal_line(drive, run.loaded.dt) for drive in run.drives]
    lines += verdict_lines(verdict) if verdict is not None else []
    if judgement is not None and judgement.late is not None:
        late = judgement.late
        lines.append(f"{'late':<10}replayed one step late: {late.cause or 'valid'}")
    lines += _times("planning", "cycles", run.planning_ms)
    lines += _times("traffic", "steps", run.step_ms) if run.loaded.interactive else []
    return "\n".join([f"{run.loaded.id}: {_outcome(run, verdict)}", *lines])


def _times(what: str, of: str, times_ms: "np.ndarray") -> list[str]:
    """Count and percentiles of some times, no line where there are none."""
    import numpy as np

    if not len(times_ms):
        return []
    p50, p95, top = map(_milliseconds, np.percentile(times_ms, (50, 95, 100)))
    return [f"{what:<10}{len(times_ms)} {of}, p50 {p50}, p95 {p95}, longest {top}"]


def _milliseconds(value: float) -> str:
    """Three digits at least, and never an exponent."""
    return f"{value:.3g} ms" if value < 1000 else f"{value:.0f} ms"


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
    path, rows = bench(args.paths, args.out, timeout_s=args.timeout, bound=args.bound,
                       **_many(args, jobs=1))  # fmt: skip
    print(f"{summary(rows)}\n\n{path}")
    return OK


def _compete(args: argparse.Namespace) -> int:
    from mpcplan.bench import summary
    from mpcplan.compete import compete, parse_budget

    budget_s = parse_budget(args.budget)
    stop = _stop_signals()
    result = compete(args.scenarios, args.out, budget_s=budget_s, stop=stop.is_set,
                     **_many(args, jobs=2))  # fmt: skip
    print(f"{summary(result.rows)}\n")
    unjudged = f", {result.unjudged} of them not judged" if result.unjudged else ""
    print(f"{result.solutions} solutions{unjudged} in {args.out}, report in {result.report}")
    if result.interrupted:
        return INTERRUPTED
    return OK if result.solutions else FAILED


def _bound(args: argparse.Namespace) -> int:
    from mpcplan.bench.find import find_scenarios
    from mpcplan.bound.report import bound_lines
    from mpcplan.config_io import load_config

    config, folder = load_config(args.config, args.set), _make_folder(args.out)
    failed = 0
    for name, path in find_scenarios(args.paths).items():
        try:
            with quiet() as terminal:
                lines = bound_lines(path, config, folder, progress(terminal))
            print("\n".join(lines), flush=True)
        except InputError:
            raise
        except MpcplanError as error:
            failed += 1
            print(f"{name}: {error}", flush=True)
    return FAILED if failed else OK


def _bench_solvers(args: argparse.Namespace) -> int:
    from mpcplan.bench.find import find_scenarios
    from mpcplan.config_io import load_config

    config = load_config(args.config, args.set)
    paths = list(find_scenarios(args.paths).values())
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    with quiet() as terminal:
        from mpcplan.solvers.report import compare_solvers, known_backends

        backends = known_backends(args.backends)
        told = compare_solvers(paths, backends, config, max(args.problems, 1), doing(terminal))
    print("\n".join(told).rstrip())
    return OK


def _stop_signals() -> threading.Event:
    """Set by the first SIGTERM or Ctrl-C, so that the run comes to an orderly end; a second one
    interrupts at once."""
    stop = threading.Event()

    def ask(number: int, frame: Any) -> None:
        if stop.is_set():
            signal.default_int_handler(number, frame)
        stop.set()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, ask)
    return stop


def _many(args: argparse.Namespace, jobs: int) -> dict[str, Any]:
    """Arguments that bench and compete have in common; ``jobs`` of the local engine by default."""
    from mpcplan.bench.engine import open_engine

    if args.planner != "mpcplan":
        with quiet():
            from mpcplan.simulate.foreign_class import find_class

            find_class(args.planner)  # a wrong name is one error, not one per scenario
    here = jobs if args.engine == "local" and args.jobs is None else args.jobs
    return {
        "engine": open_engine(args.engine, args.address, here),
        "config_path": args.config,
        "overrides": args.set,
        "memory_mb": args.memory,
        "planner": args.planner,
    }


def _compare(args: argparse.Namespace) -> int:
    from mpcplan.bench import compare

    print(compare(args.a, args.b, args.planner))
    return OK


def _forecasts(args: argparse.Namespace) -> int:
    with quiet():
        from mpcplan.bench.files import write_whole, writing_to
        from mpcplan.bench.forecasts import as_csv, as_table, forecast_errors

        errors = forecast_errors(args.results)
        if args.csv is not None:
            with writing_to(args.csv):
                write_whole(args.csv, as_csv(errors))
    print(f"displacement of the centres [m]\n{as_table(errors)}")
    return OK


def _twin(args: argparse.Namespace) -> int:
    with quiet():
        from mpcplan.sumo.twin import make_twin

        twin = make_twin(args.scenario, args.out)
    lines = [f"{twin.id} in {twin.folder}", *(f"{'note':<10}{note}" for note in twin.notes)]
    print("\n".join([*lines, f"{'drive it':<10}mpcplan solve {twin.folder}"]))
    return OK


def _config(args: argparse.Namespace) -> int:
    from mpcplan.config_io import dump_config, load_config

    print(dump_config(load_config(args.config, args.set)), end="")
    return OK
