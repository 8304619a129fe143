"""When to plan again: sooner where the way bends, others are close, or crossings lie ahead.

A plan is driven for ``drive.replan``, or for ``risk.replan`` where one of these holds:

    max |kappa(s)| over the next risk.look metres        >= risk.curvature
    least gap between the bodies now                     <= risk.gap
    somebody will enter the path within risk.look metres (mpcplan.seed.crossing)
"""

import math

import numpy as np

from mpcplan.config import RiskConfig
from mpcplan.observation import Observation
from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.road import Road
from mpcplan.seed.crossing import last_crossing
from mpcplan.trajectory import Array
from mpcplan.verify.drivability import separation


def risks(road: Road, seen: Observation, around: Occupancy, config: RiskConfig) -> tuple[str, ...]:
    """What makes it worth to plan again soon, in words; nothing where all is calm.

    Args:
        road: that is driven on.
        seen: the present observation.
        around: the forecast along the road.
        config: the thresholds.
    """
    s = float(road.frame.to_frenet(seen.state[:2])[0])
    return tuple(
        reason
        for reason in (
            _bend(road, s, config),
            _closeness(seen.state, seen, config),
            _crossing(around, seen.step, s, config),
        )
        if reason
    )


def _bend(road: Road, s: float, config: RiskConfig) -> str:
    ahead = np.arange(s, s + config.look, road.frame.spacing)
    kappa = np.abs(road.frame.curvature(ahead))
    if kappa.max() < config.curvature:
        return ""
    return f"a bend of {1 / kappa.max():.0f} m in {ahead[kappa.argmax()] - s:.0f} m"


def _closeness(state: Array, seen: Observation, config: RiskConfig) -> str:
    boxes = seen.now.boxes
    if not len(boxes):
        return ""
    gaps = np.array([separation(state[None], box[None, None]).min() for box in boxes])
    if gaps.min() > config.gap:
        return ""
    return f"obstacle {seen.now.ids[int(gaps.argmin())]} is {max(gaps.min(), 0.0):.1f} m away"


def _crossing(around: Occupancy, step: int, s: float, config: RiskConfig) -> str:
    clear = last_crossing(around, step, s)
    if not math.isfinite(clear) or clear - s > config.look:
        return ""
    return f"others will cross within {clear - s:.0f} m"
