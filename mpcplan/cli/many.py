"""bench and compete: many scenarios."""

import argparse
import signal
import threading
from typing import Any

from mpcplan.cli.common import FAILED, INTERRUPTED, OK, configured
from mpcplan.console import quiet


def bench(args: argparse.Namespace) -> int:
    """Solve many scenarios and print the table."""
    from mpcplan import bench as benchmark

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # stops the workers, like Ctrl-C
    path, rows = benchmark.bench(args.paths, args.out, timeout_s=args.timeout, bound=args.bound,
                       **_many(args, jobs=1))  # fmt: skip
    print(f"{benchmark.summary(rows)}\n\n{path}")
    return OK


def compete(args: argparse.Namespace) -> int:
    """Solve as many scenarios as a budget of time buys."""
    from mpcplan import compete as contest
    from mpcplan.bench import summary

    budget_s = contest.parse_budget(args.budget)
    stop = _stop_signals()
    result = contest.compete(args.scenarios, args.out, budget_s=budget_s, stop=stop.is_set,
                     **_many(args, jobs=2))  # fmt: skip
    print(f"{summary(result.rows)}\n")
    unjudged = f", {result.unjudged} of them not judged" if result.unjudged else ""
    print(f"{result.solutions} solutions{unjudged} in {args.out}, report in {result.report}")
    if result.interrupted:
        return INTERRUPTED
    return OK if result.solutions else FAILED


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
    configured(args)  # so is a wrong name in the configuration
    here = jobs if args.engine == "local" and args.jobs is None else args.jobs
    return {
        "engine": open_engine(args.engine, args.address, here),
        "config_path": args.config,
        "overrides": args.set,
        "memory_mb": args.memory,
        "planner": args.planner,
    }
