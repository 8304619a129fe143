"""The reward of a sequence of actions.

    R(gamma) = w1 c + w2 s + w3 o + w4 l + w5 d          summed over the actions of gamma, where

    c = -1  the body comes nearer than a margin to another player's body at an instant
    s = -1  its safety zone, the body elongated and widened, overlaps the other one's at an instant
    o = -1  the body is off the road at an instant
    l = -1  the body is out of its lane at an instant, or turned against its direction
    d = -   the distance [m] along the way from the action's end to the target, 0 beyond it

c and s count once for every other player: R is a sum of a player's own terms (o, l, d), which
depend on nobody, and of pairwise terms (c, s). No term is positive, so that what is known of a sum
bounds it from above.

Sources: report of the CommonRoad motion planning competition 2024; Li, Kolmanovsky, Girard, Yildiz
(ACC 2018), whose weights are likewise ordered: collision, then safety zone and road, then lane,
then distance.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mpcplan.config import GameConfig
from mpcplan.game.tree import Tree
from mpcplan.game.way import Pose
from mpcplan.trajectory import Array


@dataclass(frozen=True, eq=False)
class Meetings:
    """Players, and the others as each of them expects them to move, perhaps in several ways.

    Attributes:
        half: (p, 2) half lengths and widths [m] of the players.
        others: (4, p, T, o, m) poses of the others on the map during each action, rows
            :class:`mpcplan.game.way.Pose`.
        extents: (p, o, 2) half lengths and widths [m] of the others.
        weight: (p, o) how much each of them counts.
    """

    half: Array
    others: Array
    extents: Array
    weight: Array


def own_rewards(tree: Tree, config: GameConfig) -> Array:
    """(N,) the own terms w3 o + w4 l + w5 d of each node's last action."""
    player = tree.player
    half = player.length / 2 * np.abs(tree.sin) + player.width / 2 * np.abs(tree.cos)
    lane_left, lane_right, road_left, road_right = player.way.edges(tree.s)
    left, right = tree.d + half, tree.d - half
    off = ((left > road_left) | (right < road_right)).any(axis=1)
    out = ((left > lane_left) | (right < lane_right) | (tree.cos < 0)).any(axis=1)
    distance = np.maximum(player.target - tree.s[:, -1], 0.0)
    return -(config.off_road * off + config.lane * out + config.distance * distance)


def pair_rewards(
    meetings: Meetings, who: Array, layer: Array, poses: Array, config: GameConfig
) -> Array:
    """(n,) the pairwise terms w1 c + w2 s of single actions.

    Args:
        meetings: the players and the others.
        who: (n,) the acting player, as row of ``meetings``.
        layer: (n,) which of its actions it is, the first one 0.
        poses: (4, n, m) its poses during the action; rows :class:`Pose`.
        config: the game.
    """
    total = np.zeros(len(who))
    _, _, depth, count, instants = meetings.others.shape
    known = meetings.others.reshape(len(Pose), -1, count, instants)
    others = known.take(who * depth + layer, axis=1)
    near = np.flatnonzero(_near(meetings, who, poses, others, config))
    if not len(near):
        return total
    pair, instant = np.divmod(near, instants)
    row, other = np.divmod(pair, count)
    half = meetings.half.T.take(who[row], axis=1)
    extents = meetings.extents.reshape(-1, 2).T.take(who[row] * count + other, axis=1)
    own = poses.reshape(len(Pose), -1).take(row * instants + instant, axis=1)
    seen = _seen(own, others.reshape(len(Pose), -1).take(near, axis=1))
    for (longer, wider), cost in zip(
        _grown(config), (config.collision, config.safe_distance), strict=True
    ):
        hit = _overlap(seen, half[0] + longer, half[1] + wider, extents[0] + longer,
                       extents[1] + wider)  # fmt: skip
        flags = np.zeros((count, len(who)), bool)
        flags[other[hit], row[hit]] = True
        # one of the others after the next, so that sums do not depend on how many rows there are
        for number in np.flatnonzero(flags.any(axis=1)):
            total -= cost * meetings.weight[who, number] * flags[number]
    return total


def _grown(config: GameConfig) -> tuple[tuple[float, float], tuple[float, float]]:
    """How much longer and wider [m] at each end and side every body is for c, and for s."""
    return (config.margin / 2, config.margin / 2), (config.zone_length, config.zone_width)


def _near(meetings: Meetings, who: Array, poses: Array, others: Array, config: GameConfig) -> Array:
    """(n, o, m) where circles around the players and around the others, both grown, overlap; see
    :func:`pair_rewards`."""
    most = np.max(_grown(config), axis=0)
    one, other = meetings.half + most, meetings.extents + most
    reach = np.hypot(*one.T)[:, None] + np.hypot(other[..., 0], other[..., 1])
    dx = others[Pose.X] - poses[Pose.X, :, None]
    dy = others[Pose.Y] - poses[Pose.Y, :, None]
    near: Array = dx * dx + dy * dy < (reach * reach)[who][:, :, None]
    return near


class _Seen(NamedTuple):
    """How pairs of rectangles lie to each other (all (p,)): distances [m] of their centres along
    and across the first and the second one, cosine and sine between them; without their signs."""

    along: Array
    aside: Array
    along_other: Array
    aside_other: Array
    cos: Array
    sin: Array


def _seen(own: Array, other: Array) -> _Seen:
    """For poses (4, p) of the first and the second rectangles."""
    x1, y1, c1, s1 = own
    x2, y2, c2, s2 = other
    dx, dy = x2 - x1, y2 - y1
    return _Seen(
        np.abs(dx * c1 + dy * s1), np.abs(dy * c1 - dx * s1),
        np.abs(dx * c2 + dy * s2), np.abs(dy * c2 - dx * s2),
        np.abs(c1 * c2 + s1 * s2), np.abs(c1 * s2 - s1 * c2),
    )  # fmt: skip


def _overlap(seen: _Seen, length: Array, width: Array, longer: Array, wider: Array) -> Array:
    """(p,) whether rectangles overlap others; the half lengths and widths [m] of the first ones,
    then those of the second ones.

    Separating axes: two rectangles are apart if they are along a side of either.
    """
    cos, sin = seen.cos, seen.sin
    met: Array = seen.along < length + longer * cos + wider * sin
    met &= seen.aside < width + longer * sin + wider * cos
    met &= seen.along_other < longer + length * cos + width * sin
    met &= seen.aside_other < wider + length * sin + width * cos
    return met
