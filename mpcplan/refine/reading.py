"""The numbers of one refinement problem for solvers of the whole: parameters and bounds of rows.

They belong to the expressions of :mod:`mpcplan.refine.stage`. What the problem looks up in tables
along the road is read off at an iterate: the curvature as a line over the step, the road's edges
and the neighbours beside as lines in s, and what the body's exact projection adds to that onto a
circle.
"""

from dataclasses import dataclass

import numpy as np

from mpcplan.refine.constraints import FREE, Iterate
from mpcplan.refine.problem import Problem
from mpcplan.refine.stage import N_GIVEN, N_ROWS, Given, Point, body_offset_at, point_at
from mpcplan.seed.paths import BODY_POINTS
from mpcplan.seed.seed import Stage
from mpcplan.trajectory import Array
from mpcplan.vehicle import FORD_ESCORT as CAR

NO_LEAD = 1e3  # m ahead, in place of infinity
NO_DUE = -1e4  # m
REACH = 0.25  # m, to either side, over which the edges' slopes are read off


@dataclass(frozen=True, eq=False)
class Reading:
    """What was read off at an iterate.

    Attributes:
        par: (N + 1, N_GIVEN) parameters of the stages.
        rows: (2, N, N_ROWS) lower and upper bounds of the rows of stages 1..N.
        goal: (2, 4) bounds of the last body's s, d, speed and heading.
        turn: (3,) heading and curvature of the path at an arc length: for the last heading.
    """

    par: Array
    rows: Array
    goal: Array
    turn: Array


def read(problem: Problem, z: Iterate) -> Reading:
    """Reads the tables off at an iterate."""
    n, frame = problem.n, problem.seed.road.frame
    par = np.zeros((n + 1, N_GIVEN))
    curvatures = problem.curvatures(z.x)
    par[:-1, [Given.KAPPA, Given.KAPPA_SLOPE, Given.KAPPA_FROM]] = curvatures
    par[:, Given.SPEED_LIMIT] = problem.speed_limit
    par[1:, Given.DUE] = np.maximum(problem.due, NO_DUE)
    s = z.x[:, Stage.S]
    par[:, Given.LEAD] = np.minimum(problem.corridor.lead[: n + 1], s + NO_LEAD)
    par[:, Given.LANE] = problem.lane
    par[:, [Given.SLANT_S, Given.SLANT_D]] = problem.corridor.slant[: n + 1, :2]
    par[:, Given.AT] = s
    _read_body(problem, z.x[1:], par[1:])
    low, high, _ = problem.rows.goal_rows(z.x[-1])
    turn = np.concatenate([frame.heading(s[-1:]), frame.curvature(s[-1:]), s[-1:]])
    return Reading(par, _bounds(problem), np.stack([low[1::2], high[0::2]]), turn)


def _read_body(problem: Problem, x: Array, par: Array) -> None:
    """Parameters of the body's points at states k >= 1, into their rows."""
    frame = problem.seed.road.frame
    at, offset, turn = problem.rows.project_body(x)
    par[:, Given.BEND] = bend = frame.curvature(x[:, Stage.S] + CAR.rear_to_centre)
    edges = [problem.rows.sides((at + shift, offset, turn))[1:] for shift in (-REACH, 0.0, REACH)]
    for i, ahead in enumerate(BODY_POINTS):
        circle = body_offset_at(x[:, Stage.D], x[:, Stage.MU], bend, ahead)
        par[:, point_at(i, Point.BIAS)] = offset[:, i] - circle
        for side, (edge, slope) in enumerate(
            ((Point.LOW, Point.LOW_SLOPE), (Point.HIGH, Point.HIGH_SLOPE))
        ):
            before, here, after = (values[side][:, i] for values in edges)
            par[:, point_at(i, edge)] = here
            par[:, point_at(i, slope)] = (after - before) / (2 * REACH)


def _bounds(problem: Problem) -> Array:
    """(2, N, N_ROWS) bounds of the stages' rows."""
    n, refine, corridor = problem.n, problem.config.refine, problem.corridor
    later = slice(1, n + 1)
    limit = CAR.a_max * refine.actuator_share
    circle, side = CAR.a_max * refine.friction_share**2, problem.lateral_limit
    low, high = np.full((n, N_ROWS), -np.inf), np.full((n, N_ROWS), np.inf)
    low[:, 3], low[:, 5] = -side, corridor.s_min[later]
    high[:, 0], high[:, 1], high[:, 2] = limit, circle, side
    high[:, 4], high[:, 6] = corridor.s_max[later], corridor.slant[later, 2]
    low[:, 7::2], high[:, 8::2] = 0.0, 0.0
    return np.stack([np.where(low > -FREE, low, -np.inf), np.where(high < FREE, high, np.inf)])
