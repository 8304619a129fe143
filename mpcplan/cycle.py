"""What one planning cycle works with: the observation, the forecast, and what is computed of it."""

from dataclasses import dataclass

from mpcplan.observation import Forecast, Observation
from mpcplan.plan import Clock
from mpcplan.predict.occupancy import Occupancy, occupancy
from mpcplan.road.road import Road


@dataclass(frozen=True, eq=False)
class Cycle:
    """One planning cycle.

    Attributes:
        observation: what is seen.
        forecast: of the others.
        clock: times per stage.
        notes: what went wrong, in words.
        projected: forecasts and their projections by road; kept while the forecast stays the same.
        certain: time steps after which nobody is taken to be in the way any more; None: never.
        made: the forecast as it was made, where ``forecast`` already counts on a plan; else None.
    """

    observation: Observation
    forecast: Forecast
    clock: Clock
    notes: list[str]
    projected: dict[int, tuple[Forecast, Occupancy]]
    certain: int | None = None
    made: Forecast | None = None

    def around(self, road: Road) -> Occupancy:
        """The forecast along a road."""
        known = self.projected.get(id(road))
        if known is None or known[0] is not self.forecast:
            with self.clock("project"):
                known = self.forecast, occupancy(self.forecast, road.frame)
            self.projected[id(road)] = known
        if self.certain is None:
            return known[1]
        return known[1].until(self.observation.step + self.certain)
