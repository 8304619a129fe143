"""What every player does at levels 0, 1 and 2.

    level 0   maximises R with the others held as they are: standing where they are now, whatever
              their speed (so in Li et al. 2018: others are stationary obstacles)
    level k   maximises R with all others on their best sequences at level k - 1

Every player is solved once per level. A player's own rewards do not depend on the level and are
computed once.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mpcplan.config import GameConfig
from mpcplan.game.actions import STRAIGHT, Action, index_of, sequence
from mpcplan.game.player import Player
from mpcplan.game.reward import Meetings, own_rewards, pair_rewards
from mpcplan.game.search import Best, own_of, search, together, without_others
from mpcplan.game.tree import Column, begins, grow, rows_of
from mpcplan.game.way import Pose, Ways
from mpcplan.trajectory import Array

LEVELS = 3  # 0, 1 and 2


class Board:
    """All players with all that they can do.

    Attributes:
        players: the players.
        half: (p, 2) half lengths and widths of their bodies [m].
        trees: of the players.
        own: their own rewards.
    """

    def __init__(self, players: Sequence[Player], config: GameConfig) -> None:
        self.players, self.config = tuple(players), config
        self.half = np.array([(player.length, player.width) for player in players]) / 2
        nodes = int(begins(config.actions + 1)[-1])
        self._states = np.empty((len(Column), len(players), nodes, config.substeps))
        self.trees = tuple(
            grow(player, config, self._states[:, i]) for i, player in enumerate(players)
        )
        self.own = tuple(own_of(own_rewards(tree, config), config.actions) for tree in self.trees)
        self._ways = Ways([player.way for player in players])
        self._layer = np.repeat(np.arange(config.actions), np.diff(begins(config.actions + 1)))

    def poses(self, who: Array, rows: Array) -> Array:
        """(4, n, m) poses of players (n,) during actions, at rows (n,) of their trees."""
        columns = (Column.S, Column.D, Column.COS, Column.SIN)
        at = who * self._states.shape[2] + rows
        flat = self._states.reshape(len(Column), -1, self.config.substeps)
        return self._ways.poses(who, *(flat[column].take(at, axis=0) for column in columns))

    def best(
        self, acting: Sequence[int], meetings: Meetings, likely: Sequence[Array], keep: int = 1
    ) -> list[Best]:
        """The best sequences of acting players.

        Args:
            acting: indices of these players.
            meetings: with the others, a row for each of these players.
            likely: for each of them sequences that may be good.
            keep: how many of the best sequences are wanted.
        """
        if not acting or not meetings.weight.shape[1]:
            return [without_others(self.own[i], keep) for i in acting]
        index = np.array(acting, int)

        def terms(who: Array, rows: Array) -> Array:
            poses = self.poses(index[who], rows)
            return pair_rewards(meetings, who, self._layer[rows], poses, self.config)

        searches = [search(self.own[i], keep, some) for i, some in zip(acting, likely, strict=True)]
        return together(searches, terms)

    def responses(self, acting: Sequence[int], best: Sequence[Best]) -> list["Response"]:
        """What acting players do by their best sequences."""
        if not acting:
            return []
        config, index = self.config, [int(one.index[0]) for one in best]
        rows = rows_of(np.array(index, int), config.actions)
        poses = self.poses(np.repeat(np.array(acting, int), config.actions), rows.ravel())
        return [
            Response(
                index=leaf,
                reward=float(one.reward[0]),
                actions=sequence(leaf, config.actions),
                command=self.trees[i].first_command(leaf, config.step),
                path=self.trees[i].path(leaf),
                poses=moves,
            )
            for i, leaf, one, moves in zip(
                acting, index, best, np.split(poses, len(index), axis=1), strict=True
            )
        ]


@dataclass(frozen=True, eq=False)
class Response:
    """A player's best sequence at a level.

    Attributes:
        index: of the sequence in Gamma.
        reward: of the sequence.
        actions: the sequence.
        command: (2,) what can be observed of the first action, the mean acceleration and yaw rate
            relative to the lane; columns :class:`mpcplan.game.actions.Command`.
        path: (T m, 4) states at all instants; columns :class:`mpcplan.game.way.Place`.
        poses: (4, T, m) on the map during each action; rows :class:`mpcplan.game.way.Pose`.
    """

    index: int
    reward: float
    actions: tuple[Action, ...]
    command: Array
    path: Array
    poses: Array


@dataclass(frozen=True, eq=False)
class Levels:
    """What all players do at all levels.

    Attributes:
        board: the players.
        responses: for each player those at levels 0, 1 and 2.
        evaluated: actions whose pairwise terms were computed.
        pruned: sequences that were left out by their bound.
    """

    board: Board
    responses: tuple[tuple[Response, ...], ...]
    evaluated: int
    pruned: int


def solve(players: Sequence[Player], config: GameConfig) -> Levels:
    """The best responses of all players at all levels."""
    board = Board(players, config)
    shape = (len(Pose), config.actions, config.substeps)
    stand = [np.broadcast_to(player.pose[:, None, None], shape) for player in players]
    expected = np.stack(stand, axis=1)
    steady = [index_of((action,) * config.actions) for action in list(Action)[STRAIGHT]]
    found: list[list[Response]] = []
    evaluated = pruned = 0
    for level in range(LEVELS):
        # who expects the others to act as at the level before does so itself
        acting = [i for i in range(len(players)) if level < 2 or not _same(found[-1], found[-2], i)]
        likely = [np.array([*steady, *(one[i].index for one in found)]) for i in acting]
        best = board.best(acting, _meetings(board, acting, expected), likely)
        now = dict(enumerate(found[-1])) if found else {}
        now.update(zip(acting, board.responses(acting, best), strict=True))
        evaluated += sum(one.evaluated for one in best)
        pruned += sum(one.pruned for one in best)
        found.append([now[i] for i in range(len(players))])
        expected = np.stack([one.poses for one in found[-1]], axis=1)
    return Levels(board, tuple(zip(*found, strict=True)), evaluated, pruned)


def _same(now: list[Response], before: list[Response], but: int) -> bool:
    """Whether all players but one do the same at two levels."""
    pairs = zip(now, before, strict=True)
    return all(one.index == other.index for i, (one, other) in enumerate(pairs) if i != but)


def _meetings(board: Board, acting: Sequence[int], expected: Array) -> Meetings:
    """Acting players with all others, whose poses (4, p, T, m) are expected."""
    count = len(board.players)
    others = np.array([[j for j in range(count) if j != i] for i in acting], int)
    others = others.reshape(len(acting), count - 1)
    moves = np.ascontiguousarray(expected[:, others].swapaxes(2, 3))
    return Meetings(board.half[[*acting]], moves, board.half[others], np.ones(others.shape))
