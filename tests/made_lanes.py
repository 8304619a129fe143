"""Small lanelet networks and observations on them, made by hand for the tests of prediction."""

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from commonroad.scenario.intersection import Intersection, IntersectionIncomingElement
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad.scenario.traffic_sign import (
    TrafficSign,
    TrafficSignElement,
    TrafficSignIDZamunda,
)

from mpcplan.observation import Observation, Snapshot

DT = 0.1
WIDTH = 3.5  # m, of a lane
CAR = (4.5, 1.8)  # m, length and width
ASIDE = np.array([-40.0, -60.0, 0.0, 0.0, 0.0])  # of all roads: the ego vehicle is in nobody's way


def lane(
    number: int, points: Sequence[Sequence[float]], after: Sequence[int] = (),
    before: Sequence[int] = (), left: int | None = None, right: int | None = None,
) -> Lanelet:  # fmt: skip
    """A lanelet with the given centre line."""
    centre = np.asarray(points, float)
    along = np.gradient(centre, axis=0)
    normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
    bounds = centre + WIDTH / 2 * normal, centre, centre - WIDTH / 2 * normal
    return Lanelet(
        *bounds, number, predecessor=list(before), successor=list(after), adjacent_left=left,
        adjacent_left_same_direction=None if left is None else True, adjacent_right=right,
        adjacent_right_same_direction=None if right is None else True,
    )  # fmt: skip


def network(*lanelets: Lanelet, limits: dict[int, float] | None = None) -> LaneletNetwork:
    """A network of lanelets with speed limits [m/s] by lanelet."""
    roads = LaneletNetwork.create_from_lanelet_list(list(lanelets))
    for i, (number, limit) in enumerate(sorted((limits or {}).items())):
        element = TrafficSignElement(TrafficSignIDZamunda.MAX_SPEED, [str(limit)])
        roads.add_traffic_sign(
            TrafficSign(9000 + i, [element], {number}, np.zeros(2)), {number}
        )  # fmt: skip
    return roads


def line(a: Sequence[float], b: Sequence[float], count: int = 21) -> np.ndarray:
    """(count, 2) points from a to b."""
    return np.linspace(a, b, count)


def arc(start: Sequence[float], heading: float, radius: float, turn: float) -> np.ndarray:
    """(n, 2) points of a circle's arc that turns by an angle [rad], to the left if positive."""
    angles = np.linspace(0.0, abs(turn), 31)
    side = math.copysign(1.0, turn)
    x, y = radius * np.sin(angles), side * radius * (1 - np.cos(angles))
    c, s = math.cos(heading), math.sin(heading)
    return np.asarray(start) + np.column_stack([c * x - s * y, s * x + c * y])


def straight_road() -> LaneletNetwork:
    """Lanelet 1 along x from -100 m to 600 m."""
    return network(lane(1, line((-100, 0), (600, 0), 71)))


def two_lanes() -> LaneletNetwork:
    """Lanelets 1 and, to its left at y = 3.5 m, 2 along x."""
    return network(
        lane(1, line((-100, 0), (600, 0)), left=2),
        lane(2, line((-100, WIDTH), (600, WIDTH)), right=1),
    )


def fork(turn: float = 1.2) -> LaneletNetwork:
    """Lanelet 1 along x to the origin, then straight on by 2, or by 3 in a bend."""
    bend = arc((0, 0), 0.0, 15.0, turn)
    end = bend[-1] + 100 * np.array([math.cos(turn), math.sin(turn)])
    return network(
        lane(1, line((-200, 0), (0, 0)), after=(2, 3)),
        lane(2, line((0, 0), (300, 0)), before=(1,)),
        lane(3, np.vstack([bend, line(bend[-1], end)[1:]]), before=(1,)),
    )


def crossing(known: bool = True) -> LaneletNetwork:
    """Roads from the west (lanelets 1, 11, 21), the east (2, 12, 22, 6 m further north) and the
    south (3, 13, 23), which cross straight on; from the west 14 turns left onto 23.

    Args:
        known: whether the map has an intersection; then east and west are the main road.
    """
    left = arc((-9, 0), 0.0, 9.0, math.pi / 2)
    lanelets = [
        lane(1, line((-200, 0), (-9, 0)), after=(11, 14)),
        lane(11, line((-9, 0), (15, 0)), before=(1,), after=(21,)),
        lane(21, line((15, 0), (200, 0)), before=(11,)),
        lane(14, left, before=(1,), after=(23,)),
        lane(2, line((200, 6), (15, 6)), after=(12,)),
        lane(12, line((15, 6), (-9, 6)), before=(2,), after=(22,)),
        lane(22, line((-9, 6), (-200, 6)), before=(12,)),
        lane(3, line((0, -200), (0, -9)), after=(13,)),
        lane(13, line((0, -9), (0, 9)), before=(3,), after=(23,)),
        lane(23, line((0, 9), (0, 200)), before=(13, 14)),
    ]
    roads = network(*lanelets)
    if known:
        incomings = [
            IntersectionIncomingElement(101, {1}, set(), {11}, {14}),
            IntersectionIncomingElement(102, {2}, set(), {12}, set()),
            IntersectionIncomingElement(103, {3}, set(), {13}, set()),
        ]
        roads.add_intersection(Intersection(100, incomings))
    return roads


Function = Callable[[float], float]


def moving(x: float, y: float, psi: float, v: float, a: float = 0.0, side: float = 0.0) -> Function:
    """A box as a function of time [s]: along a straight line, with an acceleration [m/s^2] and a
    drift to the left [m/s]."""

    def at(t: float) -> list[float]:
        way = v * t + a * t * t / 2
        px = x + way * math.cos(psi) - side * t * math.sin(psi)
        py = y + way * math.sin(psi) + side * t * math.cos(psi)
        return [px, py, psi, v + a * t, *CAR]

    return at


def seen(
    *others: Function, ego: Sequence[float] | np.ndarray = ASIDE, steps: int = 6,
    kinds: Iterable[str] | None = None, first: int = 1,
) -> Observation:  # fmt: skip
    """What was seen of others over the latest time steps; they are at t = 0 now.

    Their ids are first, first + 1, ...; ``ego`` is a state (x, y, delta, v, psi).
    """
    ids = tuple(range(first, first + len(others)))
    names = tuple(kinds) if kinds is not None else ("car",) * len(ids)
    past = tuple(
        Snapshot(
            40 + k, ids, np.array([at(k * DT) for at in others]).reshape(-1, 6), names
        )
        for k in range(1 - steps, 1)
    )  # fmt: skip
    return Observation(40, np.asarray(ego, float), 0.0, past)
