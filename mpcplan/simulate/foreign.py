"""Planners that are not ours: found by name, kept apart from the simulation, and checked.

A class that implements :class:`mpcplan.task.PlannerInterface` becomes a driver of the closed loop.
It is given copies of the task and of each observation, nothing else. What it answers is checked
(:mod:`mpcplan.simulate.foreign_states`). Whatever fails is a PlannerError: a cause, not a crash.
"""

import copy
import json
from functools import partial
from typing import Any

import numpy as np

from mpcplan.config import Config
from mpcplan.errors import MpcplanError, PlannerError
from mpcplan.observation import Observation, Snapshot
from mpcplan.plan import Clock, Plan
from mpcplan.planner import Planner
from mpcplan.plug.named import brief
from mpcplan.road.goal import is_reached
from mpcplan.simulate.foreign_class import find_class
from mpcplan.simulate.foreign_states import as_driven, as_states
from mpcplan.simulate.loop import MakeDriver
from mpcplan.task import PlannerInterface, Task
from mpcplan.trajectory import Array, Trajectory
from mpcplan.verify.drivability import PASSED


def load_planner(spec: str) -> MakeDriver:
    """What drives for 'package.module:Class' or the short name of a shipped planner.

    Modules are found as by ``python -m``: installed, or in the current directory.

    Raises:
        InputError: the spec, the module or the class is not usable.
    """
    found = find_class(spec)
    if issubclass(found, Planner):
        return found
    return partial(ForeignDriver, found)


class ForeignDriver:
    """Drives by a planner that is not ours, through :class:`mpcplan.task.PlannerInterface`."""

    def __init__(self, make: type[PlannerInterface], task: Task, config: Config) -> None:
        """Builds the planner on a copy of the task.

        Raises:
            PlannerError: it could not be built.
        """
        self._name, self._make = make.__name__, make
        self._goal, self._dt = task.problem.planning_problem, task.dt
        self._planner = self._ask("set-up", make, copy.deepcopy(task), config)

    def plan(self, observation: Observation) -> Plan:
        """The planner's states as a checked plan.

        Raises:
            PlannerError: it failed, or answered what the vehicle cannot drive.
        """
        clock, when = Clock(), f"step {observation.step}"
        with clock("plan"):
            answer = self._ask(when, self._planner.plan, sealed(observation))
        with clock("verify"):
            try:
                trajectory = as_driven(as_states(answer), observation, self._dt)
            except PlannerError as error:
                raise PlannerError(f"{self._name}, {when}: {error}") from error
            reaches = self._reaches_goal(trajectory)
        trace = self._trace(observation.step, reaches, len(trajectory.inputs))
        trace["times_ms"] = clock.milliseconds()
        return Plan(trajectory, self._name, reaches, PASSED, trace)

    def still_safe(self, observation: Observation) -> bool:
        """The planner's own word where it has one; else True: it plans every cycle anyway."""
        own = getattr(self._planner, "still_safe", None)
        if not callable(own):
            return True
        return bool(self._ask(f"step {observation.step}", own, sealed(observation)))

    def _ask(self, when: str, call: Any, *arguments: Any) -> Any:
        """The answer of their code; its exceptions in one line, ours as they are."""
        try:
            return call(*arguments)
        except (MpcplanError, MemoryError):
            raise
        except (Exception, SystemExit) as error:
            told = brief(error, self._make)
            raise PlannerError(f"{self._name} failed at {when}: {told}") from error

    def _reaches_goal(self, trajectory: Trajectory) -> bool:
        pairs = zip(trajectory.states, trajectory.steps.tolist(), strict=True)
        return any(is_reached(self._goal, state, step) for state, step in pairs)

    def _trace(self, step: int, reaches: bool, planned: int) -> dict[str, Any]:
        """The fields of a planning cycle's trace, and under 'planner' what the planner tells."""
        told = _jsonable(self._ask(f"step {step}", getattr, self._planner, "trace", None))
        reasons = told.get("refusals") or f"{self._name} planned {planned} steps, without reasons"
        return {
            "step": step,
            "source": self._name,
            "chosen": {
                "source": self._name, "label": "", "cost": None, "reaches_goal": reaches,
                "verify": PASSED.as_dict(),
            },
            "game": None,
            "association": None,
            "seeds": {},
            "refusals": str(reasons),
            "options": [],
            "refine": None,
            "verify": PASSED.as_dict(),
            "fallback": str(told["fallback"]) if told.get("fallback") else None,
            "risks": [],
            "planner": told,
        }  # fmt: skip


def sealed(observation: Observation) -> Observation:
    """A copy whose arrays cannot be written to."""
    others = tuple(Snapshot(o.step, o.ids, _frozen(o.boxes), o.kinds) for o in observation.others)
    return Observation(
        observation.step, _frozen(observation.state), observation.acceleration, others
    )


def _frozen(values: Array) -> Array:
    values = values.copy()
    values.flags.writeable = False
    return values


def _jsonable(trace: Any) -> dict[str, Any]:
    """A planner's own trace as JSON knows it; arrays become lists, other things text."""
    if trace is None:
        return {}
    try:
        told = json.loads(json.dumps(trace, allow_nan=False, default=_plain))
    except (TypeError, ValueError, RecursionError) as error:
        return {"left out": f"the trace is no JSON: {error}"}
    return told if isinstance(told, dict) else {"trace": told}


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)
