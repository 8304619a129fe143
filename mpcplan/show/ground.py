"""The road as a picture from which views are cut: what never moves is drawn once.

Pixels are counted on a grid over the whole map, so that a view that follows the vehicle moves by
whole pixels, and roads do not flicker.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mpcplan.show.scene import draw_goal, draw_road
from mpcplan.trajectory import Array

if TYPE_CHECKING:
    from mpcplan.simulate.run import Run

SPARE = 0.5  # of a view, drawn beyond it on each side


class Ground:
    """Road and goal of one planning problem around wherever the view is."""

    def __init__(self, run: Run, index: int, scale: float, size: tuple[int, int], dpi: float):
        """Draws nothing yet.

        Args:
            run: whose road it is.
            index: of the drive, whose goal is shown.
            scale: pixels per metre.
            size: width and height of a view in pixels.
            dpi: of the figure in which the view is shown.
        """
        self._run, self._problem = run, run.drives[index].problem_id
        self._scale, self._size, self._dpi = scale, np.array(size), dpi
        self._whole = np.ceil(self._size * (1 + 2 * SPARE)).astype(int)
        self._corner = np.zeros(2, dtype=int)  # pixel of the picture's lower left corner
        self._picture: Array | None = None

    def limits(self, centre: Array) -> tuple[Array, Array]:
        """Lower left and upper right corner [m] of the view around a point (2,) [m]."""
        low = self._low(centre)
        return low / self._scale, (low + self._size) / self._scale

    def view(self, centre: Array) -> Array:
        """(height, width, 4) the view around a point (2,) [m]."""
        low = self._low(centre)
        inside = (low >= self._corner).all() and (
            low + self._size <= self._corner + self._whole
        ).all()
        if self._picture is None or not inside:
            self._corner = low - (self._whole - self._size) // 2
            self._picture = self._draw()
        x, y = low - self._corner
        width, height = self._size
        top = self._whole[1] - y - height
        return self._picture[top : top + height, x : x + width]

    def _low(self, centre: Array) -> Array:
        """Pixel of the view's lower left corner."""
        return np.rint(centre * self._scale).astype(int) - self._size // 2

    def _draw(self) -> Array:
        figure = Figure(figsize=tuple(self._whole / self._dpi), dpi=self._dpi)
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        low, high = self._corner / self._scale, (self._corner + self._whole) / self._scale
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        axes.set_autoscale_on(False)
        draw_road(axes, self._run)
        for problem in self._run.loaded.problems:
            if problem.id == self._problem:
                draw_goal(axes, problem)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba()).copy()
