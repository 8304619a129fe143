"""The gap to the nearest obstacle ahead along the path that was driven."""

import numpy as np
import shapely

from mpcplan.observation import Box
from mpcplan.trajectory import Array, State, Trajectory
from mpcplan.vehicle import FORD_ESCORT, centres

REACH = 60.0  # m, obstacles further ahead are not shown
_OVERLAP = 0.3  # m, lateral overlap from which an obstacle counts as ahead


def gap_ahead(driven: Trajectory, boxes: Array) -> Array:
    """Distance [m] to the nearest box ahead on the driven path, extended straight at its end.

    Args:
        driven: n states.
        boxes: (o, n, 6) the others at the same time steps, NaN where absent.

    Returns:
        (n,) distances from bumper to bumper; NaN where nothing is within :data:`REACH`.
    """
    path, travelled = _path(driven)
    # GEOS refuses NaN; the NaN sizes of absent boxes keep them out of the way
    where = shapely.points(np.nan_to_num(boxes[..., [Box.X, Box.Y]]))
    ahead = shapely.line_locate_point(path, where) - travelled
    beside = shapely.distance(path, where) - (FORD_ESCORT.width + boxes[..., Box.WIDTH]) / 2
    gaps = ahead - (FORD_ESCORT.length + boxes[..., Box.LENGTH]) / 2
    in_the_way = (ahead > 0) & (beside < -_OVERLAP) & (gaps <= REACH)  # False for NaN
    nearest = np.where(in_the_way, np.maximum(gaps, 0.0), np.inf).min(axis=0, initial=np.inf)
    return np.where(np.isfinite(nearest), nearest, np.nan)


def _path(driven: Trajectory) -> tuple[shapely.LineString, Array]:
    """The path of the centre and the distance [m] travelled along it at every state."""
    points = centres(driven.states)
    travelled = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    psi = driven.states[-1, State.PSI]
    beyond = points[-1] + 2 * REACH * np.array([np.cos(psi), np.sin(psi)])
    return shapely.LineString(np.vstack([points, beyond])), travelled
