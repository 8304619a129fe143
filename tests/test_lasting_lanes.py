"""The path along which rules are judged: the lane on which a route ends, without jumps."""

import numpy as np
import pytest
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from made_lanes import WIDTH, lane, line, network

from mpcplan.config import RoadConfig
from mpcplan.road.reference import build_frame, lasting_lanes
from mpcplan.road.route import Route


def three_lanes() -> LaneletNetwork:
    """Lanelets 1, 2 and 3 from right to left along x to the origin, 4, 5 and 6 from there on."""

    def pieces(number: int) -> list[Lanelet]:
        y = WIDTH * (number - 1)
        left = number + 1 if number < 3 else None
        right = number - 1 if number > 1 else None
        after = {"left": left and left + 3, "right": right and right + 3}
        return [
            lane(number, line((-200, y), (0, y)), after=(number + 3,), left=left, right=right),
            lane(number + 3, line((0, y), (300, y)), before=(number,), **after),
        ]

    return network(*pieces(1), *pieces(2), *pieces(3))


@pytest.mark.parametrize("route", [(1, 2, 3, 6), (1, 2, 5, 6), (1, 4, 5, 6), (3, 6)])
def test_lanes_are_judged_along_a_path_that_does_not_jump_between_them(route):
    roads = three_lanes()
    lanes = lasting_lanes(roads, Route(route))
    assert lanes == [3, 6]
    start = np.array([-150.0, 0.0])
    frame = build_frame(roads, Route(route), start, 100.0, RoadConfig(), lanes)
    assert np.abs(frame.heading(frame.s)).max() < 1e-3
    assert frame.points[:, 1] == pytest.approx(np.full(len(frame.s), 2 * WIDTH))


def test_the_path_jumps_to_a_lane_that_begins():
    roads = network(
        lane(1, line((-100, 0), (0, 0)), after=(4,)),
        lane(4, line((0, 0), (200, 0)), before=(1,), left=5),
        lane(5, line((0, WIDTH), (200, WIDTH)), right=4),
    )
    assert lasting_lanes(roads, Route((1, 4, 5))) == [1, 5]
