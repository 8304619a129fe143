"""Interactive twins of recorded scenarios: what is made, that SUMO drives in it, and what fails."""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import made
import numpy as np
import pytest
import shapely

from mpcplan import cli
from mpcplan.errors import InputError
from mpcplan.observation import Box
from mpcplan.scenario import load
from mpcplan.sumo import map_conversion
from mpcplan.sumo.inserted import InsertedTraffic
from mpcplan.sumo.map_conversion import convert_map
from mpcplan.sumo.twin import Twin, make_twin, twin_id

ROOT = Path(__file__).resolve().parents[1]
CROSSING = ROOT / "scenarios" / "ZAM_TJunction-1_1_T-1.xml"
LIMITED = ROOT / "scenarios" / "ZAM_GoalIntervals-1_1_T-1.xml"
TWO_EGOS = ROOT / "scenarios" / "C-ZAM_ParallelEgos-1_1_T-1.xml"
LIGHT = """<trafficLight id="900"><cycle><cycleElement><duration>30</duration><color>red</color>
</cycleElement><timeOffset>0</timeOffset></cycle><active>true</active></trafficLight>"""
CENTIMETRE = 0.01  # m, netconvert writes two decimals
PARTS = ("commonroad_sumo", "sumo")  # modules of the extra's packages
needs_converter = pytest.mark.skipif(
    any(importlib.util.find_spec(name) is None for name in PARTS),
    reason="the extra 'twin' is not installed: pip install '.[twin]'",
)


@pytest.fixture(scope="module")
def crossing(tmp_path_factory) -> Twin:
    """The twin of a T-junction, made once."""
    return make_twin(CROSSING, tmp_path_factory.mktemp("twins") / "deep" / "crossing")


def net_of(twin: Twin) -> ElementTree.Element:
    """The SUMO net of a twin."""
    return ElementTree.parse(twin.folder / f"{twin.id}.net.xml").getroot()


def lanes(twin: Twin) -> list[tuple[ElementTree.Element, np.ndarray]]:
    """The lanes of a twin's net with their points (n, 2) [m]."""
    found = []
    for lane in net_of(twin).iter("lane"):
        points = [point.split(",") for point in lane.get("shape", "").split()]
        found.append((lane, np.array(points, float)))
    return found


# -- what is made ---------------------------------------------------------------------------------


@needs_converter
def test_the_folder_holds_the_recorded_scenario_and_its_net(crossing):
    loaded, recorded = load(crossing.folder), load(CROSSING)
    assert loaded.interactive and not loaded.folder.presimulated
    assert loaded.id == crossing.id == "ZAM_TJunction-1_1_I-1-1"
    names = {file.name.removeprefix(crossing.id) for file in crossing.folder.iterdir()}
    assert names == {".cr.xml", ".net.xml", ".sumo.cfg", ".vehicles.rou.xml"}
    assert np.array_equal(loaded.problems[0].start, recorded.problems[0].start)
    assert len(loaded.scenario.obstacles) == len(recorded.scenario.obstacles) == 3
    own, original = (s.scenario.lanelet_network.lanelets for s in (loaded, recorded))
    assert [x.lanelet_id for x in own] == [x.lanelet_id for x in original]
    assert crossing.notes == ()


@needs_converter
def test_the_net_lies_on_the_lanelets(crossing):
    assert net_of(crossing).find("location").get("netOffset") == "0.00,0.00"
    loaded = load(CROSSING)
    net = shapely.union_all([shapely.LineString(points) for _, points in lanes(crossing)])
    for lanelet in loaded.scenario.lanelet_network.lanelets:
        centre = lanelet.center_vertices + loaded.origin
        assert shapely.distance(net, shapely.points(centre)).max() < 2 * CENTIMETRE


@needs_converter
def test_nets_far_from_the_origin_lie_on_the_lanelets(tmp_path):
    """UTM coordinates: the net is converted in the local frame and moved back."""
    written = made.write(tmp_path, made.problem(100, made.state(20, made.LANE / 2, 10)))
    far = make_twin(written, tmp_path / "far")
    points = np.vstack([points for _, points in lanes(far)])
    low, high = points.min(axis=0), points.max(axis=0)
    assert low == pytest.approx(made.at(0, made.LANE / 2), abs=2 * CENTIMETRE)
    assert high == pytest.approx(made.at(2 * made.LENGTH, 1.5 * made.LANE), abs=2 * CENTIMETRE)
    junctions = [j for j in net_of(far).iter("junction") if not j.get("id", "").startswith(":")]
    for junction in junctions:
        place = np.array([float(junction.get("x", "")), float(junction.get("y", ""))])
        assert (place > low - 1).all() and (place < high + 1).all()


@needs_converter
def test_who_crosses_has_to_yield(crossing):
    """The junction knows its conflicts: the left turn from the side road waits for the others."""
    root = net_of(crossing)
    junction = next(j for j in root.iter("junction") if j.get("type") == "priority")
    responses = [request.get("response", "").count("1") for request in junction.iter("request")]
    assert len(responses) == 6 and sum(n > 0 for n in responses) == 3


@needs_converter
def test_speed_limits_are_those_posted_or_driven(crossing, tmp_path):
    free = {float(x.get("speed")) for x, _ in lanes(crossing) if not x.get("id").startswith(":")}
    assert free == {13.89}  # nobody is faster than 50 km/h
    posted = make_twin(LIMITED, tmp_path / "limited")
    assert {float(lane.get("speed")) for lane, _ in lanes(posted)} == {11.11}  # 40 km/h


@needs_converter
def test_nobody_overtakes_on_the_oncoming_lane(crossing):
    assert not list(net_of(crossing).iter("neigh"))


@needs_converter
def test_same_scenario_same_bytes(crossing, tmp_path):
    again = make_twin(CROSSING, tmp_path / "again")
    for file in sorted(crossing.folder.iterdir()):
        assert (again.folder / file.name).read_bytes() == file.read_bytes(), file.name
    written = b"".join(file.read_bytes() for file in again.folder.iterdir())
    assert str(tmp_path).encode() not in written


@needs_converter
def test_sumo_drives_everybody_from_the_recorded_start(crossing):
    loaded = load(crossing.folder)
    problem = loaded.problems[0]
    first = problem.first_step
    traffic = InsertedTraffic(loaded, problem)
    try:
        for step in range(first + 1, first + 21):
            traffic.advance(step, problem.start)
        log, begin, end = traffic.log(), traffic.at(first), traffic.at(first + 20)
    finally:
        traffic.close()
    assert {entry["moved"] for entry in log.values()} == {"by SUMO"} and len(log) == 3
    assert all(entry["error"] < 1e-3 for entry in log.values())
    assert begin.ids == end.ids
    assert np.hypot(*(end.boxes - begin.boxes)[:, [Box.X, Box.Y]].T).min() > 10.0


@needs_converter
def test_traffic_lights_are_left_out_with_a_note(tmp_path):
    """The converter fails on them."""
    file = with_light(tmp_path)
    with pytest.raises(InputError, match=r"the map cannot be converted: commonroad-sumo failed: "):
        convert_map(file, tmp_path / "net.xml")
    twin = make_twin(file, tmp_path / "twin")
    assert "left out 1 traffic lights, which cannot be converted" in twin.notes
    text = (twin.folder / f"{twin.id}.cr.xml").read_text(encoding="utf-8")
    assert "trafficLight" not in text


def with_light(folder: Path) -> Path:
    """The T-junction with a traffic light."""
    root = ElementTree.parse(CROSSING).getroot()
    tags = [element.tag for element in root]
    root.insert(tags.index("intersection"), ElementTree.fromstring(LIGHT))
    ElementTree.SubElement(root.find("lanelet"), "trafficLightRef").set("ref", "900")
    ElementTree.ElementTree(root).write(folder / CROSSING.name)
    return folder / CROSSING.name


@needs_converter
def test_of_several_problems_the_first_stays(tmp_path):
    twin = make_twin(TWO_EGOS, tmp_path / "twin")
    assert twin.id == "ZAM_ParallelEgos-1_1_I-1-1"
    assert [problem.id for problem in load(twin.folder).problems] == [2001]
    assert twin.notes == ("left out planningProblem 2002: an interactive scenario has one",)


@pytest.mark.parametrize(
    ("recorded", "twin"),
    [
        ("DEU_A9-1_1_T-1", "DEU_A9-1_1_I-1-1"),
        ("DEU_A9-2_3_T-12", "DEU_A9-2_3_I-1-12"),
        ("C-USA_US101-20_2_T-1", "USA_US101-20_2_I-1-1"),
        ("DEU_A9-1_1_S-2-3", "DEU_A9-1_1_I-2-3"),
        ("DEU_A9-1_1_I-1-1", "DEU_A9-1_1_I-1-1"),
        ("DEU_A9-1", "DEU_A9-1_1_I-1-1"),
    ],
)
def test_the_twins_id(recorded, twin):
    assert twin_id(recorded) == twin


@pytest.mark.parametrize("wrong", ["", "../x", "DEU_A9", "deu_A9-1_1_T-1", "DEU_A/9-1_1_T-1"])
def test_what_is_no_id_makes_no_file_name(wrong):
    with pytest.raises(InputError, match="benchmarkID"):
        twin_id(wrong)


# -- the command ----------------------------------------------------------------------------------


@needs_converter
def test_the_command_says_what_it_made_and_nothing_else(tmp_path):
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-m", "mpcplan", "twin", str(TWO_EGOS), "--out", str(tmp_path / "twin")],
        capture_output=True, text=True, cwd=tmp_path, check=False,
        env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip
    assert done.returncode == 0 and done.stderr == ""
    assert done.stdout.splitlines() == [
        f"ZAM_ParallelEgos-1_1_I-1-1 in {tmp_path / 'twin'}",
        "note      left out planningProblem 2002: an interactive scenario has one",
        f"drive it  mpcplan solve {tmp_path / 'twin'}",
    ]
    assert [file.name for file in tmp_path.iterdir()] == ["twin"]


def refused(capfd, *arguments: object) -> str:
    """The one line with which the command refuses."""
    assert cli.main(["twin", *map(str, arguments)]) == cli.BAD_INPUT
    said = capfd.readouterr()
    assert said.out == "" and said.err.startswith("error: ") and said.err.count("\n") == 1
    return said.err


@pytest.mark.parametrize(
    ("missing", "word"), [("commonroad_sumo", "commonroad-sumo"), ("sumo", "netconvert")]
)
def test_without_the_converter_the_command_to_install_it_is_named(
    missing, word, capfd, monkeypatch, tmp_path
):
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n: None if n == missing else found(n))
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.delenv("SUMO_HOME", raising=False)
    line = refused(capfd, CROSSING, "--out", tmp_path / "twin")
    assert "pip install commonroad-sumo==2025.1.4 eclipse-sumo==1.28.0" in line
    assert word in line.split("not installed")[0]
    assert not (tmp_path / "twin").exists()


def test_the_packages_named_are_those_of_the_extra():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for package in map_conversion.INSTALL.removeprefix("pip install ").split():
        assert f'"{package}"' in text


@needs_converter
@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda folder: (folder / "out").mkdir() or (folder / "out" / "x").touch(), "something"),
        (lambda folder: (folder / "out").touch(), "something"),
        (lambda folder: (folder / "out").symlink_to("/proc/none/none"), "cannot write"),
    ],
)
def test_what_is_there_already_stays(make, word, capfd, tmp_path):
    make(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    assert word in refused(capfd, CROSSING, "--out", tmp_path / "out")
    assert sorted(tmp_path.rglob("*")) == before


@needs_converter
def test_a_folder_that_cannot_be_made(capfd, tmp_path):
    (tmp_path / "file").touch()
    line = refused(capfd, CROSSING, "--out", tmp_path / "file" / "out")
    assert str(tmp_path / "file" / "out") in line


@needs_converter
@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ('<lanelet id="1">', '<lanelet id="2">', "two elements <lanelet> have the id 2"),
        ("benchmarkID=", "nobenchmarkID=", "benchmarkID"),
        ("ZAM_TJunction-1_1_T-1", "ZAM/TJunction", "benchmarkID"),
        ("<commonRoad", "<roadCommon", ""),
        ('timeStepSize="0.1"', 'timeStepSize="0.2"', "time step"),
    ],
)
def test_broken_scenarios_are_named(old, new, word, capfd, tmp_path):
    text = CROSSING.read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "broken.xml").write_text(text.replace(old, new, 1), encoding="utf-8")
    line = refused(capfd, tmp_path / "broken.xml", "--out", tmp_path / "out")
    assert str(tmp_path / "broken.xml") in line and word in line
    assert not (tmp_path / "out").exists()


@needs_converter
def test_a_folder_is_no_recorded_scenario(crossing, capfd, tmp_path):
    line = refused(capfd, crossing.folder, "--out", tmp_path / "out")
    assert "interactive scenario already" in line


# -- the child process ----------------------------------------------------------------------------


@needs_converter
def test_a_converter_that_hangs_is_ended(tmp_path):
    with pytest.raises(InputError, match=r"did not finish within 0\.05 s"):
        convert_map(CROSSING, tmp_path / "net.xml", time_limit=0.05)


@needs_converter
@pytest.mark.parametrize(
    ("child", "word"),
    [
        ("import os; os.abort()", r"crashed \(signal 6\)"),
        ("import sys; sys.exit('all is lost')", "ended with code 1: all is lost"),
        ("print('fine')", "ended with code 0: fine"),
    ],
)
def test_a_converter_that_dies_is_told(child, word, tmp_path, monkeypatch):
    (tmp_path / "stand_in.py").write_text(child)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setattr(map_conversion, "_CHILD", "stand_in")
    with pytest.raises(InputError, match=f"cannot be converted: the converter {word}"):
        convert_map(CROSSING, tmp_path / "net.xml")


@needs_converter
def test_netconverts_own_words_reach_the_user(tmp_path, monkeypatch):
    """A netconvert that refuses: its error line is the cause."""
    home = tmp_path / "home"
    (home / "bin").mkdir(parents=True)
    program = home / "bin" / "netconvert"
    program.write_text("#!/bin/sh\necho 'Warning: x'\necho 'Error: no edges'\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setattr(map_conversion, "_netconvert", lambda: program)
    with pytest.raises(InputError, match="netconvert failed: Error: no edges"):
        convert_map(CROSSING, tmp_path / "net.xml")
