"""Parameters of the refinement."""

from typing import Annotated, Literal

from pydantic import Field

from mpcplan.config.base import ClassName, Section, par

KnownBackend = Literal[
    "osqp", "piqp", "piqp multistage", "osqp then piqp", "hpipm", "proxqp", "qpsolvers clarabel",
    "qpsolvers proxqp", "ipopt", "fatrop",
]  # fmt: skip
Backend = KnownBackend | ClassName
WHOLE = ("ipopt", "fatrop")
"""Backends that solve the nonlinear problem as a whole."""


class RefineConfig(Section):
    """The optimal-control problem and its solution by sequential quadratic programming."""

    enabled: bool = par(True, "", "refine the seeds; otherwise the sampled lattice drives alone")
    horizon: Annotated[float, Field(gt=0, le=60)] | Literal["goal"] = par(
        3.0, "s", "length of the problem, or 'goal' for the whole way to the goal"
    )
    fresh_to_goal: bool = par(
        True, "", "refine a fresh seed to its end once, whatever the horizon of later cycles is"
    )
    settle: float = par(
        0.01,
        "1",
        "where the others' motion is recorded, the last plan is refined the whole way to the goal "
        "again as long as the last time gained more than this share of its cost; 1: never",
        ge=0,
        le=1,
    )
    asides: tuple[Annotated[float, Field(ge=0, le=3)], ...] = par(
        (0.3, 0.0),
        "m",
        "how much further aside than TR1 others count as ahead, for the refinement may still move "
        "sideways: the first; where the others' motion is recorded the best of all",
        min_length=1,
    )
    retry_margins: tuple[Annotated[float, Field(gt=0, le=2)], ...] = par(
        (0.15, 0.08), "m", "margins grow by these, one after the other, while verification refuses"
    )
    iterations: int = par(5, "1", "SQP iterations at most when a plan goes on", ge=1, le=200)
    tolerance: float = par(2e-3, "1", "scaled step at which the iteration ends", gt=0, le=1)
    gain: float = par(1e-3, "1", "relative gain at which the iteration ends", ge=0, le=1)
    damping: float = par(
        0.001,
        "1",
        "Levenberg-Marquardt damping at the start, in units of typical steps",
        ge=0,
        le=10,
    )
    backend: Backend = par("hpipm", "", "QP solver of the subproblems when a plan goes on")
    fresh_backend: Backend = par(
        "hpipm",
        "",
        "QP solver for a fresh seed; 'then': where OSQP's answer could not be polished",
    )
    fresh_iterations: int = par(10, "1", "SQP iterations at most for a fresh seed", ge=1, le=200)
    qp_iterations: int = par(150, "1", "OSQP iterations at most per subproblem", ge=10, le=100000)
    qp_tolerance: float = par(1e-4, "1", "OSQP's absolute and relative tolerance", gt=0, le=0.1)
    whole_iterations: int = par(
        500, "1", "iterations at most where the problem is solved as a whole", ge=1, le=10000
    )
    compile: bool = par(
        True,
        "",
        "compile the problem's functions once, where a C compiler is found; the results are the "
        "same bits",
    )
    line_search: int = par(6, "1", "halvings of a step at most", ge=0, le=30)
    penalty_lon: float = par(
        200.0, "1/m", "exact penalty on leaving the corridor in s", gt=0, le=1e6
    )
    penalty_lat: float = par(400.0, "1/m", "exact penalty on leaving it in d", gt=0, le=1e6)
    penalty_acceleration: float = par(
        20.0, "s^2/m", "exact penalty on lateral acceleration and friction circle", gt=0, le=1e6
    )
    penalty_goal: float = par(400.0, "1/m", "exact penalty on missing the goal", gt=0, le=1e6)
    friction_share: float = par(
        0.97, "1", "part of the friction circle that plans use", gt=0.1, le=1
    )
    actuator_share: float = par(0.98, "1", "part of the actuators that plans use", gt=0.1, le=1)
    speeding: float = par(
        0.5, "s/m^2", "weight of the squared excess over the speed limit", ge=0, le=1e3
    )
    terminal: tuple[float, float, float, float, float, float] = par(
        (1.0, 10.0, 400.0, 10.0, 200.0, 0.4),
        "1/unit^2",
        "weights of the last state's distance from the seed (s, d, mu, v, delta, a), where the "
        "problem ends before the goal",
    )
