"""Whom the ego vehicle's body lies before."""

import math

import numpy as np
import pytest
from made_lanes import CAR, DT, moving, seen, straight_road

from mpcplan.config import PredictConfig
from mpcplan.predict.across import CLEAR, GAP, LOOK, held_up
from mpcplan.predict.hypotheses import hypotheses
from mpcplan.predict.kinds import OFF_LANES
from mpcplan.predict.lanes import Lanes
from mpcplan.predict.motion import motion
from mpcplan.predict.paths import Paths
from mpcplan.predict.scene import scene_of
from mpcplan.vehicle import FORD_ESCORT

STEP = 0.2  # s, of the model
FRONT = CAR[0] / 2  # of who drives from the origin along x


def held_up_by(ego, speed: float = 5.0):
    """Where the only other vehicle waits, and until when; the ego vehicle goes on at a speed."""
    paths = Paths(Lanes(straight_road()), 5.5)
    observation = seen(moving(0, 0, 0, 0), ego=np.array(ego))
    moves = motion(observation.others, PredictConfig().lane_history, DT)
    scene = scene_of(observation, moves, Lanes(straight_road()), paths, 150.0, OFF_LANES)
    found = hypotheses(scene.places, scene.weight, np.zeros(scene.count), paths)
    ego_s = speed * STEP * np.arange(41)
    stop, release = held_up(scene, found, paths, ego_s, STEP)
    row = int(np.flatnonzero(found.vehicle == 0)[0])
    of_ego = found.vehicle == scene.ego
    assert np.isinf(stop[of_ego]).all()  # nobody waits for himself
    return float(stop[row] - found.s[row]), float(release[row])


@pytest.mark.parametrize("turn", [math.pi / 2, -math.pi / 2])
@pytest.mark.parametrize("x", [6.0, 12.0])
def test_who_lies_across_is_waited_for(x, turn):
    room, until = held_up_by([x, -1.0 * math.sin(turn), 0, 1, turn])
    side = x - FORD_ESCORT.width / 2 - CLEAR - FRONT
    assert room == pytest.approx(side - GAP, abs=0.5)
    gone = (FORD_ESCORT.length + CAR[1]) / 5.0
    assert until == pytest.approx(gone, abs=1.5 * STEP)


def test_who_does_not_drive_on_is_waited_for_for_ever():
    assert held_up_by([8.0, -1.0, 0, 0, math.pi / 2], speed=0.0)[1] == pytest.approx(41 * STEP)


@pytest.mark.parametrize(
    "ego",
    [
        [12.0, 0.0, 0, 1, 0.2],  # drives along: it is followed
        [12.0, 5.0, 0, 1, math.pi / 2],  # has passed
        [12.0, -6.0, 0, 1, math.pi / 2],  # has not come yet
        [-9.0, -1.0, 0, 1, math.pi / 2],  # is behind
        [LOOK + 10.0, -1.0, 0, 1, math.pi / 2],  # is far
    ],
)
def test_who_is_not_in_the_way_is_not(ego):
    assert held_up_by(ego) == (math.inf, 0.0)
