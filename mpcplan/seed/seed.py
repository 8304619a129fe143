"""What the seed stage hands on: candidate trajectories in the Frenet frame and why others fell."""

from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any

from mpcplan.road.road import Road
from mpcplan.trajectory import Array

COLLISION = "collision"  # the constraint that names an obstacle
TOLD_REJECTIONS = 2


class Stage(IntEnum):
    """Columns of a Frenet trajectory: m, m, rad, m/s, rad, m/s^2 (acceleration of the step)."""

    S = 0
    D = 1
    MU = 2
    V = 3
    DELTA = 4
    A = 5


@dataclass(frozen=True, eq=False)
class Seed:
    """A candidate trajectory along a road.

    Attributes:
        road: the road whose frame it lives in.
        first_step: time step of the first state.
        states: (k + 1, 6) columns :class:`Stage`; A is the acceleration applied in the step before.
        cost: TR1 estimate with penalties.
        reaches_goal: whether a goal window is met at the last state.
        source: where it comes from ('lattice', 'last plan').
        label: what it does, in words.
    """

    road: Road
    first_step: int
    states: Array
    cost: float
    reaches_goal: bool
    source: str
    label: str


def after(seed: Seed, steps: int) -> Seed:
    """The part of a seed after its first ``steps`` steps."""
    return replace(seed, first_step=seed.first_step + steps, states=seed.states[steps:])


@dataclass(frozen=True)
class Rejection:
    """Why candidates of one source were refused by one constraint."""

    count: int
    smallest_violation: float
    unit: str
    obstacle: int | None = None
    step: int | None = None

    def as_dict(self) -> dict[str, Any]:
        """For the trace."""
        return {
            "count": self.count,
            "smallest_violation": self.smallest_violation,
            "unit": self.unit,
            "obstacle": self.obstacle,
            "step": self.step,
        }


@dataclass(frozen=True)
class SeedReport:
    """Candidates of one source: how many, how many passed, why the others did not."""

    source: str
    candidates: int
    accepted: int
    reaching_goal: int
    rejected: dict[str, Rejection] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """For the trace."""
        return {
            "candidates": self.candidates,
            "accepted": self.accepted,
            "reaching_goal": self.reaching_goal,
            "rejected": {name: r.as_dict() for name, r in self.rejected.items()},
        }


def merged(reports: list[SeedReport]) -> list[SeedReport]:
    """One report per source: the counts of all roads together, the smallest violation of each."""
    sources: dict[str, SeedReport] = {}
    for report in reports:
        known = sources.get(report.source)
        sources[report.source] = report if known is None else _together(known, report)
    return list(sources.values())


def _together(a: SeedReport, b: SeedReport) -> SeedReport:
    rejected = dict(a.rejected)
    for name, other in b.rejected.items():
        one = rejected.get(name)
        if one is None:
            rejected[name] = other
            continue
        least = min(one, other, key=lambda r: r.smallest_violation)
        rejected[name] = replace(least, count=one.count + other.count)
    return SeedReport(
        a.source, a.candidates + b.candidates, a.accepted + b.accepted,
        a.reaching_goal + b.reaching_goal, rejected,
    )  # fmt: skip


def words(report: SeedReport) -> str:
    """A report in words: how many passed, and what refused most of the others."""
    told = (
        f"{report.accepted} of {report.candidates} candidates of the {report.source} were "
        f"drivable, {report.reaching_goal} reached the goal"
    )
    often = sorted(report.rejected.items(), key=lambda item: (item[0] != COLLISION, -item[1].count))
    for name, rejection in often[:TOLD_REJECTIONS]:
        where = "" if rejection.obstacle is None else f" with obstacle {rejection.obstacle}"
        when = "" if rejection.step is None else f" at step {rejection.step}"
        told += f", {rejection.count} refused by {name}{where}{when}"
    return told
