"""`mpcplan explain`: a run and one cycle in words, and what it says to bad input."""

import gzip
import json
from pathlib import Path
from typing import Any

import pytest

from mpcplan.cli import BAD_INPUT, OK, main


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
