"""The other commands: explain, bound, bench-solvers, compare, forecasts, twin, config."""

import argparse
import os
from pathlib import Path
from typing import Any

from mpcplan.cli.common import FAILED, NOTE, OK, configured, line, made_folder
from mpcplan.console import doing, progress, quiet
from mpcplan.errors import InputError, MpcplanError


def explain(args: argparse.Namespace) -> int:
    """Tell in words what a run did and why."""
    from mpcplan.explain.cycle import cycle_lines
    from mpcplan.explain.read import read_trace
    from mpcplan.explain.run import run_lines

    trace = read_trace(args.run_folder)
    if args.step is not None:
        lines = cycle_lines(trace, args.step)
    else:
        verdict, cause = _verdict(args.run_folder, trace)
        lines = run_lines(trace, verdict, _scenario_fault(trace, cause))
    print("\n".join(lines))
    return OK


def _verdict(run: Path, trace: dict[str, Any]) -> tuple[str, str]:
    """What the table of `bench` says of a run, and the cause there; '' for one of `solve`."""
    from mpcplan.bench.store import read_row

    # a row is named after the scenario's file, which may be longer than its id
    rows = sorted((run.parent.parent / "rows").glob(f"{trace.get('scenario')}*.json"))
    row = read_row(rows[0]) if rows else None
    if row is None:
        return "", ""
    cause = str(row["cause"])
    if row["valid"]:
        return f"valid, TR1 {row['TR1']:.3f}" if isinstance(row["TR1"], float) else "valid", cause
    # why it did not reach the goal is told below
    return f"{row['status']}: {cause}" if row["status"] == "invalid" else str(row["status"]), cause


def _scenario_fault(trace: dict[str, Any], cause: str) -> str:
    """Why nobody can solve the scenario of a failed run; '' where that is not so, or not known."""
    from mpcplan.explain.fault import NO_SOLUTION

    if cause.startswith(NO_SOLUTION):
        return cause.partition(";")[0]
    file, failed = trace.get("file"), any(d.get("reached_step") is None for d in trace["drives"])
    if not failed or cause or file is None or not Path(file).is_file():
        return ""
    with quiet():
        from mpcplan.road.passable import fault_of
        from mpcplan.scenario import load

        try:
            return fault_of(load(file))
        except MpcplanError:  # the scenario has changed since: the trace still tells its part
            return ""


def bound(args: argparse.Namespace) -> int:
    """Seek the clairvoyant optimum of scenarios."""
    from mpcplan.bench.find import find_scenarios
    from mpcplan.bound.report import bound_lines

    config, folder = configured(args), made_folder(args.out)
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


def bench_solvers(args: argparse.Namespace) -> int:
    """Compare solvers of the refinement's problem."""
    from mpcplan.bench.find import find_scenarios

    config = configured(args)
    paths = list(find_scenarios(args.paths).values())
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    with quiet() as terminal:
        from mpcplan.solvers.report import compare_solvers, known_backends

        backends = known_backends(args.backends)
        told = compare_solvers(paths, backends, config, max(args.problems, 1), doing(terminal))
    print("\n".join(told).rstrip())
    return OK


def compare(args: argparse.Namespace) -> int:
    """Compare two tables of results."""
    from mpcplan import bench

    print(bench.compare(args.a, args.b, args.planner))
    return OK


def forecasts(args: argparse.Namespace) -> int:
    """Measure the predictions on simulated traffic."""
    with quiet():
        from mpcplan.bench.files import write_whole, writing_to
        from mpcplan.bench.forecasts import as_csv, as_table, forecast_errors

        errors = forecast_errors(args.results)
        if args.csv is not None:
            with writing_to(args.csv):
                write_whole(args.csv, as_csv(errors))
    print(
        f"displacement of the centres [m], spread along the predicted way [1]\n{as_table(errors)}"
    )
    return OK


def twin(args: argparse.Namespace) -> int:
    """Make an interactive scenario out of a recorded one."""
    with quiet():
        from mpcplan.sumo.twin import make_twin

        twin = make_twin(args.scenario, args.out)
    lines = [f"{twin.id} in {twin.folder}", *(line(NOTE, note) for note in twin.notes)]
    print("\n".join([*lines, line("drive it", f"mpcplan solve {twin.folder}")]))
    return OK


def config(args: argparse.Namespace) -> int:
    """Print the configuration in effect."""
    from mpcplan.config.files import dump_config, load_config

    print(dump_config(load_config(args.config, args.set)), end="")
    return OK
