"""At which level each of the others plays: beliefs, and what is learnt from what they do.

P(k), k in {0, 1, 2}, sums to 1 for every agent. After a step is driven, the level whose predicted
first action is nearest the observed one in the 1-norm,

    k* = argmin_k |a_k - a| + |w_k - w|,        gains:   P(k*) += learning,   then P /= sum P.

a [m/s^2] is the mean acceleration of the first action and w [rad/s] its yaw rate relative to the
lane, both as driven (who stands does not brake, whatever it is told). Where several levels predict
the same, they share the gain in proportion to their beliefs: an observation that tells nothing
changes nothing.

Source: report of the CommonRoad motion planning competition 2024, after Li et al. (ACC 2018).
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from mpcplan.config import GameConfig
from mpcplan.game.player import Player
from mpcplan.trajectory import Array

EQUAL = 1e-9  # 1, distances of actions that differ by less are equal
MIN_STRETCH = 0.2  # 1, smallest 1 - kappa d: nearer a bend's centre yaw rates mean nothing


@dataclass(frozen=True, eq=False)
class Beliefs:
    """What is believed of the others' levels; immutable.

    Attributes:
        prior: (3,) belief in an agent of whom nothing has been observed.
        of_agent: (3,) beliefs by the agents' ids.
    """

    prior: Array
    of_agent: Mapping[int, Array] = field(default_factory=lambda: MappingProxyType({}))

    def of(self, agent: int) -> Array:
        """(3,) belief in levels 0, 1 and 2 of an agent."""
        return self.of_agent.get(agent, self.prior)


def no_beliefs(config: GameConfig) -> Beliefs:
    """The beliefs before anything is observed."""
    prior = np.array(config.prior)
    return Beliefs(prior / prior.sum())


def updated(
    beliefs: Beliefs, predicted: Mapping[int, Array], observed: Mapping[int, Array],
    present: Collection[int], learning: float,
) -> Beliefs:  # fmt: skip
    """The beliefs after a step was driven.

    Args:
        beliefs: before.
        predicted: (3, 2) first actions at all levels, by agent, as they were predicted before the
            step; columns :class:`mpcplan.game.actions.Command`.
        observed: (2,) actions since, by agent; see :func:`observed_command`.
        present: agents that are still there; all others are forgotten.
        learning: gain in belief.
    """
    known = {agent: belief for agent, belief in beliefs.of_agent.items() if agent in present}
    for agent in sorted({*predicted} & {*observed} & {*present}):
        distance = np.abs(predicted[agent] - observed[agent]).sum(axis=1)
        nearest = distance <= distance.min() + EQUAL
        known[agent] = _learnt(beliefs.of(agent), nearest, learning)
    return Beliefs(beliefs.prior, MappingProxyType(known))


def _learnt(belief: Array, nearest: Array, learning: float) -> Array:
    """(3,) belief after the levels ``nearest`` (3,) have shared the gain."""
    share = np.where(nearest, belief, 0.0)
    total = share.sum()
    share = share / total if total > 0 else nearest / nearest.sum()
    gained: Array = belief + learning * share
    return gained / gained.sum()


def observed_command(player: Player, acceleration: float, yaw_rate: float) -> Array:
    """(2,) what a player was seen to do, relative to its lane; columns
    :class:`mpcplan.game.actions.Command`.

    Args:
        player: where it is now.
        acceleration: of the box [m/s^2], for example by :func:`mpcplan.predict.motion.motion`.
        yaw_rate: of the box [rad/s].
    """
    s, d, mu, v = player.place
    kappa = player.way.curvature(float(s))
    along = float(v * np.cos(mu) / max(1 - kappa * d, MIN_STRETCH))
    return np.array([acceleration, yaw_rate - kappa * along])
