"""The other commands: explain, bound, bench-solvers, compare, forecasts, twin, config."""

import argparse
import os

from mpcplan.cli.common import FAILED, OK, configured, made_folder
from mpcplan.console import doing, progress, quiet
from mpcplan.errors import InputError, MpcplanError


def explain(args: argparse.Namespace) -> int:
    """Tell in words what a run did and why."""
    from mpcplan.explain.cycle import cycle_lines
    from mpcplan.explain.read import read_trace
    from mpcplan.explain.run import run_lines

    trace = read_trace(args.run_folder)
    print("\n".join(run_lines(trace) if args.step is None else cycle_lines(trace, args.step)))
    return OK


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
    print(f"displacement of the centres [m]\n{as_table(errors)}")
    return OK


def twin(args: argparse.Namespace) -> int:
    """Make an interactive scenario out of a recorded one."""
    with quiet():
        from mpcplan.sumo.twin import make_twin

        twin = make_twin(args.scenario, args.out)
    lines = [f"{twin.id} in {twin.folder}", *(f"{'note':<10}{note}" for note in twin.notes)]
    print("\n".join([*lines, f"{'drive it':<10}mpcplan solve {twin.folder}"]))
    return OK


def config(args: argparse.Namespace) -> int:
    """Print the configuration in effect."""
    from mpcplan.config.files import dump_config, load_config

    print(dump_config(load_config(args.config, args.set)), end="")
    return OK
