"""What every prediction of the other vehicles offers, and the choice among them."""

from typing import Protocol

from commonroad.scenario.scenario import Scenario

from mpcplan.config import PredictConfig
from mpcplan.observation import Forecast, Observation
from mpcplan.predict.constant_input import ConstantInput
from mpcplan.predict.recorded import Recorded


class Predictor(Protocol):
    """Turns an observation into a forecast."""

    def __call__(self, observation: Observation) -> Forecast:
        """Forecast from the observation's time step on."""
        ...


def make_predictor(scenario: Scenario, config: PredictConfig) -> Predictor:
    """The configured predictor; only ``recorded`` reads trajectories from the scenario."""
    if config.kind == "recorded":
        return Recorded(scenario)
    return ConstantInput(config, scenario.dt)
