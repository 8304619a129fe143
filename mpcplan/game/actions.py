"""What a player of the game may do: 14 manoeuvres, and all sequences of them.

Gamma is the set of all sequences of T actions, in lexicographic order of the actions' numbers: a
sequence's index is the number whose digits to the base 14 are its actions.

Sources: report of the CommonRoad motion planning competition 2024 (table of actions); N. Li, I.
Kolmanovsky, A. Girard, Y. Yildiz: Game theoretic modeling of vehicle interactions at unsignalized
intersections and application to autonomous vehicle control, ACC 2018.
"""

import math
from enum import IntEnum

import numpy as np

from mpcplan.trajectory import Array


class Command(IntEnum):
    """Columns of commands: acceleration [m/s^2], yaw rate relative to the lane [rad/s]."""

    A = 0
    YAW_RATE = 1


class Action(IntEnum):
    """The manoeuvres."""

    MAINTAIN = 0
    BRAKE_SOFTLY = 1
    BRAKE = 2
    BRAKE_HARD = 3
    ACCELERATE_SOFTLY = 4
    ACCELERATE = 5
    LEFT = 6
    SHARP_LEFT = 7
    RIGHT = 8
    SHARP_RIGHT = 9
    ACCELERATE_LEFT = 10
    ACCELERATE_RIGHT = 11
    BRAKE_LEFT = 12
    BRAKE_RIGHT = 13


ACTIONS = len(Action)
COMMANDS = np.array(
    [
        (0.0, 0.0),
        (-1.5, 0.0),
        (-3.5, 0.0),
        (-5.0, 0.0),
        (1.5, 0.0),
        (2.5, 0.0),
        (0.0, math.pi / 4),
        (0.0, math.pi / 2),
        (0.0, -math.pi / 4),
        (0.0, -math.pi / 2),
        (1.5, math.pi / 4),
        (1.5, -math.pi / 4),
        (-1.5, math.pi / 4),
        (-1.5, -math.pi / 4),
    ]
)
"""(14, 2) what each action commands; columns :class:`Command`."""
STRAIGHT = slice(Action.MAINTAIN, Action.LEFT)
STEERING = slice(Action.LEFT, ACTIONS)


def sequence(index: int, count: int) -> tuple[Action, ...]:
    """The sequence of ``count`` actions at an index of Gamma."""
    return tuple(Action(index // ACTIONS**k % ACTIONS) for k in reversed(range(count)))


def index_of(actions: tuple[Action, ...]) -> int:
    """The index in Gamma of a sequence."""
    index = 0
    for action in actions:
        index = index * ACTIONS + action
    return index


def sequences(count: int) -> Array:
    """(14^count, count) all sequences of actions (Gamma), in order of their index."""
    digits = ACTIONS ** np.arange(count)[::-1]
    found: Array = np.arange(ACTIONS**count)[:, None] // digits % ACTIONS
    return found
