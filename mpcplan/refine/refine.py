"""From a seed to a refined plan: corridor, problem, SQP, and the exact drive of its inputs."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mpcplan.config import Config
from mpcplan.predict.occupancy import Occupancy
from mpcplan.refine.corridor import Corridor, build_corridor, narrowed
from mpcplan.refine.problem import Problem
from mpcplan.refine.reading import Iterate
from mpcplan.refine.sqp import SqpResult, solve
from mpcplan.road.goal import GoalWindow
from mpcplan.seed.goal_fit import speed_fits
from mpcplan.seed.paths import frenet_pose
from mpcplan.seed.seed import Seed, Stage
from mpcplan.trajectory import Array, State, Trajectory
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import acceleration_limit, simulate

MIN_STEPS = 2

Watch = Callable[[Problem, bool], None]
"""Is shown every problem before it is solved, and whether it is a fresh seed's."""


@dataclass(frozen=True, eq=False)
class Refined:
    """A refined seed.

    Attributes:
        trajectory: the KS model driven by the solution's inputs.
        result: how the SQP went.
        corridor: in which it was refined, at the steps 0..N.
    """

    trajectory: Trajectory
    result: SqpResult
    corridor: Corridor

    def as_dict(self) -> dict[str, Any]:
        """For the trace."""
        before, after = self.result.tr1
        tr1 = {"tr1_before": round(before, 6), "tr1_after": round(after, 6)}
        return {**self.result.as_dict(), **tr1, "steps": len(self.trajectory.inputs)}


def refine(
    seed: Seed, state: Array, acceleration: float, occupancy: Occupancy, config: Config, dt: float,
    fresh: bool, extra: float = 0.0, watch: Watch | None = None, aside: float | None = None,
) -> Refined | None:  # fmt: skip
    """Refines a seed from a rear-axle state; None where the seed is too short to refine.

    Args:
        seed: what is refined.
        state: (5,) at its first step.
        acceleration: in the step before [m/s^2].
        occupancy: the others along the seed's road.
        config: the configuration.
        dt: time step [s].
        fresh: whether the seed was never refined: then the problem may reach to its end.
        extra: margin [m] kept from obstacles and road's edge on top of the configured ones.
        watch: is shown the problem.
        aside: see :func:`mpcplan.refine.corridor.build_corridor`.
    """
    problem = make_problem(seed, state, acceleration, occupancy, config, dt, fresh, extra, aside)
    if problem is None:
        return None
    if watch is not None:
        watch(problem, fresh)
    result = solve(problem, config.refine, fresh)
    trajectory = simulate(state, _inputs(result.z, float(state[State.V]), dt), dt, seed.first_step)
    return Refined(trajectory, result, problem.corridor)


def make_problem(
    seed: Seed, state: Array, acceleration: float, occupancy: Occupancy, config: Config, dt: float,
    fresh: bool, extra: float, aside: float | None,
) -> Problem | None:  # fmt: skip
    """The optimal-control problem of a seed, see :func:`refine`."""
    total = len(seed.states) - 1
    whole = config.refine.horizon == "goal" or (fresh and config.refine.fresh_to_goal)
    n = total if whole else min(total, round(float(config.refine.horizon) / dt))
    if n < MIN_STEPS:
        return None
    pose = frenet_pose(seed.road, state)
    x0 = np.array([pose.s, pose.d, pose.mu, state[State.V], pose.delta, acceleration])
    goal = _goal_at_end(seed) if n == total and seed.reaches_goal else None
    corridor = narrowed(build_corridor(seed, occupancy, config, aside), extra)
    return Problem(seed, corridor, x0, goal, n, config, dt, extra)


def _goal_at_end(seed: Seed) -> GoalWindow | None:
    """The window that the seed's last state meets in time."""
    last = seed.first_step + len(seed.states) - 1
    goals = [goal for goal in seed.road.goals if goal.first <= last <= goal.last]
    v = seed.states[-1:, Stage.V]
    fitting = [goal for goal in goals if speed_fits(goal, v)[0]]
    goal = next(iter(fitting or goals), None)
    if goal is None:
        return None
    s, d, mu = (float(seed.states[-1, c]) for c in (Stage.S, Stage.D, Stage.MU))
    ahead = CAR.rear_to_centre * np.array([np.cos(mu), np.sin(mu)])
    return goal.around(s + ahead[0], d + ahead[1])


def _inputs(z: Iterate, v0: float, dt: float) -> Array:
    """(n, 2) inputs of an iterate, clipped to the actuators (the QP meets them to a tolerance)."""
    a, w = z.x[1:, Stage.A].tolist(), z.u[:, 1]
    v, inputs = v0, []
    for wanted in a:
        top = float(min(acceleration_limit(v), acceleration_limit(max(v + wanted * dt, 0.0))))
        applied = max(min(wanted, top, CAR.a_max), -CAR.a_max, -v / dt)
        inputs.append(applied)
        v = max(v + applied * dt, 0.0)
    return np.column_stack([inputs, np.clip(w, -CAR.v_delta_max, CAR.v_delta_max)])
