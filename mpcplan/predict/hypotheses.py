"""Which ways the others may take, with weights, and who leads whom on them.

A vehicle's places on lanes are weighed by offset, drift and heading, each place by the probability
of its lane at the fork before; every way ahead of a place that differs within reach is a hypothesis
of its own. The weights of a vehicle's hypotheses sum to 1.
"""

from dataclasses import dataclass

import numpy as np

from mpcplan.predict.lanes import Places
from mpcplan.predict.paths import Paths
from mpcplan.trajectory import Array

OFFSET = 1.0  # m, standard deviation of the offset from a lane's centre
TURN = 0.2  # rad, standard deviation of the heading relative to a lane
DRIFT = 2.0  # s, for which a lateral drift goes on
LEAST_PLACE = 0.05  # weight below which a place is left out
LOOK = 4.0  # s, at the present speed, within which ways must differ,
LOOK_MORE = 10.0  # m, and a little further
IN_LANE = 2.0  # m, from a lane's centre: a body nearer than this is in the way there
EASY = 1e-9  # weight of a place that does not fit at all


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """Ways that vehicles may take, ordered by vehicle, the most likely first (all (h,)).

    Attributes:
        vehicle: index of the vehicle.
        path: index of the way.
        s: arc length [m] of the vehicle's front.
        weight: probability.
    """

    vehicle: Array
    path: Array
    s: Array
    weight: Array

    def first(self, vehicles: int) -> Array:
        """(vehicles,) row of each vehicle's most likely hypothesis; -1: none."""
        rows = np.full(vehicles, -1)
        rows[self.vehicle[::-1]] = np.arange(len(self.vehicle))[::-1]
        return rows


def place_weights(places: Places, velocity: Array, paths: Paths, vehicles: int) -> Array:
    """(p,) probabilities of places; those of a vehicle sum to 1.

    Args:
        places: of the vehicles.
        velocity: (vehicles, 2) of the vehicles [m/s].
        paths: of the map.
        vehicles: how many there are.
    """
    moving = velocity[places.vehicle]
    drift = places.direction[:, 0] * moving[:, 1] - places.direction[:, 1] * moving[:, 0]
    off = (places.d + DRIFT * drift) / OFFSET
    weight = np.exp(-(off**2 + (places.turn / TURN) ** 2) / 2) + EASY
    weight = weight * paths.share[places.lane]
    return weight / np.bincount(places.vehicle, weight, vehicles)[places.vehicle]


def hypotheses(places: Places, weight: Array, speed: Array, paths: Paths) -> Hypotheses:
    """The hypotheses of vehicles with places (p,) of weights (p,), and speeds [m/s] by vehicle."""
    kept = np.flatnonzero(weight >= LEAST_PLACE)
    rows = [
        (int(vehicle), -float(share * chance), path, float(s))
        for vehicle, lane, s, share in zip(
            places.vehicle[kept], places.lane[kept], places.s[kept], weight[kept], strict=True
        )
        for path, chance in paths.branches(int(lane), float(s), LOOK * speed[vehicle] + LOOK_MORE)
    ]
    rows.sort()
    table = np.array(rows, float).reshape(-1, 4)
    vehicle, path = table[:, 0].astype(int), table[:, 2].astype(int)
    total = np.bincount(vehicle, -table[:, 1])[vehicle]
    return Hypotheses(vehicle, path, table[:, 3], -table[:, 1] / total)


@dataclass(frozen=True, eq=False)
class Leaders:
    """Who is ahead of each hypothesis on its way (all (h,)).

    Attributes:
        row: of the leader's most likely hypothesis; h: none.
        at: arc length [m] of the leader's front on the follower's way.
        until: arc length [m] on the leader's way from which it is elsewhere.
    """

    row: Array
    at: Array
    until: Array


def leaders(
    found: Hypotheses, places: Places, weight: Array, paths: Paths, first: Array
) -> Leaders:
    """The nearest vehicle ahead on each hypothesis' way; ``first`` (n,) are the rows of the
    vehicles' most likely hypotheses."""
    count = len(found.path)
    near = (np.abs(places.d) < IN_LANE) | (weight > 0.5)
    near &= first[places.vehicle] >= 0
    there = places.pick(np.flatnonzero(near))
    row, at, until = np.full(count, count), np.zeros(count), np.full(count, np.inf)
    if not count or not len(there.s):
        return Leaders(row, at, until)
    front = paths.starts[found.path][:, there.lane] + there.s
    with np.errstate(invalid="ignore"):
        ahead = (front > found.s[:, None]) & (there.vehicle != found.vehicle[:, None])
    front = np.where(ahead, front, np.inf)
    nearest = front.argmin(axis=1)
    led = np.flatnonzero(ahead.any(axis=1))
    row[led] = first[there.vehicle[nearest[led]]]
    at[led] = front[led, nearest[led]]
    for i in led:
        lane = int(there.lane[nearest[i]])
        until[i] = paths.parting(int(found.path[row[i]]), int(found.path[i]), lane)
    return Leaders(row, at, until)
