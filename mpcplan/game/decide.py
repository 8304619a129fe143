"""The ego vehicle's decision against others of unknown levels.

    R_P(gamma) = sum over k of P(k) R(gamma | others at level k)

With several others, each with its own belief P_i, the pairwise terms of R are weighed one by one:

    R_P(gamma) = own(gamma) + sum over i, k of P_i(k) (w1 c + w2 s)(gamma, i at level k)

The ego vehicle takes the gamma of the greatest R_P, and of several the one computed last. Who goes
first where two ways meet follows from who is there first: by that gamma on one side, on the other
by what the other one does at the level that is believed most, both going on at their last speed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from mpcplan.config import GameConfig
from mpcplan.game.actions import Action, sequence
from mpcplan.game.beliefs import Beliefs
from mpcplan.game.levels import LEVELS, Levels, Response, solve
from mpcplan.game.player import Player
from mpcplan.game.reward import Meetings
from mpcplan.game.search import Best
from mpcplan.game.way import Place, Pose
from mpcplan.trajectory import Array

CREEPING = 0.1  # m/s, who is slower at the end does not come any further


class Order(Enum):
    """Who goes first, as the ego vehicle sees it."""

    GO = "go"
    YIELD = "yield"
    NONE = "none"


@dataclass(frozen=True)
class Zone:
    """Where two ways meet: arc lengths [m] of its begin and end on the ego vehicle's way and on the
    other one's."""

    own: tuple[float, float]
    other: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Agent:
    """Another player and where its way meets the ego vehicle's; None: nowhere."""

    player: Player
    zone: Zone | None


@dataclass(frozen=True, eq=False)
class Decision:
    """What the ego vehicle does, and why.

    Attributes:
        actions: the sequence of actions.
        times: (T m + 1,) instants [s] of the path, from now on.
        path: (T m + 1, 4) states of the body's centre in the frame of the ego vehicle's way, the
            present one first; columns :class:`mpcplan.game.way.Place`.
        reward: R_P of the sequence.
        best: the best sequences with their R_P, best first.
        responses: by player (the ego vehicle's id is :data:`mpcplan.game.player.EGO`), what it does
            at levels 0, 1 and 2.
        beliefs: (3,) by agent.
        orders: who goes first, by agent.
        evaluated: actions whose pairwise terms were computed.
        pruned: sequences that were left out by their bound, of all searches.
    """

    actions: tuple[Action, ...]
    times: Array
    path: Array
    reward: float
    best: tuple[tuple[tuple[Action, ...], float], ...]
    responses: Mapping[int, tuple[Response, ...]]
    beliefs: Mapping[int, Array]
    orders: Mapping[int, Order]
    evaluated: int
    pruned: int

    @property
    def predicted(self) -> dict[int, Array]:
        """(3, 2) first actions at levels 0, 1 and 2, by player: what beliefs are updated with."""
        return {
            number: np.stack([one.command for one in found])
            for number, found in self.responses.items()
        }

    def as_dict(self) -> dict[str, object]:
        """For the trace."""
        return {
            "actions": [action.name.lower() for action in self.actions],
            "reward": self.reward,
            "best": [
                {"actions": [action.name.lower() for action in actions], "reward": reward}
                for actions, reward in self.best
            ],
            "beliefs": {number: belief.tolist() for number, belief in self.beliefs.items()},
            "responses": {
                number: [[action.name.lower() for action in one.actions] for one in found]
                for number, found in self.responses.items()
            },
            "orders": {number: order.value for number, order in self.orders.items()},
            "evaluated": self.evaluated,
            "pruned": self.pruned,
        }


def decide(ego: Player, agents: Sequence[Agent], beliefs: Beliefs, config: GameConfig) -> Decision:
    """The ego vehicle's decision; it does not depend on the order of the agents."""
    known = sorted(agents, key=lambda agent: agent.player.id)
    levels = solve([ego, *(agent.player for agent in known)], config)
    believed = [beliefs.of(agent.player.id) for agent in known]
    best = _best(levels, believed, config)
    chosen = levels.board.responses([0], [best])[0]
    players = zip([ego, *(agent.player for agent in known)], levels.responses, strict=True)
    orders = {}
    for agent, belief, found in zip(known, believed, levels.responses[1:], strict=True):
        # of equal beliefs in the higher level: it is the more careful one
        level = LEVELS - 1 - int(belief[::-1].argmax())
        orders[agent.player.id] = _order(ego, chosen.path, agent, found[level].path, config)
    return Decision(
        actions=chosen.actions,
        times=config.step / config.substeps * np.arange(len(chosen.path) + 1),
        path=np.vstack([ego.place, chosen.path]),
        reward=chosen.reward,
        best=tuple(
            (sequence(int(index), config.actions), float(reward))
            for index, reward in zip(best.index, best.reward, strict=True)
        ),
        responses={player.id: found for player, found in players},
        beliefs={agent.player.id: p for agent, p in zip(known, believed, strict=True)},
        orders=orders,
        evaluated=levels.evaluated + best.evaluated,
        pruned=levels.pruned + best.pruned,
    )


def _best(levels: Levels, believed: Sequence[Array], config: GameConfig) -> Best:
    """The ego vehicle's best sequences by R_P: every agent is met once per level."""
    board, others = levels.board, levels.responses[1:]
    nobody = np.empty((len(Pose), config.actions, 0, config.substeps))
    poses = [one.poses[:, :, None] for found in others for one in found]
    meetings = Meetings(
        half=board.half[:1],
        others=np.concatenate([nobody, *poses], axis=2)[:, None],
        extents=np.repeat(board.half[1:], LEVELS, axis=0)[None],
        weight=np.array([p for belief in believed for p in belief])[None],
    )
    likely = np.array([one.index for one in levels.responses[0]])
    return board.best([0], meetings, [likely], config.told)[0]


def _order(ego: Player, own: Array, agent: Agent, other: Array, config: GameConfig) -> Order:
    """Who is first where the ways meet, for paths (T m, 4) of both; NONE where not both come."""
    if agent.zone is None:
        return Order.NONE
    player, zone, dt = agent.player, agent.zone, config.step / config.substeps
    left = float(player.place[Place.S]) - player.length / 2 > zone.other[1]
    if left or float(ego.place[Place.S]) - ego.length / 2 > zone.own[1]:
        return Order.NONE
    mine = _arrival(ego, own, zone.own[0], dt)
    theirs = _arrival(player, other, zone.other[0], dt)
    if not np.isfinite(min(mine, theirs)):
        return Order.NONE
    return Order.GO if mine < theirs else Order.YIELD


def _arrival(player: Player, path: Array, at: float, dt: float) -> float:
    """When [s] a player's front comes to an arc length [m] on its path (n, 4) and further on at
    its last speed; 0: it is there, infinity: never."""
    front = np.concatenate([[player.place[Place.S]], path[:, Place.S]]) + player.length / 2
    reached = np.flatnonzero(front >= at)
    if len(reached):
        k = int(reached[0])
        if k == 0:
            return 0.0
        return dt * (k - float(front[k] - at) / float(front[k] - front[k - 1]))
    v = float(path[-1, Place.V] * np.cos(path[-1, Place.MU]))
    return dt * len(path) + float(at - front[-1]) / v if v > CREEPING else np.inf
