"""The rules as formulas of past-time temporal logic, and monitors that evaluate them step by step.

    R_G1   G( in_same_lane(ego, o) and in_front_of(o, ego)
              and not O_[0, t_c]( cut_in(o, ego) and P not cut_in(o, ego) )
              => keeps_safe_distance_prec(ego, o) )                        for every other o
    R_G4   G( not slow_leading_vehicle(ego) => preserves_traffic_flow(ego) )

A monitor gives the robustness of the formula under G at each time step; that under G is the lowest
so far. Before the first sample "previously" is true of everything: who cuts in when first seen has
begun to at that moment. Source: Maierhofer et al. 2020, table III.

rtamt (Nickovic, Yamaguchi: RTAMT, ATVA 2020) parses the formulas and evaluates them online in
discrete time; it is imported when the first monitor is made: that takes a quarter of a second.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mpcplan.rules.robustness import Signals
from mpcplan.trajectory import Array

OUT = "out"
SAFE_DISTANCE = (
    f"{OUT} = ((lane >= 0) and (front >= 0) "
    "and not(once[0:{recovery}]((cut >= 0) and prev(not(cut >= 0))))) implies (distance >= 0)"
)
TRAFFIC_FLOW = f"{OUT} = (not(slow >= 0)) implies (flow >= 0)"


class Monitor:
    """An online monitor of one formula.

    The demanded signal gives the robustness, the others are true or false (see
    :mod:`mpcplan.rules.robustness`).
    """

    def __init__(self, formula: str, asked: tuple[str, ...], demanded: str) -> None:
        """Parses a formula.

        Args:
            formula: rtamt's text.
            asked: names of the signals that are true (at least 0) or false.
            demanded: name of the signal that gives the robustness.
        """
        import rtamt

        spec: Any = rtamt.StlDiscreteTimeSpecification(semantics=rtamt.Semantics.OUTPUT_ROBUSTNESS)
        for name in (*asked, demanded, OUT):
            spec.declare_var(name, "float")
        for name in asked:
            spec.set_var_io_type(name, "input")
        spec.set_var_io_type(demanded, "output")
        spec.spec = formula
        spec.parse()
        self._spec, self._step = spec, 0

    def update(self, sample: Mapping[str, float]) -> float:
        """The formula's robustness at the next time step, of signals by name."""
        value = self._spec.update(self._step, [(name, float(v)) for name, v in sample.items()])
        self._step += 1
        return float(value)

    def run(self, values: Mapping[str, Array]) -> Array:
        """(k,) robustness at further time steps, of (k,) signals by name."""
        rows = zip(*values.values(), strict=True)
        return np.array([self.update(dict(zip(values, row, strict=True))) for row in rows])


def safe_distance_monitor(recovery: int) -> Monitor:
    """R_G1 towards one other; ``recovery``: t_c in time steps."""
    text = SAFE_DISTANCE.format(recovery=recovery)
    return Monitor(text, ("lane", "front", "cut"), "distance")


def traffic_flow_monitor() -> Monitor:
    """R_G4."""
    return Monitor(TRAFFIC_FLOW, ("slow",), "flow")


def monitored(found: Signals, recovery: int) -> tuple[Array, Array]:
    """(o, k) robustness of R_G1 [m] towards each other and (k,) of R_G4 [m/s], by the monitors.

    Args:
        found: signals of one trajectory (n = 1).
        recovery: t_c in time steps.
    """
    distance = np.full(found.lane.shape[1:], np.inf)
    leads = (found.lane[0] >= 0) & (found.front[0] >= 0)
    for o in np.flatnonzero(leads.any(axis=1)).tolist():
        names = ("lane", "front", "cut", "distance")
        values = {name: getattr(found, name)[0, o] for name in names}
        distance[o] = safe_distance_monitor(recovery).run(values)
    flow = traffic_flow_monitor().run({"slow": found.slow[0], "flow": found.flow[0]})
    return distance, flow
