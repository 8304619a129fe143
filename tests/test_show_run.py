"""`mpcplan show`: pictures of planning cycles and films, planned again from a run's files."""

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from mpcplan.cli import BAD_INPUT, OK, main
from mpcplan.config import Config
from mpcplan.observation import Snapshot
from mpcplan.review.again import cycle_at, run_again
from mpcplan.review.files import find_files
from mpcplan.review.replan import Replanned, replan, with_plans
from mpcplan.scenario import load
from mpcplan.show import colours, film
from mpcplan.show.moment import MOST_IN_FULL, moment
from mpcplan.show.screen import SIZE, Screen, usual_radius
from mpcplan.simulate.foreign import load_planner
from mpcplan.simulate.loop import drive
from mpcplan.vehicle import centres

SCENARIOS = Path(__file__).resolve().parents[1] / "scenarios"
EASY = SCENARIOS / "ZAM_CutIn-1_1_T-1.xml"
NAME = "ZAM_CutIn-1_1_T-1"


def write_run(run, folder: Path) -> Path:
    """The files of `solve` that tell what was driven."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "trace.json").write_text(json.dumps(run.trace()), encoding="utf-8")
    run.write_solution(folder)
    return folder


@pytest.fixture(scope="module")
def driven():
    """A short drive behind somebody who cuts in."""
    run = drive(load(EASY), Config())
    assert run.solved
    return run


@pytest.fixture
def folder(driven, tmp_path):
    return write_run(driven, tmp_path / "run")


@pytest.fixture(scope="module")
def known(driven, tmp_path_factory):
    """The run read from its files, and its cycles planned again."""
    files = find_files(write_run(driven, tmp_path_factory.mktemp("known")))
    run = run_again(files)
    return run, replan(run, 0, files.simulated)


@pytest.fixture(scope="module")
def screen(known):
    run, again = known
    return Screen(run, 0, again, 40.0)


def error(capsys) -> str:
    """The one line that a command says of bad input."""
    said = capsys.readouterr()
    assert said.out == "" and said.err.startswith("error: ") and said.err.count("\n") == 1
    return str(said.err)


def has_colour(picture: np.ndarray, colour: str) -> bool:
    wanted = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    return bool((np.abs(picture.astype(int) - wanted).max(axis=2) <= 2).any())


# -- planned again -------------------------------------------------------------------------------


def test_what_was_driven_is_read_from_the_solution(driven, known):
    run, _ = known
    before, after = driven.drives[0], run.drives[0]
    assert after.trajectory.first_step == before.trajectory.first_step
    np.testing.assert_allclose(after.trajectory.states, before.trajectory.states, atol=1e-9)
    np.testing.assert_allclose(after.trajectory.inputs, before.trajectory.inputs, atol=1e-6)
    assert after.reached_step == before.reached_step and not after.collided
    for a, b in zip(after.others, before.others, strict=True):
        assert a.ids == b.ids and (a.boxes == b.boxes).all()


def test_every_plan_comes_out_as_it_was(driven, known):
    run, again = known
    assert again.missing == "" and all(one.agrees for one in again.considered)
    for before, after in zip(
        driven.drives[0].cycles, with_plans(run.drives[0], again).cycles, strict=True
    ):
        assert before.step == after.step
        np.testing.assert_array_equal(before.plan.trajectory.states, after.plan.trajectory.states)


def test_what_a_cycle_considered(known):
    _, again = known
    first = again.considered[0]
    assert len(first.candidates.accepted) > 0
    assert len(first.candidates.collided) + len(first.candidates.refused) > 0
    np.testing.assert_allclose(
        first.candidates.accepted[:, 0], np.tile(centres(first.plan.states[:1]), (40, 1)), atol=0.05
    )
    assert first.forecast.exact and first.forecast.first_step == first.step
    ribbon = first.ribbon
    assert (ribbon.s >= ribbon.s_min - 0.1).all() and (ribbon.s <= ribbon.s_max + 0.1).all()
    middle = centres(first.plan.states)[: len(ribbon.s)]
    for side in (ribbon.left, ribbon.right):  # the body's half width fits between plan and bound
        away = np.hypot(*(side - middle[: len(side)]).T)
        assert (away > 0.8).all() and np.isfinite(away).all()


def test_a_run_of_another_version_is_told_and_not_invented(folder):
    file = folder / "trace.json"
    trace = json.loads(file.read_text())
    for cycle in trace["drives"][0]["cycles"][2:]:
        cycle["chosen"]["cost"] += 5.0
    file.write_text(json.dumps(trace))
    files = find_files(folder)
    run = run_again(files)
    again = replan(run, 0, files.simulated)
    third = run.drives[0].cycles[2].step
    assert f"the first of them at step {third}" in again.missing
    assert moment(run.drives[0], again, 0).plan is not None
    assert moment(run.drives[0], again, third).plan is None
    assert with_plans(run.drives[0], again).cycles[2] is run.drives[0].cycles[2]


def test_another_planner_has_no_plans_to_show(tmp_path, capsys):
    run = drive(load(EASY), Config(), planner=load_planner("idm"))
    folder = write_run(run, tmp_path)
    assert main(["show", str(folder), "--step", "5"]) == OK
    said = capsys.readouterr()
    assert "note      plans of IdmPurePursuit are not recorded" in said.out and said.err == ""
    assert (folder / f"{NAME}.step0005.png").is_file()


# -- pictures of a time step ---------------------------------------------------------------------


def test_a_frame_is_the_same_every_time(known, screen):
    run, again = known
    first = screen.draw(0)
    screen.draw(20)
    np.testing.assert_array_equal(screen.draw(0), first)  # nothing is left of another frame
    np.testing.assert_array_equal(Screen(run, 0, again, 40.0).draw(0), first)
    assert first.shape == (SIZE[1], SIZE[0], 3) and first.dtype == np.uint8


def test_a_frame_shows_vehicle_others_plan_and_candidates(screen):
    picture = screen.draw(0)
    for colour in (colours.of_problem(0), colours.TRAFFIC, colours.CHOSEN, colours.CORRIDOR):
        assert has_colour(picture, colour), colour
    later = screen.draw(1)  # by then the cycle's candidates have faded
    assert (later != picture).any()


def test_a_finer_picture_has_more_pixels(known):
    run, again = known
    assert Screen(run, 0, again, 40.0, finer=1.5).draw(3).shape == (1080, 1920, 3)


def test_the_view_follows_the_vehicle(known):
    run, again = known
    screen = Screen(run, 0, again, 40.0)
    for step in (0, 15, run.drives[0].trajectory.last_step):
        screen.draw(step)
        (x0, x1), (y0, y1) = screen._scene.get_xlim(), screen._scene.get_ylim()
        x, y = centres(run.drives[0].trajectory.state_at(step)[None])[0]
        assert x0 + 15 < x < x1 - 15 and y0 + 15 < y < y1 - 15
        assert min(x1 - x0, y1 - y0) == pytest.approx(80.0, abs=0.5)


def test_the_faster_the_more_road(driven):
    one = driven.drives[0]
    states = one.trajectory.states.copy()
    radius = usual_radius(one)
    states[:, 3] += 10.0
    fast = replace(one, trajectory=replace(one.trajectory, states=states))
    assert usual_radius(fast) > radius
    states[:, 3] += 100.0
    assert usual_radius(fast) == 80.0


# -- level of detail -----------------------------------------------------------------------------


def crowd(run, count: int = 70):
    """The run with so many others around, 12 m apart in rows of ten."""
    one = run.drives[0]
    here = centres(one.trajectory.states[:1])[0]
    k = np.arange(count)
    boxes = np.zeros((count, 6))
    boxes[:, 0], boxes[:, 1] = here[0] + 12.0 * (k % 10 - 5), here[1] + 12.0 * (k // 10 - 3) + 5.0
    boxes[:, 4:] = 4.5, 1.8
    seen = [Snapshot(o.step, tuple(range(100, 100 + count)), boxes) for o in one.others]
    return replace(one, others=tuple(seen))


def test_of_seventy_vehicles_few_are_drawn_in_full(known):
    run, again = known
    one = crowd(run)
    now = moment(one, again, 0)
    assert len(now.ids) == 70 and 1 <= now.full.sum() <= MOST_IN_FULL
    here = centres(one.trajectory.states[:1])[0]
    away = np.hypot(*(now.boxes[:, :2] - here).T)
    assert away[now.full].max() <= np.sort(away)[MOST_IN_FULL]
    crowded = replace(run, drives=(one,))
    screen = Screen(crowded, 0, again, 60.0)
    screen.draw(0)
    assert len(screen._road._full.get_paths()) == now.full.sum()
    assert 30 < len(screen._road._far.get_paths()) <= 70 - now.full.sum()
    assert screen._road.labels(now) == []


def test_labels_on_demand_and_for_the_feared(known):
    run, again = known
    one = crowd(run)
    feared = replace(again.considered[0], feared=((30, 165),))
    again = Replanned((feared, *again.considered[1:]))
    crowded = replace(run, drives=(one,))
    few, many = (Screen(crowded, 0, again, 60.0, labels=labels) for labels in (False, True))
    for screen in (few, many):
        screen.draw(0)
    now = moment(one, again, 0)
    assert now.full[list(now.ids).index(165)]  # however far it is
    assert [(label.text, label.alarming) for label in few._road.labels(now)] == [("165", True)]
    assert len(many._road.labels(now)) > 30


@pytest.mark.parametrize(
    ("fallback", "feared"),
    [
        (None, ()),
        (
            "emergency braking: search: collision with obstacle 165 at step 30 (gap -1 m)",
            ((30, 165),),
        ),
        ("emergency braking: 0 of 9 candidates of the lattice were drivable", ((12, 166),)),
    ],
)
def test_whom_the_trace_fears_is_shown(known, fallback, feared):
    """Also where nothing was planned again."""
    run, _ = known
    one = crowd(run)
    first = one.cycles[0]
    met = {"count": 4, "smallest_violation": 0.1, "unit": "s", "obstacle": 166, "step": 12}
    seeds = {"lattice": first.plan.trace["seeds"]["lattice"] | {"rejected": {"collision": met}}}
    trace = first.plan.trace | {"fallback": fallback, "seeds": seeds}
    one = replace(one, cycles=(replace(first, plan=replace(first.plan, trace=trace)),))
    now = moment(one, Replanned(()), 0)
    assert now.feared == feared and now.plan is None
    picture = Screen(replace(run, drives=(one,)), 0, Replanned((), "nothing"), 60.0).draw(0)
    road = picture[116:678, 14:856]
    assert has_colour(road, colours.ALARM) == bool(feared)


def test_nobody_around(known):
    run, again = known
    one = run.drives[0]
    nobody = tuple(Snapshot(o.step, (), np.empty((0, 6))) for o in one.others)
    now = moment(replace(one, others=nobody), again, 0)
    assert len(now.full) == 0
    Screen(replace(run, drives=(replace(one, others=nobody),)), 0, again, 40.0).draw(0)


# -- the command ---------------------------------------------------------------------------------


def test_the_picture_of_the_run_is_drawn_again(folder, capsys):
    assert main(["show", str(folder)]) == OK
    said = capsys.readouterr()
    assert said.out == f"picture   {folder / NAME}.png\n" and said.err == ""
    assert Image.open(folder / f"{NAME}.png").width > 1000


def test_one_cycle_and_a_series(folder, tmp_path, capsys, driven):
    assert main(["show", str(folder), "--step", "4"]) == OK
    assert capsys.readouterr().out == f"picture   {folder / NAME}.step0004.png\n"
    out = tmp_path / "elsewhere"
    assert main(["show", str(folder), "--step", "2:8:3", "--out", str(out)]) == OK
    assert [p.name[-8:-4] for p in sorted(out.iterdir())] == ["0002", "0005", "0008"]
    out = tmp_path / "all"
    assert main(["show", str(folder), "--step", "all", "--out", str(out)]) == OK
    assert len(list(out.iterdir())) == len(driven.drives[0].cycles)


def test_a_gif_has_a_frame_per_time_step(folder, tmp_path, capsys, driven):
    path = tmp_path / "film.gif"
    assert main(["show", str(folder), "--animate", str(path), "--fps", "20"]) == OK
    count = len(driven.drives[0].trajectory)
    assert f"{path} ({count} frames, {count / 20:.1f} s)" in capsys.readouterr().out
    with Image.open(path) as shown:
        assert shown.n_frames == count and shown.size == SIZE
        assert shown.info["duration"] == 50
    assert [p.name for p in tmp_path.iterdir() if p.is_file()] == ["film.gif"]


def test_an_mp4_has_a_frame_per_time_step(folder, tmp_path, driven):
    path = tmp_path / "film.mp4"
    assert main(["show", str(folder), "--animate", str(path), "--fps", "20"]) == OK
    count = len(driven.drives[0].trajectory)
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert frames == count and seconds == pytest.approx(count / 20, abs=0.06)
    reader = imageio_ffmpeg.read_frames(str(path))
    assert next(reader)["size"] == SIZE
    reader.close()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--step", "999"], "was driven from step 0 to"),
        (["--step", "-1"], "was driven from step 0 to"),
        (["--step", "5:999:5"], "was driven from step 0 to"),
        (["--step", "9:3"], "was driven from step 0 to"),
        (["--step", "some"], "expected a time step, first:last:stride, or 'all'"),
        (["--step", "1:9:0"], "expected a time step"),
        (["--step", "1:2:3:4"], "expected a time step"),
        (["--animate", "film.avi"], "film.avi: a film is an .mp4 or a .gif file"),
        (["--animate", "film"], "a film is an .mp4 or a .gif file"),
        (["--animate", "film.gif", "--fps", "0"], "--fps 0"),
        (["--animate", "film.gif", "--fps", "nan"], "--fps nan"),
        (["--step", "1", "--radius", "1"], "--radius 1: expected 10 to 500 m"),
        (["--step", "1", "--problem", "7"], "--problem 7"),
        (["--scenario", "none.xml"], "none.xml"),
        (["--scenario", str(SCENARIOS / "ZAM_Follow-1_1_T-1.xml")], "ZAM_Follow-1_1_T-1"),
    ],
)
def test_bad_input_is_one_line(folder, tmp_path, monkeypatch, capsys, arguments, told):
    monkeypatch.chdir(tmp_path)
    assert main(["show", str(folder), *arguments]) == BAD_INPUT
    assert told in error(capsys)


def test_no_run(tmp_path, capsys):
    assert main(["show", str(tmp_path)]) == BAD_INPUT
    assert "trace.json: no such file" in error(capsys)


def test_one_thing_at_a_time(folder, capsys):
    assert main(["show", str(folder), "--step", "1", "--animate", "x.gif"]) == BAD_INPUT
    assert "not allowed with" in capsys.readouterr().err


def test_ffmpeg_is_named_where_it_is_missing(folder, monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    path = tmp_path / "film.mp4"
    assert main(["show", str(folder), "--animate", str(path)]) == BAD_INPUT
    assert "pip install 'mpcplan[video]'" in error(capsys)
    film.check_kind(tmp_path / "film.gif")


def test_a_file_that_cannot_be_written(folder, tmp_path, capsys):
    path = tmp_path / "film.gif"
    path.mkdir()
    assert main(["show", str(folder), "--animate", str(path)]) == BAD_INPUT
    assert f"cannot write {path}" in error(capsys)
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []


def test_without_a_solution(folder, capsys):
    next(folder.glob("solution_*")).unlink()
    assert main(["show", str(folder)]) == BAD_INPUT
    assert "no solution of problem" in error(capsys)


def test_without_its_scenario(folder, capsys):
    file = folder / "trace.json"
    trace = json.loads(file.read_text())
    file.write_text(json.dumps(trace | {"file": "/nowhere/x.xml"}))
    assert main(["show", str(folder)]) == BAD_INPUT
    assert "name it with --scenario" in error(capsys)
    assert main(["show", str(folder), "--step", "0", "--scenario", str(EASY)]) == OK


def test_a_trace_of_bench_has_its_pictures_beside(driven, tmp_path):
    from mpcplan.bench.worker import write_trace

    write_trace(driven.trace(), tmp_path / "traces" / f"{NAME}.json.gz")
    driven.write_solution(tmp_path / "solutions")
    trace = tmp_path / "traces" / f"{NAME}.json.gz"
    assert main(["show", str(trace), "--step", "0"]) == OK
    assert (tmp_path / "pictures" / f"{NAME}.step0000.png").is_file()


def test_nothing_was_driven(folder, capsys):
    file = folder / "trace.json"
    trace = json.loads(file.read_text())
    trace["drives"][0] |= {"cycles": [], "reached_step": None, "cause": "no route leads there"}
    file.write_text(json.dumps(trace))
    next(folder.glob("solution_*")).unlink()
    assert main(["show", str(folder)]) == OK
    capsys.readouterr()
    assert main(["show", str(folder), "--step", "0"]) == BAD_INPUT
    assert "was driven: no route leads there" in error(capsys)


def test_a_configuration_of_another_version(folder, capsys):
    file = folder / "trace.json"
    trace = json.loads(file.read_text())
    trace["config"]["seed"]["gone"] = 1
    file.write_text(json.dumps(trace))
    assert main(["show", str(folder)]) == BAD_INPUT
    assert "seed.gone" in error(capsys)


def test_the_cycle_at_a_step(known):
    run, _ = known
    cycles = run.drives[0].cycles
    assert cycle_at(cycles, cycles[1].step) is cycles[1]
    assert cycle_at(cycles, cycles[1].step - 1) is cycles[0]
    assert cycle_at(cycles, run.drives[0].trajectory.last_step) is cycles[-1]


@pytest.mark.slow
def test_an_interactive_run_is_planned_again_as_it_was(tmp_path, capsys):
    folder = tmp_path / "run"
    source = tmp_path / "ZAM_LeftTurn-1_1_I-1-1"
    shutil.copytree(SCENARIOS / "interactive" / source.name, source)
    assert main(["solve", str(source), "--out", str(folder)]) == OK
    shutil.rmtree(source)  # the traffic as simulated is all that is needed
    capsys.readouterr()
    assert main(["show", str(folder), "--step", "20"]) == OK
    assert "note" not in capsys.readouterr().out
    files = find_files(folder)
    assert files.simulated
    again = replan(run_again(files), 0, files.simulated)
    assert again.missing == "" and not again.considered[0].forecast.exact
