"""Lanes of SUMO's net: mended, matched, followed onward; and the mathematics of yielding."""

import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import made_crossing as roads
import numpy as np
import pytest
import shapely
from made_crossing import EAST, NORTH
from numpy.testing import assert_allclose

from mpcplan.errors import InputError
from mpcplan.observation import Box
from mpcplan.sumo.crossings import conflicts
from mpcplan.sumo.lanes import LaneGraph
from mpcplan.sumo.matching import match
from mpcplan.sumo.meetings import Entry, Mover, find_meetings
from mpcplan.sumo.net_copy import write_mended
from mpcplan.sumo.onward import edges_of, onward, towards, with_approach
from mpcplan.sumo.polyline import between, joined, leap, length, parse, sharpest_turn, text
from mpcplan.sumo.room import has_room
from mpcplan.sumo.session import Options, Session
from mpcplan.sumo.shown import LEAP, TURNING, TWIST, Shown
from mpcplan.sumo.trips import hints, trip
from mpcplan.sumo.ways import Way
from mpcplan.sumo.yielding import COMFORT, HARD, Body, Yielding, safe_speed

DT = 0.1  # s


@pytest.fixture(scope="module")
def graph(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LaneGraph]:
    net = tmp_path_factory.mktemp("net") / "roads.net.xml"
    net.write_text(roads.net())
    with Session(Options(net)):
        yield LaneGraph()


def mended(tmp_path: Path, net_text: str) -> tuple[ElementTree.Element, tuple[str, ...]]:
    """The copy of a net, and the lanes drawn anew."""
    net, copy = tmp_path / "net.xml", tmp_path / "copy.xml"
    net.write_text(net_text)
    drawn = write_mended(net, roads.network(), np.zeros(2), copy)
    return ElementTree.parse(copy).getroot(), drawn


def lane(root: ElementTree.Element, name: str) -> ElementTree.Element:
    return next(lane for lane in root.iter("lane") if lane.get("id") == name)


# -- mended nets ----------------------------------------------------------------------------------


def test_lanes_are_as_long_as_they_are_drawn(tmp_path):
    root, drawn = mended(tmp_path, roads.net(length_factor=1.5))
    for found in root.iter("lane"):
        assert float(found.get("length")) == pytest.approx(length(parse(found.get("shape"))))
    assert drawn == ()


def test_sound_nets_keep_their_shapes(tmp_path):
    root, _ = mended(tmp_path, roads.net())
    original = ElementTree.fromstring(roads.net())
    for found in root.iter("lane"):
        assert found.get("shape") == lane(original, found.get("id")).get("shape")
        assert found.get("speed") == lane(original, found.get("id")).get("speed")


def test_an_offset_is_taken_out(tmp_path):
    root, _ = mended(tmp_path, roads.net(offset=(5000.0, -300.0)))
    original = ElementTree.fromstring(roads.net())
    assert root.find("location").get("netOffset") == "0.00,0.00"
    for found in root.iter("lane"):
        expected = parse(lane(original, found.get("id")).get("shape"))
        assert_allclose(parse(found.get("shape")), expected, atol=1e-3)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"98.00,0.00 102.00,0.00"', '"120.00,0.00 80.00,0.00"'),  # leads backwards
        ('"98.00,0.00 102.00,0.00"', '"98.00,0.00 100.00,9.00"'),  # ends far from the next lane
        ('"102.00,0.00 200.00,0.00"', '"130.00,0.50 125.00,0.50"'),  # cut away whole: turned round
    ],
)
def test_lanes_that_do_not_follow_each_other_are_drawn_along_the_lanelets(tmp_path, old, new):
    assert old in roads.net()
    root, drawn = mended(tmp_path, roads.net().replace(old, new))
    assert ":J_0_0" in drawn
    chain = [parse(lane(root, name).get("shape")) for name in ("1_0", ":J_0_0", "3_0")]
    for one, other in pairwise(chain):
        gap, turn = leap(one, other)
        assert gap < 0.01 and turn < 0.01
    assert_allclose(np.vstack(chain)[:, 1], 0, atol=1e-6)
    assert (np.diff(np.vstack(chain)[:, 0]) >= 0).all()


def test_short_curves_get_a_speed_limit(tmp_path):
    angles = np.linspace(0, math.pi / 2, 20)
    curve = np.column_stack([98 + 10 * np.sin(angles), 10 - 10 * np.cos(angles)])
    net = roads.net().replace('"98.00,0.00 102.00,0.00"', f'"{text(curve)}"')
    after = f'"{text(np.array([curve[-1], curve[-1] + [0, 90]]))}"'
    root, drawn = mended(tmp_path, net.replace('"102.00,0.00 200.00,0.00"', after))
    assert drawn == ()
    assert float(lane(root, ":J_0_0").get("speed")) == pytest.approx(math.sqrt(55), rel=0.05)
    assert float(lane(root, "1_0").get("speed")) == roads.LIMIT


@pytest.mark.parametrize(
    ("old", "new"),
    [('speed="13.9"', 'speed="fast"'), ('index="0"', 'index="x"'), ("-100.00,0.00", "nan,0")],
)
def test_numbers_that_are_none_are_refused(tmp_path, old, new):
    """SUMO's reader would take the process down."""
    with pytest.raises(InputError, match=r"net\.xml: lane 1?.*_0: the attribute \w+ is no number"):
        mended(tmp_path, roads.net().replace(old, new))


def test_polylines():
    points = np.array([[0.0, 0], [10, 0], [10, 10]])
    assert length(points) == 20
    assert_allclose(between(points, 5, 12), [[5, 0], [10, 0], [10, 2]])
    assert_allclose(between(points, 15, np.inf), [[10, 5], [10, 10]])
    assert_allclose(between(points, 30, 40), [[10, 10], [10, 10]])
    assert_allclose(joined(points[0], points[1:2] - 0.2, points[2]), points, atol=0.3)
    assert_allclose(joined(points[0], np.array([[0.5, 0.1]]), points[2]), points[[0, 2]])
    assert leap(points[:2], points[1:]) == pytest.approx((0, math.pi / 2))
    assert_allclose(parse(text(points)), points)
    assert sharpest_turn(points, 5.0) == pytest.approx(math.pi / 2)
    assert sharpest_turn(points[:2], 5.0) == 0


# -- matching and routes --------------------------------------------------------------------------


def test_places_near_a_point(graph):
    (place,) = graph.near(np.array([-20.0, 1.2]), 0.1, 3.0)
    assert (place.lane, place.offset, place.distance) == ("1_0", pytest.approx(80), 1.2)
    assert place.turn == pytest.approx(0.1)
    assert graph.near(np.array([-20.0, 1.2]), math.pi, 3.0) == []
    assert graph.near(np.array([-20.0, 3.2]), 0.0, 3.0) == []
    assert {p.lane for p in graph.near(np.zeros(2), math.pi / 4, 3.0)} == {"1_0", "2_0"}


def test_where_a_body_lies_along_lanes(graph):
    body = np.array([[-24.0, 1.5], [-20, 1.5], [-20, 3.5], [-24, 3.5]])
    ((lane, along),) = graph.along(body, 1.6)
    assert lane == "1_0" and along == pytest.approx([76, 80, 80, 76])
    assert graph.along(body, 1.4) == []


def test_lanes_found_do_not_depend_on_what_was_asked_before(graph):
    """The graph keeps what lies around the last spot."""
    rng = np.random.default_rng(2)
    for _ in range(200):
        (x, y), reach = rng.uniform(-30, 30, 2), rng.uniform(0, 15)
        corners = np.array([x, y]) + [[-1, -1], [1, -1], [1, 1], [-1, 1]]
        area = shapely.Polygon(corners)
        far = {i: lane.line.distance(area) for i, lane in graph.lanes.items()}
        expected = sorted(lane for lane, distance in far.items() if distance <= reach)
        assert [lane for lane, _ in graph.along(corners, reach)] == expected
        spot = shapely.Point(x, y)
        far = {i: lane.line.distance(spot) for i, lane in graph.lanes.items()}
        expected = sorted(lane for lane, distance in far.items() if distance <= reach)
        places = graph.near(np.array([x, y]), 0.0, reach, turn_max=math.pi)
        assert [place.lane for place in places] == expected


def test_matching_through_a_junction(graph):
    x = np.arange(90, 120, 2.0)
    places, lanes = match(graph, np.column_stack([x, 0 * x + 0.3]), 0 * x)
    assert lanes == ("1_0", ":J_0_0", "3_0")
    assert [p.lane for p in places] == ["1_0"] * 5 + [":J_0_0"] + ["3_0"] * 9
    assert len(places) == len(x)


def test_matching_ends_where_the_record_leaves_the_lanes(graph):
    fronts = np.array([[-30.0, 0], [-28, 0], [-26, 0], [-24, 9], [-22, 9]])
    places, lanes = match(graph, fronts, np.zeros(5))
    assert len(places) == 3 and lanes == ("1_0",)
    assert match(graph, fronts[3:], np.zeros(2)) == ((), ())


def test_matching_takes_the_road_that_was_driven(graph):
    y = np.arange(-4.0, 6.0)
    places, lanes = match(graph, np.column_stack([0 * y, y]), 0 * y + NORTH)
    assert lanes == ("2_0",) and len(places) == len(y)


def test_onward_to_the_nets_end(graph):
    assert onward(graph, ["1_0"], "passenger") == (":J_0_0", "3_0")
    assert onward(graph, ["3_0"], "passenger") == ()
    assert edges_of(graph, ("1_0", ":J_0_0", "3_0")) == ("1", "3")
    assert with_approach(graph, (":J_0_0", "3_0")) == ("1_0", ":J_0_0", "3_0")
    assert towards(graph, "1_0", {"3_0"}) == ("1_0", ":J_0_0", "3_0")
    assert towards(graph, "2_0", {"3_0"}) == ()


def boxes(*rows: tuple[float, float, float]) -> np.ndarray:
    """Boxes of a car at (x, y, psi)."""
    found = np.zeros((len(rows), len(Box)))
    found[:, : len(rows[0])] = rows
    found[:, [Box.LENGTH, Box.WIDTH]] = 4.5, 1.8
    return found


@pytest.mark.parametrize(
    ("start", "hint", "edges"),
    [
        ((-50, 0, EAST), (), ("1", "3")),
        ((98, 0, EAST), (), ("1", "3")),  # its front is in the junction
        ((-50, 0, EAST), ("1",), ("1", "3")),  # the route file's route is too short
        ((-50, 0, EAST), ("1", "2"), ("1", "3")),  # and here it cannot be driven
        ((0, -1, NORTH), (), ("2",)),
        ((150, 0, EAST), (), ("3",)),
    ],
)
def test_trips(graph, start, hint, edges):
    assert trip(graph, boxes(start), "passenger", hint).edges == edges


def test_the_route_file_tells_between_roads_that_are_as_near(graph):
    askew = boxes((-1.6, -1.6, math.pi / 4))
    assert trip(graph, askew, "passenger", ("1", "3")).edges == ("1", "3")
    assert trip(graph, askew, "passenger", ("2",)).edges == ("2",)


def test_no_trip_across_or_beside_lanes(graph):
    assert trip(graph, boxes((-50, 0, NORTH)), "passenger") is None
    assert trip(graph, boxes((-50, 0, math.pi)), "passenger") is None
    assert trip(graph, boxes((-50, 20, EAST)), "passenger") is None


def test_hints(tmp_path):
    file = tmp_path / "a.rou.xml"
    file.write_text(
        '<routes><route id="r" edges="1 3"/><vehicle id="30" depart="0" route="r"/>'
        '<vehicle id="31" depart="0"><route edges="2"/></vehicle></routes>'
    )
    assert hints([file]) == {"30": ("1", "3"), "31": ("2",)}


# -- conflicts and yielding -----------------------------------------------------------------------


def test_conflicts_are_where_sumo_knows_of_none(graph):
    found = conflicts(graph)
    assert sorted(found) == ["1_0", "2_0"]
    (one,), (other,) = found["1_0"], found["2_0"]
    assert (one.zone, one.side, other.side, one.together) == (other.zone, 0, 1, False)
    assert (one.begin + one.end) / 2 == pytest.approx(100, abs=0.5)
    assert (other.begin + other.end) / 2 == pytest.approx(100, abs=0.5)
    assert 3.0 < one.end - one.begin < 5.0 and 3.0 < other.end - other.begin < 5.0


@pytest.mark.parametrize("v", [0.5, 5.0, 15.0, 30.0])
@pytest.mark.parametrize("leader", [0.0, 4.0, 12.0])
def test_from_the_safe_speed_one_can_follow(v, leader):
    """Braking by COMFORT after the headway, behind a leader who brakes by as much."""
    headway = 1.0
    gap = next(g for g in np.arange(0.01, 500, 0.01) if safe_speed(g, leader, headway) >= v)
    needed = v * headway + (v * v - leader * leader) / (2 * COMFORT)
    assert gap == pytest.approx(max(needed, 0.01), abs=0.05)


def way(name: str) -> Way:
    """One lane that crosses another between 20 and 24 m."""
    zone = np.array([0 if name == "a" else 1])
    spans = np.array([20.0]), np.array([24.0]), np.array([20.0])
    return Way(name, ((name, 0.0),), frozenset({name}), zone, np.array([False]), *spans)


def mover(name: str, position: float, speed: float, steered: bool = True) -> Mover:
    return Mover(name, way(name), position, speed, 4.5, steered)


def test_meetings_are_of_those_on_their_way_to_the_same_conflict():
    (meeting,) = find_meetings([mover("a", 5, 8), mover("b", 8, 6)])
    assert isinstance(meeting.one, Entry) and {meeting.one.begin, meeting.other.begin} == {15, 12}
    assert find_meetings([mover("a", 5, 8)]) == []
    assert find_meetings([mover("a", 30, 8), mover("b", 8, 6)]) == []  # one has left
    assert find_meetings([mover("a", 28, 8), mover("b", 8, 6)]) != []  # but for its tail
    assert find_meetings([mover("a", 0, 2), mover("b", 8, 6)]) == []  # one is far


def drive(yielding: Yielding, places: dict[str, float], speeds: dict[str, float]) -> dict:
    """Both drive on, as fast as they were or may, for 8 s; who was where in each step."""
    places, seen = dict(places), []
    now = dict(speeds)
    for _ in range(80):
        limits = yielding.limits([mover(n, places[n], now[n]) for n in places], [])
        now = {n: min(now[n] + 2 * DT, speeds[n], limits.get(n, math.inf)) for n in places}
        places = {n: places[n] + now[n] * DT for n in places}
        seen.append(dict(places))
    return {n: np.array([at[n] for at in seen]) for n in places}


@pytest.mark.parametrize("behind", [0.0, 2.0, 6.0, 12.0])
def test_two_that_meet_never_are_in_the_conflict_together_and_both_get_through(behind):
    seen = drive(Yielding(DT), {"a": 0.0, "b": -behind}, {"a": 8.0, "b": 8.0})
    inside = {n: (at > 20) & (at < 24 + 4.5) for n, at in seen.items()}
    assert not (inside["a"] & inside["b"]).any()
    assert all(at[-1] > 28.5 for at in seen.values())
    assert inside["a"].argmax() <= inside["b"].argmax(), "who is nearer goes first"


def test_who_cannot_yield_is_yielded_to():
    ego = mover("a", 0, 8, steered=False)
    limits = Yielding(DT).limits([ego, mover("b", 3, 8)], [])
    assert "a" not in limits
    again = Yielding(DT)
    for position in np.arange(0, 20, 0.8):
        limits = again.limits([mover("a", position, 8, False), mover("b", 18.6, 0)], [])
        assert limits.get("b", 0.0) == 0.0


def test_bodies_in_the_lane():
    ahead = Body("a", 30.0, 34.0, 0.0)
    limits = Yielding(DT).limits([mover("a", 20, 9)], [ahead])
    assert 9 - HARD * DT <= limits["a"] < 9
    assert Yielding(DT).limits([mover("a", 36, 9)], [ahead]) == {}  # passed
    assert Yielding(DT).limits([mover("b", 20, 9)], [ahead]) == {}  # another lane
    stopped = Yielding(DT).limits([mover("a", 29.5, 0)], [ahead])
    assert stopped == {"a": 0.0}


# -- what others see ------------------------------------------------------------------------------


def test_bodies_move_over_to_where_sumo_has_them():
    shown, x = Shown(), 0.0
    shown.begin(np.array([0.0, 1.5]), 0.2, np.array([2.25, 0.0]), 0.0)
    before = np.array([2.25 - 2.25 * math.cos(0.2), 1.5 - 2.25 * math.sin(0.2), 0.2])
    for _ in range(100):
        x += 0.8
        seen = np.array(shown.step([x, 0.0, 0.0, 8.0, 4.5, 1.8], DT))
        step = seen[:3] - before
        assert abs(step[0] - 0.8) < 0.05 and -0.2 < step[1] < 0.05 and -0.05 < step[2] <= 0
        before = seen[:3]
    assert_allclose(before, [x, 0, 0], atol=0.02)


def test_leaps_are_not_seen():
    shown = Shown()
    shown.begin(np.zeros(2), 0.0, np.array([2.25, 0.0]), 0.0)
    shown.step([0.5, 0, 0, 5.0, 4.5, 1.8], DT)
    seen = np.array(shown.step([1.0, 3.0, 0.6, 5.0, 4.5, 1.8], DT))
    assert np.hypot(*(seen[:2] - [0.5, 0])) < 0.5 + 2 * LEAP
    assert abs(seen[Box.PSI]) < TWIST + (0.6 - TWIST) * DT / TURNING


def test_room():
    (car, queue, crossing), speeds = boxes((0, 0, 0), (12, 0, 0), (6, -8, NORTH)), (10, 0, 8)
    for box, v in zip((car, queue, crossing), speeds, strict=True):
        box[Box.V] = v
    assert has_room(car, np.empty((0, len(Box))))
    assert not has_room(car, queue[None])  # it would run into the queue
    assert not has_room(car, crossing[None])
    queue[Box.V] = 10
    assert has_room(car, queue[None])
    assert not has_room(car, car[None])
