"""A manoeuvre: a path of the single-track model through a narrow place, at low speed.

Polynomials d(s) are too coarse where the vehicle must turn closely past who stands in its way.
Here a path is built of pieces of one steering rate each (:mod:`mpcplan.seed.steered`). Dynamic
programming over labels (s, d, mu, delta): of all labels of equal arc length that share a cell the
cheapest stays, at most a given number. The cost of a piece is what TR1 and time would cost at the
speed at which it is driven,

    (w_SR (u v)^2 + w_LC d^2 + w_t) / v - w_t s' / v_0   per metre.

From where the cheapest label ends, feedback leads on along the reference. Who stands or will stand,
and the road, are obstacles here; who moves is left to the speed search along the path. Source:
hybrid A* (Dolgov et al. 2010), with arc length as the only order, so that a layer is one array.
"""

from dataclasses import replace

import numpy as np

from mpcplan.config import Config
from mpcplan.predict.occupancy import Occupancy
from mpcplan.road.road import Road
from mpcplan.seed.blocked import block
from mpcplan.seed.candidates import tight
from mpcplan.seed.clearance import Boxes, Clearance, kept_standing, on_road, standing
from mpcplan.seed.lattice import reach_of
from mpcplan.seed.paths import FrenetPose, Paths, frenet_pose
from mpcplan.seed.profiles import Motion
from mpcplan.seed.rules import seed_cost
from mpcplan.seed.search import as_seed, search
from mpcplan.seed.seed import Seed, SeedReport
from mpcplan.seed.steered import MIN_STRETCH, Labels, advance, returning, start
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import FORD_ESCORT as CAR

MANOEUVRE = "manoeuvre"  # source of these seeds
PIECE = 1.0  # m, of one steering rate
FASTER = 3.0  # times the usual steering rate, which asks for a lower speed
CELL = (1.0, 0.4, 0.15, 0.2)  # m, m, rad, rad: labels this close in s, d, mu, delta share a cell
SPEED = 2.0  # m/s, at which a manoeuvre is driven where steering does not ask for less
TIME = 5.0  # 1/s, its cost
END_OFFSET, END_TURN = 2.0, 10.0  # 1/m^2, 1/rad^2: cost of not being on the reference at last
ASTRAY = 2.0  # m, from the reference: a path that ends further off leads elsewhere
BEFORE = 0.6  # m, kept free before who stands now, and may set off
URGENT = 10.0  # 1/s, cost of time past who may set off
TURN_MAX = 1.4  # rad, to the reference


def manoeuvre_seeds(
    road: Road, state: Array, acceleration: float, step: int, occupancy: Occupancy,
    config: Config, dt: float,
) -> tuple[list[Seed], SeedReport]:  # fmt: skip
    """The best speed profile along a manoeuvre, where there is one, and the report.

    Args:
        road: the road.
        state: (5,) rear-axle state.
        acceleration: acceleration of the step before [m/s^2].
        step: present time step.
        occupancy: obstacles along the road.
        config: the configuration.
        dt: time step [s].
    """
    pose, motion = frenet_pose(road, state), Motion(max(float(state[State.V]), 0.0), acceleration)
    steps = max(road.last_step - step, 1)
    count = round(reach_of(road, pose, motion, steps * dt) / road.frame.spacing) + 1
    window = occupancy.window(step, steps + 1)
    seeds: list[Seed] = []
    tried = 0
    held = kept_standing(window)
    for others, boxes in ((window, standing(window)), (held, standing(held).ahead(BEFORE))):
        path = manoeuvre(road, pose, count, boxes, config)
        if path is None:
            continue
        tried += 1
        blocked = block(others, path, tight(config), config.cost)
        hurried = config
        if others is held:  # the vehicle must be before him by the time he could set off
            blocked, hurried = replace(blocked, clear=np.full(1, np.inf)), _in_haste(config)
        found = search(road, path, blocked, 0, motion.v, motion.a, step, hurried, dt)
        if found is not None:
            seed = as_seed(road, path, 0, motion.a, found, MANOEUVRE, step, dt)
            cost = seed.cost + seed_cost(seed, others, config, dt)
            seeds.append(replace(seed, cost=cost))
        if seeds and seeds[-1].reaches_goal:
            break
    reaching = sum(seed.reaches_goal for seed in seeds)
    return seeds, SeedReport(MANOEUVRE, tried, len(seeds), reaching)


def _in_haste(config: Config) -> Config:
    """The configuration with a cost of time until a path has all behind."""
    cost = config.cost.model_copy(update={"haste": URGENT})
    return config.model_copy(update={"cost": cost})


def manoeuvre(
    road: Road, pose: FrenetPose, count: int, boxes: Boxes, config: Config
) -> Paths | None:
    """The cheapest path clear of boxes, None where there is none.

    Args:
        road: the road.
        pose: present pose.
        count: samples of the path, as far apart as those of the reference.
        boxes: what may not be touched.
        config: the configuration.
    """
    present, gap = start(pose), config.seed.manoeuvre_gap
    clear = Clearance(road.area, boxes, gap, present.poses(road.frame))
    layers = [present]
    goal = min((goal.s[0] for goal in road.goals if goal.s is not None), default=np.inf)
    for _ in range(round(config.seed.manoeuvre_length / PIECE)):
        if layers[-1].s.max() > goal:
            break
        grown = _grow(road, layers[-1], clear, config)
        if grown is None:
            return None
        layers.append(grown)
    last = layers[-1]
    best = int(np.argmin(last.cost + END_OFFSET * last.d**2 + END_TURN * last.mu**2))
    if abs(last.d[best]) > ASTRAY:
        return None
    return _as_path(road, present, _played_back(layers, best), count, config.seed.manoeuvre_rate)


def _grow(road: Road, labels: Labels, clear: Clearance, config: Config) -> Labels | None:
    """The successors of a layer that are clear, the cheapest of every cell; None: there is none."""
    rates = config.seed.manoeuvre_rate * np.array([-FASTER, -1.0, 0.0, 1.0, FASTER])
    parent = np.repeat(np.arange(len(labels.s)), len(rates))
    grown = replace(labels.pick(parent), rate=np.tile(rates, len(labels.s)), parent=parent)
    steps = _steps(road)
    for _ in range(steps):
        grown = advance(road.frame, grown, grown.rate, PIECE / steps)
        low, high = road.frame.domain(grown.s)
        inside = (np.abs(grown.mu) < TURN_MAX) & (grown.d > low) & (grown.d < high)
        grown = grown.pick(np.flatnonzero(inside))
        grown = grown.pick(np.flatnonzero(clear.of_boxes(grown.poses(road.frame))))
    if not len(grown.s):
        return None
    grown = replace(grown, cost=grown.cost + _cost(labels, grown, config))
    kept = _cheapest(grown, config.seed.manoeuvre_labels)
    kept = kept.pick(np.flatnonzero(clear.of_edges(kept.poses(road.frame))))
    return kept if len(kept.s) else None


def _steps(road: Road) -> int:
    """Samples of the reference per piece."""
    return max(round(PIECE / road.frame.spacing), 1)


def _cost(labels: Labels, grown: Labels, config: Config) -> Array:
    """(n,) of the last pieces of labels that have grown from others."""
    slow = CAR.v_delta_max / np.maximum(np.abs(grown.rate), config.seed.manoeuvre_rate)
    v = np.minimum(SPEED, slow)
    steering = config.cost.steering_rate * (grown.rate * v) ** 2
    progress = grown.s - labels.s[grown.parent]
    return (steering + config.cost.lane * grown.d**2 + TIME) * PIECE / v - TIME * progress / SPEED


def _cheapest(labels: Labels, most: int) -> Labels:
    """The cheapest label of every cell, and of these the cheapest ``most``."""
    values = (labels.s, labels.d, labels.mu, labels.delta)
    cells = np.stack([np.rint(value / size) for value, size in zip(values, CELL, strict=True)])
    order = np.lexsort((labels.cost, *cells))
    first = np.concatenate([[True], (np.diff(cells[:, order], axis=1) != 0).any(axis=0)])
    kept = order[first]
    return labels.pick(kept[np.argsort(labels.cost[kept], kind="stable")[:most]])


def _played_back(layers: list[Labels], at: int) -> Array:
    """(pieces,) steering rates [rad/m] of the way to a label of the last layer."""
    rates = []
    for labels in layers[:0:-1]:
        rates.append(float(labels.rate[at]))
        at = int(labels.parent[at])
    return np.array(rates[::-1])


def _as_path(road: Road, present: Labels, rates: Array, count: int, most: float) -> Paths:
    """The path of steering rates, led on along the reference with at most a rate [rad/m]."""
    frame, spacing = road.frame, road.frame.spacing
    given = np.repeat(rates, _steps(road))[: count - 1].tolist()
    samples = [present]
    for k in range(count - 1):
        at = samples[-1]
        rate = np.array([given[k]]) if k < len(given) else returning(frame, at, most, spacing)
        samples.append(advance(frame, at, rate, spacing))
    s, d, mu, delta = (
        np.concatenate([getattr(at, name) for at in samples]) for name in ("s", "d", "mu", "delta")
    )
    whole = replace(present, s=s, d=d, mu=mu, delta=delta)
    return _with_geometry(road, whole)


def _with_geometry(road: Road, path: Labels) -> Paths:
    """Samples (n,) of a path as the only one of its kind; off the road it may not be driven."""
    frame, spacing = road.frame, road.frame.spacing
    poses = path.poses(frame)
    excess = np.where(on_road(poses, road.area, 0.0), 0.0, CAR.length)
    kappa_r = frame.curvature(path.s)
    stretch = min(max(float((1.0 - kappa_r * path.d).min()), MIN_STRETCH), 1.0)
    swing = kappa_r * (CAR.front * np.cos(path.mu)) ** 2 / 2
    delta_slope = np.gradient(path.delta, spacing)
    kappa, excess = np.tan(path.delta) / CAR.wheelbase, np.maximum.accumulate(excess)
    x, y, psi, s, d, mu, swing, kappa, delta, delta_slope, excess = (
        row[None]
        for row in (
            *poses, path.s, path.d, path.mu, swing, kappa, path.delta, delta_slope, excess
        )
    )  # fmt: skip
    return Paths(
        spacing, s, d, mu, x, y, psi, swing, kappa, delta, delta_slope, excess, path.d[-1:],
        np.array([stretch]), np.array([True]),
    )  # fmt: skip
