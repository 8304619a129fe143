"""Prediction of traffic that follows lanes and rules, and reacts.

    1. match the others, and the ego vehicle, to lanes    2. hypotheses: ways ahead, with weights
    3. leaders: who is ahead on each way                  4. drive all along their ways (Krauss)
    5. who has to yield then waits: drive again           6. from ways back to boxes

The others expect the ego vehicle to drive on like any other car, and never to give its right of way
away: if it were expected to keep its speed, then once it is slow, nobody would ever be predicted to
wait for it, and it would wait for all. Nothing is used but the observation and the map. Who is far
away, off the lanes or against their direction goes straight on.
"""

from dataclasses import replace

import numpy as np
from commonroad.scenario.lanelet import LaneletNetwork

from mpcplan.config import PredictConfig
from mpcplan.observation import Box, Forecast, Observation
from mpcplan.predict.across import held_up
from mpcplan.predict.behind import followers
from mpcplan.predict.following import STEPS, Movers, drive, kept_headway, refined
from mpcplan.predict.hypotheses import Hypotheses, Leaders, hypotheses, leaders
from mpcplan.predict.kinds import OFF_LANES, standing
from mpcplan.predict.lanes import Lanes
from mpcplan.predict.motion import motion, straight_on
from mpcplan.predict.outlines import others_that_matter, outlines
from mpcplan.predict.paths import FREE, Paths, profiles
from mpcplan.predict.right_of_way import conflicts
from mpcplan.predict.scene import Scene, scene_of
from mpcplan.predict.yielding import Traffic, Yielding
from mpcplan.trajectory import Array

SLOW = 0.1  # m/s, slower stands,
STEADY = 0.05  # m/s^2, where it does not speed up either
DISREGARD = (1.2, 1.0)  # 1, m/s: who drives faster than this times its limit plus this minds none
SIGN_DISREGARD = 1.1  # times the posted speed: if anybody drives faster, signs do not count here
NEAREST = 0.1  # m, gap that is kept at least when standing
FOE = 0.4  # weight from which others yield to a hypothesis


class LaneFollow:
    """Predicts everybody along the lanes; see the module."""

    def __init__(self, network: LaneletNetwork, config: PredictConfig, dt: float) -> None:
        self._config, self._dt = config, dt
        self._lanes = Lanes(network)
        self._paths = Paths(self._lanes, config.lateral_acceleration)
        self._yielding = Yielding(self._paths, conflicts(network, self._lanes))
        self._limit = np.array([lane.limit for lane in self._lanes.lanes])
        self._last: tuple[Observation, Forecast] | None = None

    def __call__(self, observation: Observation) -> Forecast:
        """Forecast over the configured horizon, from the present boxes.

        The rows of the most likely hypotheses come first, in the order of the snapshot. Rows of
        other hypotheses follow, with ids that have occurred, as far as they matter: they end
        sooner. Who follows the ego vehicle in its lane is left out after the first step.
        """
        if self._last is None or self._last[0] is not observation:
            self._last = observation, self._forecast(observation)
        return self._last[1]

    def _forecast(self, observation: Observation) -> Forecast:
        config, now = self._config, observation.now
        steps = round(config.lane_horizon / self._dt)
        moves = motion(observation.others, config.lane_history, self._dt)
        boxes = straight_on(now.boxes, moves, steps, self._dt)
        scene = scene_of(observation, moves, self._lanes, self._paths, config.reach, OFF_LANES)
        speed = np.abs(scene.boxes[:, Box.V])
        found = hypotheses(scene.places, scene.weight, speed, self._paths)
        found = _ego_once(found, scene.ego)
        first = found.first(scene.count)
        ahead = leaders(found, scene.places, scene.weight, self._paths, first)
        s, v = self._driven(scene, found, ahead, steps)
        predicted = outlines(
            scene, found, self._paths, s, v, self._dt, config.offset_fade, config.spread_along
        )[:, : steps + 1]
        known = np.flatnonzero(first[: scene.ego] >= 0)
        boxes[scene.rows[known]] = predicted[first[known]]
        soon = min(round(config.alternative_horizon / self._dt), steps) + 1
        others = others_that_matter(found, first, predicted, config.alternative, soon)
        if config.leave_out_followers:
            behind = followers(scene, found, first, ahead, self._paths)
            boxes[scene.rows[behind], 1:] = np.nan
            others = others[~np.isin(found.vehicle[others], behind)]
        predicted[others, soon:] = np.nan
        names = (now.ids[scene.rows[i]] for i in found.vehicle[others])
        rows = np.concatenate([boxes, predicted[others]])
        held = np.concatenate([standing(now), np.zeros(len(others), bool)])
        return Forecast(observation.step, (*now.ids, *names), rows, held)

    def _driven(
        self, scene: Scene, found: Hypotheses, ahead: Leaders, steps: int
    ) -> tuple[Array, Array]:
        """(k + 1, h) arc lengths and speeds at the forecast's time steps."""
        step, of = STEPS * self._dt, found.vehicle
        movers = self._movers(scene, found, ahead, -(-steps // STEPS))
        s, v = drive(self._paths, movers, step)
        usual = scene.drivers.usual[of]
        traffic = Traffic(
            found, np.flatnonzero(found.weight >= FOE), s, step, movers.v,
            scene.boxes[of, Box.LENGTH], movers.deceleration, usual,
        )  # fmt: skip
        stop, release = self._yielding.stops(traffic, np.flatnonzero(of != scene.ego))
        for ego in np.flatnonzero(of == scene.ego):
            before, until = held_up(scene, found, self._paths, s[:, ego], step)
            stop, release = np.minimum(stop, before), np.maximum(release, until)
        waits = np.isfinite(stop)
        stays = self._stand(scene, found) & (movers.leader == len(of)) & ~waits
        if waits.any() or stays.any():
            t = step * np.arange(len(movers.acceleration))[:, None]
            goes = np.where(waits & (t >= release), usual, movers.acceleration)
            goes[:, stays] = 0.0
            movers = replace(movers, stop=stop, release=release, acceleration=goes)
            s, v = drive(self._paths, movers, step)
        return refined(s, v, step)

    def _movers(self, scene: Scene, found: Hypotheses, ahead: Leaders, count: int) -> Movers:
        """How everybody drives who need not yield."""
        of, known = found.vehicle, scene.drivers
        v, length = np.abs(scene.boxes[of, Box.V]), scene.boxes[:, Box.LENGTH]
        b, none = known.deceleration[of], len(of)
        led = ahead.row < none
        leader = np.where(led, ahead.row, 0)
        by = of[leader]
        free = ahead.at - length[by] - found.s
        gap = np.clip(free - NEAREST, NEAREST, known.gap[of])
        headway = np.where(led, kept_headway(v, v[leader], free - gap, b), 0.0)
        return Movers(
            path=found.path,
            s=found.s,
            v=v,
            acceleration=self._accelerations(scene, found, count),
            deceleration=b,
            headway=headway,
            speed=np.maximum(known.speed[of], v),
            profile=self._profiles(scene, found, v),
            leader=np.where(led, leader, none),
            offset=np.where(led, ahead.at - found.s[leader] - length[by] - gap, 0.0),
            until=np.where(led, ahead.until + length[by], np.inf),
            stop=np.full(none, np.inf),
            release=np.zeros(none),
        )

    def _accelerations(self, scene: Scene, found: Hypotheses, count: int) -> Array:
        """(count, h) of who is not held back [m/s^2]: from the observed to the usual one."""
        of = found.vehicle
        usual = scene.drivers.usual[of]
        seen = np.where(of == scene.ego, usual, scene.motion.acceleration[of])
        t = STEPS * self._dt * np.arange(count)[:, None]
        later = usual + (seen - usual) * np.exp(-t / self._config.acceleration_fade)
        return np.minimum(later, scene.drivers.acceleration[of])

    def _stand(self, scene: Scene, found: Hypotheses) -> Array:
        """(h,) who stands. If he does so for no visible reason he stays, but for the ego vehicle,
        which is expected to go."""
        of = found.vehicle
        still = np.abs(scene.boxes[of, Box.V]) < SLOW
        still &= np.abs(scene.motion.acceleration[of]) < STEADY
        return still & (of != scene.ego)

    def _profiles(self, scene: Scene, found: Hypotheses, v: Array) -> Array:
        """(h,) which limits each hypothesis minds."""
        places = scene.places
        speed = np.abs(scene.boxes[places.vehicle, Box.V])
        others = places.vehicle != scene.ego
        signs = not (others & (speed > SIGN_DISREGARD * self._limit[places.lane])).any()
        chosen = profiles(scene.drivers.deceleration[found.vehicle], signs)
        limit = self._paths.limits(found.path, chosen)(found.s)
        return np.where(v > DISREGARD[0] * limit + DISREGARD[1], FREE, chosen)


def _ego_once(found: Hypotheses, ego: int) -> Hypotheses:
    """Without other hypotheses than the most likely one of the ego vehicle."""
    first = found.first(ego + 1)[ego]
    kept = np.flatnonzero((found.vehicle != ego) | (np.arange(len(found.vehicle)) == first))
    return Hypotheses(*(values[kept] for values in vars(found).values()))
