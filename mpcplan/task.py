"""What a planner is told before the drive, and the narrow interface that every planner offers.

A planner is built once with a :class:`Task` and the configuration; then ``plan(observation)`` is
called every replanning interval. The task holds the map, the problem and the vehicle. It holds the
others' recorded trajectories only where a scenario is played back as recorded; in interactive
scenarios nobody knows them, and ``recorded`` is None.
"""

from dataclasses import dataclass
from typing import Protocol

from commonroad.scenario.scenario import Scenario

from mpcplan.config import Config
from mpcplan.observation import Forecast, Observation
from mpcplan.predict.recorded import record
from mpcplan.scenario import LoadedScenario, Problem
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT, Vehicle


@dataclass(frozen=True, eq=False)
class Task:
    """One planning problem as a planner is given it.

    Attributes:
        road_map: the lanelet network, with signs and intersections, in a scenario without any
            obstacle; in local coordinates.
        problem: start and goal.
        vehicle: the vehicle's parameters.
        dt: time step [s].
        recorded: the others' trajectories where they are played back; None: they are not known.
    """

    road_map: Scenario
    problem: Problem
    vehicle: Vehicle
    dt: float
    recorded: Forecast | None


class PlannerInterface(Protocol):
    """What the closed loop drives: any class with these two methods."""

    def __init__(self, task: Task, config: Config) -> None:
        """Prepares for one planning problem."""

    def plan(self, observation: Observation) -> Array:
        """(n, 5) states to be driven from the observation's time step on, columns
        :class:`mpcplan.trajectory.State`.

        The first row is the present state; each next one follows from the one before it by the
        kinematic single-track model with inputs that are held over dt
        (:func:`mpcplan.vehicle.simulate` gives such states for any inputs).
        """
        ...


def task_of(loaded: LoadedScenario, problem: Problem) -> Task:
    """The task of a planning problem; of an interactive scenario without any trajectory."""
    recorded = None if loaded.interactive else record(loaded.scenario)
    return Task(road_map(loaded.scenario), problem, FORD_ESCORT, loaded.dt, recorded)


def road_map(scenario: Scenario) -> Scenario:
    """The scenario's map alone."""
    bare = Scenario(scenario.dt, scenario.scenario_id, location=scenario.location)
    bare.add_objects(scenario.lanelet_network)
    return bare
