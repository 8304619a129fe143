"""The game over a drive: who plays, what is believed of them, what is decided in each cycle."""

from dataclasses import dataclass, field

from commonroad.scenario.lanelet import LaneletNetwork

from mpcplan.config import Config
from mpcplan.game.beliefs import no_beliefs, updated
from mpcplan.game.decide import Decision, decide
from mpcplan.game.relevant import Intersections, Meeting, ego_player
from mpcplan.game.way import Way, way_of_road
from mpcplan.observation import Observation
from mpcplan.predict.lanes import Lanes
from mpcplan.predict.paths import Paths
from mpcplan.road.road import Road


@dataclass(frozen=True, eq=False)
class Played:
    """One cycle of the game.

    Attributes:
        decision: what is decided; None: there is no game.
        reasons: why with these, or with nobody, in words.
    """

    decision: Decision | None
    reasons: tuple[str, ...]

    def as_dict(self) -> dict[str, object]:
        """For the trace."""
        told: dict[str, object] = {"reasons": list(self.reasons)}
        return told if self.decision is None else told | self.decision.as_dict()


@dataclass
class Match:
    """Plays the game cycle by cycle on the roads of one planning problem.

    Beliefs learn from what the others did since the decision before.
    """

    network: LaneletNetwork
    config: Config
    dt: float
    _known: dict[int, tuple[Road, Way, tuple[Meeting, ...]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        predict, game = self.config.predict, self.config.game
        lanes = Lanes(self.network)
        paths = Paths(lanes, predict.lateral_acceleration)
        self._map = Intersections(self.network, lanes, paths, game, predict, self.dt)
        self._beliefs = no_beliefs(game)
        self._last: Decision | None = None

    def play(self, observation: Observation, road: Road) -> Played:
        """The game of the present cycle on a road."""
        way, meetings = self._on(road)
        goals = [goal.s[0] for goal in road.goals if goal.s is not None]
        ego = ego_player(way, observation.state, min(goals, default=way.end))
        with_whom = self._map.players(observation, ego, meetings)
        if self._last is not None:
            present, learning = observation.now.ids, self.config.game.learning
            self._beliefs = updated(
                self._beliefs, self._last.predicted, with_whom.observed, present, learning
            )
        self._last = None
        if with_whom.agents:
            self._last = decide(ego, with_whom.agents, self._beliefs, self.config.game)
        return Played(self._last, with_whom.reasons)

    def _on(self, road: Road) -> tuple[Way, tuple[Meeting, ...]]:
        """A road as a way, and the meetings with other lanes on it; found once."""
        if id(road) not in self._known:
            way = way_of_road(road)
            self._known[id(road)] = road, way, self._map.along(way, road.route.lanelets)
        return self._known[id(road)][1:]
