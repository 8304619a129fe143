"""Typed, validated configuration: every parameter with its unit, range and meaning."""

from mpcplan.config.base import ClassName, Section, par
from mpcplan.config.decision import GameConfig, SeedConfig
from mpcplan.config.driving import BoundConfig, DriveConfig, RiskConfig, RulesConfig, VerifyConfig
from mpcplan.config.refinement import WHOLE, Backend, KnownBackend, RefineConfig
from mpcplan.config.surroundings import (
    AssociationConfig,
    CostConfig,
    PredictConfig,
    RoadConfig,
)

__all__ = [
    "WHOLE",
    "AssociationConfig",
    "Backend",
    "BoundConfig",
    "ClassName",
    "Config",
    "CostConfig",
    "DriveConfig",
    "GameConfig",
    "KnownBackend",
    "PredictConfig",
    "RefineConfig",
    "RiskConfig",
    "RoadConfig",
    "RulesConfig",
    "Section",
    "SeedConfig",
    "VerifyConfig",
    "par",
]


class Config(Section):
    """The whole configuration."""

    cost: CostConfig = par(CostConfig(), "", "the planner's cost")
    road: RoadConfig = par(RoadConfig(), "", "route, reference path and limits")
    association: AssociationConfig = par(
        AssociationConfig(), "", "when the routes are built anew from another lane"
    )
    predict: PredictConfig = par(PredictConfig(), "", "prediction of the other vehicles")
    seed: SeedConfig = par(SeedConfig(), "", "the sampled lattice")
    game: GameConfig = par(GameConfig(), "", "the level-k game")
    refine: RefineConfig = par(RefineConfig(), "", "the optimal-control problem")
    verify: VerifyConfig = par(VerifyConfig(), "", "checks before execution")
    rules: RulesConfig = par(RulesConfig(), "", "traffic rules")
    drive: DriveConfig = par(DriveConfig(), "", "the closed loop")
    risk: RiskConfig = par(RiskConfig(), "", "when to plan again sooner")
    bound: BoundConfig = par(BoundConfig(), "", "the clairvoyant optimum")
