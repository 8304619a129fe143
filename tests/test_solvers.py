"""Solvers of the refinement's problem: they agree, they are compared, and what is wrong is told."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from reference_ocp import DT
from test_refine import busy_problem, with_refine

from mpcplan.config import Config
from mpcplan.errors import InputError
from mpcplan.refine import hpipm
from mpcplan.refine.backends import EXACT, Answer, make_backend
from mpcplan.refine.compiled import functions
from mpcplan.refine.hpipm import Settings, Sizes, StageQp
from mpcplan.refine.layout import layout
from mpcplan.refine.problem import Problem
from mpcplan.refine.qp import QpSolver
from mpcplan.refine.rearranged import mirrored
from mpcplan.refine.sqp import solve
from mpcplan.refine.stages import stages_of
from mpcplan.solvers import compare
from mpcplan.solvers.compare import lines, try_solvers
from mpcplan.solvers.record import GOES_ON, TO_GOAL, Recorded, chosen, record_problems
from mpcplan.solvers.report import DEFAULT, known_backends

ROOT = Path(__file__).resolve().parents[1]
ONCOMING = ROOT / "scenarios" / "ZAM_Oncoming-1_1_T-1.xml"
INTERIOR = ("piqp", "piqp multistage", "hpipm", "proxqp")
BRIEFLY = Config().model_copy(update={"drive": Config().drive.model_copy(update={"steps_max": 30})})
FUNCTIONS = functions(Config(), DT)
LIBRARY = ("qpsolvers clarabel", "qpsolvers proxqp")


def answer_of(problem: Problem, backend: str, times: int = 1) -> Answer:
    """The answer to a problem's first subproblem, asked several times of the same solver."""
    solver = QpSolver(problem.layout, backend, 4000, 1e-7)
    model = problem.quadratic(problem.at(problem.initial()), 1e-3)
    for _ in range(times):
        answer = solver.solve(model)
    return answer


@pytest.mark.parametrize("backend", INTERIOR)
@pytest.mark.parametrize("goal", [True, False])
def test_solvers_give_the_same_step_and_multipliers(backend, goal):
    problem = busy_problem(goal, 12)
    expected, found = answer_of(problem, "piqp"), answer_of(problem, backend)
    assert found.status == EXACT and found.usable
    lay = problem.layout
    assert found.p / lay.columns == pytest.approx(expected.p / lay.columns, abs=2e-4)
    model = problem.quadratic(problem.at(problem.initial()), 1e-3)
    whole, matrix = mirrored(lay.h.matrix(model.hessian)), lay.a.matrix(model.matrix)
    residual = whole @ found.p + model.gradient + matrix.T @ found.y
    assert np.abs(residual * lay.columns).max() < 1e-3
    value = matrix @ found.p
    assert np.maximum(model.low - value, value - model.high).max() < 1e-5


@pytest.mark.parametrize("backend", INTERIOR)
def test_a_solver_answers_the_second_time_as_the_first(backend):
    problem = busy_problem(True, 12)
    config = with_refine(Config(), fresh_backend=backend)
    expected = solve(problem, with_refine(Config(), fresh_backend="piqp").refine)
    found = solve(problem, config.refine)
    assert found.status == "converged"
    assert found.cost_after == pytest.approx(expected.cost_after, rel=1e-4)
    once, twice = answer_of(problem, backend), answer_of(problem, backend, times=2)
    assert twice.p == pytest.approx(once.p, abs=1e-5)


@pytest.mark.parametrize("backend", LIBRARY)
def test_solvers_of_the_library(backend):
    pytest.importorskip("qpsolvers", reason="the extra 'solvers' is not installed")
    problem = busy_problem(True, 12)
    expected, found = answer_of(problem, "piqp"), answer_of(problem, backend)
    assert found.usable
    scales = problem.layout.columns
    assert found.p / scales == pytest.approx(expected.p / scales, abs=5e-3)


def test_a_library_that_is_not_there_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "qpsolvers", None)
    with pytest.raises(InputError, match=r"needs qpsolvers: pip install 'mpcplan\[solvers\]'"):
        make_backend("qpsolvers clarabel", layout(FUNCTIONS, 5), 100, 1e-4)
    monkeypatch.setitem(sys.modules, "qpsolvers", SimpleNamespace(available_solvers=["cvxopt"]))
    with pytest.raises(InputError, match="does not find this solver, it has: cvxopt"):
        make_backend("qpsolvers clarabel", layout(FUNCTIONS, 5), 100, 1e-4)


def test_every_variable_and_row_has_one_place_in_the_stages():
    lay = layout(FUNCTIONS, 7)
    stages = stages_of(lay)
    assert sorted([*stages.x, *stages.u]) == list(range(lay.n_vars))
    rows = [*np.arange(lay.dynamics.stop), *stages.rows, *stages.state_boxes, *stages.input_boxes]
    assert sorted(rows) == list(range(lay.n_rows))
    assert sorted(stages.boxes) == sorted([*stages.state_boxes, *stages.input_boxes])
    sizes = stages.sizes
    assert (sum(sizes.nx), sum(sizes.nu)) == (len(stages.x), len(stages.u))
    assert sum(sizes.ng) == len(stages.rows)
    # what bounds a variable bounds it in its stage
    begin = np.cumsum([0, *sizes.nbx])
    for k in range(lay.n + 1):
        boxes = stages.state_boxes[begin[k] : begin[k + 1]]
        columns = lay.boxed[boxes - lay.box.start]
        assert (stages.stage[columns] == k).all()
        assert list(stages.index[columns]) == list(stages.idxbx[begin[k] : begin[k + 1]])


def test_a_problem_in_stages_with_a_known_answer():
    """min u_0^2 / 2 + (x_1 - 2)^2 / 2 with x_1 = u_0 + 1 <= 1.25: the bound's multiplier is 1/2."""
    solver = StageQp(Sizes((0, 1), (1, 0), (0, 1), (0, 0), (0, 0)), Settings(50, 1e-9, 1.0))
    given = {"B": 1.0, "b": 1.0, "R": 1.0, "Q": 1.0, "q": -2.0, "lbx": -9.0, "ubx": 1.25}
    for name, value in given.items():
        solver.data[name].values[:] = value
    for _ in range(2):
        status, iterations = solver.solve()
        assert status == "solved" and 0 < iterations < 20
        assert solver.found["u"].values == pytest.approx([0.25], abs=1e-6)
        assert solver.found["x"].values == pytest.approx([1.25], abs=1e-6)
        assert solver.found["lam_ub"].values == pytest.approx([0.5], abs=1e-6)
    solver.ask("ubx", 1, np.array([False]))
    solver.solve()
    assert solver.found["x"].values == pytest.approx([1.5], abs=1e-6)


def test_hpipm_of_another_casadi_is_told(monkeypatch, tmp_path):
    monkeypatch.setattr(hpipm.casadi, "__file__", str(tmp_path / "__init__.py"))
    with pytest.raises(InputError, match=r"backend 'hpipm': CasADi .* does not bring libhpipm\.so"):
        hpipm._load()
    monkeypatch.setattr(hpipm.ctypes, "CDLL", lambda path: SimpleNamespace())
    with pytest.raises(InputError, match=r"another interface of HPIPM; install 3\.8"):
        hpipm._load()


# -- comparison -----------------------------------------------------------------------------------


def test_problems_of_a_run_are_recorded():
    problems = record_problems(ONCOMING, BRIEFLY)
    assert {recorded.kind for recorded in problems} == {GOES_ON, TO_GOAL}
    short = chosen(problems, GOES_ON, (30, 30), 5)
    assert 0 < len(short) <= 5 and all(recorded.problem.n == 30 for recorded in short)
    assert len(chosen(problems, GOES_ON, (30, 30), 1)) == 1


def test_the_table(monkeypatch):
    problems = [Recorded("made", TO_GOAL, busy_problem(goal, 12)) for goal in (True, False)]
    columns = try_solvers(problems, ("piqp", "ipopt"), Config())
    head, piqp, ipopt = lines(columns)
    assert head[0] == "solver" and (piqp[0], ipopt[0]) == ("piqp", "ipopt")
    assert piqp[1] == ipopt[1] == "2 of 2"
    assert float(ipopt[6]) == 1.0 and float(ipopt[8]) == 1.0
    assert float(piqp[8]) == pytest.approx(1.0, abs=1e-3) and piqp[10] == "2 of 2"
    (_, alone) = lines(columns[:1])
    assert alone[6] == alone[8] == "-"


def test_a_slow_solver_is_given_up(monkeypatch):
    monkeypatch.setattr(compare, "GIVE_UP", 0.0)
    problems = [Recorded("made", TO_GOAL, busy_problem(True, 12))] * 3
    (column,) = try_solvers(problems, ("piqp",), Config())
    assert [trial is None for trial in column.trials] == [False, True, True]
    assert lines([column])[1][1] == "1 of 3"


def test_names_of_solvers():
    assert known_backends(None) == list(DEFAULT)
    assert known_backends("osqp, fatrop") == ["osqp", "fatrop"]
    with pytest.raises(InputError, match="no solver 'simplex'; there are: osqp, piqp"):
        known_backends("osqp,simplex")


def test_the_command(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "mpcplan", "bench-solvers", str(ONCOMING), "--problems", "3",
         "--backends", "osqp,piqp", "--set", "drive.steps_max=30"],
        capture_output=True, text=True, cwd=ROOT, check=True, timeout=300,
    )  # fmt: skip
    assert done.stderr == "" and done.stdout.startswith("goes on, 30 steps: 3 problems of 1 ")
    done = subprocess.run(
        [sys.executable, "-m", "mpcplan", "bench-solvers", str(ONCOMING), "--backends", "x"],
        capture_output=True, text=True, cwd=ROOT, check=False, timeout=300,
    )  # fmt: skip
    assert done.returncode == 2 and done.stderr.startswith("error: no solver 'x'")
