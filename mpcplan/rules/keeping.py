"""Whether a rule was kept, in a word."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mpcplan.trajectory import Array

KEPT, REGAINED, NOT_REGAINED, VIOLATED = "kept", "regained", "not regained", "violated"
KEEPING = (KEPT, REGAINED, NOT_REGAINED, VIOLATED)
"""The best first: kept at every time step; violated at the start, but kept from within t_c on;
violated at the start and not so; kept at the start and violated later."""


def keeping(values: "Array", recovery: int) -> str:
    """Which of :data:`KEEPING` (k,) values of a rule's robustness are.

    ``recovery``: time steps in which a rule that is violated at the start is to be kept again.
    """
    bad = values < 0
    if not bad.any():
        return KEPT
    if not bad[0]:
        return VIOLATED
    return NOT_REGAINED if bad[min(recovery, len(bad) - 1) :].any() else REGAINED
