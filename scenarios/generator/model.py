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
    """Other road user with its recorded motion; `static` ones stay at the motion's start."""

    motion: Motion
    size: Size = CAR
    kind: ObstacleType = ObstacleType.CAR
    static: bool = False


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
    """One scenario with the three sentences of its row in the table."""

    name: str
    road: RoadMap
    tasks: Sequence[Task]
    actors: Sequence[Actor]
    tags: tuple[Tag, ...]
    story: str
    goal_text: str
    demand: str

    @property
    def benchmark_id(self) -> str:
        """CommonRoad benchmark id, with the prefix C- for several planning problems."""
        prefix = "C-" if len(self.tasks) > 1 else ""
        return f"{prefix}ZAM_{self.name}-1_1_T-1"

    @property
    def last_goal_step(self) -> int:
        """Last step at which a goal of this scenario can be reached."""
        return max(task.goal.last for task in self.tasks)

    @property
    def last_step(self) -> int:
        """Last step of the recorded traffic."""
        return self.last_goal_step + PREVIEW_STEPS
