"""Who looks on while a planner plans: is shown what a cycle considers, and changes nothing."""

from collections.abc import Sequence
from typing import Protocol

from mpcplan.cycle import Cycle
from mpcplan.plan import Option
from mpcplan.road.road import Road
from mpcplan.seed.lattice import Lattice


class Witness(Protocol):
    """What a planner calls in every cycle."""

    def sampled(self, road: Road, grid: Lattice) -> None:
        """The lattice's candidates along a road; several times in a cycle, or not at all."""

    def chose(
        self, cycle: Cycle, chosen: Option, options: Sequence[Option], refused: Sequence[Option]
    ) -> None:
        """What is driven, what else passed verification (best first), and what did not."""
