"""Parameters of the cost, the road and the prediction."""

from typing import Annotated, Literal

from pydantic import Field

from mpcplan.config.base import ClassName, Section, par


class CostConfig(Section):
    """The TR1 cost that the planner minimises, and what it adds to it."""

    jerk: float = par(0.01, "s^5/m^2", "weight of the squared longitudinal jerk", ge=0, le=1e3)
    steering_rate: float = par(22.0, "s/rad^2", "weight of the squared steering rate", ge=0, le=1e4)
    distance: float = par(8.0, "1/s", "weight of closeness to the obstacle ahead", ge=0, le=1e4)
    lane: float = par(
        0.5, "1/(m^2 s)", "weight of the squared lane offset (report: 5)", ge=0, le=1e3
    )
    distance_decay: float = par(0.2, "1/m", "decay of the closeness with the gap", gt=0, le=10)
    distance_offset: float = par(
        0.6696, "m", "subtracted from the distance between centres", ge=0, le=5
    )
    distance_lateral: float = par(
        2.8, "m", "obstacles within this lateral distance count as ahead", gt=0, le=10
    )
    edges: bool = par(
        True,
        "",
        "where the others' motion is recorded, the jerk at both ends of a drive is weighed as the "
        "evaluator sees it",
    )
    reserve: float = par(
        0.0,
        "1",
        "goal positions are due this share of the remaining time before the last moment",
        ge=0,
        le=0.9,
    )
    late: float = par(
        0.02, "1/(m^2 s)", "weight of the squared distance to a position that is due", ge=0, le=1e3
    )
    haste: float = par(
        0.0, "1/s", "cost of each second until all crossings with others are behind", ge=0, le=100
    )
    safe_distance: float = par(
        0.0, "1/(m s)", "weight of what lacks of the safe distance (rule R_G1)", ge=0, le=1e3
    )
    traffic_flow: float = par(
        0.0, "1/m", "weight of the speed by which the traffic is hindered (rule R_G4)", ge=0, le=1e3
    )
    rules_horizon: float = par(
        60.0, "s", "broken rules cost something as far ahead as this", ge=0.1, le=60
    )
    rules_delay: float = par(
        0.0,
        "s",
        "plans keep the safe distance of a vehicle that reacts this much later; where the others' "
        "motion is a guess, drive.replan at least",
        ge=0,
        le=5,
    )


class RoadConfig(Section):
    """Route, reference path and limits of the drivable area."""

    variants: int = par(8, "1", "routes considered at most", ge=1, le=10)
    spacing: float = par(0.5, "m", "sampling of the reference path", gt=0.05, le=2)
    smoothing: float = par(
        2.0, "m^4", "penalty on the second derivative of the reference path", ge=0, le=1e5
    )
    curvature_max: float = par(
        0.3, "1/m", "the reference is smoothed until its curvature is below this", gt=0.01, le=0.5
    )
    behind: float = par(20.0, "m", "reference path kept behind the start", ge=5, le=100)
    ahead: float = par(60.0, "m", "reference path kept past what can be reached", ge=10, le=500)
    margin: float = par(0.1, "m", "distance kept from the road's edge", ge=0, le=1)
    lateral_acceleration: float = par(
        5.0, "m/s^2", "lateral acceleration that planned speeds respect in curves", gt=0.5, le=11
    )
    speed_limit_factor: float = par(
        1.0, "1", "planned speeds stay below this multiple of the signs' limit", gt=0.1, le=2
    )
    speed_max: float = par(40.0, "m/s", "speed limit where no sign stands", gt=1, le=45.8)


class AssociationConfig(Section):
    """When the routes are built anew, from another lane that the ego vehicle has come into."""

    enabled: bool = par(
        False, "", "build the routes anew where the ego vehicle has settled in another lane"
    )
    settled: float = par(
        1.0, "s", "time in the other lane after which the routes are built anew", ge=0, le=30
    )
    offset: float = par(
        0.5, "m", "who is in a lane is at most this far from its centre", gt=0, le=3
    )
    heading: float = par(
        0.1, "rad", "who is in a lane deviates at most this much from its direction", gt=0, le=1
    )
    look: float = par(
        50.0, "m", "no routes are built anew with a complex intersection in this", gt=0, le=500
    )
    near: float = par(
        1.0, "m", "another lane overlaps the reference where its centre is this near", gt=0, le=5
    )
    overlaps: int = par(
        1, "1", "overlapping lanes that make an intersection a complex one", ge=1, le=100
    )


class PredictConfig(Section):
    """How the other vehicles' motion is predicted."""

    kind: Literal["auto", "recorded", "constant_input", "lane_follow"] | ClassName = par(
        "auto",
        "",
        "recorded trajectories, constant acceleration and yaw rate, or along the lanes; auto: "
        "recorded where the traffic is played back, else along the lanes",
    )
    horizon: float = par(3.0, "s", "length of constant_input's prediction", gt=0.1, le=20)
    history: int = par(
        5, "1", "past boxes from which constant_input fits acceleration and yaw rate", ge=2, le=50
    )
    variants: int = par(
        3, "1", "routes considered at most where the others' motion is a guess", ge=1, le=10
    )
    reserve: float = par(
        0.25, "1", "cost.reserve is at least this where the others' motion is a guess", ge=0, le=0.9
    )
    haste: float = par(
        1.5, "1/s", "cost.haste is at least this where the others' motion is a guess", ge=0, le=100
    )
    safe_distance: float = par(
        5.0,
        "1/(m s)",
        "cost.safe_distance is at least this where the others' motion is a guess",
        ge=0,
        le=1e3,
    )
    rules_horizon: float = par(
        3.0,
        "s",
        "cost.rules_horizon is at most this where the others' motion is a guess",
        ge=0.1,
        le=60,
    )
    lane_horizon: float = par(8.0, "s", "length of lane_follow's prediction", ge=0.2, le=20)
    lane_history: int = par(
        3, "1", "past boxes from which lane_follow fits acceleration and drift", ge=2, le=50
    )
    reach: float = par(
        150.0, "m", "lane_follow predicts those further away straight on", gt=0, le=1000
    )
    acceleration_fade: float = par(
        3.0, "s", "time constant by which an observed acceleration becomes the usual one", gt=0
    )
    offset_fade: float = par(
        20.0, "s", "time constant by which offsets from the lane's centre fade", gt=0
    )
    lateral_acceleration: float = par(
        5.5, "m/s^2", "lateral acceleration of the others in turns", gt=0.5, le=11
    )
    lateness: float = par(
        0.0,
        "s",
        "guesses of the others' motion hold for an ego vehicle that is this late, too",
        ge=0,
        le=1,
    )
    hope: tuple[Annotated[float, Field(ge=0, le=20)], ...] = par(
        (0.0, 2.0),
        "s",
        "where no plan reaches the goal, one is sought that counts on others' making way this much "
        "later than plans are verified, at the first of these times that gives one",
    )
    alternative: float = par(
        0.25,
        "1",
        "hypotheses of at least this weight are predicted beside the main one",
        gt=0,
        le=1,
    )
    alternative_horizon: float = par(
        3.0, "s", "length of the prediction of such hypotheses", ge=0, le=20
    )
    spread_along: float = par(
        0.02, "1", "predicted boxes grow by this part of the way driven at either end", ge=0, le=0.5
    )
    leave_out_followers: bool = par(
        True, "", "who follows the ego vehicle in its lane is expected to stay behind it"
    )
