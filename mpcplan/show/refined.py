"""The refinement's problem behind a plan: found again among those that came up in the drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mpcplan.errors import InputError
from mpcplan.refine.problem import Problem
from mpcplan.refine.sqp import SqpResult, solve
from mpcplan.solvers.record import TO_GOAL, Recorded

if TYPE_CHECKING:
    from mpcplan.simulate.run import Cycle, Run


@dataclass(frozen=True, eq=False)
class RefinedPlan:
    """The problem whose solution became a plan.

    Attributes:
        step: time step of the planning cycle.
        problem: the problem.
        fresh: whether it is a fresh seed's, which decides on backend and iterations.
        result: its solution.
    """

    step: int
    problem: Problem
    fresh: bool
    result: SqpResult


def refined_plan(run: Run, problems: Sequence[Recorded]) -> RefinedPlan:
    """The first refined plan of a run, with its problem.

    Args:
        run: what was driven.
        problems: all that came up, see :func:`mpcplan.solvers.record.record_problems`.

    Raises:
        InputError: no plan of the run is a refined one, or its problem is not among those given.
    """
    for drive in run.drives:
        for cycle in drive.cycles:
            if cycle.plan.trace["refine"] is not None:
                return _problem_of(run, cycle, problems)
    raise InputError(f"no plan of {run.loaded.id} is a refined one: there is nothing to show")


def refined_plan_at(run: Run, problems: Sequence[Recorded], step: int) -> RefinedPlan:
    """The refined plan of the cycle that planned at a time step, with its problem.

    Args:
        run: what was driven.
        problems: all that came up.
        step: time step of a planning cycle.

    Raises:
        InputError: that plan is not a refined one, or its problem is not among those given.
    """
    cycles = [cycle for drive in run.drives for cycle in drive.cycles]
    for cycle in cycles:
        if cycle.step == step and cycle.plan.trace["refine"] is not None:
            return _problem_of(run, cycle, problems)
    refined = [str(c.step) for c in cycles if c.plan.trace["refine"] is not None]
    raise InputError(
        f"{run.loaded.id}: no refined plan of step {step}; those of these steps are: "
        f"{', '.join(refined) or 'none'}"
    )


def _problem_of(run: Run, cycle: Cycle, problems: Sequence[Recorded]) -> RefinedPlan:
    """A cycle's plan with its problem.

    Several problems come up in a cycle (seeds, ways to count who is ahead) and one becomes the
    plan. It is recognised by its solution, which is the same to the last digit of the trace.
    """
    told = cycle.plan.trace["refine"]
    for one in problems:
        if one.problem.seed.first_step != cycle.step or one.problem.n != told["steps"]:
            continue
        fresh = one.kind == TO_GOAL
        result = solve(one.problem, run.config.refine, fresh)
        if result.as_dict().items() <= told.items():
            return RefinedPlan(cycle.step, one.problem, fresh, result)
    raise InputError(
        f"the problem of the plan at step {cycle.step} is not among those recorded: record "
        "them with the run's configuration"
    )
