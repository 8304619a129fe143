"""A predictor that is not ours: found by name, told what it may know, its forecasts checked."""

from dataclasses import replace
from typing import Any

import numpy as np

from mpcplan.config import PredictConfig
from mpcplan.errors import PlannerError
from mpcplan.observation import Box, Forecast, Observation
from mpcplan.plug.named import Part, asked, class_named
from mpcplan.task import Task

PREDICTOR = Part("predict.kind", "__call__", "observation")


class ForeignPredictor:
    """Predicts by a class 'package.module:Class'.

    It is built as ``Class(task, config)`` with :class:`mpcplan.task.Task` and
    :class:`mpcplan.config.PredictConfig`, then called with every observation and answers a
    :class:`mpcplan.observation.Forecast`. Recorded trajectories are kept from it: what it answers
    is a guess.
    """

    def __init__(self, spec: str, task: Task, config: PredictConfig) -> None:
        """Builds the predictor.

        Raises:
            InputError: the name leads to no usable class.
            PlannerError: the class could not be built.
        """
        self._spec, self._make = spec, class_named(spec, PREDICTOR)
        self._last: tuple[Observation, Forecast] | None = None
        self._predictor = self._ask("set-up", self._make, replace(task, recorded=None), config)

    def __call__(self, observation: Observation) -> Forecast:
        """Its forecast; the same one for the same observation.

        Raises:
            PlannerError: it failed, or answered no forecast.
        """
        if self._last is None or self._last[0] is not observation:
            when = f"step {observation.step}"
            answer = self._ask(when, self._predictor, observation)
            wrong = _wrong(answer, observation)
            if wrong:
                raise PlannerError(f"{PREDICTOR.name} {self._spec!r}, {when}: {wrong}")
            self._last = observation, replace(answer, exact=False)
        return self._last[1]

    def _ask(self, when: str, call: Any, *arguments: Any) -> Any:
        return asked(PREDICTOR, self._spec, self._make, when, call, *arguments)


def _wrong(answer: Any, observation: Observation) -> str:
    """What is wrong with an answer, '' where nothing is."""
    if not isinstance(answer, Forecast):
        return f"it answered a {type(answer).__name__}, expected a Forecast"
    if answer.first_step != observation.step:
        return f"its forecast begins at step {answer.first_step}, expected {observation.step}"
    boxes = answer.boxes
    expected = f"(o, k, {len(Box)}) with o = {len(answer.ids)} ids and k of at least 1"
    if not isinstance(boxes, np.ndarray) or boxes.ndim != 3:
        return f"its boxes must be an array {expected}"
    rows, steps, columns = boxes.shape
    if rows != len(answer.ids) or columns != len(Box) or not steps:
        return f"its boxes are {boxes.shape}, expected {expected}"
    if np.isinf(boxes).any():
        return "its boxes hold infinite numbers; NaN stands for an obstacle that is not there"
    missing = sorted(set(observation.now.ids) - set(answer.ids))
    if missing:
        return f"its forecast leaves out obstacle {missing[0]}, which is seen"
    return ""
