"""Traffic that starts as recorded and is then driven by SUMO.

Every obstacle is put into SUMO exactly where its record begins, at the time step at which it
begins, with its shape, its speed and a route (:mod:`mpcplan.sumo.trips`); one step later SUMO
drives it. What no lane leads (parked beside the road, pedestrians, driving against a lane) is
played back as recorded, and static obstacles stand; SUMO's cars see both where they are in the way.
"""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import shapely
import shapely.affinity

from mpcplan.errors import TrafficError
from mpcplan.observation import Box, Snapshot
from mpcplan.scenario import LoadedScenario, Problem
from mpcplan.sumo.courtesy import Courtesy
from mpcplan.sumo.driven import Driven
from mpcplan.sumo.drivers import driver_of
from mpcplan.sumo.ego import EGO, EgoVehicle
from mpcplan.sumo.lanes import LaneGraph
from mpcplan.sumo.net_copy import write_mended
from mpcplan.sumo.played import Played
from mpcplan.sumo.records import records
from mpcplan.sumo.room import has_room
from mpcplan.sumo.session import Options, Session, Vehicles
from mpcplan.sumo.trips import hints, trip
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import FORD_ESCORT, centres

SEED = 1  # of SUMO's random numbers (imperfect driving)
LANE_CHANGE = 4.0  # s, duration of a lane change where the folder sets none
WAIT_STEPS = 50  # time steps for which an obstacle waits until its place is free
OFF_LANES = ("pedestrian", "train")  # kinds that are always played back


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
        self._last = Vehicles((), np.empty((0, len(Box))), ())
        with tempfile.TemporaryDirectory(prefix="mpcplan-") as folder:
            net = Path(folder, "net.xml")
            self._drawn = write_mended(
                loaded.folder.net, loaded.scenario.lanelet_network, loaded.origin, net
            )
            self._session = Session(_options(net, loaded))
        try:
            self._begin(problem)
        except BaseException:
            self.close()
            raise

    def _begin(self, problem: Problem) -> None:
        folder, origin = self._loaded.folder, self._loaded.origin
        assert folder is not None
        self._graph = LaneGraph()
        self._courtesy = Courtesy(self._graph, self._loaded.dt)
        self._sort(hints(folder.routes))
        goals = _goal_lanes(self._graph, problem, origin)
        start = self._ego_box(problem.start)
        self._ego = EgoVehicle(self._session, self._graph, start, goals)
        self._advance(self._first, problem.start)

    def _sort(self, routes: Mapping[str, tuple[str, ...]]) -> None:
        """Sorts the obstacles into those that SUMO drives and those that are played back."""
        self._driven: list[Driven] = []
        self._played: list[Played] = []
        found = records(self._loaded, self._first)
        end = max((r.last_step for r in found if not r.stands), default=self._first)
        for known in found:
            way = None
            if not known.stands and known.kind not in OFF_LANES:
                vehicle_class = driver_of(known.kind).vehicle_class
                way = trip(self._graph, known.boxes, vehicle_class, routes.get(str(known.id), ()))
            if way is None:
                self._played.append(Played(known, known.last_step == end, self._loaded.dt))
            else:
                self._driven.append(Driven(known, way, self._graph))

    @property
    def _late(self) -> list[int]:
        """Who came in after the time step at which its record begins."""
        driven = [d for d in self._driven if d.entered is not None]
        return [d.record.id for d in driven if d.entered != d.record.first_step]

    @property
    def _left_out(self) -> list[int]:
        """Who waited for too long."""
        latest = self._first + len(self._snapshots) - 1 - WAIT_STEPS
        waiting = [d for d in self._driven if d.entered is None]
        return [d.record.id for d in waiting if d.record.first_step < latest]

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the result should know about this traffic, one sentence each."""
        played = [p.record.id for p in self._played if not p.record.stands]
        return tuple(
            f"{words}: {', '.join(map(str, ids))}"
            for words, ids in (
                ("played back as recorded, since no lane leads their way", played),
                ("came in late, since their place was taken", self._late),
                ("never came in, since their place was taken", self._left_out),
            )
            if ids
        )

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
        """What was done with every obstacle, for debugging: how it is moved, its lane, class and
        route, the time step of its entry and SUMO's error there [m]."""
        found: dict[str, dict[str, object]] = {
            p.name: {"kind": p.record.kind, "moved": "as recorded"} for p in self._played
        }
        for d in self._driven:
            found[d.name] = {
                "kind": d.record.kind,
                "moved": "by SUMO",
                "lane": d.trip.start.lane,
                "lane offset": d.trip.start.distance,
                "class": d.trip.vehicle_class,
                "route": d.trip.edges,
                "entered": d.entered,
                "error": d.error,
            }
        return found

    def _advance(self, step: int, state: Array) -> None:
        """One step: whoever is not driven by SUMO is put where it is to be at its end."""
        ego, dt = self._ego_box(state), self._loaded.dt
        on_road = [d for d in self._driven if d.name in self._last.ids]
        for driven in on_road:
            driven.settle(dt)
        if self._snapshots:
            self._courtesy.step(self._routes(on_road), EGO, self._bodies(step - 1))
        self._ego.place(ego)
        for played in self._played:
            played.place(self._session, self._graph, step)
        entering = self._enter(step, ego)
        self._session.step()
        self._ego.placed()
        for driven in entering:
            driven.release(step)
        self._ego_now = ego
        self._snapshots.append(self._snapshot(step))

    def _routes(self, on_road: list[Driven]) -> dict[str, frozenset[str]]:
        """The lanes of all routes, by SUMO's id."""
        return {driven.name: driven.lanes for driven in on_road} | {EGO: self._ego.lanes}

    def _bodies(self, step: int) -> list[tuple[Array, str]]:
        """The boxes that SUMO's cars may not see at a time step, and the lane where they do."""
        boxes = [(played.box(step), played.lane) for played in self._played]
        return [(self._ego_now, self._ego.lane)] + [(b, lane) for b, lane in boxes if b is not None]

    def _enter(self, step: int, ego: Array) -> list[Driven]:
        """Brings in who is due at a time step and finds room; all at the first time step."""
        entering: list[Driven] = []
        for driven in self._driven:
            wait = step - driven.record.first_step
            if driven.entered is not None or not 0 <= wait <= WAIT_STEPS:
                continue
            if step > self._first:
                there = [self._last.boxes, ego[None], *(d.start[None] for d in entering)]
                if not has_room(driven.start, np.vstack(there)):
                    continue
            driven.enter(self._session, self._graph)
            entering.append(driven)
        return entering

    def _snapshot(self, step: int) -> Snapshot:
        """All others now, by id, in local coordinates."""
        self._last = self._session.vehicles().without(EGO)
        rows = {name: row for row, name in enumerate(self._last.ids)}
        driven = [d for d in self._driven if d.name in rows]
        dt = self._loaded.dt
        boxes = [
            d.start if d.entered == step else d.shown(self._last.boxes[rows[d.name]], dt)
            for d in driven
        ]
        records = [d.record for d in driven]
        for played in self._played:
            box = played.box(step)
            if box is not None:
                boxes.append(box)
                records.append(played.record)
        order = sorted(range(len(records)), key=lambda i: records[i].id)
        found = np.array([boxes[i] for i in order]).reshape(-1, len(Box))
        found[:, [Box.X, Box.Y]] -= self._loaded.origin
        ids = tuple(records[i].id for i in order)
        return Snapshot(step, ids, found, tuple(records[i].kind for i in order))

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
