"""The arguments of all commands."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpcplan.cli.many import bench, compete
from mpcplan.cli.report import report
from mpcplan.cli.show import show
from mpcplan.cli.solve import evaluate, solve
from mpcplan.cli.tools import bench_solvers, bound, compare, config, explain, forecasts, twin


def parser() -> argparse.ArgumentParser:
    """The parser; each command's function is its default ``run``."""
    whole = argparse.ArgumentParser(
        prog="mpcplan", description="Motion planner for CommonRoad scenarios."
    )
    commands = whole.add_subparsers(required=True, metavar="COMMAND")
    one = _command(commands, "solve", solve, "plan and drive one scenario, and judge the result")
    one.add_argument("scenario", type=Path, metavar="SCENARIO", help="CommonRoad XML file")
    one.add_argument("--out", type=Path, help="folder for the results (default: out/<id>)")
    _add_planner(one)
    _add_config(one)

    why = _command(commands, "explain", explain, "tell in words what a run did and why")
    why.add_argument(
        "run_folder", type=Path, metavar="RUN", help="folder of `solve`, or a trace of `bench`"
    )
    why.add_argument("--step", type=int, metavar="K", help="tell the cycle of this time step")

    seen = _command(commands, "show", show, "draw a run, its planning cycles, or a film of it")
    _add_show(seen)

    judge = _command(commands, "evaluate", evaluate, "judge a solution by the official checker")
    judge.add_argument("scenario", type=Path, metavar="SCENARIO", help="CommonRoad XML file")
    judge.add_argument("solution", type=Path, metavar="SOLUTION", help="solution XML file")
    judge.add_argument("--json", action="store_true", help="print the verdict as JSON")

    table = _command(commands, "bench", bench, "solve many scenarios and print the table")
    _add_bench(table)
    _add_many(table)

    contest = _command(
        commands, "compete", compete, "solve as many scenarios as a budget of time buys"
    )
    _add_compete(contest)
    _add_many(contest)

    best = _command(
        commands, "bound", bound, "seek the clairvoyant optimum: what was possible with hindsight"
    )
    best.add_argument("paths", nargs="+", metavar="PATH", help="scenario files or folders of them")
    best.add_argument(
        "--out", type=Path, default=Path("out", "bounds"), metavar="FOLDER",
        help="folder for the solutions (default: out/bounds)",
    )  # fmt: skip
    _add_config(best)

    solvers = _command(
        commands, "bench-solvers", bench_solvers,
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

    versus = _command(commands, "compare", compare, "compare two tables of results")
    versus.add_argument("a", metavar="A", help="results.csv or its folder")
    versus.add_argument("b", metavar="B", help="another one, perhaps with a column 'planner'")
    versus.add_argument("--planner", help="compare with this planner of B only")

    page = _command(commands, "report", report, "make one HTML page of results of `bench`")
    _add_report(page)

    errors = _command(
        commands, "forecasts", forecasts, "measure the predictions on simulated traffic"
    )
    errors.add_argument("results", type=Path, metavar="RESULTS", help="a benchmark's folder")
    errors.add_argument("--csv", type=Path, metavar="FILE", help="write the table there too")

    pair = _command(commands, "twin", twin, "make an interactive scenario out of a recorded one")
    pair.add_argument("scenario", type=Path, metavar="SCENARIO", help="CommonRoad XML file")
    pair.add_argument(
        "--out", type=Path, required=True, metavar="FOLDER", help="folder to make; new or empty"
    )

    shown = _command(commands, "config", config, "print the configuration in effect")
    _add_config(shown)
    return whole


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


def _add_show(seen: argparse.ArgumentParser) -> None:
    seen.add_argument(
        "run_folder", type=Path, metavar="RUN",
        help="folder of `solve`, a trace of `bench`, or the folder of `bench` for all its runs",
    )  # fmt: skip
    what = seen.add_mutually_exclusive_group()
    what.add_argument(
        "--step", metavar="K",
        help="a picture of this time step with all that was planned; FIRST:LAST:STRIDE or 'all' "
        "(planning cycles) for a series",
    )  # fmt: skip
    what.add_argument(
        "--animate", type=Path, metavar="FILE",
        help="a film: FILE.mp4 or FILE.gif; of all runs of `bench` just mp4 or gif",
    )  # fmt: skip
    seen.add_argument(
        "--fps", type=float, default=10.0, metavar="N",
        help="frames per second of the film, one per time step of 0.1 s: 10 is real time (10)",
    )  # fmt: skip
    seen.add_argument("--labels", action="store_true", help="write the ids of all others")
    seen.add_argument(
        "--radius", type=float, metavar="M",
        help="metres around the vehicle that are shown (default: by its speed)",
    )  # fmt: skip
    seen.add_argument("--problem", type=int, metavar="ID", help="of several planning problems")
    seen.add_argument(
        "--scenario", type=Path, metavar="FILE",
        help="the run's scenario, where it is not where the trace says; of all runs of `bench` the "
        "folder of their scenarios",
    )  # fmt: skip
    seen.add_argument(
        "--out", type=Path, metavar="FOLDER",
        help="folder for pictures (default: the run's own; of bench, its folder 'pictures')",
    )  # fmt: skip
    many = seen.add_argument_group("for all runs of a benchmark")
    many.add_argument("--failed", action="store_true", help="those without a valid solution only")
    many.add_argument("--again", action="store_true", help="also those that are drawn already")
    many.add_argument("--jobs", type=int, metavar="N", help="runs at a time (default: 1)")


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


def _add_report(page: argparse.ArgumentParser) -> None:
    page.add_argument(
        "results", nargs="+", type=Path, metavar="RESULTS",
        help="folder of `bench`, or a table with its columns; several are compared",
    )  # fmt: skip
    page.add_argument("--out", type=Path, required=True, metavar="FILE", help="HTML file to write")
    page.add_argument("--names", metavar="A,B", help="of the runs (default: the folders' names)")
    page.add_argument("--title", metavar="TEXT", help="heading of the page")
    page.add_argument(
        "--embed", action="store_true",
        help="put the pictures into the page, made smaller, instead of links to them",
    )  # fmt: skip


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
