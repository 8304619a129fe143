"""The ego vehicle in SUMO: which lane it is taken to be on where lanes fork."""

from pathlib import Path

import libsumo
import numpy as np

from mpcplan.sumo.ego import EGO, EgoVehicle
from mpcplan.sumo.lanes import LaneGraph
from mpcplan.sumo.session import Options, Session


def fork_net() -> str:
    """Edge 1 along x to J at x = 100 m, then 2 straight on, and 3, which turns left."""

    def lane(name: str, shape: str, length: float) -> str:
        return (
            f'<lane id="{name}_0" index="0" speed="13.9" length="{length}" width="3.5" '
            f'shape="{shape}"/>'
        )

    bend = "100,0 106,0.9 111,3.6 115,7.6 117.5,12.6"
    return (
        '<net version="1.9"><location netOffset="0,0" convBoundary="0,0,0,0" '
        'origBoundary="0,0,0,0" projParameter="!"/>'
        f'<edge id=":J_0" function="internal">{lane(":J_0", "100,0 120,0", 20)}</edge>'
        f'<edge id=":J_1" function="internal">{lane(":J_1", bend, 23)}</edge>'
        f'<edge id="1" from="A" to="J" priority="1">{lane("1", "0,0 100,0", 100)}</edge>'
        f'<edge id="2" from="J" to="B" priority="1">{lane("2", "120,0 200,0", 80)}</edge>'
        f'<edge id="3" from="J" to="C" priority="1">{lane("3", "117.5,12.6 140,60", 52)}</edge>'
        '<junction id="A" type="dead_end" x="0" y="0" incLanes="" intLanes=""/>'
        '<junction id="B" type="dead_end" x="200" y="0" incLanes="2_0" intLanes=""/>'
        '<junction id="C" type="dead_end" x="140" y="60" incLanes="3_0" intLanes=""/>'
        '<junction id="J" type="priority" x="110" y="0" incLanes="1_0" intLanes=":J_0_0 :J_1_0">'
        '<request index="0" response="00" foes="00" cont="0"/>'
        '<request index="1" response="00" foes="00" cont="0"/></junction>'
        '<connection from="1" to="2" fromLane="0" toLane="0" via=":J_0_0" dir="s" state="M"/>'
        '<connection from="1" to="3" fromLane="0" toLane="0" via=":J_1_0" dir="l" state="M"/>'
        '<connection from=":J_0" to="2" fromLane="0" toLane="0" dir="s" state="M"/>'
        '<connection from=":J_1" to="3" fromLane="0" toLane="0" dir="l" state="M"/></net>'
    )


def box_at(x: float, y: float, psi: float, v: float = 5.0) -> np.ndarray:
    return np.array([x, y, psi, v, 4.3, 1.7])


def driven_into_the_fork(tmp_path: Path, *boxes: np.ndarray) -> str:
    """The lane on which SUMO has the ego vehicle, which wants to turn left, in the end."""
    net = tmp_path / "net.xml"
    net.write_text(fork_net())
    with Session(Options(net)) as session:
        ego = EgoVehicle(session, LaneGraph(), boxes[0], {"3_0"})
        for box in boxes:
            ego.place(box)
            session.step()
            ego.placed()
            x, y = libsumo.vehicle.getPosition(EGO)
            front = box[:2] + 2.15 * np.array([np.cos(box[2]), np.sin(box[2])])
            assert np.hypot(x - front[0], y - front[1]) < 1.5  # about where it was put
            assert ego.lane  # seen by others at every time step
        return ego.lane


def test_a_turn_that_is_taken_wide_is_still_the_turn(tmp_path):
    """Nearer to the lane straight on: the others must not take it for a vehicle that goes there."""
    way = [box_at(x, -0.3, 0.05) for x in np.arange(90.0, 108.0, 0.5)]
    assert driven_into_the_fork(tmp_path, *way) == ":J_1_0"


def test_a_turn_that_is_missed_is_left(tmp_path):
    way = [box_at(x, 0.0, 0.0) for x in np.arange(90.0, 125.0, 0.5)]
    assert driven_into_the_fork(tmp_path, *way) == "2_0"
