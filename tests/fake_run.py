"""Runs made by hand: straight drives with plans, in the shape of mpcplan.simulate's."""

from types import SimpleNamespace

import numpy as np

from mpcplan.config import Config
from mpcplan.scenario import LoadedScenario, Problem
from mpcplan.trajectory import Trajectory
from mpcplan.vehicle import simulate


def straight(problem: Problem, steps: int, dt: float) -> Trajectory:
    """A drive that brakes, holds and accelerates, with a slight turn to and fro."""
    time = np.linspace(0, 2 * np.pi, steps)
    inputs = np.column_stack([-1.5 * np.cos(time), 0.02 * np.sin(2 * time)])
    return simulate(problem.start.tolist(), inputs, dt, problem.first_step)


def drive(problem: Problem, steps: int = 40, every: int = 3, **changes: object) -> SimpleNamespace:
    """What the closed loop answers for one problem."""
    driven = straight(problem, steps, 0.1)
    cycles = []
    for step in range(driven.first_step, driven.last_step, every):
        inputs = np.zeros((30, 2))
        plan = simulate(driven.state_at(step).tolist(), inputs, driven.dt, step)
        seconds = 0.02 + 0.001 * (step % 7)
        cycles.append(
            SimpleNamespace(step=step, plan=SimpleNamespace(trajectory=plan), seconds=seconds)
        )
    values = {"reached_step": driven.last_step, "cause": "", "collided": False, **changes}
    return SimpleNamespace(problem_id=problem.id, trajectory=driven, cycles=tuple(cycles), **values)


def run(loaded: LoadedScenario, *drives: SimpleNamespace, cause: str = "") -> SimpleNamespace:
    """A run; by default every problem is driven for 4 s and solved."""
    chosen = drives or tuple(drive(problem) for problem in loaded.problems)
    return SimpleNamespace(
        loaded=loaded, config=Config(), drives=tuple(chosen), solved=not cause, cause=cause
    )
