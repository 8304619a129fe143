"""Checks of a CommonRoad file's XML tree; every failure names the object and what is expected.

They work on the tree, before commonroad-io reads it, because its reader fills whatever is missing
with zeros and answers most mistakes with a bare exception.
"""

import math
from xml.etree.ElementTree import Element

from mpcplan.errors import InputError
from mpcplan.scenario_xml import name
from mpcplan.vehicle import FORD_ESCORT

TIME_STEP = 0.1  # s, of all of CommonRoad's competitions; the vehicle model's step
VERSIONS = ("2018b", "2020a")  # that commonroad-io reads
_NUMBERS = frozenset(  # elements whose text is a number
    ["x", "y", "z", "exact", "intervalStart", "intervalEnd", "length", "width", "radius"]
)


def check_header(root: Element) -> None:
    """Raises InputError for a version, time step or benchmark id that we cannot work with."""
    version = root.get("commonRoadVersion")
    if version not in VERSIONS:
        raise InputError(
            f"commonRoadVersion is {version!r}, supported are {' and '.join(VERSIONS)}"
        )
    if not root.get("benchmarkID"):
        raise InputError("the attribute benchmarkID of <commonRoad> is missing")
    try:
        dt = float(root.get("timeStepSize", ""))
    except ValueError as error:
        raise InputError("timeStepSize is missing or no number; expected 0.1 s") from error
    if not math.isclose(dt, TIME_STEP, abs_tol=1e-9):
        raise InputError(f"the time step is {dt:g} s; expected {TIME_STEP:g} s")


def check_numbers(root: Element) -> None:
    """Raises InputError, naming the object, for a coordinate or value that is not finite."""
    for owner in root:
        for element in owner.iter():
            # <orientation> is a number in a rectangle and holds <exact> in a state
            leaf = element.tag == "orientation" and len(element) == 0
            if (element.tag in _NUMBERS or leaf) and not _is_finite(element.text):
                text = (element.text or "").strip()
                raise InputError(f"{name(owner)}: <{element.tag}> is {text!r}, not a finite number")


def _is_finite(text: str | None) -> bool:
    try:
        return math.isfinite(float(text or ""))
    except ValueError:
        return False


def check_problems(root: Element) -> None:
    """Raises InputError, naming problem and field, for what no planner could work with."""
    problems = root.findall("planningProblem")
    if not problems:
        raise InputError("the file has no planning problem")
    lanelets = {lanelet.get("id") for lanelet in root.iterfind("lanelet")}
    if not lanelets:
        raise InputError("the file has no lanelet")
    for problem in problems:
        first_step = _check_initial_state(problem)
        _check_goals(problem, first_step, lanelets)


def _check_initial_state(problem: Element) -> int:
    """Checks the initial state; answers its time step."""
    state = problem.find("initialState")
    if state is None:
        raise InputError(f"{name(problem)}: the initial state is missing")
    if state.find("position/point/x") is None or state.find("position/point/y") is None:
        raise InputError(
            f"{name(problem)}: the initial position must be a point (uncertain initial states, "
            "given by a shape, are not supported)"
        )
    for field in ("orientation", "velocity", "time"):
        if state.find(field) is None:
            raise InputError(f"{name(problem)}: the initial state has no {field}")
    for field in ("orientation", "velocity", "time", "yawRate", "slipAngle", "acceleration"):
        if state.find(field) is not None and state.find(f"{field}/exact") is None:
            raise InputError(
                f"{name(problem)}: the initial {field} must be exact (uncertain initial states, "
                "given by an interval, are not supported)"
            )
    _check_speed(problem, float(state.findtext("velocity/exact", "")))
    return _step(problem, state.findtext("time/exact", ""), "the initial time")


def _check_speed(problem: Element, v: float) -> None:
    if not 0 <= v <= FORD_ESCORT.v_max:
        raise InputError(
            f"{name(problem)}: the initial velocity is {v:g} m/s; expected 0 to "
            f"{FORD_ESCORT.v_max:g} m/s"
        )


def _step(problem: Element, text: str, what: str) -> int:
    try:
        return int(text)
    except ValueError as error:
        raise InputError(f"{name(problem)}: {what} is {text!r}, no whole time step") from error


def _check_goals(problem: Element, first_step: int, lanelets: set[str | None]) -> None:
    goals = problem.findall("goalState")
    if not goals:
        raise InputError(f"{name(problem)}: it has no goal state")
    for goal in goals:
        for reference in goal.iterfind("position/lanelet"):
            if reference.get("ref") not in lanelets:
                raise InputError(
                    f"{name(problem)}: the goal lanelet {reference.get('ref')} does not exist"
                )
    ends = [_goal_end(problem, goal) for goal in goals]
    if max(ends) < first_step:
        raise InputError(
            f"{name(problem)}: the goal ends at time step {max(ends)}, before the initial time "
            f"step {first_step}"
        )


def _goal_end(problem: Element, goal: Element) -> int:
    text = goal.findtext("time/intervalEnd")
    if text is None:
        raise InputError(f"{name(problem)}: a goal state has no time interval")
    return _step(problem, text, "the end of the goal's time interval")
