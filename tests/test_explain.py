"""`mpcplan explain`: a run and one cycle in words, and what it says to bad input."""

import gzip
import json
from pathlib import Path
from typing import Any

import made
import pytest

from mpcplan.bench.store import empty_row
from mpcplan.cli import BAD_INPUT, OK, main
from mpcplan.explain.cycle import cycle_lines
from mpcplan.explain.fault import fault_line
from mpcplan.explain.feared import once, refused_plans
from mpcplan.seed.seed import Rejection, SeedReport, words
from mpcplan.verify.drivability import Finding


def option(source: str = "lattice, refined", cost: float | None = 1.0, goal: bool = True) -> dict:
    """An option that passed verification."""
    found = {"ok": True, "amount": 0.0}
    return {
        "source": source, "label": "to d = 0.00 m", "cost": cost, "reaches_goal": goal,
        "verify": found,
    }  # fmt: skip


def cycle(step: int, **changes: Any) -> dict:
    """A cycle without fallback."""
    refine = {
        "status": "converged", "iterations": 3, "steps": 30, "tr1_before": 2.0, "tr1_after": 1.5,
    }  # fmt: skip
    refusal = {
        "count": 7, "smallest_violation": 0.2, "unit": "s", "obstacle": 42, "step": step + 9,
    }  # fmt: skip
    lattice = {
        "candidates": 100, "accepted": 60, "reaching_goal": 12, "rejected": {"collision": refusal},
    }  # fmt: skip
    plain = {
        "step": step, "source": "lattice, refined", "chosen": option(), "options": [option()],
        "refine": refine, "seeds": {"lattice": lattice}, "refusals": "60 of 100 were drivable",
        "fallback": None, "game": None, "verify": {"ok": True},
        "times_ms": {"predict": 1.0, "seed": 5.0 + step, "refine": 2.0, "total": 8.0 + step},
    }  # fmt: skip
    return plain | changes


GAME = {
    "reasons": ["obstacle 42 can be at the meeting of lanelets 1 and 2 in 3.0 s"],
    "actions": ["accelerate", "brake_hard"],
    "reward": -10.0,
    "best": [
        {"actions": ["accelerate", "brake_hard"], "reward": -10.0},
        {"actions": ["accelerate", "maintain"], "reward": -10.0},
        {"actions": ["maintain", "maintain"], "reward": -12.5},
    ],
    "beliefs": {"42": [0.2, 0.7, 0.1]},
    "responses": {"42": [["maintain"], ["brake_softly"], ["maintain"]]},
    "orders": {"42": "go"},
}


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The folder of a run of three cycles, the second of which fell back."""
    fell = cycle(
        3, source="emergency braking", chosen=option("emergency braking", None, False), options=[],
        refine=None, fallback="emergency braking: collision with obstacle 42 at step 11",
    )  # fmt: skip
    dear = cycle(6, chosen=option(cost=9.0), game=GAME)
    drive = {
        "problem": 5, "reached_step": None, "collided": False, "cause": "the goal was not reached",
        "cycles": [cycle(0), fell, dear, cycle(9, chosen=option(cost=20.0), options=[])],
    }  # fmt: skip
    trace = {"scenario": "ZAM_Some-1", "notes": ["an id was renamed"], "drives": [drive]}
    (tmp_path / "trace.json").write_text(json.dumps(trace), encoding="utf-8")
    return tmp_path


def told(capsys, *arguments: str) -> str:
    """What the command prints."""
    assert main(["explain", *arguments]) == OK
    return str(capsys.readouterr().out)


def test_a_run_is_told_with_its_cause_fallbacks_surprises_and_times(run, capsys):
    text = told(capsys, str(run))
    assert text.startswith("ZAM_Some-1\nproblem 5: did not reach the goal\n")
    for line in (
        "cause     the goal was not reached",
        "cycles    4, planned by: 3 x lattice, refined, 1 x emergency braking",
        "gained    refinement lowered the plans' TR1 from 6.000 to 4.500 in all",
        "goal      not reached by the plans of step 3",
        "fallback  step 3: emergency braking: collision with obstacle 42 at step 11",
        "surprise  step 9: the plan's cost rose from 9.0 to 20.0; 60 of 100 were drivable",
        "game      played at step 6; --step tells it",
        "longest 17 ms at step 9, there most of it for seed",
        "note      an id was renamed",
    ):
        assert line in text


@pytest.mark.parametrize("step", [6, 7, 8])
def test_a_cycle_is_told_with_its_game(run, capsys, step):
    text = told(capsys, str(run), "--step", str(step))
    for line in (
        "problem 5, cycle of step 6",
        "driven    lattice, refined (to d = 0.00 m): cost 9.00, reaches the goal",
        "seeds     lattice: 60 of 100 drivable, 12 reach the goal",
        "collision with obstacle 42 at step 15 refused 7, the best of them by 0.2 s",
        "the ego vehicle: accelerate, brake hard",
        "obstacle 42: level 0 20%, level 1 70%, level 2 10%; order: go",
        "at level 1 it would: brake softly",
        "1 more of those told are equal, it is the one computed last; the next one has 2.500 less",
    ):
        assert line in text


def test_the_fallback_of_a_cycle_is_told(run, capsys):
    text = told(capsys, str(run), "--step", "3")
    assert "driven    emergency braking" in text and "cost" not in text.split("\n")[1]
    assert "fallback  emergency braking: collision with obstacle 42 at step 11" in text


def test_traces_of_benchmarks_are_read_too(run, capsys):
    packed = run / "one.json.gz"
    packed.write_bytes(gzip.compress((run / "trace.json").read_bytes()))
    assert told(capsys, str(packed)) == told(capsys, str(run))


@pytest.mark.parametrize(
    ("content", "says"),
    [(None, "no such file"), (b"{", "cannot be read as a trace"), (b"[]", "is no trace"),
     (b'{"drives": [1]}', "is no trace"), (b"\xff\xfe", "cannot be read as a trace")],
)  # fmt: skip
def test_what_is_no_trace_is_refused_with_a_reason(tmp_path, capsys, content, says):
    file = tmp_path / "trace.json"
    if content is not None:
        file.write_bytes(content)
    assert main(["explain", str(file)]) == BAD_INPUT
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("error: ") and says in err and str(file) in err


def test_a_step_before_the_first_cycle_is_refused(run, capsys):
    assert main(["explain", str(run), "--step", "-1"]) == BAD_INPUT
    assert "the first one is of step 0" in capsys.readouterr().err


# -- whose fault it was, and what was feared ------------------------------------------------------


def failed(*cycles: dict, **changes: Any) -> dict:
    """A drive that did not reach its goal."""
    plain = {"problem": 5, "reached_step": None, "collided": False, "cause": "too late"}
    return plain | {"cycles": list(cycles)} | changes


def lost(step: int, **changes: Any) -> dict:
    """A cycle in which nothing reaches the goal."""
    rejected = {
        "acceleration": {
            "count": 70, "smallest_violation": 0.3, "unit": "m/s^2", "obstacle": None, "step": None,
        },
        "collision": {
            "count": 30, "smallest_violation": 0.2, "unit": "s", "obstacle": 42, "step": step + 9,
        },
    }  # fmt: skip
    seeds = {
        "lattice": {"candidates": 100, "accepted": 3, "reaching_goal": 0, "rejected": rejected}
    }
    return cycle(step, chosen=option(goal=False), seeds=seeds, **changes)


def test_fault_of_a_constraint_with_obstacle_step_and_margin():
    told = fault_line(failed(lost(0), lost(3)))
    assert told is not None and told.startswith("fault     a constraint: no plan reached the goal")
    assert "at step 0 3 of 100 candidates were drivable and none reached the goal" in told
    assert "collision with obstacle 42 at step 9 refused 30, the best of them by 0.2 s" in told
    assert told.index("collision") < told.index("acceleration refused 70")


def test_fault_of_the_planner_begins_where_the_goal_was_lost_for_good():
    told = fault_line(failed(cycle(0), lost(3), cycle(6), lost(9), lost(12)))
    assert told is not None and told.startswith("fault     the planner: its plan of step 6 still")
    assert "from step 9 on none did any more: at step 9 3 of 100" in told


def test_fault_of_a_collision():
    """Then it is asked since when no plan was safe."""
    reason = "emergency braking: search: collision with obstacle 7 at step 9 (gap -0.1 m)"
    braking = lost(6, fallback=reason)
    crash: dict[str, Any] = {"collided": True, "cause": "collided at step 9; first fallback: it"}
    told = fault_line(failed(lost(0), lost(3), braking, **crash))
    assert told is not None
    assert "the planner: its plan of step 3 was still safe, from step 6 on none was any" in told
    assert "(collided at step 9)" in told and "obstacle 7 at step 9, gap -0.1 m" in told
    told = fault_line(failed(braking, **crash))
    assert told is not None and "a constraint: no plan was safe from the first cycle on" in told
    told = fault_line(failed(braking, cycle(9), **crash))
    assert told is not None and "was taken to be safe, and yet collided at step 9" in told


def test_fault_of_the_planner_whose_plans_all_reached_the_goal():
    told = fault_line(failed(cycle(0), cycle(3)))
    assert told is not None and "the planner: every plan reached the goal, and yet" in told


def test_fault_of_the_scenario():
    scenario = "the scenario has no solution: the road is cut"
    assert fault_line(failed(lost(0)), scenario) == "fault     the scenario: the road is cut"
    told = fault_line(failed(cause="no route"))
    assert told is not None and "the scenario: nothing could be planned: no route" in told


def test_no_fault_where_the_goal_was_reached():
    assert fault_line(failed(lost(0), reached_step=9)) is None


def test_verification_is_named_where_candidates_reached_the_goal():
    reason = "emergency braking: search, refined: collision with obstacle 7 at step 4 (gap -0.1 m)"
    told = fault_line(failed(cycle(0, chosen=option(goal=False), fallback=reason)))
    assert told is not None
    assert "verification refused its plans by collision with obstacle 7 at step 4, gap -0" in told


def test_refusals_are_read_as_verification_writes_them():
    """The trace holds them in words: those of a finding and those of a seed report."""
    findings = [
        Finding(False, "collision", 28, 331, -0.0931, "m", "gap"),
        Finding(False, "road", 75, None, 0.0394, "m^2", "off the road by"),
        Finding(False, "kinematics", 13, None, 0.466, "over the limit", "friction"),
    ]
    report = SeedReport("lattice", 9, 0, 0, {"collision": Rejection(4, 0.2, "s", 42, 9)})
    fallback = "; ".join(["emergency braking", *(f"search: {f}" for f in findings), words(report)])
    refused = refused_plans(cycle(0, fallback=fallback))
    assert [(r.check, r.obstacle, r.step) for r in refused] == [
        ("collision", 331, 28), ("road", None, 75), ("kinematics", None, 13),
    ]  # fmt: skip
    assert str(refused[0]) == "collision with obstacle 331 at step 28, gap -0.0931 m"


def test_whom_the_plans_feared(run, capsys):
    text = told(capsys, str(run))
    assert "feared    of 4 cycles: obstacle 42 in 4 (steps 0 to 9)" in text
    assert "tried     400 candidates, 240 of them drivable; refused by collision 28" in text
    assert "fault     the planner: every plan" in text
    text = told(capsys, str(run), "--step", "3")
    assert "feared    collision with obstacle 42 at step 11" in text


def test_a_cycle_tells_its_risks_and_by_how_much_an_option_was_refused():
    found = {
        "ok": False, "check": "collision", "step": 8, "obstacle": 3, "amount": -0.25, "unit": "m",
        "detail": "gap",
    }  # fmt: skip
    chosen = option("search, refined") | {"verify": found}
    lines = cycle_lines(
        {"drives": [failed(cycle(0, chosen=chosen, risks=["the way bends"]))]}, 0
    )  # fmt: skip
    text = "\n".join(lines)
    assert "refused: collision with obstacle 3 at step 8 (gap -0.25 m)" in text
    assert "risk      the way bends; the next plan comes sooner" in text


def test_equal_reasons_are_told_once():
    assert (
        once("braking: a at step 1; b; a at step 1; b; b") == "braking: a at step 1; b; a at step 1"
    )


def test_a_step_after_the_end_is_none(run, capsys):
    assert main(["explain", str(run), "--step", "999"]) == BAD_INPUT
    assert "no planning cycle at step 999; the last one is of step 9" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("cells", "said"),
    [
        ({"status": "solved", "valid": True, "TR1": 1.25}, "verdict   valid, TR1 1.250"),
        ({"status": "invalid", "cause": "on_road: left"}, "verdict   invalid: on_road: left"),
        ({"status": "not_solved", "cause": "too late"}, "verdict   not_solved\n"),
        (
            {"status": "not_solved", "cause": "the scenario has no solution: it is cut; too late"},
            "fault     the scenario: it is cut\n",
        ),
    ],
)
def test_the_table_of_bench_tells_the_verdict(tmp_path, capsys, cells, said):
    trace = {"scenario": "ZAM_Some-1", "drives": [failed(lost(0))]}
    for name in ("traces", "rows"):
        (tmp_path / name).mkdir()
    path = tmp_path / "traces" / "ZAM_Some-1.json.gz"
    path.write_bytes(gzip.compress(json.dumps(trace).encode()))
    row = empty_row("ZAM_Some-1") | cells
    (tmp_path / "rows" / "ZAM_Some-1.json").write_text(json.dumps(row), encoding="utf-8")
    assert said in told(capsys, str(path))


@pytest.mark.parametrize(
    ("y", "said"),
    [
        (0.3, "fault     the scenario: its start is off the road by"),
        (1.75, "fault     a constraint"),
    ],
)
def test_the_scenario_is_asked_where_the_trace_says(tmp_path, capsys, y, said):
    path = made.write(tmp_path, made.problem(1, made.state(10, y, 10), made.rectangle_goal(80)))
    trace = {"scenario": "ZAM_Some-1", "file": str(path), "drives": [failed(lost(0))]}
    (tmp_path / "trace.json").write_text(json.dumps(trace), encoding="utf-8")
    assert said in told(capsys, str(tmp_path))
    path.write_text("<commonRoad", encoding="utf-8")  # then the trace alone is told
    assert "fault     a constraint" in told(capsys, str(tmp_path))
