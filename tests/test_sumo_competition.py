"""The traffic of the competition's folders: the organisers' where their SUMO runs, and ours to use.

The road made by the tests serves for everything that holds with any version of SUMO.
"""

import hashlib
import math
import os
import subprocess
import sys
from pathlib import Path

import libsumo
import made
import made_sumo
import numpy as np
import pytest
from commonroad.common.file_reader import CommonRoadFileReader

from mpcplan.errors import StartTakenError, TrafficError
from mpcplan.observation import Box
from mpcplan.scenario import LoadedScenario, load
from mpcplan.sumo.organisers import ORGANISERS_SUMO, Simulation, version
from mpcplan.sumo.presimulated import PresimulatedTraffic, RoadUsers
from mpcplan.sumo.session import Session
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import centres

COMPETITION = Path(__file__).resolve().parents[2] / "shared" / "scenarios" / "competition"
organisers_sumo = pytest.mark.skipif(
    version() != ORGANISERS_SUMO,
    reason=f"the organisers' SUMO {ORGANISERS_SUMO} is not installed, but {version()}",
)
PRESIMULATED = 2.0  # s, of the road made by the tests
OWN_ID = 100  # of its planning problem, the highest of its file


def competition(name: str) -> LoadedScenario:
    """A published competition folder."""
    if not (COMPETITION / name).is_dir():
        pytest.skip("the public competition folders are not here")
    return load(COMPETITION / name)


def traffic_of(loaded: LoadedScenario) -> PresimulatedTraffic:
    return PresimulatedTraffic(loaded, loaded.problems[0])


@pytest.fixture
def traffic(tmp_path):
    """Traffic on the road made by the tests; the ego vehicle starts 60 m ahead of SUMO's."""
    running = traffic_of(load(made_sumo.write(tmp_path / "folder")))
    yield running
    running.close()


def standing(loaded: LoadedScenario) -> Array:
    """(5,) the start at rest."""
    state = loaded.problems[0].start.copy()
    state[State.V] = 0.0
    return state


# ---------------------------------------------------------------- the organisers' traffic


def fronts(boxes: Array) -> Array:
    """(n, 2) middles of the front bumpers [m]."""
    heading = np.column_stack([np.cos(boxes[:, Box.PSI]), np.sin(boxes[:, Box.PSI])])
    return boxes[:, : Box.PSI] + boxes[:, Box.LENGTH, None] / 2 * heading


@organisers_sumo
@pytest.mark.parametrize(
    ("name", "count"), [("DEU_Aachen-2_1_I-1", 9), ("DEU_Cologne-63_5_I-1", 15)]
)
def test_every_initial_state_of_the_published_folders(name, count):
    """Front bumpers: the files' headings, unlike the organisers' at step 0, are of the motion."""
    loaded = competition(name)
    traffic = traffic_of(loaded)
    traffic.close()
    found = traffic.at(0).boxes
    obstacles = loaded.scenario.dynamic_obstacles
    assert len(obstacles) == count
    recorded = np.array(
        [
            [*o.initial_state.position, o.initial_state.orientation, o.initial_state.velocity,
             o.obstacle_shape.length, o.obstacle_shape.width]
            for o in obstacles
        ]
    )  # fmt: skip
    gaps = np.linalg.norm(fronts(recorded)[:, None] - fronts(found)[None], axis=-1)
    same = found[np.argmin(gaps, axis=1)]
    assert gaps.min(axis=1).max() < 5e-4
    np.testing.assert_allclose(same[:, Box.V], recorded[:, Box.V], atol=1e-3)
    np.testing.assert_allclose(same[:, Box.LENGTH :], recorded[:, Box.LENGTH :], atol=1e-9)
    assert traffic.notes == ()


# (length, width, {time step: (x, y, speed)}) in the published recording of the organisers'
# simulator on DEU_Cologne-63_5_I-1 with the ego vehicle driven by SUMO
RECORDING = [
    (4.458625601999501, 1.9353834342344947, {0: (-0.8611, -75.6524, 8.4672),
                                             3: (0.0204, -73.2701, 8.4672)}),
    (5.0358454607831575, 1.9282728517827874, {0: (-44.7027, -194.1174, 10.7356),
                                              4: (-43.1945, -190.0421, 10.8854),
                                              20: (-38.9473, -178.5652, 6.0361),
                                              27: (-37.4486, -174.5154, 6.3984)}),
    (None, None, {29: (-29.5184, -143.0141, 12.3349), 62: (-15.3420, -104.7083, 12.4246)}),
]  # fmt: skip


@organisers_sumo
def test_the_published_recording():
    """With SUMO at the ego vehicle's wheel the traffic is as the organisers recorded it."""
    loaded = competition("DEU_Cologne-63_5_I-1")
    folder = loaded.folder
    simulation, users = Simulation(folder, folder.settings), RoadUsers(1)
    seen = []
    try:
        simulation.presimulate(folder.settings.presimulation_steps)
        for step in range(63):
            seen.append(users.now(step, simulation.users())[1])
            simulation.presimulate(1)
    finally:
        simulation.close()
    for length, width, states in RECORDING:
        for step, (x, y, speed) in states.items():
            boxes = seen[step]
            nearest = boxes[np.argmin(np.hypot(boxes[:, Box.X] - x, boxes[:, Box.Y] - y))]
            np.testing.assert_allclose(nearest[[Box.X, Box.Y]], [x, y], atol=2e-4)
            assert nearest[Box.V] == pytest.approx(speed, abs=2e-4)
            if length:
                assert nearest[Box.LENGTH] == length
                assert nearest[Box.WIDTH] == width


@organisers_sumo
def test_the_ego_vehicle_arrives_at_its_start():
    for name in ("DEU_Aachen-2_1_I-1", "DEU_Cologne-63_5_I-1"):
        loaded = competition(name)
        simulation = Simulation(loaded.folder, loaded.folder.settings)
        try:
            simulation.presimulate(loaded.folder.settings.presimulation_steps)
            box = simulation.ego_box()
        finally:
            simulation.close()
        start = centres(loaded.problems[0].start[None])[0] + loaded.origin
        np.testing.assert_allclose(box[:2], start, atol=2e-4)
        assert box[Box.V] == pytest.approx(loaded.problems[0].start[State.V], abs=2e-4)


@pytest.mark.skipif(version() == ORGANISERS_SUMO, reason="the organisers' SUMO leaves it free")
def test_the_start_on_cologne_is_taken_with_other_versions():
    with pytest.raises(StartTakenError) as caught:
        traffic_of(competition("DEU_Cologne-63_5_I-1"))
    assert caught.value.overlap > 0
    for words in (version(), ORGANISERS_SUMO, "the start is taken"):
        assert words in str(caught.value)


@pytest.mark.parametrize("name", ["DEU_Aachen-2_1_I-1", "DEU_Frankfurt-34_11_I-1"])
def test_published_folders_run(name):
    loaded = competition(name)
    traffic = traffic_of(loaded)
    try:
        for step in range(1, 21):
            traffic.advance(step, standing(loaded))
    finally:
        traffic.close()
    taken = {lanelet.lanelet_id for lanelet in loaded.scenario.lanelet_network.lanelets}
    for step in range(21):
        seen = traffic.at(step)
        assert len(seen.ids) > 20
        assert not taken & set(seen.ids)
        assert np.isfinite(seen.boxes).all()
        assert np.abs(seen.boxes[:, :2]).max() < 1e4  # m: local, though Frankfurt's file is in UTM


# ---------------------------------------------------------------- with any version of SUMO


def test_others_at_the_start(traffic):
    seen = traffic.at(0)
    assert seen.step == 0
    assert seen.ids == (OWN_ID + 1, OWN_ID + 2, OWN_ID + 3)
    assert seen.kinds == ("car",) * 3
    road = seen.boxes[:, [Box.X, Box.Y]] - (made.at(0, 0) - np.round(made.at(100, made.LANE / 2)))
    np.testing.assert_allclose(road[:, 1], np.array([0.5, 1.5, 0.5]) * made.LANE, atol=1e-6)
    np.testing.assert_allclose(seen.boxes[:, Box.PSI], 0, atol=1e-9)
    travelled = road[:, 0] + seen.boxes[:, Box.LENGTH] / 2 - np.array([40, 10, 5])
    mean = travelled / (PRESIMULATED - np.array([0, 0, made_sumo.LATE]))
    assert (mean > 8).all()
    assert (mean < 1.2 * made_sumo.SPEED).all()


def test_bodies_are_drawn_in_the_organisers_order(traffic):
    """Width, length, then the minimum gap, acceleration and deceleration of each vehicle; maximum
    speed is no interval here."""
    draw = np.random.RandomState(made_sumo.SEED).uniform
    bodies = {}
    for vehicle in ("0", "1", made_sumo.EGO, "3"):  # the last one enters later
        width, length = draw(1.8, 2.1), draw(4.0, 5.5)
        gap, accel, decel = draw(3.5, 5.0), draw(2.0, 2.9), draw(4, 7.5)
        bodies[vehicle] = (length, width)
        assert libsumo.vehicle.getMinGap(vehicle) == gap
        assert libsumo.vehicle.getAccel(vehicle) == accel
        assert libsumo.vehicle.getDecel(vehicle) == decel
        assert libsumo.vehicle.getMaxSpeed(vehicle) == 50
    found = traffic.at(0).boxes[:, [Box.LENGTH, Box.WIDTH]]
    np.testing.assert_array_equal(found, [bodies[vehicle] for vehicle in ("0", "1", "3")])


def test_vehicles_without_intervals_use_no_random_numbers(tmp_path):
    """A bicycle's size is fixed: the vehicle after it is drawn as if it had one number less."""
    bicycle = '<vType id="bike" vClass="bicycle"/>'
    bicycle += made_sumo.vehicle("-b", 70, speed=4, more='type="bike"')
    loaded = load(made_sumo.write(tmp_path / "folder", routes=bicycle))
    traffic = traffic_of(loaded)
    traffic.close()
    draw = np.random.RandomState(made_sumo.SEED).uniform
    draw(1, 1.4), draw(2.5, 3.5)
    width, length = draw(1.8, 2.1), draw(4.0, 5.5)
    seen = traffic.at(0)
    assert seen.kinds == ("bicycle", "car", "car", "car")
    np.testing.assert_array_equal(seen.boxes[0, [Box.LENGTH, Box.WIDTH]], [2.0, 0.68])
    np.testing.assert_array_equal(seen.boxes[1, [Box.LENGTH, Box.WIDTH]], [length, width])


def test_sumo_is_told_where_the_ego_vehicle_is(traffic):
    loaded_start = traffic._state
    state = loaded_start.copy()
    for step in range(1, 6):
        state = state.copy()
        state[State.X] += 0.7
        state[State.Y] += 0.1
        state[State.V] = 7.0
        traffic.advance(step, state)
        x, y = libsumo.vehicle.getPosition(made_sumo.EGO)
        centre = centres(state[None])[0] + traffic._origin
        np.testing.assert_allclose([x - 2.5, y], centre, atol=1e-6)  # ego_veh_length 5 m
        assert libsumo.vehicle.getSpeed(made_sumo.EGO) == 7.0
    assert "m from its start" in traffic.notes[0]


def test_others_react_to_the_ego_vehicle(tmp_path):
    """Who comes from behind stops behind a standing ego vehicle, or passes it in the other lane."""
    routes = made_sumo.vehicle("4", 30)
    loaded = load(made_sumo.write(tmp_path / "folder", routes=routes))
    traffic = traffic_of(loaded)
    state = standing(loaded)
    ego = centres(state[None])[0]
    try:
        for step in range(1, 101):
            traffic.advance(step, state)
            for box in traffic.at(step).boxes:
                apart = np.abs(box[:2] - ego)
                assert apart[0] > 4.5 or apart[1] > 1.8, (step, box)
        behind = [
            box for box in traffic.at(100).boxes
            if box[Box.X] < ego[0] and abs(box[Box.Y] - ego[1]) < 1
        ]  # fmt: skip
        passed = [box for box in traffic.at(100).boxes if box[Box.X] > ego[0]]
        assert all(box[Box.V] < 1 for box in behind)
        assert behind or passed
    finally:
        traffic.close()


def test_a_taken_start_is_the_cause(tmp_path):
    first = traffic_of(load(made_sumo.write(tmp_path / "free")))
    first.close()
    box = first.at(0).boxes[1]
    x = box[Box.X] + first._origin[0] - made.FAR[0]
    start = made.state(x + 1.0, 1.5 * made.LANE, 5)
    taken = made_sumo.write(tmp_path / "taken", made.problem(OWN_ID, start))
    with pytest.raises(StartTakenError) as caught:
        traffic_of(load(taken))
    assert caught.value.obstacle == OWN_ID + 2
    assert caught.value.version == version()
    width = box[Box.WIDTH] / 2 + 1.674 / 2
    assert caught.value.overlap == pytest.approx(width, abs=1e-6)
    for words in (f"obstacle {OWN_ID + 2}", version(), ORGANISERS_SUMO, "step 0"):
        assert words in str(caught.value)
    traffic_of(load(tmp_path / "free")).close()  # nothing was left running


def test_an_ego_vehicle_that_left_is_brought_back(traffic):
    state = traffic._state.copy()
    traffic.advance(1, state)
    libsumo.vehicle.remove(made_sumo.EGO)
    for step in (2, 3):
        traffic.advance(step, state)
    x, y = libsumo.vehicle.getPosition(made_sumo.EGO)
    np.testing.assert_allclose([x - 2.5, y], centres(state[None])[0] + traffic._origin, atol=1e-6)
    assert "added again" in traffic.notes[-1]


@pytest.mark.parametrize(
    ("depart", "options"), [(3.0, ""), (1.1, '<x><max-depart-delay value="0.1"/></x>')]
)
def test_an_ego_vehicle_that_did_not_enter_in_time(tmp_path, depart, options):
    """It departs later than the start, or SUMO gave up to insert it."""
    path = made_sumo.write(tmp_path / "folder", config=options)
    file = path / f"{made_sumo.NAME}.vehicle.rou.xml"
    ego = made_sumo.vehicle(made_sumo.EGO, 20)
    assert ego in file.read_text()
    text = file.read_text().replace(ego, "")
    late = made_sumo.vehicle(made_sumo.EGO, 20, depart=depart)
    block = made_sumo.vehicle("block", 22, depart=1, speed=0) if options else ""
    file.write_text(text.replace("</routes>", f"{block}{late}</routes>"))
    traffic = traffic_of(load(path))
    try:
        assert "not on the road" in traffic.notes[0]
        state = traffic._state
        for step in range(1, 31):
            traffic.advance(step, state)
            centre = centres(state[None])[0] + traffic._origin + [2.5, 0]
            np.testing.assert_allclose(
                libsumo.vehicle.getPosition(made_sumo.EGO), centre, atol=1e-6
            )
        assert ("added again" in traffic.notes[-1]) == bool(options)
    finally:
        traffic.close()


def test_an_ego_vehicle_beyond_the_road_does_no_harm(traffic):
    state = traffic._state.copy()
    for step in range(1, 60):
        state = state.copy()
        state[State.X] += 3
        state[State.V] = 30
        traffic.advance(step, state)
    assert len(traffic.at(59).ids) <= 3


def test_pedestrians_are_seen(tmp_path):
    walker = '<person id="p" depart="0" departPos="120"><walk edges="road"/></person>'
    loaded = load(made_sumo.write(tmp_path / "folder", routes=walker))
    traffic = traffic_of(loaded)
    traffic.close()
    seen = traffic.at(0)
    assert seen.kinds[-1] == "pedestrian"
    assert seen.boxes[-1, Box.X] > seen.boxes[:-1, Box.X].max()


def test_substeps(tmp_path):
    """Two steps of SUMO in one time step: half the way of the ego vehicle in each."""
    path = made_sumo.write(tmp_path / "folder")
    (path / "simulation_config.p").write_bytes(made_sumo.settings(delta_steps=2))
    loaded = load(path)
    traffic = traffic_of(loaded)
    try:
        assert libsumo.simulation.getDeltaT() == 0.05
        assert libsumo.simulation.getTime() == pytest.approx(PRESIMULATED)
        state = traffic._state.copy()
        traffic.advance(1, state)
        after = state.copy()
        after[State.X] += 1.0
        before = traffic.at(1).boxes
        traffic.advance(2, after)
        assert libsumo.simulation.getTime() == pytest.approx(PRESIMULATED + 0.2)
        moved = (traffic.at(2).boxes - before)[:, Box.X]
        mean = (traffic.at(2).boxes + before)[:, Box.V] / 2
        np.testing.assert_allclose(moved, 0.1 * mean, atol=0.02)
        assert libsumo.vehicle.getDistance(made_sumo.EGO) > 0
    finally:
        traffic.close()


def test_what_sumo_refuses_ends_in_an_error(tmp_path):
    wrong = made_sumo.vehicle("9", 150).replace('"road"', '"nowhere"')
    with pytest.raises(TrafficError, match=r"SUMO"):
        traffic_of(load(made_sumo.write(tmp_path / "folder", routes=wrong)))
    traffic_of(load(made_sumo.write(tmp_path / "next"))).close()


def test_time_steps_follow_each_other(traffic):
    with pytest.raises(TrafficError, match="time step 2"):
        traffic.advance(2, traffic._state)


def test_static_obstacles_are_seen(tmp_path):
    path = made_sumo.write(tmp_path / "folder")
    parked = [o for o in made.every_kind_of_obstacle() if o.obstacle_id == 32]
    written = made.write(path, made.problem(100, made.state(100, 1.75, 10)), obstacles=parked)
    written.replace(path / f"{made_sumo.NAME}.cr.xml")
    traffic = traffic_of(load(path))
    traffic.close()
    seen = traffic.at(0)
    assert seen.ids == (32, 101, 102, 103)
    assert seen.kinds[0] == "parkedVehicle"
    np.testing.assert_allclose(seen.boxes[0, :2] + traffic._origin, made.at(70, 6))


def test_obstacles_in_the_file_change_nothing(tmp_path, traffic):
    """The .cr.xml of a competition folder records initial states; nothing of it may be used."""
    path = made_sumo.write(tmp_path / "other")
    problem = made.problem(OWN_ID, made.state(100, made.LANE / 2, 10))
    written = made.write(path, problem, obstacles=[made.car(30, 20, 1, 3)])
    written.replace(path / f"{made_sumo.NAME}.cr.xml")
    traffic.close()
    other = traffic_of(load(path))
    other.close()
    assert other.at(0).ids == traffic.at(0).ids
    np.testing.assert_array_equal(other.at(0).boxes, traffic.at(0).boxes)


def test_headings_are_the_organisers():
    """From step 2 on, above walking pace, from the last centre to the present front."""
    users = RoadUsers(7)

    def now(step: int, x: float, y: float, v: float) -> Array:
        return users.now(step, [("a", "car", np.array([x, y, 0.1, v, 4.0, 2.0]))])[1][0]

    c, s = 2 * math.cos(0.1), 2 * math.sin(0.1)
    for step in (0, 1):
        np.testing.assert_allclose(now(step, step, 0.0, 5.0)[:3], [step, 0.0, 0.1], atol=1e-12)
    found = now(2, 2.0, 1.0, 5.0)
    psi = math.atan2(1.0 + s, 1.0 + c)
    centre = [2.0 + c - 2 * math.cos(psi), 1.0 + s - 2 * math.sin(psi), psi]
    np.testing.assert_allclose(found[:3], centre, atol=1e-12)
    np.testing.assert_allclose(now(3, 2.0, 1.0, 0.4)[:3], [2.0, 1.0, 0.1], atol=1e-12)
    fresh = users.now(9, [("b", "car", np.array([0, 0, 0.3, 9.0, 4.0, 2.0]))])
    assert fresh[0] == (8,)
    np.testing.assert_allclose(fresh[1][0, :3], [0, 0, 0.3], atol=1e-12)


# ---------------------------------------------------------------- determinism

RUN = """
import hashlib, sys
from mpcplan.scenario import load
from mpcplan.sumo.presimulated import PresimulatedTraffic
loaded = load(sys.argv[1])
state = loaded.problems[0].start
traffic = PresimulatedTraffic(loaded, loaded.problems[0])
digest = hashlib.sha256()
for step in range(41):
    if step:
        state = state + [0.05 * step, 0, 0, 0, 0]
        traffic.advance(step, state)
    seen = traffic.at(step)
    digest.update(repr((seen.ids, seen.kinds)).encode() + seen.boxes.tobytes())
traffic.close()
sys.stdout.write(digest.hexdigest())
"""


def digest(folder: Path, seed: str) -> str:
    """What a fresh process saw, in 64 digits."""
    run = subprocess.run(
        [sys.executable, "-c", RUN, str(folder)], capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONHASHSEED": seed},
    )  # fmt: skip
    assert len(run.stdout) == len(hashlib.sha256().hexdigest())
    return run.stdout


def test_fresh_processes_see_the_same_bytes(tmp_path):
    folder = made_sumo.write(tmp_path / "folder")
    assert digest(folder, "1") == digest(folder, "2")


@pytest.mark.parametrize("name", ["DEU_Aachen-2_1_I-1", "DEU_Frankfurt-34_11_I-1"])
def test_fresh_processes_see_the_same_bytes_in_published_folders(name):
    competition(name)
    assert digest(COMPETITION / name, "1") == digest(COMPETITION / name, "2")


def test_a_second_run_in_the_same_process_sees_the_same(tmp_path):
    loaded = load(made_sumo.write(tmp_path / "folder"))
    runs = []
    for _ in range(2):
        traffic = traffic_of(loaded)
        for step in range(1, 31):
            traffic.advance(step, standing(loaded))
        traffic.close()
        runs.append(np.vstack([traffic.at(step).boxes for step in range(31)]))
    np.testing.assert_array_equal(*runs)


def test_only_one_simulation_is_alive(traffic, tmp_path):
    with pytest.raises(TrafficError, match="another"):
        traffic_of(load(made_sumo.write(tmp_path / "second")))
    traffic.close()
    traffic.close()
    assert Session._alive is None


def test_the_made_road_agrees_with_its_net(tmp_path):
    """The tests' own net and map lie upon each other."""
    path = made_sumo.write(tmp_path / "folder")
    scenario, _ = CommonRoadFileReader(str(path / f"{made_sumo.NAME}.cr.xml")).open()
    right = scenario.lanelet_network.find_lanelet_by_id(1).center_vertices[0]
    text = (path / f"{made_sumo.NAME}.net.xml").read_text()
    assert f'shape="{right[0]},{right[1]} ' in text
