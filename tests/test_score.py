"""The official checker in its child process: verdicts, places of failure, cost, crashes."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import straight_road as road

from mpcplan.errors import InputError, RefereeError
from mpcplan.score import referee_start
from mpcplan.score.referee import Verdict, evaluate
from mpcplan.score.tr1 import CHECKER_WEIGHTS, REPORT_WEIGHTS, tr1
from mpcplan.score.verdict import CHECKS, verdict_lines

PARTS = {"Jlon": 100.0, "SR": 0.1, "D": 0.5, "LC": 2.0}


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    return road.write_scenario(tmp_path)


def _judge(scenario: Path, states, problem: int = road.PROBLEM) -> Verdict:
    return evaluate(scenario, road.write_solution(scenario.parent, states, problem))


def _failed(verdict: Verdict) -> list[str]:
    return [name for name in CHECKS if not verdict.checks[name]]


def test_tr1_is_the_weighted_sum():
    assert tr1(PARTS) == pytest.approx(1.0 + 2.2 + 4.0 + 1.0)
    assert tr1(PARTS, REPORT_WEIGHTS) == pytest.approx(1.0 + 2.2 + 4.0 + 10.0)


def test_weights_are_those_of_the_checker():
    from commonroad.common.solution import CostFunction
    from commonroad_dc.costs.evaluation import cost_function_mapping

    official = {part.name: w for part, w in cost_function_mapping[CostFunction.TR1]}
    assert official == dict(CHECKER_WEIGHTS)


def test_the_caller_does_not_import_the_checker():
    code = "import sys, mpcplan.score.referee; print([m for m in sys.modules if 'commonroad' in m])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_straight_drive_is_valid_and_silent(scenario, capfd):
    verdict = _judge(scenario, road.straight())
    assert verdict.valid and not verdict.reasons and verdict.cause == ""
    assert list(verdict.checks) == list(CHECKS)
    assert verdict.scenario == road.ID
    assert verdict.duration_s == pytest.approx(2.0)
    assert verdict.tr1 == pytest.approx(tr1(verdict.parts))
    assert verdict.tr1_report == pytest.approx(tr1(verdict.parts, REPORT_WEIGHTS))
    assert capfd.readouterr() == ("", "")


def test_parts_are_those_of_a_direct_call(scenario):
    verdict = _judge(scenario, road.straight())
    code = f"""
import json, os
from commonroad.common.file_reader import CommonRoadFileReader
from commonroad.common.solution import CommonRoadSolutionReader, CostFunction, VehicleType
from commonroad_dc.costs.evaluation import CostFunctionEvaluator
scenario, problems = CommonRoadFileReader({str(scenario)!r}).open()
part = CommonRoadSolutionReader.open({str(scenario.with_name("solution.xml"))!r})
part = part.planning_problem_solutions[0]
evaluator = CostFunctionEvaluator(CostFunction.TR1, VehicleType.FORD_ESCORT)
problem = problems.planning_problem_dict[part.planning_problem_id]
result = evaluator.evaluate_pp_solution(scenario, problem, part.trajectory)
print(json.dumps({{k.name: float(v) for k, v in result.partial_costs.items()}}), flush=True)
os._exit(0)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert verdict.parts == pytest.approx(json.loads(done.stdout), abs=1e-6)


def test_far_away_map_gives_the_same_verdict(tmp_path):
    near, far = tmp_path / "near", tmp_path / "far"
    near.mkdir()
    far.mkdir()
    utm = (691000.0, 5334000.0)
    a = _judge(road.write_scenario(near), road.straight())
    b = _judge(road.write_scenario(far, utm), road.straight(offset=utm))
    assert b.valid
    assert b.parts == pytest.approx(a.parts, abs=1e-4)


def test_collision_names_obstacle_and_step(scenario):
    states = road.straight()
    for state in states:
        state.position = state.position + np.array([0.0, road.WIDTH])
    verdict = _judge(scenario, states)
    # both boxes are half 4.298 m and half 4.5 m long: they meet from x = 20 - 4.399 m on
    assert verdict.reasons["no_collision"] == "problem 100: hits obstacle 50 at step 16"
    assert "starts with position" in verdict.reasons["start"]


def test_leaving_the_road_names_step_and_place(scenario):
    states = road.straight()
    for state in states[10:]:
        state.position = state.position - [0.0, 1.5]
    verdict = _judge(scenario, states)
    assert _failed(verdict) == ["on_road", "feasible"]
    assert "leaves the road at step 10, x 10.00 m, y -1.50 m" in verdict.reasons["on_road"]
    assert "from step 9 to 10" in verdict.reasons["feasible"]


def test_jump_ahead_names_the_transition(scenario):
    states = road.straight()
    for state in states[12:]:
        state.position = state.position + np.array([0.5, 0.0])
    verdict = _judge(scenario, states)
    assert _failed(verdict) == ["feasible"]
    reason = verdict.reasons["feasible"]
    assert reason.startswith("problem 100: the KS model cannot drive from step 11 to 12")
    assert verdict.cause == f"feasible: {reason}"


def test_wrong_start_names_the_attribute(scenario):
    verdict = _judge(scenario, road.straight(steps=30, v=6.0))
    assert "starts with velocity 6.0, the problem asks for 10.0" in verdict.reasons["start"]


def test_missed_goal_names_time_and_distance(scenario):
    verdict = _judge(scenario, road.straight(steps=10))
    assert _failed(verdict) == ["goal"]
    assert "time step 10 not in [20, 25]" in verdict.reasons["goal"]
    assert "position 5.00 m away" in verdict.reasons["goal"]


def test_solution_of_another_problem(scenario):
    verdict = _judge(scenario, road.straight(), problem=7)
    expected = "problem 100 has no solution, the scenario has no problem 7"
    assert verdict.reasons["all_problems"] == expected
    assert verdict.tr1 is None and "KeyError" in verdict.cost_error
    assert any("no cost" in line for line in verdict_lines(verdict))


def test_cost_outside_the_map_is_an_error_not_an_exception(scenario):
    states = road.straight()
    for state in states:
        state.position = state.position + np.array([0.0, 500.0])
    verdict = _judge(scenario, states)
    assert not verdict.valid
    assert verdict.parts is None and verdict.cost_error


@pytest.mark.parametrize("broken", ["scenario", "solution"])
def test_broken_files_are_input_errors(scenario, broken):
    solution = road.write_solution(scenario.parent, road.straight())
    path = {"scenario": scenario, "solution": solution}[broken]
    path.write_text(path.read_text()[:500])
    with pytest.raises(InputError, match=str(path)):
        evaluate(scenario, solution)


def test_missing_file_is_an_input_error(scenario):
    with pytest.raises(InputError, match="solution file not found"):
        evaluate(scenario, scenario.with_name("none.xml"))


def test_value_that_is_not_finite_is_an_input_error(scenario):
    states = road.straight()
    states[3].position = np.array([np.nan, 0.0])
    with pytest.raises(InputError, match="problem 100, step 3"):
        _judge(scenario, states)


def test_solution_of_another_scenario_is_an_input_error(scenario):
    solution = road.write_solution(scenario.parent, road.straight())
    solution.write_text(solution.read_text().replace("ZAM_Straight-1", "ZAM_Straight-2"))
    with pytest.raises(InputError, match="ZAM_Straight-2_1_T-1"):
        evaluate(scenario, solution)


def _fake_child(monkeypatch, tmp_path: Path, body: str) -> None:
    """Replace the child by a module whose code sees paths and tasks as sys.argv."""
    (tmp_path / "fake_child.py").write_text(
        "import json, os, signal, sys, time\n"
        "out = open(sys.argv[3], 'a', buffering=1)\n"
        "def say(**message): out.write(json.dumps(message) + '\\n')\n"
        "def ok(task): say(begin=task); say(task=task, ok=True, reason='', parts=None)\n" + body
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))  # for a program
    monkeypatch.syspath_prepend(tmp_path)  # for a fork
    monkeypatch.setattr(referee_start, "CHILD", "fake_child")


STARTS = pytest.mark.parametrize("start", [referee_start.as_program, referee_start.as_fork])


CRASH_ON_ROAD = """
say(header={"scenario": "X", "duration_s": 1.0})
for task in sys.argv[4:]:
    if task == "on_road":
        say(begin=task)
        os.kill(os.getpid(), signal.SIGSEGV)
    ok(task)
say(end=True)
"""


@STARTS
def test_crash_in_one_check_costs_this_check_only(scenario, monkeypatch, tmp_path, start):
    _fake_child(monkeypatch, tmp_path, CRASH_ON_ROAD)
    solution = road.write_solution(scenario.parent, road.straight())
    verdict = evaluate(scenario, solution, start=start)
    assert _failed(verdict) == ["on_road"]
    expected = "checker crashed (signal 11, SIGSEGV) during the boundary check"
    assert verdict.reasons["on_road"] == expected


@STARTS
def test_a_child_that_always_dies_is_a_referee_error(scenario, monkeypatch, tmp_path, start):
    _fake_child(monkeypatch, tmp_path, "sys.exit('no module of that kind')")
    solution = road.write_solution(scenario.parent, road.straight())
    with pytest.raises(RefereeError, match=r"ended with code 1 during the start: no module"):
        evaluate(scenario, solution, start=start)


@STARTS
def test_both_ways_to_start_the_child_give_one_verdict(scenario, start):
    solution = road.write_solution(scenario.parent, road.straight())
    assert evaluate(scenario, solution, start=start) == evaluate(scenario, solution)


@STARTS
def test_a_check_that_hangs_is_stopped(scenario, monkeypatch, tmp_path, start):
    hang = CRASH_ON_ROAD.replace("os.kill(os.getpid(), signal.SIGSEGV)", "time.sleep(60)")
    _fake_child(monkeypatch, tmp_path, hang)
    solution = road.write_solution(scenario.parent, road.straight())
    verdict = evaluate(scenario, solution, timeout_s=1.0, start=start)
    assert _failed(verdict) == ["on_road"]
    assert "did not finish within 1 s" in verdict.reasons["on_road"]
