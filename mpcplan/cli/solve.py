"""solve and evaluate: one scenario, one solution."""

import argparse
import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from mpcplan.cli.common import FAILED, NOTE, OK, configured, line, made_folder
from mpcplan.console import progress, quiet

if TYPE_CHECKING:
    import numpy as np

    from mpcplan.rules.judge import Robustness, RulesDriven
    from mpcplan.score.judge import Judgement
    from mpcplan.score.verdict import Verdict
    from mpcplan.simulate.run import Drive, Run


def solve(args: argparse.Namespace) -> int:
    """Plan and drive one scenario, and judge the result."""
    config = configured(args)
    os.environ.setdefault("MPLBACKEND", "Agg")
    with quiet() as terminal:
        from mpcplan.scenario import load

        loaded = load(args.scenario)  # bad input is found before the solvers are imported
        from mpcplan.simulate.foreign import load_planner
        from mpcplan.simulate.loop import drive

        planner = load_planner(args.planner)
        folder = made_folder(args.out or Path("out", loaded.id))
        run = drive(loaded, config, progress(terminal), planner)
        files, judgement = _write(run, folder)
        rules, told = rules_told(run)
    verdict = judgement.verdict if judgement is not None else None
    print("\n".join([_report(run, judgement), *told]))
    with quiet():
        from mpcplan.show.plots import plot_run

        picture = folder / f"{loaded.id}.png"
        plot_run(run, picture, rules)
    print("\n".join(line("" if i else "files", f) for i, f in enumerate([*files, picture])))
    return OK if run.solved and verdict is not None and verdict.valid else FAILED


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
    lines = [line(NOTE, note) for note in run.notes]
    if verdict is None or not verdict.valid:
        lines += [line("scenario", fault) for fault in (fault_of(run.loaded),) if fault]
    lines += [_goal_line(drive, run.loaded.dt) for drive in run.drives]
    lines += verdict_lines(verdict) if verdict is not None else []
    if judgement is not None and judgement.late is not None:
        late = judgement.late
        lines.append(line("late", f"replayed one step late: {late.cause or 'valid'}"))
    lines += _times("planning", "cycles", run.planning_ms)
    lines += _times("traffic", "steps", run.step_ms) if run.loaded.interactive else []
    return "\n".join([f"{run.loaded.id}: {_outcome(run, verdict)}", *lines])


def rules_told(run: "Run") -> "tuple[tuple[RulesDriven, ...], list[str]]":
    """How each drive kept the rules (nothing where that cannot be told), and it in words."""
    from mpcplan.simulate.rules import rules_of, together

    if not run.driven:
        return (), []
    try:
        rules = rules_of(run)
    except Exception as error:  # whatever it is: the drive and its verdict stand
        return (), [line("rules", f"not judged: {type(error).__name__}: {error}")]
    worst = together(rules)
    flow = "violated" if worst.traffic_flow.lowest < 0 else "kept"
    return rules, [
        _rule_line("R_G1", f"safe distance {worst.kept}", worst.safe_distance, "m"),
        _rule_line("R_G4", f"traffic flow {flow}", worst.traffic_flow, "m/s"),
    ]


def _rule_line(name: str, told: str, rule: "Robustness", unit: str) -> str:
    if rule.step is None:
        return line(name, f"{told}: it never applies")
    return line(name, f"{told}: lowest robustness {rule.lowest:.2f} {unit} at step {rule.step}")


def _times(what: str, of: str, times_ms: "np.ndarray") -> list[str]:
    """Count and percentiles of some times, no line where there are none."""
    import numpy as np

    if not len(times_ms):
        return []
    p50, p95, top = map(_milliseconds, np.percentile(times_ms, (50, 95, 100)))
    return [line(what, f"{len(times_ms)} {of}, p50 {p50}, p95 {p95}, longest {top}")]


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
    return line("goal", f"{name}{reached.removeprefix(name)}")


def evaluate(args: argparse.Namespace) -> int:
    """Judge a solution."""
    from mpcplan.score import referee
    from mpcplan.score.verdict import verdict_lines

    verdict = referee.evaluate(args.scenario, args.solution)
    if args.json:
        print(json.dumps(asdict(verdict), indent=1))
    else:
        word = "valid" if verdict.valid else "not valid"
        print("\n".join([f"{verdict.scenario}: {word}", *verdict_lines(verdict)]))
    return OK if verdict.valid else FAILED
