"""The traffic of an interactive folder, by its kind."""

from mpcplan.scenario import LoadedScenario, Problem
from mpcplan.simulate.traffic import Traffic
from mpcplan.sumo.inserted import InsertedTraffic


def open_traffic(loaded: LoadedScenario, problem: Problem) -> Traffic:
    """A simulation that stands at the problem's first time step.

    Raises:
        TrafficError: the simulation cannot begin.
        InputError: a file of the folder is broken.
    """
    assert loaded.folder is not None  # interactive
    if loaded.folder.presimulated:
        from mpcplan.sumo.presimulated import PresimulatedTraffic

        return PresimulatedTraffic(loaded, problem)
    return InsertedTraffic(loaded, problem)
