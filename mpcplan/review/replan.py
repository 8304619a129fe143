"""The planning cycles of a run once more, to see what they considered.

The same planner is asked at the same time steps with the same observations: the others as recorded
or as simulated, the ego vehicle as driven. It is deterministic, so it answers the same; a cycle
that does not (another version planned the run) says so. As in the closed loop the state is that of
the plan before, as long as the solution says nothing else: it has more digits.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mpcplan.config import Config
from mpcplan.errors import MpcplanError
from mpcplan.observation import Observation
from mpcplan.plan import Plan
from mpcplan.planner import Planner
from mpcplan.predict.recorded import record
from mpcplan.review.again import cycle_at
from mpcplan.review.considered import Considered, Notes
from mpcplan.scenario import LoadedScenario, Problem
from mpcplan.simulate.loop import HISTORY
from mpcplan.simulate.recorded import RecordedTraffic
from mpcplan.simulate.run import Cycle, Drive, Run
from mpcplan.task import Task, road_map
from mpcplan.trajectory import Array, Input, Trajectory
from mpcplan.vehicle import FORD_ESCORT

SAME_STATE = 1e-6  # m, rad, m/s: closer states are the same but for rounding in files
SAME_COST = 1e-3  # of a plan's cost: the trace rounds it
Told = Callable[[], object]


@dataclass(frozen=True, eq=False)
class Replanned:
    """The cycles of one drive.

    Attributes:
        considered: of the cycles that were planned again, in their order.
        missing: why there are not all of them, or not as they were; '' where nothing is missing.
    """

    considered: tuple[Considered, ...]
    missing: str = ""

    def at(self, cycle: Cycle) -> Considered | None:
        """What a cycle considered, None where that is not known."""
        return next((one for one in self.considered if one.step == cycle.step), None)


def replan(
    run: Run, index: int, simulated: bool, until: int | None = None, tell: Told | None = None
) -> Replanned:
    """Plans the cycles of a drive again.

    Args:
        run: what was driven.
        index: of the drive.
        simulated: whether nobody knew the others' motion when the run was planned.
        until: the last time step that is of interest; None: all.
        tell: called after every cycle.
    """
    drive, loaded = run.drives[index], run.loaded
    cycles = [c for c in drive.cycles if until is None or c.step <= until]
    if any("planner" in cycle.plan.trace for cycle in cycles):
        return Replanned((), f"plans of {cycles[0].plan.source} are not recorded")
    problem = next(p for p in loaded.problems if p.id == drive.problem_id)
    notes, found = Notes(run.config), list[Considered]()
    try:
        again = _Again(loaded, problem, run.config, simulated, notes)
        for cycle in cycles:
            plan = again.plan(drive, cycle.step)
            assert notes.last is not None  # the planner has just shown it
            found.append(replace(notes.last, agrees=_agrees(cycle.plan, plan)))
            if tell is not None:
                tell()
    except MpcplanError as error:
        return Replanned(tuple(found), f"planning again failed: {error}")
    differ = [one.step for one in found if not one.agrees]
    if differ:
        return Replanned(
            tuple(found),
            f"planned again, {len(differ)} of {len(found)} cycles differ from the trace, the first "
            f"of them at step {differ[0]}: another version drove it",
        )
    return Replanned(tuple(found))


def with_plans(drive: Drive, replanned: Replanned) -> Drive:
    """The drive with the whole plans of those cycles that were planned again as they were."""
    cycles = []
    for cycle in drive.cycles:
        known = replanned.at(cycle)
        if known is not None and known.agrees:
            cycle = replace(cycle, plan=replace(cycle.plan, trajectory=known.plan))
        cycles.append(cycle)
    return replace(drive, cycles=tuple(cycles))


class _Again:
    """The planner of a drive, with what it is shown."""

    def __init__(
        self, loaded: LoadedScenario, problem: Problem, config: Config, simulated: bool,
        notes: Notes,
    ) -> None:  # fmt: skip
        known = None if simulated else record(loaded.scenario)
        task = Task(road_map(loaded.scenario), problem, FORD_ESCORT, loaded.dt, known)
        self._planner = Planner(task, config, witness=notes)
        notes.config = self._planner.config
        self._traffic = RecordedTraffic(loaded.scenario)
        self._start = problem.start
        self._last: Trajectory | None = None

    def plan(self, drive: Drive, step: int) -> Plan:
        """The plan at a time step that was driven."""
        driven = drive.trajectory
        state, before = driven.state_at(step), 0.0
        if step == driven.first_step:
            state = self._same(state, self._start)
        else:
            before = float(driven.inputs[step - 1 - driven.first_step, Input.A])
            last = self._last
            if last is not None and last.first_step < step <= last.last_step:
                planned = last.state_at(step)
                same = self._same(state, planned)
                if same is planned:
                    before = float(last.inputs[step - 1 - last.first_step, Input.A])
                state = same
        first = max(driven.first_step, step - HISTORY)
        others = tuple(self._traffic.at(k) for k in range(first, step + 1))
        plan = self._planner.plan(Observation(step, state, before, others))
        self._last = plan.trajectory
        return plan

    @staticmethod
    def _same(driven: Array, planned: Array) -> Array:
        """The planned state where it is the driven one but for rounding."""
        return planned if np.abs(driven - planned).max() < SAME_STATE else driven


def _agrees(told: Plan, again: Plan) -> bool:
    """Whether a plan is the one that the trace tells of."""
    a, b = told.trace["chosen"]["cost"], again.trace["chosen"]["cost"]
    if told.source != again.source or (a is None) != (b is None):
        return False
    return a is None or abs(a - b) <= SAME_COST * (1.0 + abs(a))


__all__ = ["Replanned", "cycle_at", "replan", "with_plans"]
