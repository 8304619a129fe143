"""What every prediction of the other vehicles offers, and the choice among them."""

from typing import Protocol

from mpcplan.config import PredictConfig
from mpcplan.observation import Forecast, Observation
from mpcplan.predict.constant_input import ConstantInput
from mpcplan.predict.recorded import Recorded
from mpcplan.task import Task


class Predictor(Protocol):
    """Turns an observation into a forecast."""

    def __call__(self, observation: Observation) -> Forecast:
        """Forecast from the observation's time step on."""
        ...


def make_predictor(task: Task, config: PredictConfig) -> Predictor:
    """The configured predictor; only ``recorded`` reads trajectories."""
    if config.kind == "recorded" and task.recorded is not None:
        return Recorded(task.recorded)
    return ConstantInput(config, task.dt)
