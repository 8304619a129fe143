"""Whether what was driven kept the rules: the robustness of both at every time step.

The path along which lanes and distances are counted is that of the route that the drive followed.
"""

from dataclasses import dataclass

import numpy as np
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.scenario.scenario import Scenario

from mpcplan.config import Config
from mpcplan.errors import RoadError
from mpcplan.observation import Forecast
from mpcplan.predict.occupancy import occupancy
from mpcplan.road.frame import Frame
from mpcplan.road.reference import build_frame, lasting_lanes
from mpcplan.road.route import find_routes
from mpcplan.road.strips import build_strips
from mpcplan.rules.formulas import monitored
from mpcplan.rules.keeping import keeping
from mpcplan.rules.predicates import ego_bodies, other_bodies
from mpcplan.rules.robustness import recovery_steps, signals
from mpcplan.trajectory import Array, State, Trajectory
from mpcplan.vehicle import centres

AHEAD = 100.0  # m, of the path beyond what was driven: those further ahead demand nothing


@dataclass(frozen=True, eq=False)
class Robustness:
    """The robustness of one rule over a drive.

    Attributes:
        first_step: time step of the first value.
        values: (k,) one per time step [m for R_G1, m/s for R_G4]; +inf where nothing is demanded.
    """

    first_step: int
    values: Array

    @property
    def lowest(self) -> float:
        """The robustness of the whole drive."""
        return float(self.values.min(initial=np.inf))

    @property
    def step(self) -> int | None:
        """Time step of the lowest value, None where nothing is ever demanded."""
        if not np.isfinite(self.lowest):
            return None
        return self.first_step + int(self.values.argmin())


@dataclass(frozen=True, eq=False)
class RulesDriven:
    """How a drive kept both rules.

    Attributes:
        safe_distance: R_G1 towards all others [m].
        traffic_flow: R_G4 [m/s].
        kept: of R_G1, one of :data:`mpcplan.rules.keeping.KEEPING`.
    """

    safe_distance: Robustness
    traffic_flow: Robustness
    kept: str


def judge_rules(
    scenario: Scenario, problem: PlanningProblem, driven: Trajectory, others: Forecast,
    parked: Array, config: Config,
) -> RulesDriven:  # fmt: skip
    """How a drive kept the rules.

    Args:
        scenario: the map.
        problem: what was to be driven.
        driven: what was driven.
        others: their boxes, as they were seen.
        parked: (o,) who of them never moves.
        config: the configuration.

    Raises:
        RoadError: no route leads from the start.
    """
    frame = _followed(scenario, problem, driven, config)
    strips = build_strips(scenario, frame, config.road.lateral_acceleration, config.rules)
    s, d = frame.to_frenet(driven.states[:, [State.X, State.Y]])
    mu = driven.states[:, State.PSI] - frame.heading(s)
    ego = ego_bodies(s[None], d[None], mu[None], driven.states[None, :, State.V])
    around = occupancy(others, frame).window(driven.first_step, len(driven))
    found = signals(strips, ego, other_bodies(around), parked, config.rules)
    recovery = recovery_steps(config.rules, driven.dt)
    distance, flow = monitored(found, recovery)
    distance = distance.min(axis=0, initial=np.inf)
    return RulesDriven(
        Robustness(driven.first_step, distance), Robustness(driven.first_step, flow),
        keeping(distance, recovery),
    )  # fmt: skip


def _followed(
    scenario: Scenario, problem: PlanningProblem, driven: Trajectory, config: Config
) -> Frame:
    """The path of that route from which the drive deviated least."""
    network, points = scenario.lanelet_network, centres(driven.states)
    way = float(np.hypot(*np.diff(points, axis=0).T).sum())
    best, least, reasons = None, np.inf, []
    for route in find_routes(network, problem, config.road.variants):
        try:
            lanes = lasting_lanes(network, route)
            frame = build_frame(network, route, points[0], way + AHEAD, config.road, lanes)
        except RoadError as error:
            reasons.append(str(error))
            continue
        deviation = float(np.abs(frame.to_frenet(points)[1]).max())
        if deviation < least:
            best, least = frame, deviation
    if best is None:
        raise RoadError(f"no path along any route: {'; '.join(reasons)}")
    return best
