"""report: results as a page."""

import argparse

from mpcplan.cli.common import OK
from mpcplan.console import doing, quiet


def report(args: argparse.Namespace) -> int:
    """Write one HTML page about the results of a benchmark, or of several."""
    names = None if args.names is None else [name.strip() for name in args.names.split(",")]
    with quiet() as terminal:
        from mpcplan.report.write import write_report

        tell = doing(terminal)
        written = write_report(args.results, args.out, names, args.title, args.embed, tell)
        tell("")
    for run in written.runs:
        print(f"{run.name}: {len(run.entries)} scenarios, {len(run.solved)} solved")
    print(f"{args.out} ({written.size_mb:.1f} MB)")
    return OK
