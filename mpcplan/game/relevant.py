"""When the game is played, and with whom.

It is played where the ego vehicle's way meets others' ways ahead, at a crossing or where lanes
merge (:mod:`mpcplan.predict.right_of_way`), that have no traffic lights, with those whose most
likely way (:mod:`mpcplan.predict.hypotheses`) leads through such a meeting and who can be there
soon, if the ego vehicle can be, too. Their other hypotheses are left out: a player has one way.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork

from mpcplan.config import GameConfig, PredictConfig
from mpcplan.game.actions import COMMANDS, Command
from mpcplan.game.beliefs import observed_command
from mpcplan.game.decide import Agent, Zone
from mpcplan.game.player import EGO, Player
from mpcplan.game.way import Place, Way
from mpcplan.observation import Box, Observation
from mpcplan.predict.hypotheses import IN_LANE, Hypotheses, hypotheses
from mpcplan.predict.kinds import OFF_LANES
from mpcplan.predict.lane_follow import DISREGARD
from mpcplan.predict.lanes import Lanes
from mpcplan.predict.motion import motion
from mpcplan.predict.paths import BEHIND, SPACING, Paths, profiles
from mpcplan.predict.right_of_way import conflicts
from mpcplan.predict.scene import Scene, scene_of
from mpcplan.predict.yielding import ZONE
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import centres

SOONEST = float(COMMANDS[:, Command.A].max())  # m/s^2, acceleration of who comes as soon as it can


@dataclass(frozen=True)
class Meeting:
    """A place where a way meets a lane.

    Attributes:
        at: arc length [m] on the way.
        own: the lanelet of the way, by its id.
        lane: index of the other lane.
        there: arc length [m] on the other lane.
        lit: whether there are traffic lights.
    """

    at: float
    own: int
    lane: int
    there: float
    lit: bool


@dataclass(frozen=True, eq=False)
class Relevant:
    """With whom the game is played.

    Attributes:
        agents: the others, the nearest in time first; empty: there is no game.
        observed: (2,) what they were seen to do, by id; columns
            :class:`mpcplan.game.actions.Command`.
        reasons: why, in words.
    """

    agents: tuple[Agent, ...]
    observed: Mapping[int, Array]
    reasons: tuple[str, ...]


def ego_player(way: Way, state: Array, target: float) -> Player:
    """The ego vehicle at a rear-axle state (5,), columns :class:`mpcplan.trajectory.State`, with an
    arc length [m] that its centre wants to reach."""
    centre = centres(state[None])[0]
    place = way.place(centre, float(state[State.PSI]), float(state[State.V]))
    return Player(EGO, way, place, CAR.length, CAR.width, target)


class Intersections:
    """The meetings of ways on a map; built once."""

    def __init__(
        self, network: LaneletNetwork, lanes: Lanes, paths: Paths, config: GameConfig,
        predict: PredictConfig, dt: float,
    ) -> None:  # fmt: skip
        """For a map with its lanes and ways, as the prediction knows them."""
        self._lanes, self._paths = lanes, paths
        self._config, self._predict, self._dt = config, predict, dt
        self._conflicts = conflicts(network, lanes)
        lanelets = [network.find_lanelet_by_id(lane.id) for lane in lanes.lanes]
        lights = np.array([bool(lanelet.traffic_lights) for lanelet in lanelets])
        self._lit = [
            bool(lights[i] or lights[[*lane.predecessors]].any())
            for i, lane in enumerate(lanes.lanes)
        ]
        self._edges = _edges(network, lanelets)

    def along(self, way: Way, lanelets: Sequence[int]) -> tuple[Meeting, ...]:
        """The meetings on a way along lanelets, the nearest first; once per way."""
        found = []
        for number in lanelets:
            lane = self._lanes.index[number]
            for conflict in self._conflicts.get(lane, ()):
                known = self._lanes.lanes[lane]
                point = [np.interp(conflict.at, known.s, known.points[:, i]) for i in range(2)]
                place = way.place(np.array(point), 0.0, 0.0)
                lit = self._lit[lane] or self._lit[conflict.other]
                if (
                    abs(place[Place.D]) < IN_LANE
                    and self._lanes.lanes[conflict.other].id not in lanelets
                ):
                    at = float(place[Place.S])
                    found.append(Meeting(at, number, conflict.other, conflict.there, lit))
        return tuple(sorted(found, key=lambda meeting: (meeting.at, meeting.lane)))

    def players(
        self, observation: Observation, ego: Player, meetings: Sequence[Meeting]
    ) -> Relevant:
        """With whom the game is played now; ``meetings`` are those along the ego's way."""
        rear, front = (float(ego.place[Place.S]) + side * ego.length / 2 for side in (-1, 1))
        ahead = [m for m in meetings if m.at + ZONE > rear and m.at - front < self._config.look]
        if not ahead:
            return Relevant((), {}, (f"no ways meet within {self._config.look:g} m",))
        unlit = [meeting for meeting in ahead if not meeting.lit]
        if not unlit:
            return Relevant((), {}, ("where ways meet ahead there are traffic lights",))
        scene, found = self._scene(observation)
        first = found.first(scene.count)
        coming = []
        for vehicle in np.flatnonzero(first[: scene.ego] >= 0):
            one = self._coming(observation, scene, found, int(first[vehicle]), ego, unlit)
            if one is not None:
                coming.append(one)
        coming.sort(key=lambda one: (one[0], one[1].player.id))
        if not coming:
            return Relevant((), {}, (f"nobody comes to {self._name(unlit[0])} soon",))
        kept = coming[: self._config.agents]
        return Relevant(
            tuple(agent for _, agent, _, _ in kept),
            {agent.player.id: command for _, agent, command, _ in kept},
            tuple(why for *_, why in kept),
        )

    def _scene(self, observation: Observation) -> tuple[Scene, Hypotheses]:
        moves = motion(observation.others, self._predict.lane_history, self._dt)
        scene = scene_of(
            observation, moves, self._lanes, self._paths, self._predict.reach, OFF_LANES
        )
        speed = np.abs(scene.boxes[:, Box.V])
        return scene, hypotheses(scene.places, scene.weight, speed, self._paths)

    def _coming(
        self, observation: Observation, scene: Scene, found: Hypotheses, row: int, ego: Player,
        meetings: Sequence[Meeting],
    ) -> tuple[float, Agent, Array, str] | None:  # fmt: skip
        """When [s] somebody can be at its first meeting with the ego vehicle, who it is, what it
        was seen to do, and why in words; None: not soon, or never. ``row`` is its hypothesis."""
        vehicle, path = int(found.vehicle[row]), int(found.path[row])
        box, front = scene.boxes[vehicle], float(found.s[row])
        for meeting in meetings:
            there = float(self._paths.starts[path, meeting.lane]) + meeting.there
            if not there + ZONE > front - box[Box.LENGTH]:  # also where its way does not lead there
                continue
            player = self._player(observation.now.ids[scene.rows[vehicle]], box, path, front)
            zone = Zone((meeting.at - ZONE, meeting.at + ZONE), (there - ZONE, there + ZONE))
            time = _soonest(player, zone.other[0])
            if max(time, _soonest(ego, zone.own[0])) > self._config.window:
                return None
            moved = scene.motion.acceleration[vehicle], scene.motion.yaw_rate[vehicle]
            command = observed_command(player, *(float(value) for value in moved))
            why = f"obstacle {player.id} can be at {self._name(meeting)} in {time:.1f} s"
            return time, Agent(player, zone), command, why
        return None

    def _name(self, meeting: Meeting) -> str:
        other = self._lanes.lanes[meeting.lane].id
        return f"the meeting of lanelets {meeting.own} and {other}"

    def _player(self, number: int, box: Array, path: int, front: float) -> Player:
        """Somebody on its way, with its front at an arc length [m] there."""
        v = abs(float(box[Box.V]))
        way = self._way(path, front, v)
        point = box[[Box.X, Box.Y]]
        place = way.place(point, float(box[Box.PSI]), v, front - box[Box.LENGTH] / 2)
        return Player(number, way, place, float(box[Box.LENGTH]), float(box[Box.WIDTH]), way.end)

    def _way(self, path: int, front: float, v: float) -> Way:
        """A way from a little behind somebody to further than it can come, who drives at v."""
        duration = self._config.actions * self._config.step
        reach = max(self._config.look, v * duration + SOONEST * duration**2 / 2) + BEHIND
        s = np.arange(math.floor(front - BEHIND), front + reach, SPACING)
        points = self._paths.at(np.full(len(s), path), s)
        tangent = np.gradient(points, axis=0)
        known = self._paths.paths[path]
        lane = np.array(known.lanes)[
            np.maximum(np.searchsorted(known.starts, s, side="right") - 1, 0)
        ]
        deceleration = np.array([-COMMANDS[:, Command.A].min()])
        profile = np.repeat(profiles(deceleration, True), len(s))
        cap = self._paths.limits(np.full(len(s), path), profile)(np.maximum(s, 0.0))
        limit = float(np.interp(front, s, cap))
        if v > DISREGARD[0] * limit + DISREGARD[1]:  # who minds no limit is not made to brake
            cap = np.maximum(cap, v)
        heading = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
        return Way(float(s[0]), SPACING, np.column_stack([points, heading, cap, self._edges[lane]]))


def _edges(network: LaneletNetwork, lanelets: Sequence[Lanelet]) -> Array:
    """(m, 4) edges of lane and road of lanelets [m]: to the left and right of the centre line.

    The road is the lane with its neighbours of either direction.
    """
    width = {lanelet.lanelet_id: _width(lanelet) for lanelet in network.lanelets}
    rows = []
    for lanelet in lanelets:
        half = width[lanelet.lanelet_id] / 2
        left, right = (width.get(i, 0.0) for i in (lanelet.adj_left, lanelet.adj_right))
        rows.append((half, -half, half + left, -half - right))
    return np.array(rows)


def _width(lanelet: Lanelet) -> float:
    """The median width of a lanelet [m]."""
    across = np.asarray(lanelet.left_vertices) - np.asarray(lanelet.right_vertices)
    return float(np.median(np.hypot(*across.T)))


def _soonest(player: Player, at: float) -> float:
    """After what time [s] a player's front can come to an arc length [m]; 0: it is there.

    It accelerates as much as players do, to the greatest speed that its way allows until there.
    """
    s, _, _, v = (float(value) for value in player.place)
    way = at - s - player.length / 2
    if way <= 0:
        return 0.0
    top = max(v, float(player.way.cap(np.linspace(s, at)).max()))
    speeding = (top**2 - v**2) / (2 * SOONEST)
    if way <= speeding:
        return (math.sqrt(v**2 + 2 * SOONEST * way) - v) / SOONEST
    return (top - v) / SOONEST + (way - speeding) / top
