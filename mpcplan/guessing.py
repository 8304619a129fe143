"""What a planner does otherwise where the others' motion is a guess."""

from mpcplan.config import Config


def for_guesses(config: Config) -> Config:
    """The configuration for others whose motion is a guess: the last moment may be too late, and
    what counts on their motion far ahead (later lane changes, further routes, the jerk at the
    drive's end) is not worth it."""
    reserve = max(config.cost.reserve, config.predict.reserve)
    haste = max(config.cost.haste, config.predict.haste)
    cost = config.cost.model_copy(update={"reserve": reserve, "haste": haste, "edges": False})
    variants = min(config.road.variants, config.predict.variants)
    changes = {
        "cost": cost,
        "road": config.road.model_copy(update={"variants": variants}),
        "seed": config.seed.model_copy(update={"delays": (), "shortest": False}),
    }
    return config.model_copy(update=changes)


def without_haste(config: Config) -> Config:
    """The same configuration without haste; itself where there is none."""
    if not config.cost.haste:
        return config
    return config.model_copy(update={"cost": config.cost.model_copy(update={"haste": 0.0})})
