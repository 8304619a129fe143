"""The traffic of the competition's folders (2022): SUMO's own, run for a while before step 0.

With SUMO 1.12 it is the organisers' (:mod:`mpcplan.sumo.organisers`). Newer versions drive
differently: SUMO's ego vehicle then stands elsewhere at step 0, and another road user may stand at
the ego's start.
"""

import math

import numpy as np

from mpcplan.errors import StartTakenError, TrafficError
from mpcplan.observation import Box, Snapshot
from mpcplan.predict.recorded import kinds_of, record
from mpcplan.scenario import LoadedScenario, Problem
from mpcplan.sumo.organisers import ORGANISERS_SUMO, Simulation, version
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import centres
from mpcplan.verify.drivability import separation

_AT_START = 0.1  # m, within which SUMO's ego vehicle stands at its start
_HEADING_SPEED = 0.5  # m/s, above which a heading is that of the motion
_HEADING_STEP = 2  # first time step at which it is


class PresimulatedTraffic:
    """SUMO's traffic around the ego vehicle; implements :class:`mpcplan.simulate.Traffic`."""

    def __init__(self, loaded: LoadedScenario, problem: Problem) -> None:
        """Runs SUMO up to the problem's first time step.

        Raises:
            StartTakenError: a road user overlaps the ego vehicle at its start.
            TrafficError: SUMO cannot run the folder.
        """
        assert loaded.folder is not None and loaded.folder.settings is not None  # presimulated
        self._origin, self._settings = loaded.origin, loaded.folder.settings
        self._first = problem.first_step
        self._state = problem.start
        self._standing = _standing(loaded)
        self._users = RoadUsers(_free_id(loaded, problem))
        self._notes: list[str] = []
        self._simulation = Simulation(loaded.folder, self._settings)
        try:
            self._simulation.presimulate(self._settings.presimulation_steps)
            self._note_start()
            self._snapshots = [self._snapshot(self._first)]
            self._check_start()
        except BaseException:
            self.close()
            raise

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the result should know about this traffic, one sentence each."""
        return (*self._notes, *self._simulation.notes)

    def at(self, step: int) -> Snapshot:
        """The others at a time step that has been simulated, in local coordinates."""
        return self._snapshots[step - self._first]

    def advance(self, step: int, state: Array) -> None:
        """Moves the others to the next time step, at which the ego is in ``state``.

        Args:
            step: one more than the last time step simulated.
            state: (5,) of the ego at that step (rear axle, local coordinates).

        Raises:
            TrafficError: another time step, or SUMO cannot go on.
        """
        if step != self._first + len(self._snapshots):
            raise TrafficError(f"time step {step} does not follow the last one simulated")
        self._simulation.step(self._ego(self._state), self._ego(state))
        self._state = state
        self._snapshots.append(self._snapshot(step))

    def close(self) -> None:
        """Ends the simulation."""
        self._simulation.close()

    def _note_start(self) -> None:
        """Notes where SUMO's ego vehicle is not at the start; the first step takes it there, as
        the organisers do."""
        start, there = self._ego(self._state), self._simulation.ego_box()
        off = math.inf if there is None else math.dist(there[: Box.PSI], start[: Box.PSI])
        if off > _AT_START:
            where = "not on the road" if there is None else f"{off:.1f} m from its start"
            self._notes.append(
                f"the traffic is not the one in which the problem was posed: as the drive started, "
                f"the ego vehicle of SUMO {version()} was {where} (the organisers use "
                f"{ORGANISERS_SUMO})"
            )

    def _ego(self, state: Array) -> Array:
        """(6,) box in file coordinates by which SUMO's ego vehicle is placed: the front lies half
        the organisers' length ahead of the centre."""
        x, y = centres(state[None])[0] + self._origin
        length = self._settings.ego_length
        return np.array([x, y, state[State.PSI], state[State.V], length, 0.0])

    def _snapshot(self, step: int) -> Snapshot:
        """All others now."""
        ids, boxes, kinds = self._users.now(step - self._first, self._simulation.users())
        boxes[:, [Box.X, Box.Y]] -= self._origin
        return Snapshot(
            step,
            (*self._standing.ids, *ids),
            np.vstack([self._standing.boxes, boxes]),
            (*self._standing.kinds, *kinds),
        )

    def _check_start(self) -> None:
        """Raises StartTakenError where somebody overlaps the ego vehicle."""
        others = self._snapshots[0]
        if not others.ids:
            return
        gaps = separation(self._state[None], others.boxes[:, None])[:, 0]
        worst = int(np.argmin(gaps))
        if gaps[worst] < 0:
            obstacle, overlap = others.ids[worst], -float(gaps[worst])
            raise StartTakenError(
                f"the start is taken: obstacle {obstacle} overlaps the ego vehicle by "
                f"{overlap:.2f} m at step {self._first} in SUMO {version()}; the organisers' "
                f"version is {ORGANISERS_SUMO}",
                obstacle,
                overlap,
                version(),
            )


class RoadUsers:
    """Ids and headings of the others over time."""

    def __init__(self, first_id: int) -> None:
        self._free = first_id
        self._ids: dict[str, int] = {}
        self._centres: dict[str, tuple[float, float]] = {}

    def now(
        self, step: int, users: list[tuple[str, str, Array]]
    ) -> tuple[tuple[int, ...], Array, tuple[str, ...]]:
        """Ids, boxes (n, 6) and kinds at a time step since the start, the oldest id first.

        The headings are the organisers': above walking pace the direction from the last centre to
        the present front bumper, which is not quite that of the body in lane changes.
        """
        rows = [(self._id(name), self._headed(step, name, box), kind) for name, kind, box in users]
        rows.sort(key=lambda row: row[0])
        boxes = np.array([box for _, box, _ in rows]).reshape(-1, len(Box))
        return tuple(row[0] for row in rows), boxes, tuple(row[2] for row in rows)

    def _id(self, name: str) -> int:
        if name not in self._ids:
            self._ids[name] = self._free
            self._free += 1
        return self._ids[name]

    def _headed(self, step: int, name: str, box: Array) -> Array:
        x, y, psi, v, length, width = box.tolist()  # plain floats are quicker
        front = x + length / 2 * math.cos(psi), y + length / 2 * math.sin(psi)
        if step >= _HEADING_STEP and v > _HEADING_SPEED and name in self._centres:
            last = self._centres[name]
            psi = math.atan2(front[1] - last[1], front[0] - last[0])
            x, y = front[0] - length / 2 * math.cos(psi), front[1] - length / 2 * math.sin(psi)
        self._centres[name] = x, y
        return np.array([x, y, psi, v, length, width])


def _free_id(loaded: LoadedScenario, problem: Problem) -> int:
    """The lowest id above those of the map, of standing obstacles and of the problem."""
    network = loaded.scenario.lanelet_network
    ids = [problem.id]
    ids += [lanelet.lanelet_id for lanelet in network.lanelets]
    ids += [sign.traffic_sign_id for sign in network.traffic_signs]
    ids += [light.traffic_light_id for light in network.traffic_lights]
    for intersection in network.intersections:
        ids.append(intersection.intersection_id)
        ids += [incoming.incoming_id for incoming in intersection.incomings]
    ids += [obstacle.obstacle_id for obstacle in loaded.scenario.static_obstacles]
    return max(ids) + 1


def _standing(loaded: LoadedScenario) -> Snapshot:
    """The scenario's static obstacles."""
    recorded, kinds = record(loaded.scenario), kinds_of(loaded.scenario)
    assert recorded.held is not None  # a record always says who stands
    held = np.flatnonzero(recorded.held)
    ids = tuple(recorded.ids[row] for row in held)
    return Snapshot(0, ids, recorded.boxes[held, 0], tuple(kinds[i] for i in ids))
