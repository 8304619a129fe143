"""A driven trajectory replayed in a new simulation, on time or some steps late.

The competition's organisers replay a solution one time step late: at time step k the ego stands
where the solution is at k - 1, and the others react to that.
"""

from dataclasses import dataclass

import numpy as np

from mpcplan.observation import Snapshot
from mpcplan.scenario import LoadedScenario, Problem
from mpcplan.simulate.open import open_traffic
from mpcplan.trajectory import Array, Trajectory
from mpcplan.verify.drivability import separation


@dataclass(frozen=True, eq=False)
class Replay:
    """What the others did in a replay.

    Attributes:
        others: at every time step of the trajectory.
        hit: (time step, obstacle id) at which the replayed ego first overlapped somebody, or None.
    """

    others: tuple[Snapshot, ...]
    hit: tuple[int, int] | None


def replay(loaded: LoadedScenario, problem: Problem, driven: Trajectory, lag: int) -> Replay:
    """Replays a trajectory ``lag`` time steps late.

    Raises:
        TrafficError: the simulation cannot begin or go on.
    """
    traffic = open_traffic(loaded, problem)
    try:
        others, hit = [], None
        for step in driven.steps.tolist():
            state = driven.state_at(max(step - lag, driven.first_step))
            if step > driven.first_step:
                traffic.advance(step, state)
            others.append(traffic.at(step))
            if hit is None:
                hit = _hit(state, others[-1])
        return Replay(tuple(others), hit)
    finally:
        traffic.close()


def _hit(state: Array, seen: Snapshot) -> tuple[int, int] | None:
    """Time step and id of somebody whose box overlaps the ego's."""
    if not seen.ids:
        return None
    gap = separation(state[None], seen.boxes[:, None])[:, 0]
    nearest = int(np.argmin(gap))
    return (seen.step, seen.ids[nearest]) if gap[nearest] < 0 else None
