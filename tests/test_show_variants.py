"""Figures that compare sampled with refined drives, and the notebook that shows them."""

import json
import re
import shutil
from pathlib import Path

import fake_run
import made
import matplotlib
import nbformat
import numpy as np
import pytest
import shapely
from matplotlib.colors import to_hex
from nbclient import NotebookClient
from scipy.integrate import simpson

from mpcplan.bench.store import COLUMNS, csv_text, empty_row
from mpcplan.config import Config
from mpcplan.errors import InputError
from mpcplan.refine.problem import Problem
from mpcplan.refine.sqp import SqpResult, solve
from mpcplan.scenario import load
from mpcplan.score.tr1 import CHECKER_WEIGHTS, PARTS, tr1
from mpcplan.show import colours, variants
from mpcplan.show.comparison import Compared, plot_comparison
from mpcplan.show.convergence import FLOOR, RESIDUALS, converge, plot_convergence
from mpcplan.show.corridor import FRONT, bounds_of, plot_corridor
from mpcplan.show.quantities import ACCELERATION, GAP, SPEED, STEERING_RATE, jerk_of
from mpcplan.show.refined import refined_plan
from mpcplan.show.results import costs, mean_parts, pairs_of, plot_results
from mpcplan.show.times import TOTAL, percentiles, plot_times, stage_times, times_table
from mpcplan.show.variants import NO_COST, drive_variants, plot_variants, told
from mpcplan.simulate.loop import drive
from mpcplan.solvers.record import GOES_ON, TO_GOAL, Recorded, record_problems
from mpcplan.trajectory import Input, State

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = {  # with the number of their figures
    "sampling_vs_refined": 7,  # three scenarios, corridor, convergence, times, results
    "anatomy_of_a_plan": 7,  # run, forecast, candidates, corridor, sparsity, convergence, tail
    "interaction": 5,  # run, decision, beliefs, what the others did, rules
}
COST = {"Jlon": 100.0, "SR": 0.05, "D": 0.25, "LC": 1.0}
PALETTE = {
    color.lower()
    for color in (*colours.PROBLEMS, *colours.COSTS, colours.TRAFFIC, colours.PLAN, colours.LIMIT)
}
SAMPLING = Config.model_validate({"refine": {"enabled": False}})
REFINED = Config()


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """4 s along a straight road behind a car that is slower."""
    goal = made.rectangle_goal(45)
    problem = made.problem(100, made.state(10, made.LANE / 2, 10), goal)
    car = made.car(30, 35, made.LANE / 2, 7)
    return made.write(tmp_path_factory.mktemp("scenario"), problem, obstacles=[car])


@pytest.fixture(scope="module")
def run(path):
    """Driven with refinement."""
    return drive(load(path), REFINED)


@pytest.fixture(scope="module")
def plan(path, run):
    """The first plan's problem with its solution."""
    return refined_plan(run, record_problems(path, REFINED))


def lines_of(axes) -> dict[str, np.ndarray]:
    """(n, 2) points of the lines by their labels."""
    return {line.get_label(): np.column_stack(line.get_data()) for line in axes.lines}


def legend_of(axes) -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]


def line_colours(figure) -> set[str]:
    return {to_hex(line.get_color()) for axes in figure.axes for line in axes.lines}


# ---------------------------------------------------------------- drives


def test_strips_show_the_run(run, path):
    """Every strip holds the run's own numbers, and says what they are in which unit."""
    jerk = jerk_of(run)
    quantities = (SPEED, ACCELERATION, jerk, STEERING_RATE, GAP)
    figure = plot_comparison([Compared("refined", run, COST)], quantities=quantities)
    scene, *strips, bars = figure.axes
    assert (scene.get_xlabel(), scene.get_ylabel()) == ("x [m]", "y [m]")
    assert [axes.get_title() for axes in strips] == [q.label for q in quantities]
    assert all(re.search(r" \[(m|rad)(/s[²³]?)?\]$", axes.get_title()) for axes in strips)
    assert {axes.get_xlabel() for axes in strips} == {"time [s]"}
    driven = run.drives[0].trajectory
    speed, acceleration, shown, rate, gap = strips
    np.testing.assert_array_equal(speed.lines[0].get_ydata(), driven.states[:, State.V])
    for axes, column in ((acceleration, Input.A), (rate, Input.V_DELTA)):
        np.testing.assert_array_equal(axes.patches[0].get_data().values, driven.inputs[:, column])
    np.testing.assert_array_equal(shown.lines[0].get_ydata(), jerk.values(driven, None))
    # the car ahead starts with its rear 23 m ahead of the front bumper
    assert np.nanmax(gap.lines[0].get_ydata()) == pytest.approx(35 - 10 - 4.3, abs=1.0)
    assert bars.get_title() == "TR1"


def test_nobody_ahead_is_told(tmp_path):
    fake = fake_run.run(load(made.write(tmp_path, obstacles=[])))
    figure = plot_comparison([Compared("a", fake, COST)], quantities=(SPEED, GAP))
    assert [text.get_text() for text in figure.axes[2].texts] == ["nobody ahead within 60 m"]


def test_a_drive_without_a_cost_has_no_bar(tmp_path):
    fake = fake_run.run(load(made.write(tmp_path)))
    compared = [Compared("a", fake, COST), Compared("b", fake, NO_COST)]
    costs = plot_comparison(compared).axes[-1]
    assert [text.get_text() for text in costs.texts] == ["4.60", "no cost"]
    heights = [[bar.get_height() for bar in bars] for bars in costs.containers]
    assert np.sum(heights, axis=0) == pytest.approx([tr1(COST), 0.0])
    cycles = str(len(fake.drives[0].cycles))
    assert told(compared).splitlines()[2].split() == ["b", *5 * "-", cycles]


def test_variants_that_are_not_valid_say_so(path, tmp_path, monkeypatch):
    """Their cost is told where there is one; who never drove is not judged."""

    class Verdict:
        valid, parts = False, COST

    class Judgement:
        verdict = Verdict

    names = []
    monkeypatch.setattr(variants, "judge_run", lambda run, to: names.append(to.name) or Judgement)
    stuck = fake_run.run(load(path), cause="no way")
    stuck.driven = True
    still = fake_run.run(load(path), cause="no road")
    still.driven = False
    runs = iter((stuck, still))
    monkeypatch.setattr(variants, "drive", lambda loaded, config: next(runs))
    found = drive_variants(path, {"a": SAMPLING, "b": REFINED}, tmp_path)
    assert [one.name for one in found] == ["a (not valid)", "b (not driven)"]
    assert names == ["a"] and found[0].parts == COST and np.isnan(found[1].parts["D"])
    assert told(found).splitlines()[-2:] == ["a (not valid): no way", "b (not driven): no road"]


@pytest.mark.slow
def test_drives_of_a_bundled_scenario(tmp_path):
    """Bars sum to the official TR1, and the jerk shown is the one that was evaluated."""
    scenario = ROOT / "scenarios" / "ZAM_LaneChange-1_1_T-1.xml"
    compared = drive_variants(scenario, {"sampled": SAMPLING, "refined": REFINED}, tmp_path)
    assert [one.name for one in compared] == ["sampled", "refined"]
    assert tr1(compared[1].parts) < tr1(compared[0].parts)
    figure = plot_variants(compared, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000
    assert legend_of(figure.axes[0]) == ["sampled", "refined"]
    bars = np.array([[b.get_height() for b in part] for part in figure.axes[-1].containers])
    assert bars.sum(axis=0) == pytest.approx([tr1(one.parts) for one in compared])
    assert legend_of(figure.axes[-1]) == list(PARTS)
    for line, one in zip(figure.axes[3].lines, compared, strict=True):
        evaluated = simpson(np.asarray(line.get_ydata()) ** 2, dx=one.run.loaded.dt)
        assert evaluated == pytest.approx(one.parts["Jlon"], rel=0.01)


# ---------------------------------------------------------------- times


def timed(*cycles: dict[str, float]):
    """A run whose cycles took these times."""
    plans = [fake_run.SimpleNamespace(trace={"times_ms": times}) for times in cycles]
    found = [fake_run.SimpleNamespace(plan=plan) for plan in plans]
    return fake_run.SimpleNamespace(drives=[fake_run.SimpleNamespace(cycles=found)])


def test_times_are_those_of_the_trace(run):
    times = stage_times([run])
    cycles = run.drives[0].cycles
    told = [cycle.plan.trace["times_ms"]["total"] for cycle in cycles]
    np.testing.assert_array_equal(times[TOTAL], told)
    assert list(times)[-1] == TOTAL and {"predict", "seed", "refine", "verify"} <= set(times)


def test_a_stage_counts_where_it_worked():
    times = stage_times([timed({"seed": 10.0, "total": 12.0}, {"total": 2.0}), timed({"total": 4})])
    assert {stage: spent.tolist() for stage, spent in times.items()} == {
        "seed": [10.0], "total": [12.0, 2.0, 4.0],
    }  # fmt: skip
    assert percentiles(times) == {"seed": (10.0, 10.0), "total": (4.0, pytest.approx(11.2))}


def test_bars_and_whiskers_are_the_percentiles():
    variants = {
        "a": stage_times([timed({"seed": 1.0, "total": 2.0}, {"seed": 3.0, "total": 4.0})]),
        "b": stage_times([timed({"refine": 5.0, "total": 6.0})]),
    }
    (axes,) = plot_times(variants).axes
    assert [text.get_text() for text in axes.get_yticklabels()] == ["seed", "refine", "total"]
    assert axes.get_xlabel().endswith("[ms]") and "measured on this machine" in axes.get_title()
    assert legend_of(axes) == ["a: p50, whisker p95", "b: p50, whisker p95"]
    bars = [c for c in axes.containers if hasattr(c, "patches")]
    assert [[bar.get_width() for bar in one] for one in bars] == [[2.0, 3.0], [5.0, 6.0]]
    ends = [one.errorbar.lines[2][0].get_segments() for one in bars]
    assert [segment[1][0] for segment in ends[0]] == pytest.approx([2.9, 3.9])
    assert {to_hex(bar.get_facecolor()) for one in bars for bar in one} <= PALETTE
    assert times_table(variants).splitlines()[1].split() == ["seed", "a", "2", "2.0", "2.9"]


def test_no_cycle_at_all():
    times = stage_times([timed()])
    assert percentiles(times) == {}
    assert plot_times({"a": times}).axes[0].get_yticklabels() == []


# ---------------------------------------------------------------- one plan


def test_the_plan_is_the_runs(run, plan):
    """The problem found again has the solution that the trace tells of, input by input."""
    cycle = next(c for c in run.drives[0].cycles if c.plan.trace["refine"] is not None)
    assert plan.step == cycle.step
    assert plan.result.as_dict().items() <= cycle.plan.trace["refine"].items()
    planned = cycle.plan.trajectory.inputs[: plan.problem.n, Input.V_DELTA]
    np.testing.assert_allclose(planned, plan.result.z.u[: len(planned), 1], atol=1e-9)


def test_other_problems_of_the_cycle_are_not_taken_for_the_plans(run, plan):
    """One of the same seed that weighs jerk otherwise: its solution is another."""
    one = plan.problem
    dear = Config.model_validate({"cost": {"jerk": 10 * REFINED.cost.jerk}})
    other = Problem(one.seed, one.corridor, one.x0, one.goal, one.n, dear, one.dt)
    kind = TO_GOAL if plan.fresh else GOES_ON
    recorded = [Recorded("decoy", kind, other), Recorded("plan", kind, one)]
    assert refined_plan(run, recorded).problem is one
    with pytest.raises(InputError, match="not among those recorded"):
        refined_plan(run, recorded[:1])


def test_a_plan_that_is_not_refined_has_no_problem(path, run, plan):
    with pytest.raises(InputError, match="no plan of ZAM_Straight-1_1_T-1 is a refined one"):
        refined_plan(drive(load(path), SAMPLING), [])
    with pytest.raises(InputError, match="at step 0 is not among those recorded"):
        refined_plan(run, [])


def test_corridor_contains_the_refined_plan(plan):
    """Up to the slacks of the solution, which are small here."""
    bounds = bounds_of(plan.problem, plan.result.z)
    slacks = plan.problem.at(plan.result.z).slacks[:-1].reshape(-1, 3)
    sigma_s, sigma_d = slacks[:, 0] + 1e-9, slacks[:, [1]] + 1e-9
    assert slacks[:, :2].max() < 0.02
    assert np.isfinite(bounds.s_max).any() and bounds.time.shape == (plan.problem.n,)
    assert (bounds.s_min - sigma_s <= bounds.s).all() and (bounds.s <= bounds.s_max + sigma_s).all()
    assert (bounds.d_min - sigma_d <= bounds.d).all() and (bounds.d <= bounds.d_max + sigma_d).all()
    assert (bounds.d_min < bounds.d_max).all() and bounds.d.shape == (plan.problem.n, 4)


def test_corridor_figure_shows_seed_plan_and_bounds(plan):
    problem, z = plan.problem, plan.result.z
    figure = plot_corridor(problem, z)
    along, across = figure.axes
    assert (along.get_xlabel(), along.get_ylabel()) == ("time t [s]", "rear axle's s [m]")
    assert (across.get_xlabel(), across.get_ylabel()) == ("s [m]", "front's d [m]")
    bounds = bounds_of(problem, z)
    drawn = lines_of(along)
    np.testing.assert_array_equal(drawn["refined"], np.column_stack([bounds.time, bounds.s]))
    np.testing.assert_array_equal(drawn["seed"][:, 1], problem.initial().x[1:, 0])
    drawn = lines_of(across)
    front = np.column_stack([bounds.at[:, FRONT], bounds.d[:, FRONT]])
    np.testing.assert_array_equal(drawn["refined"], front)
    assert legend_of(along) == ["forbidden", "seed", "refined"]
    assert legend_of(across) == ["forbidden", "road's edges", "seed", "refined"]
    assert line_colours(figure) <= PALETTE


def test_forbidden_is_what_lies_beyond_the_bounds(plan):
    """The filled areas' edges are the bounds, and the refined plan lies in none of them."""
    along, across = plot_corridor(plan.problem, plan.result.z).axes
    bounds = bounds_of(plan.problem, plan.result.z)
    top = along.get_ylim()[1]
    edge = along.collections[0].get_paths()[0].vertices
    for time, most in zip(bounds.time, np.minimum(bounds.s_max, top), strict=True):
        at = edge[np.isclose(edge[:, 0], time), 1]
        assert at.min() == pytest.approx(most) and at.max() == pytest.approx(top)
    for axes, x, y in (
        (along, bounds.time, bounds.s), (across, bounds.at[:, FRONT], bounds.d[:, FRONT])
    ):  # fmt: skip
        points = shapely.points(x, y)
        for area in axes.collections:
            for outline in area.get_paths():
                inside = shapely.Polygon(outline.vertices).buffer(-0.02)
                assert not shapely.contains(inside, points).any()


def test_convergence_ends_with_the_plans_result(plan):
    found = converge(plan.problem, REFINED.refine, plan.fresh)
    assert len(found.cost) == plan.result.iterations + 1 == len(found.kkt) + 1
    assert found.cost[0] == plan.result.cost_before and found.cost[-1] == plan.result.cost_after
    assert found.kkt[-1] == plan.result.kkt
    assert found.cost[-1] < found.cost[0]
    assert found.residuals("defect").max() < 10.0 and found.residuals("defect")[-1] < 1e-6


def test_iterates_are_those_of_the_whole_solution(plan, monkeypatch):
    """What comes after k iterations is where the whole solution is then."""
    seen = []
    whole = type(plan.problem).quadratic

    def quadratic(problem, point, damping=0.0):
        seen.append(point.cost)
        return whole(problem, point, damping)

    with monkeypatch.context() as patch:
        patch.setattr(type(plan.problem), "quadratic", quadratic)
        result: SqpResult = solve(plan.problem, REFINED.refine, plan.fresh)
    assert len(seen) == result.iterations  # a model for each
    found = converge(plan.problem, REFINED.refine, plan.fresh)
    np.testing.assert_array_equal(found.cost, [*seen, result.cost_after])


def test_convergence_figure(plan):
    found = converge(plan.problem, REFINED.refine, plan.fresh)
    figure = plot_convergence(found)
    cost, residuals = figure.axes
    np.testing.assert_array_equal(cost.lines[0].get_ydata(), found.cost)
    shown = [np.asarray(line.get_ydata()) for line in residuals.lines]
    for name, values in zip(RESIDUALS, shown, strict=True):
        np.testing.assert_array_equal(values, np.maximum(found.residuals(name), FLOOR))
    assert [label.split()[0] for label in legend_of(residuals)] == list(RESIDUALS)
    assert cost.get_xlabel() == residuals.get_xlabel() == "SQP iteration k"
    assert residuals.get_yscale() == cost.get_yscale() == "log"
    assert plan.result.status in figure.get_suptitle()
    assert len(line_colours(figure)) == len(RESIDUALS) and line_colours(figure) <= PALETTE


# ---------------------------------------------------------------- results


def table(folder: Path, name: str, **of: tuple[bool, float]) -> Path:
    """The results.csv of scenarios with their validity and share of COST."""
    rows = []
    for scenario, (valid, share) in of.items():
        parts = {part: share * value for part, value in COST.items()}
        values = {"valid": valid, "TR1": tr1(parts) if valid else "", **parts}
        times = {"plan_p50_ms": 10 * share, "plan_p95_ms": 40 * share}
        rows.append(empty_row(scenario) | values | times)
    (folder / name).mkdir()
    (folder / name / "results.csv").write_text(csv_text(rows, COLUMNS))
    return folder / name


@pytest.fixture
def pairs(tmp_path):
    a = table(tmp_path, "a", Z=(True, 1.0), Y=(True, 2.0), X=(False, 1.0), W=(True, 1.0))
    b = table(tmp_path, "b", Z=(True, 0.5), Y=(True, 0.4), X=(True, 1.0), V=(True, 1.0))
    return pairs_of(a, b)


def test_pairs_are_what_both_solved(pairs):
    assert [(one.scenario, other.scenario) for one, other in pairs] == [("Y", "Y"), ("Z", "Z")]
    np.testing.assert_allclose(costs(pairs), tr1(COST) * np.array([[2.0, 0.4], [1.0, 0.5]]))
    weighted = [CHECKER_WEIGHTS[part] * COST[part] for part in PARTS]
    np.testing.assert_allclose(mean_parts(pairs), np.outer([1.5, 0.45], weighted))


def test_tables_without_a_pair_are_refused(tmp_path):
    a = table(tmp_path, "a", Z=(True, 1.0), Y=(False, 1.0))
    b = table(tmp_path, "b", Y=(True, 1.0))
    with pytest.raises(InputError, match="no scenario in common that both solved"):
        pairs_of(a, b)
    two = tmp_path / "two.csv"
    two.write_text("scenario,valid,TR1,planner\nZ,True,1.0,idm\nZ,True,1.0,mpcplan\n")
    with pytest.raises(InputError, match="several planners: idm, mpcplan"):
        pairs_of(a, two)


def test_results_figure_shows_the_tables(pairs):
    figure = plot_results(pairs, ("sampled", "refined"))
    scatter, ratio, parts, times = figure.axes
    np.testing.assert_array_equal(lines_of(scatter)["a scenario"], costs(pairs))
    assert (scatter.get_xlabel(), scatter.get_ylabel()) == ("TR1, sampled", "TR1, refined")
    assert scatter.get_xlim() == scatter.get_ylim()
    assert lines_of(ratio)["scenarios"][1:, 0] == pytest.approx([0.2, 0.5])
    heights = np.array([[bar.get_height() for bar in part] for part in parts.containers])
    assert heights.sum(axis=0) == pytest.approx(costs(pairs).mean(axis=0))
    assert [text.get_text() for text in parts.texts] == ["6.900", "2.070"]
    assert times.get_xlabel().endswith("[ms]")
    drawn = lines_of(times)
    assert drawn["sampled, p50"][1:, 0] == pytest.approx([10, 20])
    assert drawn["refined, p95"][1:, 0] == pytest.approx([16, 20])
    assert figure.get_suptitle() == "2 scenarios that both solved"
    assert line_colours(figure) <= PALETTE


def test_results_without_times_or_parts(tmp_path):
    """Tables of other planners may have no more than is needed."""
    path = tmp_path / "results.csv"
    path.write_text("scenario,valid,TR1\nZ,True,1.0\n")
    figure = plot_results(pairs_of(path, path), ("a", "b"))
    assert len(figure.axes[3].lines) == 0 and figure.axes[3].get_legend() is None
    assert [text.get_text() for text in figure.axes[2].texts] == 2 * ["parts unknown"]


# ---------------------------------------------------------------- the notebooks


def test_all_notebooks_are_tested():
    assert {path.stem for path in (ROOT / "notebooks").glob("*.ipynb")} == set(NOTEBOOKS)


@pytest.fixture(params=NOTEBOOKS)
def notebook_path(request):
    return ROOT / "notebooks" / f"{request.param}.ipynb"


@pytest.fixture
def notebook(notebook_path):
    return nbformat.read(notebook_path, as_version=4)


def test_notebook_is_committed_clean(notebook):
    """Without outputs, and without anything of the machine it was written on."""
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert code and all(cell.outputs == [] for cell in code)
    assert all(cell.execution_count is None and not cell.metadata for cell in code)
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    text = json.dumps(notebook)
    assert not re.search(r"(?<![\w.>*)\]\"}])/(home|tmp|work|usr|root|Users|opt)/|[A-Z]:\\\\", text)


def test_notebook_links_and_parameters_exist(notebook, notebook_path):
    text = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")
    links = re.findall(r"\]\(([^)#]+)", text)
    assert links and all((notebook_path.parent / link).exists() for link in links)
    parameters = re.findall(rf"`({'|'.join(Config.model_fields)})\.(\w+)[`=]", text)
    assert parameters
    for section, key in parameters:
        assert hasattr(getattr(REFINED, section), key), f"{section}.{key}"


def test_notebook_only_calls(notebook):
    """What it computes is in the package, where it is tested."""
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert not re.search(r"^\s*(def|class|lambda)\b", cell.source, re.MULTILINE)
            assert "numpy" not in cell.source and "pyplot" not in cell.source


@pytest.mark.slow
@pytest.mark.timeout(1800)  # it drives and benches: minutes on an idle machine
def test_notebook_runs(notebook, notebook_path, tmp_path):
    """From a clean kernel in a copy of the tree: no cell fails, and all figures are there."""
    (tmp_path / "pyproject.toml").touch()
    for name in ("configs", "scenarios"):
        (tmp_path / name).symlink_to(ROOT / name)
    folder = tmp_path / "notebooks"
    folder.mkdir()
    shutil.copy(notebook_path, folder)
    place = {"metadata": {"path": str(folder)}}
    done = NotebookClient(notebook, timeout=1200, kernel_name="python3", resources=place).execute()
    outputs = [output for cell in done.cells for output in cell.get("outputs", ())]
    assert not [output for output in outputs if output.output_type == "error"]
    figures = [output for output in outputs if "image/png" in output.get("data", {})]
    assert len(figures) == NOTEBOOKS[notebook_path.stem]
    assert all(len(figure.data["image/png"]) > 10_000 for figure in figures)
    assert [path.name for path in folder.iterdir()] == [notebook_path.name]  # nothing is left


def test_no_global_state_is_touched(pairs, plan):
    before = matplotlib.get_backend()
    plot_results(pairs, ("a", "b"))
    plot_corridor(plan.problem, plan.result.z)
    assert matplotlib.get_backend() == before
