"""mpcplan: a motion planner for automated vehicles in the CommonRoad format."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mpcplan.config import Config
    from mpcplan.config.files import load_config
    from mpcplan.planner import Planner
    from mpcplan.scenario import load
    from mpcplan.score.referee import evaluate
    from mpcplan.simulate.loop import drive

__version__ = "0.1.0"
__all__ = ["Config", "Planner", "drive", "evaluate", "load", "load_config"]

_HOMES = {
    "Config": "mpcplan.config",
    "Planner": "mpcplan.planner",
    "drive": "mpcplan.simulate.loop",
    "evaluate": "mpcplan.score.referee",
    "load": "mpcplan.scenario",
    "load_config": "mpcplan.config.files",
}


def __getattr__(name: str) -> Any:
    """The public names, imported when first used: the command line's help stays instant."""
    if name not in _HOMES:
        raise AttributeError(f"module 'mpcplan' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
