"""Traffic that starts as recorded and is then driven by SUMO.

Every obstacle comes in exactly where its record begins, at the time step at which it begins, with
its shape, its speed and a route (:mod:`mpcplan.sumo.trips`); one step later SUMO drives it. What no
lane leads (parked beside the road, pedestrians, driving across or against a lane) is played back as
recorded, and static obstacles stand; SUMO's cars see both where they are in the way.

SUMO alone is not enough. The nets are mended first (:mod:`mpcplan.sumo.net_copy`), vehicles get
used to SUMO's way of driving (:mod:`mpcplan.sumo.settling`), yield where SUMO's net does not tell
them to (:mod:`mpcplan.sumo.courtesy`), and do not leap (:mod:`mpcplan.sumo.shown`).
"""

import tempfile
from pathlib import Path

import numpy as np
import shapely.affinity

from mpcplan.errors import TrafficError
from mpcplan.observation import Box, Snapshot
from mpcplan.scenario import LoadedScenario, Problem
from mpcplan.sumo.courtesy import Courtesy
from mpcplan.sumo.ego import EGO, EgoVehicle
from mpcplan.sumo.lanes import LaneGraph
from mpcplan.sumo.net_copy import write_mended
from mpcplan.sumo.participants import Participants
from mpcplan.sumo.records import records
from mpcplan.sumo.session import Options, Session, Vehicles
from mpcplan.sumo.trips import hints
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import FORD_ESCORT, centres

SEED = 1  # of SUMO's random numbers (imperfect driving)
LANE_CHANGE = 4.0  # s, duration of a lane change where the folder sets none


class InsertedTraffic:
    """SUMO's traffic from a recorded start (a :class:`mpcplan.simulate.traffic.Traffic`)."""

    def __init__(self, loaded: LoadedScenario, problem: Problem) -> None:
        """Starts SUMO and brings it to the problem's first time step.

        Raises:
            TrafficError: SUMO refuses the net or cannot go on.
            InputError: a file of the folder is broken.
        """
        assert loaded.folder is not None  # interactive
        self._loaded, self._first = loaded, problem.first_step
        self._snapshots: list[Snapshot] = []
        self._now = Vehicles((), np.empty((0, len(Box))), ())
        with tempfile.TemporaryDirectory(prefix="mpcplan-") as folder:
            net, network = Path(folder, "net.xml"), loaded.scenario.lanelet_network
            write_mended(loaded.folder.net, network, loaded.origin, net)
            self._session = Session(_options(net, loaded))
        try:
            self._begin(problem)
        except BaseException:
            self.close()
            raise

    def _begin(self, problem: Problem) -> None:
        loaded, folder = self._loaded, self._loaded.folder
        assert folder is not None
        graph = LaneGraph()
        self._courtesy = Courtesy(graph, loaded.dt)
        found, routes = records(loaded, self._first), hints(folder.routes)
        self._others = Participants(found, graph, routes, self._first, loaded.dt)
        goals = _goal_lanes(graph, problem, loaded.origin)
        self._ego_now = self._ego_box(problem.start)
        self._ego = EgoVehicle(self._session, graph, self._ego_now, goals)
        self._advance(self._first, problem.start)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the result should know about this traffic, one sentence each."""
        return self._others.notes

    def at(self, step: int) -> Snapshot:
        """The others at a time step that has been simulated."""
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
        self._advance(step, state)

    def close(self) -> None:
        """Ends the simulation."""
        self._session.close()

    def log(self) -> dict[str, dict[str, object]]:
        """What was done with every obstacle, for debugging, by SUMO's id."""
        return self._others.log()

    def _advance(self, step: int, state: Array) -> None:
        """One step: whoever is not driven by SUMO is put where it is to be at its end."""
        if self._snapshots:
            self._tell(step - 1)
        self._ego_now = self._ego_box(state)
        self._ego.place(self._ego_now)
        self._others.place(self._session, step)
        entering = self._others.enter(self._session, step, self._now, self._ego_now)
        self._session.step()
        self._ego.placed()
        for driven in entering:
            driven.release(step)
        self._now = self._session.vehicles(but=EGO)
        self._snapshots.append(self._snapshot(step))

    def _tell(self, step: int) -> None:
        """Before a simulation step, given the time step that SUMO stands at: what SUMO's cars are
        told."""
        on_road = self._others.on_road(self._now)
        for driven in on_road:
            driven.settle(self._loaded.dt)
        routes = {driven.name: driven.lanes for driven in on_road} | {EGO: self._ego.lanes}
        bodies = [(self._ego_now, self._ego.lane), *self._others.bodies(step)]
        self._courtesy.step(routes, EGO, bodies)

    def _snapshot(self, step: int) -> Snapshot:
        """All others now, by id, in local coordinates."""
        found = sorted(self._others.boxes(step, self._now), key=lambda item: item[0].id)
        boxes = np.array([box for _, box in found]).reshape(-1, len(Box))
        boxes[:, [Box.X, Box.Y]] -= self._loaded.origin
        ids = tuple(known.id for known, _ in found)
        return Snapshot(step, ids, boxes, tuple(known.kind for known, _ in found))

    def _ego_box(self, state: Array) -> Array:
        """(6,) of the ego vehicle, file coordinates."""
        x, y = centres(state[None])[0] + self._loaded.origin
        car = FORD_ESCORT
        return np.array([x, y, state[State.PSI], state[State.V], car.length, car.width])


def _options(net: Path, loaded: LoadedScenario) -> Options:
    """SUMO's options: those of the folder that concern lane changes, else ours."""
    assert loaded.folder is not None
    given = dict(loaded.folder.options)
    return Options(
        net=net,
        dt=loaded.dt,
        seed=SEED,
        lateral_resolution=float(given.get("lateral-resolution", 0.0)),
        lanechange_duration=float(given.get("lanechange.duration", LANE_CHANGE)),
    )


def _goal_lanes(graph: LaneGraph, problem: Problem, origin: Array) -> frozenset[str]:
    """The lanes at the goal's position, none where no position is asked for."""
    lanes: set[str] = set()
    for state in problem.planning_problem.goal.state_list:
        if state.has_value("position"):
            for part in getattr(state.position, "shapes", [state.position]):
                area = shapely.affinity.translate(part.shapely_object, *origin)
                lanes.update(graph.within(area))
    return frozenset(lanes)
