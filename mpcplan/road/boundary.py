"""The official checker's triangulated road boundary, built where a crash costs nothing.

The triangulation library ends its process on some maps (segmentation fault). It therefore runs in
a forked child, which shares everything that is loaded already and so costs a few milliseconds; a
child that dies means that there is no official boundary, and the union of the lanelets holds alone.
"""

import faulthandler
import multiprocessing as mp
from multiprocessing.connection import Connection

import numpy as np
import shapely
from commonroad.scenario.scenario import Scenario
from commonroad_dc.boundary import construction
from numpy.typing import NDArray

from mpcplan.trajectory import Array

TIMEOUT = 60.0  # s, a child that hangs is ended; no plan depends on how fast it is


def official_boundary(scenario: Scenario) -> NDArray[np.object_]:
    """Triangles outside of the road as the checker sees it; none where they cannot be built."""
    forks = "fork" in mp.get_all_start_methods()
    context = mp.get_context("fork") if forks else mp.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    child = context.Process(target=_send_triangles, args=(scenario, sender), daemon=True)
    child.start()
    sender.close()
    triangles = _received(receiver)
    child.join(TIMEOUT)
    if child.is_alive():
        child.kill()
    outside: NDArray[np.object_] = shapely.polygons(triangles)
    return outside


def _received(receiver: Connection) -> Array:
    """(n, 3, 2) corners from the child, none where it died or hangs."""
    try:
        if receiver.poll(TIMEOUT):
            corners: Array = np.asarray(receiver.recv(), float).reshape(-1, 3, 2)
            return corners
    except EOFError:  # the child died
        pass
    return np.empty((0, 3, 2))


def _send_triangles(scenario: Scenario, sender: Connection) -> None:
    """The child: builds the boundary and sends its triangles' corners."""
    faulthandler.disable()  # a crash here is expected on some maps and nobody's news
    try:
        built = construction.construct(scenario, ["section_triangles", "triangulation"])
        corners = [np.array(triangle.vertices()) for triangle in built["triangulation"].unpack()]
    except Exception:  # the construction raises bare exceptions
        corners = []
    sender.send(np.array(corners, float).reshape(-1, 3, 2))
    sender.close()
