"""The figure of a run: what it shows, in every situation, without a display."""

import math

import fake_run
import made
import matplotlib
import numpy as np
import pytest
from matplotlib import _pylab_helpers
from matplotlib.collections import PolyCollection
from matplotlib.lines import Line2D

from mpcplan.observation import Box
from mpcplan.scenario import load
from mpcplan.show import plot_run
from mpcplan.show.comparison import Compared, plot_comparison
from mpcplan.show.gap import REACH, gap_ahead
from mpcplan.show.strips import STRIPS
from mpcplan.trajectory import State
from mpcplan.vehicle import FORD_ESCORT, centres, simulate

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def loaded(tmp_path):
    """Two problems, every kind of obstacle and of goal."""
    return load(
        made.write(
            tmp_path,
            made.problem(100, made.state(10, 1.75, 10), made.rectangle_goal(80)),
            made.lanelet_goal(101, made.state(20, 5, 5)),
            obstacles=made.every_kind_of_obstacle(),
        )
    )


def panels(figure):
    """The scene and the strips by name."""
    scene, *strips = figure.axes
    return scene, dict(zip(STRIPS, strips, strict=True))


def test_file_and_title(loaded, tmp_path):
    path = tmp_path / "run.png"
    figure = plot_run(fake_run.run(loaded), path)
    assert path.read_bytes().startswith(PNG)
    assert figure.get_suptitle() == "ZAM_Straight-1_1_T-1: solved"


def test_drives_are_compared(loaded, tmp_path):
    """The ways, the strips and a bar of costs for each drive."""
    parts = {"Jlon": 100.0, "SR": 0.05, "D": 0.25, "LC": 1.0}
    cheap = {name: value / 2 for name, value in parts.items()}
    run, path = fake_run.run(loaded), tmp_path / "compared.png"
    figure = plot_comparison([Compared("a", run, parts), Compared("b", run, cheap)], path)
    assert path.read_bytes().startswith(PNG)
    scene, *strips, costs = figure.axes
    assert [text.get_text() for text in scene.get_legend().get_texts()] == ["a", "b"]
    assert strips[0].get_title() == "speed [m/s]" and len(strips) == 4
    for axes in strips:
        assert len(axes.lines) + len(axes.patches) >= 2 * len(run.drives)
    assert [text.get_text() for text in costs.texts] == ["4.60", "2.30"]
    heights = [sum(bar.get_height() for bar in bars) for bars in costs.containers]
    assert heights == pytest.approx([1.5, 1.65, 3.0, 0.75])


@pytest.mark.parametrize("suffix", [".pdf", ".svg"])
def test_other_formats(loaded, tmp_path, suffix):
    path = tmp_path / f"run{suffix}"
    plot_run(fake_run.run(loaded), path)
    assert path.stat().st_size > 1000


def test_same_bytes_twice(loaded, tmp_path):
    for name in ("a.png", "b.png"):
        plot_run(fake_run.run(loaded), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_pyplot_is_left_alone(loaded):
    before = matplotlib.get_backend()
    plot_run(fake_run.run(loaded))
    assert _pylab_helpers.Gcf.get_all_fig_managers() == []
    assert matplotlib.get_backend() == before


def test_cause_in_the_title(loaded):
    title = plot_run(fake_run.run(loaded, cause="no plan at time step 3")).get_suptitle()
    assert title == "ZAM_Straight-1_1_T-1: not solved, no plan at time step 3"
    long = plot_run(fake_run.run(loaded, cause="why " * 99)).get_suptitle()
    assert len(long) <= 110
    assert long.endswith("...")


def test_view_is_in_equal_scales_with_a_margin(loaded):
    run = fake_run.run(loaded)
    scene, _ = panels(plot_run(run))
    box = scene.get_window_extent()
    (x0, x1), (y0, y1) = scene.get_xlim(), scene.get_ylim()
    assert (x1 - x0) / box.width == pytest.approx((y1 - y0) / box.height, rel=1e-3)
    for drive in run.drives:
        x, y = centres(drive.trajectory.states).T
        assert min(x.min() - x0, x1 - x.max(), y.min() - y0, y1 - y.max()) >= 15


def test_a_drive_to_the_north_stands_beside_the_strips(tmp_path):
    start = made.state(10, 1.75, 10)
    start.orientation = math.pi / 2
    run = fake_run.run(load(made.write(tmp_path, made.problem(1, start))))
    scene, strips = panels(plot_run(run))
    left = scene.get_position().x1
    assert all(axes.get_position().x0 > left for axes in strips.values())


def test_driven_vehicle_every_half_second(loaded):
    run = fake_run.run(loaded)
    scene, _ = panels(plot_run(run))
    bodies = [c for c in scene.collections if c.get_array() is not None]
    assert [len(c.get_paths()) for c in bodies] == [9, 9]
    np.testing.assert_allclose(bodies[0].get_array(), np.arange(9) * 0.5)
    plans = [c for c in scene.collections if c.get_alpha() == 0.5]
    assert [len(c.get_paths()) for c in plans] == [len(d.cycles) for d in run.drives]


def test_goals_and_traffic_are_shown(loaded):
    scene, _ = panels(plot_run(fake_run.run(loaded)))
    polygons = [c for c in scene.collections if isinstance(c, PolyCollection)]
    hatched = [len(c.get_paths()) for c in polygons if c.get_hatch()]
    assert hatched == [1, 1]
    # four lanelets, two goals, later and first rectangles of the traffic, two drives
    assert [len(c.get_paths()) for c in polygons] == [4, 1, 1, 4, 3, 9, 9]


def test_strips_show_states_and_limits(loaded):
    run = fake_run.run(loaded)
    _, strips = panels(plot_run(run))
    driven = run.drives[0].trajectory
    speed = strips["speed [m/s]"].lines[0]
    np.testing.assert_array_equal(speed.get_ydata(), driven.states[:, State.V])
    np.testing.assert_allclose(speed.get_xdata(), driven.steps * 0.1)
    limit = dashed(strips["acceleration [m/s²]"])[0]
    np.testing.assert_allclose(
        limit.get_ydata(), 11.5 * np.minimum(1, 4.755 / driven.states[:, State.V])
    )
    assert {line.get_ydata()[0] for line in dashed(strips["steering rate [rad/s]"])} == {-0.4, 0.4}
    assert all(axes.get_xlim() == speed.axes.get_xlim() for axes in strips.values())


def dashed(axes) -> list[Line2D]:
    """The lines of the limits."""
    return [line for line in axes.lines if line.get_linestyle() == "--"]


def test_limits_come_into_view_when_they_are_reached(loaded):
    problem = loaded.problems[0]
    drive = fake_run.drive(problem)
    inputs = np.tile([-9.0, 0.4], (10, 1))
    drive.trajectory = simulate(problem.start, inputs, 0.1, problem.first_step)
    _, strips = panels(plot_run(fake_run.run(loaded, drive)))
    assert strips["steering rate [rad/s]"].get_ylim()[1] > 0.4


def test_nothing_was_driven(loaded):
    drives = [fake_run.drive(problem, steps=0, cause="stuck") for problem in loaded.problems]
    plot_run(fake_run.run(loaded, *drives, cause="stuck"))


def test_no_traffic_no_goal_position_and_a_collision(tmp_path):
    loaded = load(made.write(tmp_path, obstacles=[]))
    drive = fake_run.drive(loaded.problems[0], collided=True)
    scene, strips = panels(plot_run(fake_run.run(loaded, drive, cause="hit")))
    assert any(line.get_marker() == "X" for line in scene.lines)
    assert np.isnan(strips["gap ahead [m]"].lines[0].get_ydata()).all()


# ---------------------------------------------------------------- the gap


def boxes(x: float, y: float, count: int, length: float = 4.0) -> np.ndarray:
    """(1, count, 6) boxes of a vehicle that stands at (x, y)."""
    box = np.zeros((1, count, len(Box)))
    box[..., [Box.X, Box.Y, Box.LENGTH, Box.WIDTH]] = (x, y, length, 2.0)
    return box


@pytest.fixture
def drive_along_x():
    """1 s at 10 m/s along x, with the centre at 0 at the start."""
    x0 = np.array([-FORD_ESCORT.rear_to_centre, 0, 0, 10, 0])
    return simulate(x0, np.zeros((10, 2)), 0.1)


def test_gap_runs_from_bumper_to_bumper(drive_along_x):
    gaps = gap_ahead(drive_along_x, boxes(30, 1, 11))
    expected = 30 - np.arange(11) - 2 - FORD_ESCORT.length / 2
    np.testing.assert_allclose(gaps, expected, atol=1e-9)


def test_gap_along_a_curve():
    """On a circle of radius 20 m the gap is an arc, not a chord."""
    steering = math.atan(FORD_ESCORT.wheelbase / 20)
    driven = simulate([0, 0, steering, 10, 0], np.zeros((40, 2)), 0.1)
    where = centres(driven.states)[-1]
    gaps = gap_ahead(driven, boxes(*where, 41))
    radius = math.hypot(20, FORD_ESCORT.rear_to_centre)
    arc = radius * (driven.states[-1, State.PSI] - driven.states[0, State.PSI])
    assert gaps[0] == pytest.approx(arc - 2 - FORD_ESCORT.length / 2, abs=0.05)


@pytest.mark.parametrize(
    ("x", "y"), [(-20, 0), (30, 3), (30, -3), (REACH + 20, 0), (math.nan, math.nan)]
)
def test_no_gap_to_what_is_behind_beside_far_or_absent(drive_along_x, x, y):
    assert np.isnan(gap_ahead(drive_along_x, boxes(x, y, 11))).all()


def test_nearest_of_several(drive_along_x):
    both = np.concatenate([boxes(50, 0, 11), boxes(25, 0, 11), np.full((1, 11, 6), np.nan)])
    np.testing.assert_array_equal(
        gap_ahead(drive_along_x, both), gap_ahead(drive_along_x, boxes(25, 0, 11))
    )
