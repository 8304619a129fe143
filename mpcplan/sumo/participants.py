"""All others in the traffic: who SUMO drives, who is played back, and who has not come in yet."""

from collections.abc import Mapping, Sequence

import numpy as np

from mpcplan.sumo.driven import Driven
from mpcplan.sumo.drivers import driver_of
from mpcplan.sumo.lanes import LaneGraph
from mpcplan.sumo.played import Played
from mpcplan.sumo.records import Record
from mpcplan.sumo.room import has_room
from mpcplan.sumo.session import Session, Vehicles
from mpcplan.sumo.trips import trip
from mpcplan.trajectory import Array

WAIT_STEPS = 50  # time steps for which an obstacle waits until its place is free
OFF_LANES = ("pedestrian", "train")  # kinds that are always played back


class Participants:
    """Everybody who is recorded.

    Where a scenario records initial states only, or not much more, played back obstacles go on as
    they moved last: who is recorded up to the end has not left.
    """

    def __init__(
        self,
        found: list[Record],
        graph: LaneGraph,
        routes: Mapping[str, tuple[str, ...]],
        first_step: int,
        dt: float,
    ) -> None:
        """Sorts the recorded obstacles.

        Args:
            found: what is recorded of each, by id.
            graph: SUMO's net.
            routes: edges of the routes in the folder's files, by SUMO's id.
            first_step: time step at which the traffic begins.
            dt: time step [s].
        """
        self._graph, self._dt = graph, dt
        self._driven: list[Driven] = []
        self._played: list[Played] = []
        self._step = self._first = first_step
        end = max((known.last_step for known in found if not known.stands), default=0)
        for known in found:
            way = None
            if not known.stands and known.kind not in OFF_LANES:
                vehicle_class = driver_of(known.kind).vehicle_class
                way = trip(graph, known.boxes, vehicle_class, routes.get(str(known.id), ()))
            if way is None:
                self._played.append(Played(known, known.last_step == end, dt))
            else:
                self._driven.append(Driven(known, way, graph))

    def on_road(self, now: Vehicles) -> list[Driven]:
        """Whom SUMO drives at present."""
        ids = frozenset(now.ids)
        return [driven for driven in self._driven if driven.name in ids]

    def bodies(self, step: int) -> list[tuple[Array, str]]:
        """(6,) boxes of where who is played back is at a time step and soon will be, and the lane
        on which SUMO has them."""
        boxes = [(played.reach(step), played.lane) for played in self._played]
        return [(box, lane) for box, lane in boxes if box is not None]

    def place(self, session: Session, step: int) -> None:
        """Puts who is played back where they are to be after the next step."""
        for played in self._played:
            played.place(session, self._graph, step)

    def enter(self, session: Session, step: int, now: Vehicles, ego: Array) -> list[Driven]:
        """Brings in who is due at a time step: all at the first one, later those that find room.

        Args:
            session: the simulation.
            step: the time step after the next simulation step.
            now: whom SUMO has on the road, the ego vehicle left out.
            ego: (6,) box of the ego vehicle at that time step.

        Returns:
            who comes in, to be released after the simulation step.
        """
        entering: list[Driven] = []
        for driven in self._driven:
            wait = step - driven.record.first_step
            if driven.entered is not None or not 0 <= wait <= WAIT_STEPS:
                continue
            there = np.vstack([now.boxes, ego[None], *(d.start[None] for d in entering)])
            if step == self._first or has_room(driven.start, there):
                driven.enter(session, self._graph)
                entering.append(driven)
        self._step = step
        return entering

    def boxes(self, step: int, now: Vehicles) -> list[tuple[Record, Sequence[float]]]:
        """Who is there at a time step, and (6,) boxes as others see them; once a step."""
        rows = dict(zip(now.ids, now.boxes.tolist(), strict=True))
        found: list[tuple[Record, Sequence[float]]] = [
            (d.record, d.start.tolist() if d.entered == step else d.shown(rows[d.name], self._dt))
            for d in self._driven
            if d.name in rows
        ]
        for played in self._played:
            box = played.box(step)
            if box is not None:
                found.append((played.record, box.tolist()))
        return found

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the result should know, one sentence each."""
        entered = [d for d in self._driven if d.entered is not None]
        waiting = [d.record for d in self._driven if d.entered is None]
        told = {
            "played back as recorded, since no lane leads their way": [
                p.record.id for p in self._played if not p.record.stands
            ],
            "came in late, since their place was taken": [
                d.record.id for d in entered if d.entered != d.record.first_step
            ],
            "never came in, since their place was taken": [
                known.id for known in waiting if known.first_step + WAIT_STEPS < self._step
            ],
        }
        return tuple(
            f"obstacles {words}: {', '.join(map(str, ids))}" for words, ids in told.items() if ids
        )

    def log(self) -> dict[str, dict[str, object]]:
        """What was done with each, by SUMO's id: how it is moved, its lane, class and route, the
        time step of its entry and SUMO's error there [m]."""
        found: dict[str, dict[str, object]] = {
            p.name: {"kind": p.record.kind, "moved": "as recorded"} for p in self._played
        }
        for d in self._driven:
            found[d.name] = {
                "kind": d.record.kind,
                "moved": "by SUMO",
                "lane": d.trip.start.lane,
                "distance": d.trip.start.distance,
                "class": d.trip.vehicle_class,
                "route": d.trip.edges,
                "entered": d.entered,
                "error": d.error,
            }
        return found
