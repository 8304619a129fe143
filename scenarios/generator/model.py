"""What a scenario of the collection consists of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from commonroad.scenario.obstacle import ObstacleType
from commonroad.scenario.scenario import Tag

from .motion import Motion
from .paths import Path
from .roads import LANE_WIDTH, RoadMap

EGO_LENGTH = 4.298  # CommonRoad vehicle type 1 (Ford Escort) [m]
EGO_WIDTH = 1.674  # [m]
PREVIEW_STEPS = 30  # recorded traffic continues this long after the last goal step


class Size(NamedTuple):
    """Length and width of an obstacle [m]."""

    length: float
    width: float


CAR = Size(4.5, 1.8)
TRUCK = Size(8.0, 2.4)
BICYCLE = Size(2.0, 0.7)


@dataclass(frozen=True)
class Actor:
    """Other road user with its recorded motion; `static` ones stay at the motion's start.

    The motion's own time is the scenario's, also for who appears later, at `first_step`.
    """

    motion: Motion
    size: Size = CAR
    kind: ObstacleType = ObstacleType.CAR
    static: bool = False
    first_step: int = 0


class Zone(NamedTuple):
    """Rectangle around station `s` of a lane centre; all measures in metres."""

    path: Path
    s: float
    length: float
    width: float = LANE_WIDTH


class Range(NamedTuple):
    """Closed interval."""

    low: float
    high: float


@dataclass(frozen=True)
class Goal:
    """Time interval in steps and optional conditions.

    The velocity is in m/s; the orientation [rad] is meant before the map is turned.
    """

    first: int
    last: int
    zone: Zone | None = None
    lanelets: tuple[int, ...] = ()
    velocity: Range | None = None
    orientation: Range | None = None


@dataclass(frozen=True)
class Task:
    """Planning problem; `example` is one motion that solves it and fixes the initial state."""

    example: Motion
    goal: Goal


@dataclass(frozen=True)
class Case:
    """One scenario with the three sentences of its row in the table.

    `record_steps` is the last step of the recorded traffic in interactive scenarios, where the
    record only tells where the others start and turn; None: not interactive, and the record ends a
    little after the last goal step.
    """

    name: str
    road: RoadMap
    tasks: Sequence[Task]
    actors: Sequence[Actor]
    tags: tuple[Tag, ...]
    story: str
    goal_text: str
    demand: str
    record_steps: int | None = None

    @property
    def benchmark_id(self) -> str:
        """CommonRoad benchmark id, with the prefix C- for several planning problems."""
        prefix = "C-" if len(self.tasks) > 1 else ""
        traffic = "T-1" if self.record_steps is None else "I-1-1"
        return f"{prefix}ZAM_{self.name}-1_1_{traffic}"

    @property
    def last_goal_step(self) -> int:
        """Last step at which a goal of this scenario can be reached."""
        return max(task.goal.last for task in self.tasks)

    @property
    def last_step(self) -> int:
        """Last step of the recorded traffic."""
        if self.record_steps is not None:
            return self.record_steps
        return self.last_goal_step + PREVIEW_STEPS
