"""What a planner does otherwise where the others' motion is a guess, or nothing else leads on."""

from mpcplan.config import Config


def for_guesses(config: Config) -> Config:
    """The configuration for others whose motion is a guess: the last moment may be too late,
    who drives ahead may brake at any time, and what counts on their motion far ahead (later lane
    changes, further routes, the jerk at the drive's end, distances by then) is not worth it."""
    reserve = max(config.cost.reserve, config.predict.reserve)
    haste = max(config.cost.haste, config.predict.haste)
    distance = max(config.cost.safe_distance, config.predict.safe_distance)
    rules = min(config.cost.rules_horizon, config.predict.rules_horizon)
    changed = {"reserve": reserve, "haste": haste, "edges": False}
    delay = max(config.cost.rules_delay, config.drive.replan)  # what happens is seen so much later
    changed |= {"safe_distance": distance, "rules_horizon": rules, "rules_delay": delay}
    cost = config.cost.model_copy(update=changed)
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


def in_the_last_moment(config: Config) -> Config:
    """The same configuration with the accelerations that are kept for the last moment; itself where
    there are none."""
    seed = config.seed
    if not seed.last_accelerations:
        return config
    actions = tuple(sorted({*seed.search_actions, *seed.last_accelerations}))
    return config.model_copy(update={"seed": seed.model_copy(update={"search_actions": actions})})
