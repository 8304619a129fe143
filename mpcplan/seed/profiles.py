"""Longitudinal candidates: speed profiles sigma(t) along a path (Werling et al. 2010, 2012).

Every profile is a first move over [0, t1], a second over [t1, t1 + t2], then constant speed:

- velocity keeping: a quartic to a sampled speed, held; or a second quartic to another speed,
- goal: a quartic to a sampled speed, then a quintic to a sampled position and speed in the goal,
- stopping: a quintic to rest at a sampled distance,
- following: a quintic to a sampled gap behind a leader at its speed.
"""

from dataclasses import dataclass

import numpy as np

from mpcplan.config import SeedConfig
from mpcplan.seed.polynomials import evaluate, quartic, quintic
from mpcplan.trajectory import Array

HARD_STOP, GENTLE_STOP = 8.0, 1.0  # m/s^2, mean decelerations of the shortest and longest stop
ROLL = 5.0  # m, added to the longest stop
SECOND_MOVE = 2.5  # s, duration of a second speed change
MIN_DURATION = 0.4  # s, shortest second move


@dataclass(frozen=True)
class Motion:
    """Longitudinal state at the beginning: speed [m/s] and acceleration [m/s^2]."""

    v: float
    a: float


@dataclass(frozen=True)
class Arrival:
    """A goal window along a path: duration [s], sigma and speed intervals [m, m/s]."""

    duration: float
    sigma: tuple[float, float]
    v: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Profiles:
    """Speed profiles, all (n, k) at t = 0, dt, ...: sigma [m], v [m/s], a [m/s^2]."""

    sigma: Array
    v: Array
    a: Array


def sample_profiles(
    motion: Motion,
    arrivals: list[Arrival],
    leaders: Array,
    t: Array,
    speed_limit: float,
    config: SeedConfig,
) -> Profiles:
    """All speed profiles from a motion.

    Args:
        motion: present speed and acceleration.
        arrivals: goal windows with a position.
        leaders: (m, 3) positions sigma to stop or follow at: columns time [s], sigma [m], v [m/s].
        t: (k,) times [s].
        speed_limit: largest sampled speed [m/s].
        config: grids.
    """
    top = max(min(motion.v + config.speed_change, speed_limit), motion.v, 1.0)
    speeds = np.linspace(0.0, top, config.speeds)
    parts = [
        _keeping(motion, speeds, np.array(config.times), t),
        _changing(motion, speeds[::2], t),
        _stopping(motion, config.stop_distances, t),
    ]
    parts += [_arriving(motion, arrival, speeds[::2], t, config) for arrival in arrivals]
    if len(leaders):
        parts.append(_following(motion, leaders, np.array(config.follow_gaps), t))
    return Profiles(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _grid(*axes: Array) -> list[Array]:
    return [axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")]


def _play(first: Array, t1: Array, second: Array, t2: Array, t: Array) -> tuple[Array, ...]:
    """Two moves one after the other, then constant speed: sigma, v, a, each (n, k)."""
    t1, t2 = t1[:, None], t2[:, None]
    early = evaluate(first, np.minimum(t, t1))
    late = evaluate(second, np.clip(t - t1, 0.0, t2))
    sigma, v, a = (np.where(t <= t1, e, w) for e, w in zip(early, late, strict=True))
    over = t > t1 + t2
    sigma = sigma + np.where(over, v * (t - t1 - t2), 0.0)
    return sigma, v, np.where(over, 0.0, a)


def _hold(end: Array, v: Array) -> tuple[Array, Array]:
    """Constant speed as a second move of no duration."""
    zero = np.zeros_like(v)
    return np.stack([end, v, zero, zero, zero, zero], axis=-1), zero


def _end(c: Array, t1: Array) -> Array:
    return evaluate(c, t1[:, None])[0][:, 0]


def _keeping(motion: Motion, speeds: Array, times: Array, t: Array) -> tuple[Array, ...]:
    v1, t1 = _grid(speeds, times)
    first = quartic(0.0, motion.v, motion.a, v1, 0.0, t1)
    return _play(first, t1, *_hold(_end(first, t1), v1), t)


def _changing(motion: Motion, speeds: Array, t: Array) -> tuple[Array, ...]:
    """Two speed changes: to v1, then to v2."""
    v1, v2, t1 = _grid(speeds, speeds, np.array([1.2, 2.4]))
    first = quartic(0.0, motion.v, motion.a, v1, 0.0, t1)
    second = quartic(_end(first, t1), v1, 0.0, v2, 0.0, np.full_like(v1, SECOND_MOVE))
    return _play(first, t1, second, np.full_like(v1, SECOND_MOVE), t)


def _stopping(motion: Motion, count: int, t: Array) -> tuple[Array, ...]:
    """Quintics to rest at distances from a hard stop to a long roll."""
    v = max(motion.v, 0.5)
    hard, gentle = v**2 / (2 * HARD_STOP), v**2 / (2 * GENTLE_STOP) + ROLL
    distance, stretch = _grid(np.linspace(hard, gentle, count), np.array([1.6, 2.0, 2.6]))
    t1 = np.maximum(stretch * distance / v, MIN_DURATION)
    first = quintic(0.0, motion.v, motion.a, distance, 0.0, 0.0, t1)
    return _play(first, t1, *_hold(distance, np.zeros_like(distance)), t)


def _arriving(
    motion: Motion, arrival: Arrival, speeds: Array, t: Array, config: SeedConfig
) -> tuple[Array, ...]:
    """To the goal at a given time: by way of a sampled speed, or directly."""
    positions = np.linspace(*arrival.sigma, config.goal_positions)
    mean = max(positions[-1], 1.0) / arrival.duration
    low, high = max(arrival.v[0], 0.0), min(arrival.v[1], 2.0 * mean + 2.0)
    ends = np.linspace(low, max(low, high), config.goal_speeds)
    shares = np.array([0.15, 0.35, 0.6])
    v1, end, v2, share = _grid(speeds, positions, ends, shares)
    t1 = np.maximum(share * arrival.duration, MIN_DURATION / 4)
    t2 = np.maximum(arrival.duration - t1, MIN_DURATION)
    first = quartic(0.0, motion.v, motion.a, v1, 0.0, t1)
    second = quintic(_end(first, t1), v1, 0.0, end, v2, 0.0, t2)
    detour = _play(first, t1, second, t2, t)
    end, v2 = _grid(positions, ends)
    t1 = np.full_like(end, max(arrival.duration, MIN_DURATION))
    direct = quintic(0.0, motion.v, motion.a, end, v2, 0.0, t1)
    straight = _play(direct, t1, *_hold(end, v2), t)
    return tuple(np.concatenate(pair) for pair in zip(detour, straight, strict=True))


def _following(motion: Motion, leaders: Array, gaps: Array, t: Array) -> tuple[Array, ...]:
    """Quintics to a gap behind a leader's predicted position, at its speed."""
    row, gap = _grid(np.arange(len(leaders)), gaps)
    t1, sigma, v1 = leaders[row.astype(int)].T
    end = np.maximum(sigma - gap, 0.1)
    first = quintic(0.0, motion.v, motion.a, end, v1, 0.0, t1)
    return _play(first, t1, *_hold(end, v1), t)
