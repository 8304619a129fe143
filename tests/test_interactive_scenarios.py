"""The bundled interactive scenarios: reproducible, consistent, and that their traffic reacts."""

import importlib.util
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from commonroad.common.writer.file_writer_xml import XMLFileWriter
from shapely.geometry import Polygon

from mpcplan.observation import Box, Snapshot, box_corners
from mpcplan.scenario import LoadedScenario, load
from mpcplan.score.judge import judge_run
from mpcplan.simulate.loop import drive
from mpcplan.sumo.inserted import InsertedTraffic
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import FORD_ESCORT, centres
from mpcplan.verify.drivability import separation

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "scenarios" / "interactive"
MAX_BYTES = 250_000  # of one scenario's folder
BOUNDARY_CODE = """
import os, sys
from commonroad.common.file_reader import CommonRoadFileReader
from commonroad_dc.feasibility import solution_checker
solution_checker._construct_boundary_checker(CommonRoadFileReader(sys.argv[1]).open()[0])
os._exit(0)
"""


@dataclass(frozen=True)
class Row:
    """What a scenario consists of.

    Attributes:
        others: how many obstacles of each kind.
        goal: what the goal asks for beside the time.
        steps: its time interval.
        ways: least number of different headings that the others take within 8 s, by 45 degrees.
        yields: who has to brake when the ego stands at its start.
        late: obstacles that appear later, and when.
    """

    others: dict[str, int]
    goal: frozenset[str]
    steps: tuple[int, int]
    ways: int
    yields: tuple[int, ...] = ()
    late: tuple[tuple[int, int], ...] = ()


LANELET = frozenset(["lanelet"])
TABLE = {
    "Bicycles": Row({"bicycle": 2, "car": 2}, LANELET, (149, 150), 1),
    "BusyRoundabout": Row({"car": 5}, LANELET, (164, 165), 4, yields=(1005,)),
    "DenseLaneChange": Row(
        {"car": 6, "truck": 1}, LANELET | {"velocity"}, (99, 100), 1, yields=(1007,)
    ),
    "DenseMerge": Row({"car": 5, "truck": 1}, LANELET, (119, 120), 1),
    "LeftTurn": Row({"car": 6}, LANELET, (149, 150), 3),
    "Roadworks": Row(
        {"constructionZone": 1, "car": 4},
        frozenset(["position", "velocity", "orientation"]),
        (120, 130),
        1,
    ),
    "SideStreet": Row(
        {"car": 5, "truck": 1, "motorcycle": 1},
        LANELET,
        (119, 120),
        3,
        yields=(1004,),
        late=((1005, 10), (1006, 30)),
    ),
    "SlowTraffic": Row({"car": 3, "truck": 1, "bicycle": 1}, frozenset(), (33, 33), 2),
}
SIMULATED = 80  # steps
bundled = pytest.mark.parametrize("name", TABLE)


def folder_of(name: str) -> Path:
    """The folder of a scenario."""
    return FOLDER / f"ZAM_{name}-1_1_I-1-1"


@cache
def loaded(name: str) -> LoadedScenario:
    """A scenario, read once."""
    return load(folder_of(name))


@cache
def simulated(name: str, speed: float) -> tuple[tuple[Snapshot, ...], dict[str, dict]]:
    """The others while the ego goes straight on at a constant speed [m/s], and what was done with
    them; once per session."""
    problem = loaded(name).problems[0]
    state, first = problem.start.copy(), problem.first_step
    state[State.V] = speed
    with closing(InsertedTraffic(loaded(name), problem)) as traffic:
        for step in range(first + 1, first + SIMULATED + 1):
            state[State.X] += 0.1 * speed * np.cos(state[State.PSI])
            state[State.Y] += 0.1 * speed * np.sin(state[State.PSI])
            traffic.advance(step, state)
        return tuple(traffic.at(first + k) for k in range(SIMULATED + 1)), traffic.log()


def own_speed(name: str) -> float:
    """The ego's speed at the start [m/s]."""
    return float(loaded(name).problems[0].start[State.V])


def bodies(snapshot: Snapshot) -> Iterator[Polygon]:
    """The areas that the others cover."""
    return (Polygon(corners) for corners in box_corners(snapshot.boxes))


# -- files ----------------------------------------------------------------------------------------


def test_every_bundled_scenario_has_its_row():
    assert {path.name for path in FOLDER.iterdir() if path.is_dir()} == {
        folder_of(name).name for name in TABLE
    }
    assert len(TABLE) >= 6


@pytest.mark.slow
@pytest.mark.skipif(
    any(importlib.util.find_spec(package) is None for package in ("commonroad_sumo", "sumo")),
    reason="the extra 'twin' is not installed: pip install '.[twin]'",
)
def test_generator_reproduces_committed_files(tmp_path):
    """A fresh process with another hash seed writes exactly the committed bytes."""
    subprocess.run(
        [sys.executable, str(ROOT / "scenarios" / "make_interactive.py"), "--out", str(tmp_path)],
        check=True,
        env={**os.environ, "PYTHONHASHSEED": "7", "PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
    )
    made, committed = (
        {path.relative_to(root): path for path in root.rglob("*") if path.suffix != ".png"}
        for root in (tmp_path, FOLDER)
    )
    assert made.keys() == committed.keys()
    for name, path in sorted(made.items()):
        assert path.is_dir() or path.read_bytes() == committed[name].read_bytes(), name


@bundled
def test_files_are_valid_and_small(name):
    folder = folder_of(name)
    root = ElementTree.parse(folder / f"{folder.name}.cr.xml").getroot()
    for begin in root.iterfind("dynamicObstacle/initialState/time/exact"):
        begin.text = "0"  # the schema knows nobody who appears later; commonroad-io does
    assert XMLFileWriter.check_validity_of_commonroad_file(ElementTree.tostring(root))
    files = {file.name.removeprefix(folder.name): file for file in folder.iterdir()}
    assert set(files) == {".cr.xml", ".net.xml", ".sumo.cfg", ".vehicles.rou.xml"}
    assert sum(file.stat().st_size for file in files.values()) < MAX_BYTES


@bundled
def test_what_is_inside(name):
    row, scenario, problem = TABLE[name], loaded(name), loaded(name).problems[0]
    assert scenario.id == folder_of(name).name and scenario.notes == () and scenario.interactive
    kinds = Counter(obstacle.obstacle_type.value for obstacle in scenario.scenario.obstacles)
    assert kinds == row.others
    goal = problem.planning_problem.goal
    (state,) = goal.state_list
    asked = {"lanelet" if goal.lanelets_of_goal_position else "position"} & {"lanelet", "position"}
    asked = asked if state.has_value("position") else set()
    asked |= {field for field in ("velocity", "orientation") if state.has_value(field)}
    assert asked == row.goal
    assert (state.time_step.start, state.time_step.end) == row.steps
    assert problem.first_step == 0
    late = {
        o.obstacle_id: o.initial_state.time_step
        for o in scenario.scenario.dynamic_obstacles
        if o.initial_state.time_step > 0
    }
    assert late == dict(row.late)


@bundled
def test_nobody_stands_where_another_starts(name):
    start = loaded(name).problems[0].start
    ego = np.array(
        [*centres(start[None])[0], start[State.PSI], 0.0, FORD_ESCORT.length, FORD_ESCORT.width]
    )
    first = simulated(name, own_speed(name))[0][0]
    areas = [Polygon(box_corners(ego[None])[0]), *bodies(first)]
    assert not any(a.intersects(b) for a, b in combinations(areas, 2))


@pytest.mark.slow
@bundled
def test_official_boundary_checker_survives(name):
    """The official checker does not crash on the road boundary (in a process of its own)."""
    file = folder_of(name) / f"{folder_of(name).name}.cr.xml"
    assert (
        subprocess.run([sys.executable, "-c", BOUNDARY_CODE, str(file)], check=False).returncode
        == 0
    )


# -- traffic --------------------------------------------------------------------------------------


@bundled
def test_everybody_begins_exactly_as_recorded(name):
    log = simulated(name, own_speed(name))[1]
    moved = {number: entry["moved"] for number, entry in log.items()}
    played = {int(number) for number, how in moved.items() if how == "as recorded"}
    assert played == {o.obstacle_id for o in loaded(name).scenario.static_obstacles}
    late = dict(TABLE[name].late)
    for number, entry in log.items():
        if int(number) not in played:
            assert entry["entered"] == late.get(int(number), 0)
            assert entry["error"] < 1e-3


@bundled
def test_the_others_move_and_go_several_ways(name):
    snapshots, _ = simulated(name, own_speed(name))
    eighths = set()
    for snapshot in snapshots:
        moving = snapshot.boxes[snapshot.boxes[:, Box.V] > 1.0]
        eighths |= set(np.round(moving[:, Box.PSI] / (np.pi / 4)).astype(int) % 8)
    assert len(eighths) >= TABLE[name].ways
    way = track(snapshots, 1002 if name == "Roadworks" else 1001)[:, [Box.X, Box.Y]]
    assert np.hypot(*(way[-1] - way[0])) > 20.0


@bundled
def test_the_others_keep_apart(name):
    """SUMO's cars do not run into each other while the ego stands at its start."""
    for snapshot in simulated(name, 0.0)[0]:
        areas = list(bodies(snapshot))
        assert not any(a.intersects(b) for a, b in combinations(areas, 2)), snapshot.step


@pytest.mark.parametrize("name", [name for name, row in TABLE.items() if row.yields])
def test_who_follows_brakes_for_an_ego_that_stands(name):
    for obstacle in TABLE[name].yields:
        driven, held = (track(simulated(name, v)[0], obstacle) for v in (own_speed(name), 0.0))
        n = min(len(driven), len(held))
        assert np.hypot(*(driven[n - 1] - held[n - 1])[:2]) > 3.0
        assert held[:, Box.V].min() < held[0, Box.V] - 2.0


def track(snapshots: tuple[Snapshot, ...], obstacle: int) -> Array:
    """(n, 6) boxes of one of the others over time."""
    return np.array([s.boxes[s.ids.index(obstacle)] for s in snapshots if obstacle in s.ids])


@bundled
def test_the_folder_is_not_written_to(name):
    """Reading and simulating leave every file as it is."""
    before = {file: (file.read_bytes(), file.stat().st_mtime_ns) for file in files_of(name)}
    simulated.__wrapped__(name, 0.0)
    assert before == {file: (file.read_bytes(), file.stat().st_mtime_ns) for file in files_of(name)}


def files_of(name: str) -> list[Path]:
    """All files of a scenario."""
    return sorted(folder_of(name).rglob("*"))


# -- drives ---------------------------------------------------------------------------------------

DRIVEN = {"SlowTraffic": 2.0}  # m, the least separation from everybody


@pytest.mark.parametrize("name", DRIVEN)
def test_driven_to_the_goal_and_apart_from_everybody(name, tmp_path):
    run = drive(load(folder_of(name)))
    assert run.solved and run.cause == ""
    (driven,) = run.drives
    gaps = [
        separation(state[None], snapshot.boxes[:, None])
        for state, snapshot in zip(driven.trajectory.states, driven.others, strict=True)
    ]
    assert min(np.nanmin(gap) for gap in gaps) > DRIVEN[name]
    judgement = judge_run(run, tmp_path)
    assert judgement.verdict.valid, judgement.verdict.cause
    assert judgement.late is not None and judgement.late.valid
