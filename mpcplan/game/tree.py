"""All that a player can do in T actions: a tree of 14 + 14^2 + ... + 14^T states.

In the frame of its way, (s, d, mu, v) move for h seconds under an action (a, w) by

    s' = v cos mu      d' = v sin mu      mu' = w      v' = a

until they stop: nobody reverses, and who stands does not turn. With theta = mu + w t the solution
is

    w = 0:   s += (v t + a t^2 / 2) cos mu                     d += (v t + a t^2 / 2) sin mu
    else:    s += [(v + a t) sin theta / w + a cos theta / w^2] - [the same at t = 0]
             d += [a sin theta / w^2 - (v + a t) cos theta / w] - [the same at t = 0]

Nobody drives faster than its way allows: an acceleration is lowered to (cap - v) / h, with the cap
at the place to which the present speed leads in that time, but not below the hardest braking.

The states after t = 1, ..., T actions are the layers of the tree, in the order of Gamma: node n's
children are 14 n, ..., 14 n + 13 in the next layer. All layers lie in a row in the same arrays.
"""

import itertools
from dataclasses import dataclass
from enum import IntEnum
from functools import cache

import numpy as np

from mpcplan.config import GameConfig
from mpcplan.game.actions import ACTIONS, COMMANDS, STEERING, STRAIGHT, Command
from mpcplan.game.player import Player
from mpcplan.game.way import Place
from mpcplan.trajectory import Array

HARDEST = float(COMMANDS[:, Command.A].min())  # m/s^2
ACCELERATIONS = COMMANDS[:, Command.A, None]
TURNING = COMMANDS[STEERING, Command.YAW_RATE, None]


class Column(IntEnum):
    """The arrays of a tree: those of :class:`mpcplan.game.way.Place`, and cosine and sine of mu."""

    S = 0
    D = 1
    MU = 2
    V = 3
    COS = 4
    SIN = 5


@dataclass(frozen=True, eq=False)
class Tree:
    """What a player can do: all arrays (N, m) over the nodes of all layers and instants of a
    node's last action, its end the last one.

    Attributes:
        player: whose tree it is.
        depth: number of layers, T.
        s, d, mu, v: states; see :class:`mpcplan.game.way.Place`.
        cos, sin: of mu.
    """

    player: Player
    depth: int
    s: Array
    d: Array
    mu: Array
    v: Array
    cos: Array
    sin: Array

    def path(self, leaf: int) -> Array:
        """(T m, 4) states at all instants of a sequence of actions; columns :class:`Place`."""
        nodes = rows_of(np.array([leaf]), self.depth)[0]
        columns = [values[nodes].ravel() for values in (self.s, self.d, self.mu, self.v)]
        return np.column_stack(columns)

    def first_command(self, leaf: int, step: float) -> Array:
        """(2,) mean acceleration and yaw rate over the first of a sequence's actions, which lasts
        ``step`` seconds: what can be observed of it; columns :class:`Command`."""
        node = leaf // ACTIONS ** (self.depth - 1)
        before = self.player.place
        changes = (self.v[node, -1] - before[Place.V], self.mu[node, -1] - before[Place.MU])
        return np.array(changes) / step


@cache
def begins(count: int) -> Array:
    """(count,) rows at which layers begin; read-only."""
    found: Array = np.cumsum(ACTIONS ** np.arange(count)) - 1
    found.flags.writeable = False
    return found


def rows_of(leaves: Array, depth: int) -> Array:
    """(n, T) rows of the nodes on the way to sequences (n,) of T actions."""
    below = ACTIONS ** np.arange(depth)[::-1]
    rows: Array = leaves[:, None] // below + begins(depth)
    return rows


def grow(player: Player, config: GameConfig, found: Array | None = None) -> Tree:
    """All states to which a player's sequences of actions lead.

    ``found`` (6, N, m) is where the tree's arrays shall lie; None: in new memory.
    """
    last = player.place[:, None]
    times = config.step / config.substeps * np.arange(1, config.substeps + 1)
    ends = begins(config.actions + 1)
    if found is None:
        found = np.empty((len(Column), ends[-1], config.substeps))
    for begin, end in itertools.pairwise(ends):
        layer = found[:, begin:end]
        _continue(player, last, times, layer.reshape(len(Column), -1, ACTIONS, config.substeps))
        last = layer[: len(Place), :, -1]
    return Tree(player, config.actions, *found)


def _continue(player: Player, states: Array, times: Array, found: Array) -> None:
    """Fills ``found`` (6, n, 14, m): s, d, mu, v, cos mu and sin mu at instants (m,) [s] of all
    actions from states (4, n); see the module."""
    s, v, step = states[Column.S], states[Column.V], times[-1]
    spare = np.maximum((player.way.cap(s + v * step) - v) / step, HARDEST)[:, None, None]
    s, d, mu, v = states[:, :, None, None]
    cos, sin = np.cos(mu), np.sin(mu)
    a = np.minimum(ACCELERATIONS, spare)
    t = np.minimum(times, _standstill(v, a))
    v1 = found[Column.V]
    np.maximum(v + a * t, 0.0, out=v1)
    straight, turning = found[:, :, STRAIGHT], found[:, :, STEERING]
    way = (v + v1[:, STRAIGHT]) / 2 * t[:, STRAIGHT]
    straight[Column.S], straight[Column.D] = s + way * cos, d + way * sin
    straight[Column.MU], straight[Column.COS], straight[Column.SIN] = mu, cos, sin
    theta = mu + TURNING * t[:, STEERING]
    cos1, sin1, v1, a = np.cos(theta), np.sin(theta), v1[:, STEERING], a[:, STEERING]
    turning[Column.MU], turning[Column.COS], turning[Column.SIN] = theta, cos1, sin1
    turning[Column.S] = s + (v1 * sin1 - v * sin) / TURNING + a / TURNING**2 * (cos1 - cos)
    turning[Column.D] = d + (v * cos - v1 * cos1) / TURNING + a / TURNING**2 * (sin1 - sin)


def _standstill(v: Array, a: Array) -> Array:
    """After what time [s] who drives at v with an acceleration a stands; infinity: never."""
    never = np.where((v > 0) | (a > 0), np.inf, 0.0)
    braking = a < 0
    return np.where(braking, v / np.where(braking, -a, 1.0), never)
