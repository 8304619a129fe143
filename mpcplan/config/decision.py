"""Parameters of the seeds and the level-k game."""

from typing import Annotated

from pydantic import Field

from mpcplan.config.base import ClassName, Section, par


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
    last_accelerations: tuple[float, ...] = par(
        (6.0,), "m/s^2", "further accelerations of the search where nothing else reaches the goal"
    )
    search_labels: int = par(1500, "1", "states kept per move of the search", ge=10, le=100000)
    manoeuvre: bool = par(
        True, "", "at low speed, search a narrow way around the others where nothing else leads on"
    )
    manoeuvre_speed: float = par(
        5.0, "m/s", "present speed up to which manoeuvres are searched", ge=0, le=20
    )
    manoeuvre_length: float = par(28.0, "m", "length of a manoeuvre", ge=2, le=100)
    manoeuvre_rate: float = par(
        0.2, "rad/m", "steering rate of a manoeuvre, over the way", gt=0, le=2
    )
    manoeuvre_gap: float = par(0.25, "m", "gap to the others in a manoeuvre", ge=0, le=2)
    manoeuvre_labels: int = par(300, "1", "states kept per metre of a manoeuvre", ge=10, le=100000)
    sources: tuple[ClassName, ...] = par(
        (), "", "further sources of seeds, beside the lattice and the search"
    )
    finalists: int = par(2, "1", "candidates that are handed on to the refinement", ge=1, le=10)


class GameConfig(Section):
    """The level-k game at intersections without traffic lights."""

    enabled: bool = par(False, "", "play the level-k game where ways meet without traffic lights")
    actions: int = par(2, "1", "actions in a row that every player considers (T)", ge=1, le=4)
    step: float = par(1.5, "s", "duration of one action", ge=0.2, le=3)
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
