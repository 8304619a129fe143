"""The traffic that belongs to a scenario."""

from mpcplan.scenario import LoadedScenario, Problem
from mpcplan.simulate.recorded import RecordedTraffic
from mpcplan.simulate.traffic import Traffic


def open_traffic(loaded: LoadedScenario, problem: Problem) -> Traffic:
    """Recorded traffic, or a simulation that stands at the problem's first time step.

    Raises:
        TrafficError: the simulation cannot begin.
    """
    if not loaded.interactive:
        return RecordedTraffic(loaded.scenario)
    from mpcplan.sumo import traffic  # the simulator takes long to import

    return traffic.open_traffic(loaded, problem)
