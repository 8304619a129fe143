"""Typed, validated configuration: every parameter with its unit, range and meaning."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

Backend = Literal[
    "osqp", "piqp", "piqp multistage", "osqp then piqp", "hpipm", "proxqp", "qpsolvers clarabel",
    "qpsolvers proxqp", "ipopt", "fatrop",
]  # fmt: skip
WHOLE = ("ipopt", "fatrop")
"""Backends that solve the nonlinear problem as a whole."""


def par(default: Any, unit: str, meaning: str, **limits: Any) -> Any:
    """A parameter: its default, unit, meaning and limits (pydantic's gt, ge, lt, le)."""
    return Field(default, description=meaning, json_schema_extra={"unit": unit}, **limits)


class Section(BaseModel):
    """A group of parameters; unknown keys are refused and values cannot change."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)


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


class PredictConfig(Section):
    """How the other vehicles' motion is predicted."""

    kind: Literal["auto", "recorded", "constant_input", "lane_follow"] = par(
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


class SeedConfig(Section):
    """The sampled lattice (Werling 2010, 2012)."""

    speeds: int = par(9, "1", "sampled end speeds", ge=2, le=50)
    speed_change: float = par(
        8.0, "m/s", "sampled end speeds reach this far above the present speed", gt=0, le=30
    )
    times: tuple[float, ...] = par(
        (1.0, 2.0, 3.0), "s", "sampled durations of the first speed change", min_length=1
    )
    goal_positions: int = par(3, "1", "sampled arrival positions in the goal region", ge=1, le=20)
    goal_speeds: int = par(3, "1", "sampled arrival speeds", ge=1, le=20)
    stop_distances: int = par(8, "1", "sampled stopping positions", ge=1, le=50)
    follow_gaps: tuple[float, ...] = par(
        (8.0, 14.0, 22.0), "m", "sampled gaps behind a leader", min_length=1
    )
    offsets: tuple[float, ...] = par(
        (-0.6, 0.0, 0.6), "m", "sampled end offsets from a lane's centre", min_length=1
    )
    lengths: tuple[float, ...] = par(
        (15.0, 40.0), "m", "sampled lengths of a lateral move", min_length=1
    )
    delays: tuple[float, ...] = par(
        (30.0, 60.0),
        "m",
        "how much further on moves to other lanes may begin as well, where the others' motion is "
        "recorded",
    )
    passed: int = par(2, "1", "slow obstacles around which paths lead out and back", ge=0, le=10)
    pass_speed: float = par(5.0, "m/s", "obstacles slower than this may be passed", ge=0, le=30)
    pass_gap: float = par(0.5, "m", "gap to the side when passing", ge=0, le=3)
    margin_lon: float = par(0.2, "m", "gap kept ahead and behind", ge=0, le=5)
    margin_lat: float = par(0.1, "m", "gap kept to the side", ge=0, le=2)
    goal_missed: float = par(200.0, "1", "cost of a candidate that misses the goal", ge=0, le=1e6)
    goal_distance: float = par(
        5.0, "1/m", "cost of each metre by which the goal is missed", ge=0, le=1e6
    )
    road_slack: float = par(
        0.6, "m", "excess over the road's edge that the refinement is trusted to repair", ge=0, le=2
    )
    steering_slack: float = par(
        0.4, "rad/s", "excess steering rate that the refinement is trusted to repair", ge=0, le=2
    )
    slack_cost: float = par(30.0, "1/m, s/rad", "cost of either excess", ge=0, le=1e4)
    search: bool = par(True, "", "search speed profiles where the lattice finds no way to the goal")
    shortest: bool = par(
        True,
        "",
        "where the others' motion is recorded, the search also follows the shortest move to each "
        "target where that cannot be driven at the present speed",
    )
    search_steps: int = par(3, "time steps", "duration of one move of the search", ge=1, le=10)
    search_actions: tuple[float, ...] = par(
        (-9.0, -6.0, -3.0, -1.5, 0.0, 1.5, 3.0),
        "m/s^2",
        "accelerations of the search",
        min_length=2,
    )
    search_labels: int = par(1500, "1", "states kept per move of the search", ge=10, le=100000)
    finalists: int = par(2, "1", "candidates that are handed on to the refinement", ge=1, le=10)


class GameConfig(Section):
    """The level-k game at intersections without traffic lights."""

    enabled: bool = par(False, "", "play the level-k game where ways meet without traffic lights")
    actions: int = par(3, "1", "actions in a row that every player considers (T)", ge=1, le=4)
    step: float = par(1.0, "s", "duration of one action", ge=0.2, le=3)
    substeps: int = par(
        4, "1", "instants of every action at which rewards look at the players", ge=1, le=20
    )
    agents: int = par(4, "1", "other players at most, the nearest in time", ge=1, le=8)
    collision: float = par(
        10000.0, "1", "cost of each action in which bodies touch (w1)", ge=0, le=1e9
    )
    safe_distance: float = par(
        1000.0, "1", "cost of each action in which safety zones overlap (w2)", ge=0, le=1e9
    )
    off_road: float = par(1000.0, "1", "cost of each action off the road (w3)", ge=0, le=1e9)
    lane: float = par(
        100.0, "1", "cost of each action out of the lane or against it (w4)", ge=0, le=1e9
    )
    distance: float = par(
        1.0, "1/m", "cost of the distance to the target after each action (w5)", ge=0, le=1e6
    )
    margin: float = par(0.2, "m", "gap below which bodies count as touching", ge=0, le=2)
    zone_length: float = par(
        1.5, "m", "how far a safety zone reaches ahead of and behind a body", ge=0, le=30
    )
    zone_width: float = par(
        0.2, "m", "how far a safety zone reaches to either side of a body", ge=0, le=5
    )
    learning: float = par(
        0.2, "1", "what the level gains in belief that fits an observed action", ge=0, le=10
    )
    prior: tuple[Annotated[float, Field(gt=0, le=1)], ...] = par(
        (1.0, 1.0, 1.0),
        "1",
        "how likely levels 0, 1 and 2 are before anything is observed, in proportion",
        min_length=3,
        max_length=3,
    )
    look: float = par(60.0, "m", "ways that meet within this distance matter", gt=0, le=300)
    window: float = par(
        6.0, "s", "others matter who can be at a meeting of ways within this time", gt=0, le=30
    )
    told: int = par(5, "1", "best sequences of actions that a decision tells", ge=1, le=100)


class RefineConfig(Section):
    """The optimal-control problem and its solution by sequential quadratic programming."""

    enabled: bool = par(True, "", "refine the seeds; otherwise the sampled lattice drives alone")
    horizon: Annotated[float, Field(gt=0, le=60)] | Literal["goal"] = par(
        3.0, "s", "length of the problem, or 'goal' for the whole way to the goal"
    )
    fresh_to_goal: bool = par(
        True, "", "refine a fresh seed to its end once, whatever the horizon of later cycles is"
    )
    settle: float = par(
        0.01,
        "1",
        "where the others' motion is recorded, the last plan is refined the whole way to the goal "
        "again as long as the last time gained more than this share of its cost; 1: never",
        ge=0,
        le=1,
    )
    asides: tuple[Annotated[float, Field(ge=0, le=3)], ...] = par(
        (0.3, 0.0),
        "m",
        "how much further aside than TR1 others count as ahead, for the refinement may still move "
        "sideways: the first; where the others' motion is recorded the best of all",
        min_length=1,
    )
    retry_margin: float = par(
        0.15,
        "m",
        "margins grow by this for a second try when verification refuses the first",
        ge=0,
        le=2,
    )
    iterations: int = par(5, "1", "SQP iterations at most when a plan goes on", ge=1, le=200)
    tolerance: float = par(2e-3, "1", "scaled step at which the iteration ends", gt=0, le=1)
    gain: float = par(5e-4, "1", "relative gain at which the iteration ends", ge=0, le=1)
    damping: float = par(
        0.001,
        "1",
        "Levenberg-Marquardt damping at the start, in units of typical steps",
        ge=0,
        le=10,
    )
    backend: Backend = par("osqp", "", "QP solver of the subproblems when a plan goes on")
    fresh_backend: Backend = par(
        "piqp multistage",
        "",
        "QP solver for a fresh seed; 'then': where OSQP's answer could not be polished",
    )
    fresh_iterations: int = par(10, "1", "SQP iterations at most for a fresh seed", ge=1, le=200)
    qp_iterations: int = par(150, "1", "OSQP iterations at most per subproblem", ge=10, le=100000)
    qp_tolerance: float = par(1e-4, "1", "OSQP's absolute and relative tolerance", gt=0, le=0.1)
    whole_iterations: int = par(
        500, "1", "iterations at most where the problem is solved as a whole", ge=1, le=10000
    )
    line_search: int = par(6, "1", "halvings of a step at most", ge=0, le=30)
    penalty_lon: float = par(
        200.0, "1/m", "exact penalty on leaving the corridor in s", gt=0, le=1e6
    )
    penalty_lat: float = par(400.0, "1/m", "exact penalty on leaving it in d", gt=0, le=1e6)
    penalty_acceleration: float = par(
        20.0, "s^2/m", "exact penalty on lateral acceleration and friction circle", gt=0, le=1e6
    )
    penalty_goal: float = par(400.0, "1/m", "exact penalty on missing the goal", gt=0, le=1e6)
    friction_share: float = par(
        0.97, "1", "part of the friction circle that plans use", gt=0.1, le=1
    )
    actuator_share: float = par(0.98, "1", "part of the actuators that plans use", gt=0.1, le=1)
    speeding: float = par(
        0.5, "s/m^2", "weight of the squared excess over the speed limit", ge=0, le=1e3
    )
    terminal: tuple[float, float, float, float, float, float] = par(
        (1.0, 10.0, 400.0, 10.0, 200.0, 0.4),
        "1/unit^2",
        "weights of the last state's distance from the seed (s, d, mu, v, delta, a), where the "
        "problem ends before the goal",
    )


class VerifyConfig(Section):
    """What a plan must pass before it is executed."""

    position_tolerance: float = par(
        1e-6, "m", "re-simulated positions agree to this", gt=0, le=0.01
    )
    margin: float = par(0.05, "m", "gap kept to every predicted rectangle", ge=0, le=1)
    braking: float = par(8.0, "m/s^2", "deceleration of the fail-safe tail", gt=1, le=11.5)
    tail_road: float = par(
        0.03,
        "m^2",
        "where the others' motion is a guess, a fail-safe tail may be this much off the road; what "
        "is driven may not",
        ge=0,
        le=0.2,
    )
    horizon: float = par(
        3.0,
        "s",
        "where the others' motion is a guess, a plan is verified this far, and a fail-safe tail "
        "from there; where it is recorded, to its end",
        gt=0.1,
        le=60,
    )


class RulesConfig(Section):
    """Traffic rules R_G1 (safe distance) and R_G4 (traffic flow)."""

    reaction: float = par(
        0.3,
        "s",
        "who follows at the safe distance brakes after this time: the ego vehicle behind the "
        "others, and others behind it when a fail-safe tail begins",
        ge=0,
        le=5,
    )
    braking_ego: float = par(
        10.0, "m/s^2", "deceleration of the ego vehicle in the safe distance", gt=1, le=15
    )
    braking_others: float = par(
        10.5, "m/s^2", "deceleration of the others in the safe distance", gt=1, le=15
    )
    recovery: float = par(
        3.0, "s", "after somebody cut in the safe distance is due again in this time", ge=0, le=30
    )
    cut_in_turn: float = par(
        0.01, "rad", "who cuts in turns to the ego vehicle by this at least", gt=0, le=0.5
    )
    flow: float = par(
        15.0, "m/s", "who is slower than allowed by more than this hinders the traffic", gt=0, le=45
    )
    speed_interstate: float = par(
        36.1, "m/s", "allowed on interstates and highways where no sign stands", gt=1, le=70
    )
    speed_usual: float = par(
        13.9, "m/s", "allowed on other roads where no sign stands", gt=1, le=70
    )
    overlap: float = par(
        0.2, "m", "a body that reaches this far into a lane is on it", ge=0, le=1.5
    )


class DriveConfig(Section):
    """The closed loop."""

    replan: float = par(0.3, "s", "time between planning cycles", ge=0.1, le=5)
    steps_max: int = par(1000, "1", "time steps driven at most", ge=1, le=100000)


class RiskConfig(Section):
    """When to plan again sooner than usual."""

    replan: float = par(
        0.3,
        "s",
        "time between planning cycles where there is risk, if less than usual",
        ge=0.1,
        le=5,
    )
    look: float = par(30.0, "m", "way ahead in which bends and crossings count", gt=0, le=200)
    curvature: float = par(0.08, "1/m", "curvature of the way from which it counts", gt=0, le=1)
    gap: float = par(3.0, "m", "gap to the nearest body up to which it counts", ge=0, le=50)


class BoundConfig(Section):
    """The clairvoyant optimum that results are compared with."""

    labels: int = par(
        3000, "1", "states kept per move of the search for homotopies", ge=10, le=100000
    )
    arrivals: int = par(
        4, "1", "parts of the goal's time for each of which ways are sought", ge=1, le=50
    )
    lengths: tuple[float, ...] = par(
        (15.0, 40.0, 80.0), "m", "sampled lengths of a lateral move", min_length=1
    )
    delays: tuple[float, ...] = par(
        (30.0, 60.0, 120.0), "m", "how much further on moves to other lanes may begin as well"
    )
    refined: int = par(16, "1", "ways that are refined, the cheapest ones", ge=1, le=1000)
    polished: int = par(
        3, "1", "refined ways of which the corridor is made anew until they settle", ge=1, le=100
    )
    rounds: int = par(4, "1", "new corridors at most", ge=0, le=50)
    gain: float = par(1e-3, "1", "relative gain at which a way has settled", ge=0, le=1)
    iterations: int = par(20, "1", "SQP iterations at most", ge=1, le=200)


class Config(Section):
    """The whole configuration."""

    cost: CostConfig = par(CostConfig(), "", "the planner's cost")
    road: RoadConfig = par(RoadConfig(), "", "route, reference path and limits")
    predict: PredictConfig = par(PredictConfig(), "", "prediction of the other vehicles")
    seed: SeedConfig = par(SeedConfig(), "", "the sampled lattice")
    game: GameConfig = par(GameConfig(), "", "the level-k game")
    refine: RefineConfig = par(RefineConfig(), "", "the optimal-control problem")
    verify: VerifyConfig = par(VerifyConfig(), "", "checks before execution")
    rules: RulesConfig = par(RulesConfig(), "", "traffic rules")
    drive: DriveConfig = par(DriveConfig(), "", "the closed loop")
    risk: RiskConfig = par(RiskConfig(), "", "when to plan again sooner")
    bound: BoundConfig = par(BoundConfig(), "", "the clairvoyant optimum")
