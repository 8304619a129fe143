"""Prediction of traffic that follows lanes and rules and reacts: DESIGN's prediction (b).

1. Match the others, and the ego vehicle, to lanes.        2. Hypotheses: ways ahead, with weights.
3. Leaders: who is ahead on each way.                      4. Drive all along their ways (Krauss).
5. Who has to yield then waits: drive again.               6. Back from ways to boxes.

The ego vehicle is expected to keep its speed. Only the observation is used, and the map.
"""

from dataclasses import dataclass, replace

import numpy as np
from commonroad.scenario.lanelet import LaneletNetwork

from mpcplan.config import PredictConfig
from mpcplan.observation import Box, Forecast, Observation
from mpcplan.predict.following import STEPS, Movers, drive, kept_headway, refined
from mpcplan.predict.hypotheses import Hypotheses, Leaders, hypotheses, leaders, place_weights
from mpcplan.predict.kinds import OFF_LANES, Drivers, drivers
from mpcplan.predict.lanes import Lanes, Places
from mpcplan.predict.motion import Motion, motion, straight_on
from mpcplan.predict.paths import FREE, Paths, profiles
from mpcplan.predict.right_of_way import Rule, conflicts
from mpcplan.predict.yielding import Road, Yielding
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import FORD_ESCORT, centres

SLOW = 0.1  # m/s, slower stands,
STEADY = 0.05  # m/s^2, where it does not speed up either
DISREGARD = (1.2, 1.0)  # 1, m/s: who drives faster than this times its limit plus this minds none
SIGN_DISREGARD = 1.3  # times the posted speed: if anybody drives faster, signs do not count here
NEAREST = 0.1  # m, gap that is kept at least when standing
TURNING = 0.5  # s, time constant by which headings come to those of the ways
DIFFERENT = 1.0  # m, by which another hypothesis must differ to matter
OWN_LANE = 1.5  # m, from a lane's centre, within which the ego vehicle drives on it


@dataclass(frozen=True, eq=False)
class _Scene:
    """Those who are predicted along lanes, the ego vehicle last (arrays by vehicle).

    Attributes:
        rows: their rows in the snapshot, without the ego vehicle.
        boxes: (n, 6) of them.
        motion: of them.
        drivers: of them.
        places: on lanes.
        weight: of the places.
    """

    rows: Array
    boxes: Array
    motion: Motion
    drivers: Drivers
    places: Places
    weight: Array

    @property
    def ego(self) -> int:
        """Index of the ego vehicle."""
        return len(self.rows)


class LaneFollow:
    """Predicts everybody along the lanes; see the module."""

    def __init__(self, network: LaneletNetwork, config: PredictConfig, dt: float) -> None:
        self._config, self._dt = config, dt
        self._lanes = Lanes(network)
        meetings = conflicts(network, self._lanes)
        yielding = [
            lane for lane, some in meetings.items() if any(c.rule is Rule.YIELD for c in some)
        ]
        self._paths = Paths(self._lanes, yielding, config.lateral_acceleration)
        self._yielding = Yielding(self._paths, meetings)
        self._limit = np.array([lane.limit for lane in self._lanes.lanes])
        self._last: tuple[Observation, Forecast] | None = None

    def __call__(self, observation: Observation) -> Forecast:
        """Forecast over the configured horizon, from the present boxes.

        The rows of the most likely hypotheses come first, in the order of the snapshot; rows of
        other hypotheses follow, with the same ids, as far as they matter.
        """
        if self._last is None or self._last[0] is not observation:
            self._last = observation, self._forecast(observation)
        return self._last[1]

    def _forecast(self, observation: Observation) -> Forecast:
        now, steps = observation.now, round(self._config.lane_horizon / self._dt)
        moves = motion(observation.others, self._config.lane_history, self._dt)
        boxes = straight_on(now.boxes, moves, steps, self._dt)
        scene = self._scene(observation, moves)
        found = hypotheses(scene.places, scene.weight, np.abs(scene.boxes[:, Box.V]), self._paths)
        found = _ego_once(found, scene.ego)
        first = found.first(scene.ego + 1)
        ahead = leaders(found, scene.places, scene.weight, self._paths, scene.ego + 1)
        s, v = self._driven(scene, found, first, ahead, steps)
        predicted = self._boxes(scene, found, s, v)[:, : steps + 1]
        known = np.flatnonzero(first[: scene.ego] >= 0)
        boxes[scene.rows[known]] = predicted[first[known]]
        ids, extra = self._alternatives(scene, found, first, predicted)
        if self._config.leave_out_followers:
            behind = self._followers(scene, found, first, ahead)
            boxes[scene.rows[behind], 1:] = np.nan
            kept = ~np.isin(ids, behind)
            ids, extra = ids[kept], extra[kept]
        names = tuple(now.ids[scene.rows[i]] for i in ids)
        return Forecast(observation.step, (*now.ids, *names), np.concatenate([boxes, extra]))

    # -- who is where ---------------------------------------------------------------------------

    def _scene(self, observation: Observation, moves: Motion) -> _Scene:
        now = observation.now
        ego = _ego_box(observation.state)
        kinds = now.kinds or ("unknown",) * len(now.ids)
        offset = now.boxes[:, [Box.X, Box.Y]] - ego[[Box.X, Box.Y]]
        near = np.hypot(*offset.T) < self._config.reach
        near &= np.array([kind not in OFF_LANES for kind in kinds], bool)
        rows = np.flatnonzero(near)
        boxes = np.vstack([now.boxes[rows], ego])
        v, psi = ego[Box.V], ego[Box.PSI]
        own = Motion(
            np.append(moves.acceleration[rows], 0.0),
            np.append(moves.yaw_rate[rows], 0.0),
            np.vstack([moves.velocity[rows], [v * np.cos(psi), v * np.sin(psi)]]),
            np.append(moves.known[rows], 1),
        )
        along = np.column_stack([np.cos(boxes[:, Box.PSI]), np.sin(boxes[:, Box.PSI])])
        fronts = boxes[:, [Box.X, Box.Y]] + boxes[:, Box.LENGTH, None] / 2 * along
        places = self._lanes.match(fronts, boxes[:, Box.PSI])
        weight = place_weights(places, own.velocity, self._paths, len(boxes))
        return _Scene(rows, boxes, own, drivers([*(kinds[i] for i in rows), "car"]), places, weight)

    # -- how they drive -------------------------------------------------------------------------

    def _driven(
        self, scene: _Scene, found: Hypotheses, first: Array, ahead: Leaders, steps: int
    ) -> tuple[Array, Array]:
        """(k + 1, h) arc lengths and speeds at the forecast's time steps."""
        step = STEPS * self._dt
        movers = self._movers(scene, found, ahead, -(-steps // STEPS))
        s, v = drive(self._paths, movers, step)
        of = found.vehicle
        road = Road(
            found, first[first >= 0], s, step, movers.v, scene.boxes[of, Box.LENGTH],
            movers.deceleration, scene.drivers.usual[of],
        )  # fmt: skip
        stop, release = self._yielding.stops(road, np.flatnonzero(of != scene.ego))
        if np.isfinite(stop).any():
            t = step * np.arange(len(movers.acceleration))[:, None]
            released = np.isfinite(stop) & (t >= release)
            acceleration = np.where(released, scene.drivers.usual[of], movers.acceleration)
            s, v = drive(
                self._paths,
                replace(movers, stop=stop, release=release, acceleration=acceleration),
                step,
            )
        return refined(s, v, step)

    def _movers(self, scene: _Scene, found: Hypotheses, ahead: Leaders, count: int) -> Movers:
        of, drive_as = found.vehicle, scene.drivers
        v = np.abs(scene.boxes[of, Box.V])
        length, b = scene.boxes[:, Box.LENGTH], drive_as.deceleration[of]
        led = ahead.row < len(of)
        leader = np.where(led, ahead.row, 0)
        by = of[leader] if len(of) else leader
        free = ahead.at - length[by] - found.s
        gap = np.where(led, np.clip(free - NEAREST, NEAREST, drive_as.gap[of]), 0.0)
        headway = np.where(led, kept_headway(v, v[leader], free - gap, b), 1.0)
        own = of == scene.ego
        return Movers(
            path=found.path,
            s=found.s,
            v=v,
            acceleration=self._accelerations(scene, found, led, v, count),
            deceleration=b,
            headway=headway,
            speed=np.where(own, np.inf, np.maximum(drive_as.speed[of], v)),
            profile=np.where(own, FREE, self._profiles(scene, found, v)),
            leader=np.where(own, len(of), ahead.row),
            offset=np.where(led, ahead.at - found.s[leader] - length[by] - gap, 0.0),
            until=ahead.until + length[by],
            stop=np.full(len(of), np.inf),
            release=np.zeros(len(of)),
        )

    def _accelerations(
        self, scene: _Scene, found: Hypotheses, led: Array, v: Array, count: int
    ) -> Array:
        """(count, h) of who is not held back: from the observed to the usual one; who stands for
        no visible reason stays, the ego vehicle keeps its speed."""
        of = found.vehicle
        seen, usual = scene.motion.acceleration[of], scene.drivers.usual[of]
        fade = np.where(seen < 0, self._config.braking_fade, self._config.acceleration_fade)
        t = STEPS * self._dt * np.arange(count)[:, None]
        later = usual + (seen - usual) * np.exp(-t / fade)
        stays = (v < SLOW) & (np.abs(seen) < STEADY) & ~led
        stays |= of == scene.ego
        return np.where(stays, 0.0, np.minimum(later, scene.drivers.acceleration[of]))

    def _profiles(self, scene: _Scene, found: Hypotheses, v: Array) -> Array:
        """Which limits each hypothesis minds."""
        at, speed = scene.places.lane, np.abs(scene.boxes[scene.places.vehicle, Box.V])
        signs = not (speed > SIGN_DISREGARD * self._limit[at]).any()
        chosen = profiles(scene.drivers.deceleration[found.vehicle], np.full(len(v), signs))
        limit = self._paths.limits(found.path, chosen)(found.s)
        return np.where(v > DISREGARD[0] * limit + DISREGARD[1], FREE, chosen)

    # -- back to boxes ----------------------------------------------------------------------------

    def _boxes(self, scene: _Scene, found: Hypotheses, s: Array, v: Array) -> Array:
        """(h, k + 1, 6) boxes: both bumpers' middles on the way, but for the present offset."""
        now = scene.boxes[found.vehicle]
        length = now[:, Box.LENGTH, None]
        front = self._paths.at(found.path[:, None], s.T)
        rear = self._paths.at(found.path[:, None], s.T - length)
        axis = front - rear
        psi = np.arctan2(axis[..., 1], axis[..., 0])
        along = np.stack([np.cos(psi), np.sin(psi)], axis=-1)
        across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
        off = now[:, [Box.X, Box.Y]] - (front[:, 0] + rear[:, 0]) / 2
        t = self._dt * np.arange(s.shape[0])
        quick = np.exp(-t / TURNING)
        lag = (off * along[:, 0]).sum(axis=1)[:, None] * quick
        aside = self._aside(scene, found, off, across[:, 0], t)
        turn = now[:, Box.PSI] - psi[:, 0]
        turn = turn - 2 * np.pi * np.round(turn / (2 * np.pi))
        boxes = np.empty((*psi.shape, len(Box)))
        centre = (front + rear) / 2 + aside[..., None] * across + lag[..., None] * along
        boxes[..., [Box.X, Box.Y]] = centre
        boxes[..., Box.PSI] = psi + turn[:, None] * quick
        boxes[..., Box.V] = v.T
        grown = 2 * self._config.spread_along * (s - s[0]).T
        boxes[..., Box.LENGTH] = length + grown
        boxes[..., Box.WIDTH] = now[:, Box.WIDTH, None]
        boxes[:, 0] = now
        return boxes

    def _aside(
        self, scene: _Scene, found: Hypotheses, off: Array, across: Array, t: Array
    ) -> Array:
        """(h, k + 1) offsets [m] to the left of the ways: they fade, and who drifts towards the
        way goes on until it is on it."""
        offset = (off * across).sum(axis=1)
        side = np.sign(offset)
        drift = (scene.motion.velocity[found.vehicle] * across).sum(axis=1)
        towards = np.maximum(-side * drift, 0.0)
        left = np.maximum(np.abs(offset)[:, None] - towards[:, None] * t, 0.0)
        return side[:, None] * left * np.exp(-t / self._config.offset_fade)

    def _alternatives(
        self, scene: _Scene, found: Hypotheses, first: Array, predicted: Array
    ) -> tuple[Array, Array]:
        """Vehicles and boxes of other hypotheses that are likely enough and differ soon enough."""
        count = round(self._config.alternative_horizon / self._dt) + 1
        other = found.weight >= self._config.alternative
        other &= first[found.vehicle] != np.arange(len(other))
        other &= found.vehicle != scene.ego
        rows = np.flatnonzero(other)
        main = predicted[first[found.vehicle[rows]], :count]
        apart = np.hypot(*np.moveaxis((predicted[rows, :count] - main)[..., :2], -1, 0))
        rows = rows[(apart > DIFFERENT).any(axis=1)]
        boxes = predicted[rows].copy()
        boxes[:, count:] = np.nan
        return found.vehicle[rows], boxes

    def _followers(self, scene: _Scene, found: Hypotheses, first: Array, ahead: Leaders) -> Array:
        """Vehicles behind the ego vehicle in its own lane that can stay there, and theirs.

        They react to whatever the ego vehicle does, which a forecast cannot know.
        """
        ego = first[scene.ego]
        if ego < 0:
            return np.empty(0, int)
        places = scene.places
        own = places.lane[(places.vehicle == scene.ego) & (np.abs(places.d) < OWN_LANE)]
        on_lane = np.isfinite(self._paths.starts[found.path][:, own]).any(axis=1)
        length, v = scene.boxes[:, Box.LENGTH], scene.boxes[:, Box.V]
        left_out: list[int] = []
        front, added = {int(ego)}, True
        while added:
            added = False
            for vehicle in range(scene.ego):
                row = int(first[vehicle])
                if row < 0 or vehicle in left_out or int(ahead.row[row]) not in front:
                    continue
                by = int(found.vehicle[ahead.row[row]])
                if by == scene.ego and not on_lane[row]:
                    continue
                gap = ahead.at[row] - length[by] - found.s[row]
                closing = max(v[vehicle] - v[by], 0.0)
                if closing**2 <= 2 * scene.drivers.deceleration[vehicle] * gap:
                    left_out.append(vehicle)
                    front.add(row)
                    added = True
        return np.array(sorted(left_out), int)


def _ego_once(found: Hypotheses, ego: int) -> Hypotheses:
    """Without other hypotheses than the most likely one of the ego vehicle."""
    first = found.first(ego + 1)[ego]
    kept = np.flatnonzero((found.vehicle != ego) | (np.arange(len(found.vehicle)) == first))
    return Hypotheses(*(values[kept] for values in vars(found).values()))


def _ego_box(state: Array) -> Array:
    """(6,) box of the ego vehicle."""
    x, y = centres(state[None])[0]
    car = FORD_ESCORT
    return np.array([x, y, state[State.PSI], state[State.V], car.length, car.width])
