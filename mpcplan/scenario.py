"""Loading of CommonRoad scenarios: checked, repaired where safe, in local coordinates.

Everything after this module works in a frame whose origin lies at the first problem's initial
position, rounded to whole metres: UTM coordinates of 5e6 m cost the solvers digits and crash the
checker's boundary construction. Only the solution goes back to the file's coordinates.
"""

import math
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from commonroad.common.reader.file_reader_xml import XMLFileReader
from commonroad.geometry.shape import Shape
from commonroad.planning.planning_problem import PlanningProblem, PlanningProblemSet
from commonroad.scenario.scenario import Scenario
from commonroad.scenario.state import InitialState

from mpcplan import scenario_checks as checks
from mpcplan import scenario_xml
from mpcplan.errors import InputError
from mpcplan.scenario_repair import repair
from mpcplan.sumo.folder import SumoFolder, read_folder
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT, Vehicle

_SLOW = 0.1  # m/s, below it the yaw rate says nothing about the steering angle


@dataclass(frozen=True)
class Problem:
    """One planning problem.

    Attributes:
        id: as in the file.
        planning_problem: in local coordinates.
        start: (5,) state of the KS model at the rear axle, columns
            :class:`mpcplan.trajectory.State`.
        first_step: time step of the start.
    """

    id: int
    planning_problem: PlanningProblem
    start: Array
    first_step: int


@dataclass(frozen=True)
class LoadedScenario:
    """A scenario in local coordinates.

    Attributes:
        id: benchmark id, 'ZAM_Foo-1_1_T-1'.
        path: the file.
        scenario: map and traffic.
        problems: in the file's order.
        problem_set: the same problems as commonroad-io's set.
        origin: (2,) file coordinates [m] of the local frame's origin.
        notes: what was repaired, one sentence each.
        dt: time step [s].
        folder: where SUMO moves the traffic: the folder with its files; else None.
    """

    id: str
    path: Path
    scenario: Scenario
    problems: tuple[Problem, ...]
    problem_set: PlanningProblemSet
    origin: Array
    notes: tuple[str, ...]
    dt: float
    folder: SumoFolder | None = None

    @property
    def interactive(self) -> bool:
        """Whether SUMO moves the others, so that nobody knows their future."""
        return self.folder is not None


def load(path: str | Path) -> LoadedScenario:
    """Reads, checks and repairs a CommonRoad file (XML, version 2018b or 2020a), or the folder of
    an interactive scenario (:mod:`mpcplan.sumo.folder`).

    Raises:
        InputError: the file cannot be used; names file, object and field, and what is expected.
    """
    path = Path(path)
    if path.is_dir():
        return _load_folder(read_folder(path))
    try:
        return _load(path)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _load_folder(folder: SumoFolder) -> LoadedScenario:
    """The folder's .cr.xml, with the folder at hand."""
    loaded = replace(load(folder.scenario), folder=folder)
    if len(loaded.problems) > 1:
        raise InputError(
            f"{folder.scenario}: {len(loaded.problems)} planning problems; in an interactive "
            "scenario one is supported"
        )
    return loaded


def _load(path: Path) -> LoadedScenario:
    root = scenario_xml.parse(path)
    checks.check_header(root)
    checks.check_numbers(root)
    checks.check_problems(root)
    notes = repair(root)
    origin = scenario_xml.whole_metres(root)
    if scenario_xml.move(root, origin):
        notes += ("heights (z) are ignored",)
    scenario, problem_set = _read(root)
    problems = tuple(_problem(p) for p in problem_set.planning_problem_dict.values())
    _check_on_map(scenario, problems)
    return LoadedScenario(
        id=str(scenario.scenario_id),
        path=path,
        scenario=scenario,
        problems=problems,
        problem_set=problem_set,
        origin=origin,
        notes=notes,
        dt=checks.TIME_STEP,
    )


class _TreeReader(XMLFileReader):
    """commonroad-io's reader of a tree that is parsed already; large files take half as long."""

    def __init__(self, root: Element) -> None:
        super().__init__("")
        self._root = root

    def _parse_file(self) -> None:
        self._tree = ElementTree.ElementTree(self._root)


def _read(root: Element) -> tuple[Scenario, PlanningProblemSet]:
    """The tree read by commonroad-io."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return _TreeReader(root).open()
    except Exception as error:  # the reader raises everything down to a bare Exception
        detail = str(error) or "no detail given"
        raise InputError(
            f"no valid CommonRoad scenario: {type(error).__name__}: {detail}"
        ) from error


def _problem(planning_problem: PlanningProblem) -> Problem:
    return Problem(
        id=planning_problem.planning_problem_id,
        planning_problem=planning_problem,
        start=start_state(planning_problem.initial_state),
        first_step=planning_problem.initial_state.time_step,
    )


def start_state(initial: InitialState, vehicle: Vehicle = FORD_ESCORT) -> Array:
    """(5,) KS state at the rear axle for an initial state given at the centre.

    CommonRoad gives no steering angle: delta = atan(l psi' / v) reproduces the yaw rate psi'.
    """
    x, y = initial.position
    psi, v = float(initial.orientation), float(initial.velocity)
    delta = math.atan(vehicle.wheelbase * initial.yaw_rate / v) if v > _SLOW else 0.0
    delta = min(max(delta, -vehicle.delta_max), vehicle.delta_max)
    b = vehicle.rear_to_centre
    return np.array([x - b * math.cos(psi), y - b * math.sin(psi), delta, v, psi])


def _check_on_map(scenario: Scenario, problems: tuple[Problem, ...]) -> None:
    """Raises InputError for a start or a goal that lies outside of all lanelets."""
    lanelets = np.array(
        [lanelet.polygon.shapely_object for lanelet in scenario.lanelet_network.lanelets]
    )
    for problem in problems:
        centre = shapely.Point(problem.planning_problem.initial_state.position)
        distance = float(shapely.distance(lanelets, centre).min())
        if distance > 0:
            raise InputError(
                f"planningProblem {problem.id}: the initial position lies off the map, "
                f"{distance:.2f} m from the nearest lanelet"
            )
        _check_goal_on_map(problem, lanelets)


def _check_goal_on_map(problem: Problem, lanelets: np.ndarray) -> None:
    """Raises InputError if every goal state asks for a position outside of all lanelets."""
    distances = [
        _distance(state.position, lanelets) if state.has_value("position") else 0.0
        for state in problem.planning_problem.goal.state_list
    ]
    if min(distances) > 0:
        raise InputError(
            f"planningProblem {problem.id}: the goal lies off the map, {min(distances):.2f} m "
            "from the nearest lanelet"
        )


def _distance(shape: Shape, lanelets: np.ndarray) -> float:
    """Distance [m] of a commonroad-io shape or group of shapes from the nearest lanelet."""
    parts = getattr(shape, "shapes", [shape])
    return min(float(shapely.distance(lanelets, part.shapely_object).min()) for part in parts)
