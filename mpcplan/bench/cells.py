"""The cells of a row that a run and its judgement fill."""

import traceback
from pathlib import Path
from typing import TYPE_CHECKING

from mpcplan.bench.store import Row
from mpcplan.errors import MpcplanError
from mpcplan.score.tr1 import PARTS
from mpcplan.score.verdict import Verdict

if TYPE_CHECKING:
    from mpcplan.score.judge import Judgement
    from mpcplan.simulate.run import Run
    from mpcplan.trajectory import Array

_DIGITS_MS = 3
_DIGITS_RULES = 3


def with_cells(row: Row, *more: Row) -> Row:
    """The row with more cells; notes are added to those that it has."""
    notes = [str(one["notes"]) for one in (row, *more) if one.get("notes")]
    for cells in more:
        row = row | cells
    return row | {"notes": "; ".join(notes)}


def run_cells(run: "Run") -> Row:
    """Cycles, the times of planning and of the simulation, and notes."""
    cells: Row = {"cycles": len(run.planning_ms), "notes": "; ".join(run.notes)}
    planning = {"plan_p50_ms": 50.0, "plan_p95_ms": 95.0, "plan_max_ms": 100.0}
    cells |= _percentiles(run.planning_ms, planning)
    if run.loaded.interactive:
        cells |= _percentiles(run.step_ms, {"sim_ms_p50": 50.0, "sim_ms_max": 100.0})
    return cells


def rules_cells(run: "Run") -> Row:
    """The robustness of the rules; what goes wrong there is a note and costs nothing else."""
    if not run.driven:
        return {}
    from mpcplan.simulate.rules import rules_of, together

    try:
        found = together(rules_of(run))
    except Exception as error:
        traceback.print_exc()
        return {"notes": f"rules not judged: {type(error).__name__}: {error}"}
    cells: Row = {"R_G1_kept": found.kept}
    for name, rule in (("R_G1", found.safe_distance), ("R_G4", found.traffic_flow)):
        if rule.step is not None:
            cells |= {name: round(rule.lowest, _DIGITS_RULES), f"{name}_step": rule.step}
    return cells


def _percentiles(times_ms: "Array", wanted: dict[str, float]) -> Row:
    """Percentiles of times [ms] by column, nothing where there are no times."""
    import numpy as np

    if not len(times_ms):
        return {}
    values = np.percentile(times_ms, list(wanted.values()))
    return {n: round(float(v), _DIGITS_MS) for n, v in zip(wanted, values, strict=True)}


def judgement_cells(run: "Run", judgement: "Judgement | None") -> Row:
    """Status, validity on time and late, cause, the checks and the cost."""
    if judgement is None:
        return {"status": "not_solved", "valid": False, "cause": run.cause}
    verdict, late = judgement.verdict, judgement.late
    cells = verdict_cells(verdict)
    if late is not None:
        cells |= {"valid_late": late.valid, "cause_late": late.cause}
    if not run.solved:
        return cells | {"status": "not_solved", "valid": False, "cause": run.cause}
    status = "solved" if verdict.valid else "invalid"
    return cells | {"status": status, "valid": verdict.valid, "cause": verdict.cause}


def bound_cells(run: "Run", judgement: "Judgement", folder: Path) -> Row:
    """The clairvoyant optimum on the run's own traffic, and TR1 as a multiple of it."""
    from mpcplan.bound.judged import bound_of_run
    from mpcplan.score.referee_start import as_fork

    cost = judgement.verdict.tr1
    if cost is None:
        return {"bound_by": "no bound: the run has no cost"}
    try:
        found = bound_of_run(run, judgement, folder, as_fork)
    except MpcplanError as error:
        return {"bound_by": f"no bound: {error}"}
    best = min(found.tr1, cost)
    gap = cost / best if best > 0 else 1.0
    by = found.words if found.tr1 < cost else f"the drive; {found.tr1:.3f} by {found.words}"
    return {"bound": best, "gap": gap, "bound_by": by}


def verdict_cells(verdict: Verdict) -> Row:
    """The checks and the cost, or a note on why there is none."""
    cells: Row = {**verdict.checks, "duration_s": round(verdict.duration_s, 3)}
    if verdict.parts is None:
        return cells | {"notes": f"no cost: {verdict.cost_error}"}
    cells |= {part: verdict.parts[part] for part in PARTS}
    return cells | {"TR1": verdict.tr1, "TR1_report": verdict.tr1_report}
