"""What a planning cycle considered, as lines on the map."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mpcplan.config import Config
from mpcplan.cycle import Cycle
from mpcplan.observation import Forecast
from mpcplan.plan import Option
from mpcplan.refine.corridor import FAR, Corridor, build_corridor
from mpcplan.road.road import Road
from mpcplan.seed.lattice import Lattice
from mpcplan.seed.seed import COLLISION, Stage
from mpcplan.seed.track import frenet_states
from mpcplan.trajectory import Array, Trajectory
from mpcplan.vehicle import FORD_ESCORT as CAR
from mpcplan.vehicle import centres

SHOWN = 40  # candidates of each kind that are kept, evenly over all
POINTS = 12  # of a candidate's line
LOOK = 60  # time steps of the forecast that are kept
USUAL_HORIZON = 3.0  # s, of the corridor of a plan that goes on as it was


@dataclass(frozen=True, eq=False)
class Candidates:
    """Some of the lattice's candidates: (n, POINTS, 2) lines of the body's centre [m]."""

    accepted: Array
    collided: Array
    refused: Array


@dataclass(frozen=True, eq=False)
class Ribbon:
    """The corridor of a plan, at its steps 0..N.

    Attributes:
        left, right: (N + 1, 2) how far the body's sides may go [m], on the map.
        s: (N + 1,) the plan's arc length from where it begins, of the rear axle [m].
        s_min, s_max: (N + 1,) its bounds; infinite where there is none.
    """

    left: Array
    right: Array
    s: Array
    s_min: Array
    s_max: Array


@dataclass(frozen=True, eq=False)
class Considered:
    """One planning cycle.

    Attributes:
        step: its time step.
        plan: what it answered.
        forecast: of the others, for a while.
        candidates: of the lattice; None: no new ones were sought.
        options: centre lines of what else passed verification, each (n, 2).
        turned_down: of what did not.
        feared: time step and obstacle of the collisions for which plans were turned down.
        ribbon: the plan's corridor; None: it has none (emergency braking, no refinement).
        agrees: whether the plan is the one of which the trace tells.
    """

    step: int
    plan: Trajectory
    forecast: Forecast
    candidates: Candidates | None
    options: tuple[Array, ...]
    turned_down: tuple[Array, ...]
    feared: tuple[tuple[int, int], ...]
    ribbon: Ribbon | None
    agrees: bool = True


@dataclass(eq=False)
class Notes:
    """Takes down what the planner shows: a :class:`mpcplan.witness.Witness`."""

    config: Config
    _sampled: list[tuple[Road, Candidates]] = field(default_factory=list)
    last: Considered | None = None

    def sampled(self, road: Road, grid: Lattice) -> None:
        """Keeps some candidates; the lattice's tables are too large for that."""
        self._sampled.append((road, _candidates(grid)))

    def chose(
        self, cycle: Cycle, chosen: Option, options: Sequence[Option], refused: Sequence[Option]
    ) -> None:
        """Keeps the cycle as :attr:`last`."""
        road = chosen.seed.road if chosen.seed is not None else None
        found = [candidates for on, candidates in self._sampled if road is None or on is road]
        self._sampled.clear()
        self.last = Considered(
            cycle.observation.step,
            chosen.trajectory,
            _for_a_while(cycle.forecast, cycle.observation.step),
            found[0] if found else None,
            tuple(centres(o.trajectory.states) for o in options if o is not chosen),
            tuple(centres(o.trajectory.states) for o in refused if o is not chosen),
            _feared(refused),
            self._ribbon(cycle, chosen),
        )

    def _ribbon(self, cycle: Cycle, chosen: Option) -> Ribbon | None:
        """The corridor in which the plan was refined; of one that goes on as it was, the one in
        which it could have been."""
        if chosen.seed is None or not self.config.refine.enabled:
            return None
        if chosen.refined is not None:
            corridor, n = chosen.refined.corridor, len(chosen.refined.trajectory.inputs)
        else:
            around = cycle.around(chosen.seed.road)
            corridor = build_corridor(chosen.seed, around, self.config)
            n = round(USUAL_HORIZON / chosen.trajectory.dt)
        n = min(n, len(chosen.trajectory.inputs), len(chosen.seed.states) - 1)
        before = cycle.observation.acceleration
        return _ribbon(chosen.trajectory, chosen.seed.road, corridor.steps(0, n + 1), before)


def _feared(refused: Sequence[Option]) -> tuple[tuple[int, int], ...]:
    """Time step and obstacle of every collision that verification foresaw, once each."""
    found: dict[int, int] = {}
    for option in refused:
        finding = option.finding
        if finding.obstacle is not None and finding.step is not None:
            found.setdefault(finding.obstacle, finding.step)
    return tuple((step, obstacle) for obstacle, step in found.items())


def _for_a_while(forecast: Forecast, step: int) -> Forecast:
    boxes = forecast.at(np.arange(step, step + LOOK + 1))
    return Forecast(step, forecast.ids, boxes, forecast.held, forecast.exact)


def _candidates(grid: Lattice) -> Candidates:
    """Some of the accepted, of those in somebody's way, and of those refused otherwise."""
    hit = grid.violations[COLLISION][0] > 0.0
    return Candidates(
        _lines(grid, grid.accepted),
        _lines(grid, ~grid.accepted & hit),
        _lines(grid, ~grid.accepted & ~hit),
    )


def _lines(grid: Lattice, wanted: Array) -> Array:
    """Centre lines of so many of the candidates (p, i), evenly over all."""
    which = np.argwhere(wanted)
    which = which[np.unique(np.linspace(0, len(which) - 1, min(SHOWN, len(which))).astype(int))]
    paths, lines = grid.paths, np.empty((len(which), POINTS, 2))
    along = paths.spacing * np.arange(paths.s.shape[1])
    for line, (p, i) in zip(lines, which, strict=True):
        end = grid.profiles.sigma[i, grid.table.ks[grid.table.k_end[p, i]]]
        sigma = np.linspace(0.0, max(float(end), 0.0), POINTS)
        psi = np.interp(sigma, along, np.unwrap(paths.psi[p]))
        line[:, 0] = np.interp(sigma, along, paths.x[p]) + CAR.rear_to_centre * np.cos(psi)
        line[:, 1] = np.interp(sigma, along, paths.y[p]) + CAR.rear_to_centre * np.sin(psi)
    return lines


def _ribbon(plan: Trajectory, road: Road, corridor: Corridor, acceleration: float) -> Ribbon:
    """The corridor along the plan, with the road's edges where no obstacle is nearer."""
    last = plan.first_step + len(corridor.s_min) - 1
    states = frenet_states(road.frame, plan.until(last), acceleration)
    s, half = states[:, Stage.S], CAR.width / 2
    at = s + CAR.rear_to_centre * np.cos(states[:, Stage.MU])
    left = np.minimum(corridor.d_max + half, np.interp(at, road.frame.s, road.limits.left))
    right = np.maximum(corridor.d_min - half, np.interp(at, road.frame.s, road.limits.right))
    bounded = np.abs(corridor.s_min) < FAR / 2, np.abs(corridor.s_max) < FAR / 2
    return Ribbon(
        road.frame.to_cartesian(at, left), road.frame.to_cartesian(at, right), s - s[0],
        np.where(bounded[0], corridor.s_min - s[0], -np.inf),
        np.where(bounded[1], corridor.s_max - s[0], np.inf),
    )  # fmt: skip
