"""What a planning cycle yields: the plan, the options it was chosen from, and the times."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from mpcplan.refine.refine import Refined
from mpcplan.seed.seed import Seed
from mpcplan.trajectory import Trajectory
from mpcplan.verify.drivability import Finding


@dataclass(frozen=True, eq=False)
class Plan:
    """A plan to execute until the next cycle.

    Attributes:
        trajectory: from the present state; to the goal, or into a standstill.
        source: where it comes from, in words.
        reaches_goal: whether the plan ends in the goal, or its seed does.
        finding: what verification said.
        trace: why this plan; JSON-able.
        hold: time steps after which the next plan is due, where that is sooner than usual.
    """

    trajectory: Trajectory
    source: str
    reaches_goal: bool
    finding: Finding
    trace: dict[str, Any]
    hold: int | None = None


@dataclass(frozen=True, eq=False)
class Option:
    """A trajectory that could become the plan.

    Attributes:
        trajectory: the plan; seed: what it was made of, None for emergency braking.
        cost: as it would be driven, see :mod:`mpcplan.seed.cost`.
        reaches_goal: whether it ends in the goal.
        finding: of its verification.
        source: where it comes from, in words.
        refined: how it was refined, None where it was not.
        settled: whether the corridor made around it and the refinement the whole way to the goal
            are known to gain no more.
    """

    trajectory: Trajectory
    seed: Seed | None
    cost: float
    reaches_goal: bool
    finding: Finding
    source: str
    refined: Refined | None = None
    settled: bool = True

    def as_dict(self) -> dict[str, Any]:
        """For the trace."""
        return {
            "source": self.source,
            "label": self.seed.label if self.seed is not None else "",
            "cost": round(self.cost, 4) if self.cost < float("inf") else None,
            "reaches_goal": self.reaches_goal,
            "verify": self.finding.as_dict(),
        }


class Clock:
    """Wall-clock time per stage; it is reported, never used for a decision."""

    def __init__(self) -> None:
        self._spent: dict[str, float] = {}
        self._start = time.perf_counter()

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Adds the time of the block to a stage."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self._spent[stage] = self._spent.get(stage, 0.0) + time.perf_counter() - start

    def milliseconds(self) -> dict[str, float]:
        """Times [ms] per stage and since the clock was made."""
        times = {stage: round(1e3 * seconds, 3) for stage, seconds in self._spent.items()}
        return {**times, "total": round(1e3 * (time.perf_counter() - self._start), 3)}
