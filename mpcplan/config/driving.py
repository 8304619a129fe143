"""Parameters of verification, traffic rules, the closed loop, and of the bound."""

from mpcplan.config.base import Section, par


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
    waiting: bool = par(
        True,
        "",
        "where the others' motion is a guess, plans must also be safe from who stands now if he "
        "has not moved by the next cycle",
    )
    held: bool = par(
        True,
        "",
        "where the others' motion is a guess, who stands does not set off into a plan that is in "
        "his way by then",
    )
    trusting: bool = par(
        True,
        "",
        "where the others' motion is a guess and no plan that passes leads to the goal, drive one "
        "that only those refuse who follow at the safe distance",
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
