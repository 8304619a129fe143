"""Traffic from a recorded start: exact at its begin, driven by SUMO, and it heeds the ego vehicle.

Most of it on the roads of :mod:`made_crossing`; on the public interactive folders where they are.
"""

import hashlib
import math
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from itertools import combinations, pairwise
from pathlib import Path

import libsumo
import made_crossing as roads
import numpy as np
import pytest
import shapely
from commonroad.geometry.shape import Circle, Rectangle
from commonroad.scenario.obstacle import ObstacleType
from made_crossing import EAST, NORTH, moving, standing, state

from mpcplan.errors import TrafficError
from mpcplan.observation import Box, Snapshot, box_corners
from mpcplan.predict.recorded import record
from mpcplan.scenario import LoadedScenario, load
from mpcplan.sumo.courtesy import Courtesy
from mpcplan.sumo.inserted import InsertedTraffic
from mpcplan.sumo.participants import WAIT_STEPS
from mpcplan.sumo.session import Options, Session, angle, heading
from mpcplan.sumo.traffic import open_traffic
from mpcplan.trajectory import Array, State
from mpcplan.verify.drivability import separation

SHARED = Path(__file__).resolve().parents[2] / "shared" / "scenarios" / "interactive"
Drive = Callable[[int], Array]
AWAY = state(0, 60, NORTH, 10)

# All kinds of road users that published scenarios have, with a shape each
KINDS = (
    (ObstacleType.CAR, Rectangle(4.5, 1.8), "by SUMO"),
    (ObstacleType.TRUCK, Rectangle(12.0, 2.5), "by SUMO"),
    (ObstacleType.BUS, Rectangle(11.0, 2.5), "by SUMO"),
    (ObstacleType.BICYCLE, Rectangle(1.9, 0.6), "by SUMO"),
    (ObstacleType.MOTORCYCLE, Rectangle(2.3, 0.8), "by SUMO"),
    (ObstacleType.TAXI, Rectangle(4.7, 1.8), "by SUMO"),
    (ObstacleType.PRIORITY_VEHICLE, Rectangle(6.0, 2.2), "by SUMO"),
    (ObstacleType.UNKNOWN, Rectangle(4.0, 2.0), "by SUMO"),
    (ObstacleType.PEDESTRIAN, Circle(0.4), "as recorded"),
)


def traffic_of(folder: Path) -> InsertedTraffic:
    loaded = load(folder)
    return InsertedTraffic(loaded, loaded.problems[0])


def stays(loaded: LoadedScenario) -> Drive:
    """An ego vehicle that stands at its start."""
    still = loaded.problems[0].start.copy()
    still[State.V] = 0.0
    return lambda _: still


def goes(loaded: LoadedScenario) -> Drive:
    """An ego vehicle that goes straight on at its first speed."""
    start = loaded.problems[0].start

    def at(step: int) -> Array:
        now, way = start.copy(), 0.1 * step * start[State.V]
        now[State.X] += way * math.cos(start[State.PSI])
        now[State.Y] += way * math.sin(start[State.PSI])
        return now

    return at


def run(folder: Path, steps: int, ego: Callable[[LoadedScenario], Drive] = stays) -> list[Snapshot]:
    """The others over some steps, in file coordinates."""
    loaded = load(folder)
    drive = ego(loaded)
    with closing(InsertedTraffic(loaded, loaded.problems[0])) as traffic:
        for step in range(1, steps + 1):
            traffic.advance(step, drive(step))
        seen = [traffic.at(step) for step in range(steps + 1)]
    for snapshot in seen:
        snapshot.boxes[:, [Box.X, Box.Y]] += loaded.origin
    return seen


def accelerations(seen: list[Snapshot], obstacle: int) -> Array:
    """Of one obstacle [m/s^2], in every step that it is there."""
    speeds = [s.box_of(obstacle)[Box.V] for s in seen if s.box_of(obstacle) is not None]
    return np.diff(speeds) / 0.1


def touch(snapshot: Snapshot) -> list[tuple[int, int]]:
    """Who overlaps whom by more than 5 cm."""
    slim = snapshot.boxes.copy()
    slim[:, [Box.LENGTH, Box.WIDTH]] -= 0.1
    bodies = dict(zip(snapshot.ids, map(shapely.Polygon, box_corners(slim)), strict=True))
    return [(a, b) for a, b in combinations(bodies, 2) if bodies[a].intersects(bodies[b])]


# -- the session ----------------------------------------------------------------------------------


@pytest.fixture
def net(tmp_path: Path) -> Path:
    path = tmp_path / "roads.net.xml"
    path.write_text(roads.net())
    return path


def test_one_simulation_at_a_time(net):
    running = "running in this process already"
    with Session(Options(net)), pytest.raises(TrafficError, match=running):
        Session(Options(net))
    with Session(Options(net)) as session:  # one after another is fine
        session.step()
        assert session.time == pytest.approx(0.1)
    session.close()


def test_sumo_says_why_it_does_not_start(tmp_path, net, capfd):
    with pytest.raises(TrafficError, match=r"none\.net\.xml.*not accessible"):
        Session(Options(tmp_path / "none.net.xml"))
    with pytest.raises(TrafficError, match="SUMO does not start"):
        Session(Options(net, further=(("no-such-option", "1"),)))
    assert capfd.readouterr() == ("", "")
    Session(Options(net)).close()  # what failed leaves nothing alive


@pytest.mark.parametrize("psi", np.linspace(-3.1, 3.1, 9))
def test_angles(psi):
    assert heading(angle(psi)) == pytest.approx(psi)
    assert 0 <= angle(psi) < 360


def test_sumos_angles_count_from_north_clockwise():
    assert [angle(psi) for psi in (EAST, NORTH)] == [90, 0]


# -- the begin ------------------------------------------------------------------------------------


def test_everybody_begins_exactly_as_recorded(tmp_path):
    """Beside the middle of the lane, turned, and in a junction too."""
    starts = [
        state(-60, 0, EAST, 8), state(-40, 0.6, EAST + 0.1, 9), state(-20, -0.4, EAST - 0.05, 9),
        state(100, 0, EAST, 7), state(0, -60, NORTH, 6), state(0.3, -80, NORTH + 0.03, 0),
    ]  # fmt: skip
    folder = roads.write(tmp_path / "f", *(moving(30 + i, s) for i, s in enumerate(starts)))
    seen = run(folder, 20)
    for i, start in enumerate(starts):
        expected = [*start.position, start.orientation, start.velocity, 4.5, 1.8]
        assert seen[0].box_of(30 + i) == pytest.approx(expected, abs=1e-7)
    with closing(traffic_of(folder)) as traffic:
        assert all(entry["error"] < 1e-3 for entry in traffic.log().values())


def test_nobody_leaps_and_all_come_to_the_middle_of_the_lane(tmp_path):
    starts = [state(-40, 1.0, EAST + 0.3, 9), state(0, -60, NORTH - 0.2, 6)]
    seen = run(roads.write(tmp_path / "f", *(moving(30 + i, s) for i, s in enumerate(starts))), 80)
    for i in (30, 31):
        boxes = np.array([s.box_of(i) for s in seen])
        way = np.hypot(*np.diff(boxes[:, [Box.X, Box.Y]], axis=0).T)
        assert np.abs(way - 0.1 * boxes[1:, Box.V]).max() < 0.15
        assert np.abs(np.diff(boxes[:, Box.PSI])).max() < 0.1
    assert seen[80].box_of(30)[[Box.Y, Box.PSI]] == pytest.approx([0, EAST], abs=0.1)
    assert seen[80].box_of(31)[[Box.X, Box.PSI]] == pytest.approx([0, NORTH], abs=0.1)


def test_kinds_and_shapes_are_kept(tmp_path):
    starts = [state(-90 + 22 * i, 0, EAST, 5) for i in range(len(KINDS))]
    others = [
        moving(30 + i, start, kind=kind, shape=shape)
        for i, (start, (kind, shape, _)) in enumerate(zip(starts, KINDS, strict=True))
    ]
    loaded = load(roads.write(tmp_path / "f", *others))
    with closing(InsertedTraffic(loaded, loaded.problems[0])) as traffic:
        for step in range(1, 4):
            traffic.advance(step, loaded.problems[0].start)
        seen, log = traffic.at(3), traffic.log()
    for i, (kind, shape, moved) in enumerate(KINDS):
        size = [2 * shape.radius] * 2 if isinstance(shape, Circle) else [shape.length, shape.width]
        assert seen.kind_of(30 + i) == kind.value
        assert seen.box_of(30 + i)[[Box.LENGTH, Box.WIDTH]] == pytest.approx(size)
        assert log[str(30 + i)]["moved"] == moved


def test_nets_with_an_offset(tmp_path):
    start = state(-40, 0.5, EAST, 9)
    shifted = roads.net(offset=(5000.0, -300.0))
    plain = run(roads.write(tmp_path / "a", moving(30, start)), 30)
    moved = run(roads.write(tmp_path / "b", moving(30, start), net_text=shifted), 30)
    for one, other in zip(plain, moved, strict=True):
        assert other.boxes == pytest.approx(one.boxes, abs=1e-6)


def test_nothing_is_written_into_the_folder(tmp_path):
    folder = roads.write(tmp_path / "f", moving(30, state(-40, 0, EAST, 9)))
    before = {path: path.read_bytes() for path in folder.iterdir()}
    run(folder, 5)
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


# -- SUMO drives ----------------------------------------------------------------------------------


def test_cars_drive_on_through_the_junction_and_leave_at_the_nets_end(tmp_path):
    seen = run(roads.write(tmp_path / "f", moving(30, state(60, 0, EAST, 13)), ego=AWAY), 120)
    assert max(s.box_of(30)[Box.X] for s in seen if s.box_of(30) is not None) > 190
    assert seen[-1].box_of(30) is None


def test_speeds_are_what_positions_show_where_the_net_counts_lanes_too_long(tmp_path):
    folder = roads.write(
        tmp_path / "f", moving(30, state(-60, 0, EAST, 10)), net_text=roads.net(length_factor=1.7)
    )
    boxes = np.array([s.box_of(30) for s in run(folder, 40)])
    assert np.diff(boxes[:, Box.X]) == pytest.approx(0.1 * boxes[1:, Box.V], abs=0.01)


def test_who_is_too_near_or_too_fast_gets_used_to_it_gently(tmp_path):
    """Left alone, SUMO brakes by 4.5 to 9 m/s^2 at once."""
    near = [moving(30, state(-40, 0, EAST, 12)), moving(31, state(-49, 0, EAST, 12))]
    fast = moving(32, state(0, -80, NORTH, roads.LIMIT + 5))
    seen = run(roads.write(tmp_path / "f", *near, fast), 50)
    for obstacle in (30, 31, 32):
        assert accelerations(seen, obstacle).min() > -4.0
    assert seen[50].box_of(32)[Box.V] < roads.LIMIT + 0.1


# -- SUMO's cars heed the ego vehicle -------------------------------------------------------------


def gap_to_ego(seen: list[Snapshot], ego: Array, obstacle: int) -> float:
    """The least gap [m] between a standing ego vehicle (5,) and an obstacle."""
    boxes = np.array([s.box_of(obstacle) for s in seen])
    return float(separation(ego[None], boxes[:, None]).min())


@pytest.mark.parametrize(
    ("ego", "other"),
    [
        (state(0, 0, EAST, 0), state(-50, 0, EAST, 12)),  # on its lane
        (state(100, 0, EAST, 0), state(50, 0, EAST, 12)),  # in the junction
        (state(0, 0, EAST, 0), state(0, -50, NORTH, 12)),  # across its lane
        (state(-1.5, 0, EAST, 0), state(0, -50, NORTH, 12)),  # with its front only
        (state(0, 1.9, EAST, 0), state(-50, 0, EAST, 12)),  # half beside its lane
        (state(0.5, 2, EAST + 1.0, 0), state(-50, 0, EAST, 12)),  # askew
    ],
)
def test_cars_stop_for_a_standing_ego_vehicle(tmp_path, ego, other):
    folder = roads.write(tmp_path / "f", moving(30, other), ego=ego)
    loaded = load(folder)
    start = loaded.problems[0].start.copy()
    start[[State.X, State.Y]] += loaded.origin
    seen = run(folder, 100)
    assert gap_to_ego(seen, start, 30) > 0.3
    assert seen[100].box_of(30)[Box.V] < 0.2
    assert gap_to_ego(seen, start, 30) < 6.0, "it comes near"
    assert accelerations(seen, 30).min() > -7.1


def test_cars_pass_an_ego_vehicle_that_is_not_in_their_way(tmp_path):
    ego = state(-6, 0, EAST, 0)  # its front is 2.9 m from the middle of the crossing lane
    seen = run(roads.write(tmp_path / "f", moving(30, state(0, -50, NORTH, 12)), ego=ego), 80)
    assert seen[80].box_of(30)[Box.Y] > 20


@pytest.fixture
def crossings(monkeypatch):
    """Vehicles yield to each other at crossings unknown to SUMO."""
    monkeypatch.setattr("mpcplan.sumo.inserted.Courtesy", partial(Courtesy, crossings=True))


@pytest.mark.parametrize("ahead", [20, 30, 40, 50])
def test_crossing_cars_let_each_other_pass(tmp_path, crossings, ahead):
    others = [moving(30, state(-40, 0, EAST, 10)), moving(31, state(0, -ahead, NORTH, 10))]
    seen = run(roads.write(tmp_path / "f", *others, ego=AWAY), 100)
    assert not any(touch(snapshot) for snapshot in seen)
    for i, column in ((30, Box.X), (31, Box.Y)):
        assert max(s.box_of(i)[column] for s in seen if s.box_of(i) is not None) > 10


def test_without_that_they_do_not_see_each_other(tmp_path):
    """The reason for it: SUMO knows of no crossing there."""
    others = [moving(30, state(-40, 0, EAST, 10)), moving(31, state(0, -40, NORTH, 10))]
    seen = run(roads.write(tmp_path / "f", *others, ego=AWAY), 60)
    assert any(touch(snapshot) == [(30, 31)] for snapshot in seen)


@pytest.mark.parametrize("ahead", [26, 30, 40])
def test_at_crossings_the_ego_vehicle_is_one_of_them(tmp_path, crossings, ahead):
    """It comes first and goes on; who comes later lets it pass."""
    ego, other = state(-25, 0, EAST, 9), state(0, -ahead, NORTH, 8)
    loaded = load(roads.write(tmp_path / "f", moving(30, other), ego=ego))
    drive = goes(loaded)
    with closing(InsertedTraffic(loaded, loaded.problems[0])) as traffic:
        for step in range(1, 60):
            traffic.advance(step, drive(step))
            assert separation(drive(step)[None], traffic.at(step).boxes[:, None]).min() > 0.3


# -- who is not driven by SUMO --------------------------------------------------------------------


def test_pedestrians_go_as_recorded_and_cars_wait_for_them(tmp_path):
    walk = moving(40, state(0, -2.4, NORTH, 0.5), 90, ObstacleType.PEDESTRIAN, Circle(0.4))
    seen = run(roads.write(tmp_path / "f", walk, moving(30, state(-40, 0, EAST, 10))), 100)
    for step in (0, 1, 50, 90):
        assert seen[step].box_of(40)[[Box.X, Box.Y]] == pytest.approx([0, -2.4 + 0.05 * step])
    assert not any(touch(snapshot) for snapshot in seen)
    assert min(s.box_of(30)[Box.V] for s in seen) < 1.0
    assert seen[100].box_of(40)[Box.Y] == pytest.approx(2.6), "recorded to the end: it goes on"


def test_who_was_recorded_for_a_while_and_left_is_gone(tmp_path):
    short = moving(40, state(0, -20, EAST, 1.0), 5, ObstacleType.PEDESTRIAN, Circle(0.4))
    long = moving(41, state(0, -30, EAST, 1.0), 20, ObstacleType.PEDESTRIAN, Circle(0.4))
    seen = run(roads.write(tmp_path / "f", short, long), 25)
    assert [s.ids for s in (seen[5], seen[6], seen[25])] == [(40, 41), (41,), (41,)]


@pytest.mark.parametrize("across", [EAST + 2.0, math.pi])
def test_who_drives_across_or_against_lanes_is_played_back_with_a_note(tmp_path, across):
    loaded = load(roads.write(tmp_path / "f", moving(30, state(-40, 0, across, 3), 3)))
    with closing(InsertedTraffic(loaded, loaded.problems[0])) as traffic:
        assert traffic.log()["30"]["moved"] == "as recorded"
        assert [n for n in traffic.notes if "no lane leads their way: 30" in n] == [*traffic.notes]


@pytest.mark.parametrize(("y", "passes"), [(0.0, False), (1.5, False), (3.2, True)])
def test_standing_obstacles_block_those_whose_way_they_stand_in(tmp_path, y, passes):
    there = standing(50, state(0, y, EAST, 0))
    seen = run(roads.write(tmp_path / "f", there, moving(30, state(-50, 0, EAST, 10))), 120)
    assert all(s.box_of(50) == pytest.approx([0, y, 0, 0, 4.5, 1.8], abs=1e-9) for s in seen)
    assert (seen[120].box_of(30)[Box.X] > 10) == passes
    assert not any(touch(snapshot) for snapshot in seen)


# -- who comes later ------------------------------------------------------------------------------


def test_later_obstacles_come_in_exactly_then(tmp_path):
    later = state(-60, 0.3, EAST, 9, step=7)
    seen = run(roads.write(tmp_path / "f", moving(30, later), moving(31, AWAY)), 12)
    assert [30 in s.ids for s in seen] == [False] * 7 + [True] * 6
    assert seen[7].box_of(30) == pytest.approx([-60, 0.3, 0, 9, 4.5, 1.8], abs=1e-9)
    assert seen[12].box_of(30)[Box.X] == pytest.approx(-60 + 0.5 * 9, abs=0.8)


def later(tmp_path: Path, until: int, steps: int) -> tuple[list[Snapshot], tuple[str, ...]]:
    """Obstacle 30 is to come in at step 5, where the ego vehicle stands until it drives off."""
    loaded = load(
        roads.write(
            tmp_path / "f", moving(30, state(-60, 0, EAST, 9, step=5)), ego=state(-60, 0, EAST, 0)
        )
    )
    with closing(InsertedTraffic(loaded, loaded.problems[0])) as traffic:
        for step in range(1, steps + 1):
            now = loaded.problems[0].start.copy()
            now[State.X] += 1.5 * max(step - until, 0)
            now[State.V] = 15.0 if step > until else 0.0
            traffic.advance(step, now)
        return [traffic.at(step) for step in range(steps + 1)], traffic.notes


def test_who_finds_its_place_taken_waits(tmp_path):
    seen, notes = later(tmp_path, 20, 60)
    first = next(s for s in seen if 30 in s.ids)
    assert 20 < first.step < 40
    assert first.box_of(30)[Box.V] == 9
    assert notes == ("obstacles came in late, since their place was taken: 30",)


def test_who_finds_its_place_taken_for_long_is_left_out(tmp_path):
    seen, notes = later(tmp_path, 5 + WAIT_STEPS + 1, WAIT_STEPS + 30)
    assert not any(s.ids for s in seen)
    assert notes == ("obstacles never came in, since their place was taken: 30",)


# -- the interface --------------------------------------------------------------------------------


def test_steps_come_one_after_another(tmp_path):
    loaded = load(roads.write(tmp_path / "f", moving(30, state(-40, 0, EAST, 9))))
    with closing(open_traffic(loaded, loaded.problems[0])) as traffic:
        assert isinstance(traffic, InsertedTraffic)
        with pytest.raises(TrafficError, match="time step 2 does not follow"):
            traffic.advance(2, loaded.problems[0].start)


def test_a_failing_begin_leaves_no_simulation_alive(tmp_path, monkeypatch):
    loaded = load(roads.write(tmp_path / "f", moving(30, state(-40, 0, EAST, 9))))

    def refuse(*_: object) -> None:
        raise libsumo.TraCIException("no")

    with monkeypatch.context() as patch:
        patch.setattr("mpcplan.sumo.session.libsumo.simulationStep", refuse)
        with pytest.raises(TrafficError, match=r"SUMO stopped at 0\.0 s: no"):
            InsertedTraffic(loaded, loaded.problems[0])
    InsertedTraffic(loaded, loaded.problems[0]).close()


def test_an_ego_vehicle_off_all_roads_and_back(tmp_path):
    loaded = load(roads.write(tmp_path / "f", moving(30, state(-40, 0, EAST, 9))))
    with closing(InsertedTraffic(loaded, loaded.problems[0])) as traffic:
        for step in range(1, 10):
            now = loaded.problems[0].start.copy()
            now[State.Y] += 40.0 if 3 < step < 7 else 0.0
            traffic.advance(step, now)
        assert traffic.at(9).box_of(30) is not None


DIGEST = """
import hashlib, sys
sys.path.insert(0, sys.argv[1])
import test_sumo_traffic as tests
from pathlib import Path
print(tests.digest(Path(sys.argv[2])))
"""


def digest(folder: Path) -> str:
    """Of everything that is seen in 50 steps beside a slow ego vehicle."""
    seen = run(folder, 50, goes)
    parts = (repr((s.ids, s.kinds)).encode() + s.boxes.tobytes() for s in seen)
    return hashlib.sha256(b"".join(parts)).hexdigest()


def digests(folder: Path) -> Iterator[str]:
    """The same in fresh processes, with other hash seeds."""
    for seed in ("1", "2"):
        done = subprocess.run(
            [sys.executable, "-c", DIGEST, str(Path(__file__).parent), str(folder)],
            capture_output=True, text=True, check=True, env={"PYTHONHASHSEED": seed},
        )  # fmt: skip
        yield done.stdout.strip()


@pytest.mark.slow
def test_the_same_again_in_fresh_processes(tmp_path):
    others = [moving(30 + i, state(-90 + 25 * i, 0.2 * i, EAST, 8 + i)) for i in range(5)]
    others += [moving(40 + i, state(0, -90 + 25 * i, NORTH, 9 - i)) for i in range(3)]
    folder = roads.write(tmp_path / "f", *others, ego=state(60, 0, EAST, 5))
    assert set(digests(folder)) == {digest(folder)}


# -- public interactive folders -------------------------------------------------------------------


PUBLIC = (
    "ZAM_Tjunction-1_101_I-1-1",
    "USA_US101-13_4_I-1-1",
    "DEU_Flensburg-12_1_I-1-1",
    "CHN_Sha-6_4_I-1-1",
    "RUS_Bicycle-13_1_I-1-1",
    "ESP_Berga-10_3_I-1-1",
)


@pytest.fixture(params=PUBLIC)
def public(request: pytest.FixtureRequest) -> Path:
    if not (SHARED / request.param).is_dir():
        pytest.skip("the public interactive folders are not here")
    return SHARED / request.param


@pytest.mark.slow
def test_public_folders_begin_as_recorded_and_go_on_sensibly(public, crossings):
    loaded = load(public)
    expected = record(loaded.scenario)
    with closing(InsertedTraffic(loaded, loaded.problems[0])) as traffic:
        assert traffic.at(0).ids == expected.ids
        assert traffic.at(0).boxes == pytest.approx(expected.boxes[:, 0], abs=1e-9)
        for step in range(1, 51):
            traffic.advance(step, goes(loaded)(step))
        seen, log = [traffic.at(step) for step in range(51)], traffic.log()
    driven = {int(name) for name, entry in log.items() if entry["moved"] == "by SUMO"}
    assert all(log[str(obstacle)]["error"] < 0.01 for obstacle in driven)
    moves = [(a, b, i) for a, b in pairwise(seen) for i in driven]
    for before, after, obstacle in moves:
        if obstacle in before.ids and obstacle in after.ids:
            one, other = before.box_of(obstacle), after.box_of(obstacle)
            way = np.hypot(*(other - one)[[Box.X, Box.Y]])
            assert way < 0.1 * max(one[Box.V], other[Box.V]) + 0.4, (obstacle, after.step)
            assert abs(other[Box.V] - one[Box.V]) < 1.3, (obstacle, after.step)
    assert {pair for s in seen for pair in touch(s)} == set(touch(seen[0]))
