"""What every prediction of the other vehicles offers, and the choice among them."""

from typing import Protocol

from mpcplan.config import PredictConfig
from mpcplan.errors import InputError
from mpcplan.observation import Forecast, Observation
from mpcplan.predict.constant_input import ConstantInput
from mpcplan.predict.foreign import ForeignPredictor
from mpcplan.predict.lane_follow import LaneFollow
from mpcplan.predict.lateness import LateEgo
from mpcplan.predict.recorded import Recorded
from mpcplan.task import Task


class Predictor(Protocol):
    """Turns an observation into a forecast."""

    def __call__(self, observation: Observation) -> Forecast:
        """Forecast from the observation's time step on."""
        ...


def make_predictor(task: Task, config: PredictConfig) -> Predictor:
    """The configured predictor; only ``recorded`` reads trajectories.

    Raises:
        InputError: recorded trajectories are asked for where the traffic reacts and none exist, or
            the class that is named cannot be used.
    """
    kind = config.kind
    if kind == "auto":
        kind = "lane_follow" if task.recorded is None else "recorded"
    if kind == "constant_input":
        return _late(ConstantInput(config, task.dt), config)
    if kind == "lane_follow":
        return _late(LaneFollow(task.road_map.lanelet_network, config, task.dt), config)
    if ":" in kind:
        return _late(ForeignPredictor(kind, task, config), config)
    if task.recorded is None:
        raise InputError(
            "predict.kind is 'recorded', but the traffic of an interactive scenario reacts and "
            "nobody knows its future; choose 'auto', 'lane_follow' or 'constant_input'"
        )
    return Recorded(task.recorded)


def _late(predictor: Predictor, config: PredictConfig) -> Predictor:
    """A guess that also holds when the ego vehicle is late, where that is configured."""
    return LateEgo(predictor, config.lateness) if config.lateness > 0 else predictor
