"""The picture of one time step: the road around the vehicle, strips beside it, words above.

What stays the same in all pictures of a drive is drawn once; for each picture it is copied and the
rest is drawn onto it, which is some ten times faster than drawing the whole figure.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from mpcplan.show import colours
from mpcplan.show.ground import Ground
from mpcplan.show.legend import draw_legend, scale_length
from mpcplan.show.lookahead import LookAhead
from mpcplan.show.moment import Moment, moment
from mpcplan.show.moving_road import MovingRoad
from mpcplan.show.moving_strips import MovingStrips
from mpcplan.show.stamps import stamp
from mpcplan.show.words import headline, plan_lines
from mpcplan.trajectory import Array, State
from mpcplan.vehicle import centres

if TYPE_CHECKING:
    from mpcplan.review.replan import Replanned
    from mpcplan.simulate.run import Drive, Run

SIZE = (1280, 720)  # pixels at the usual resolution; both even, as video wants it
DPI = 100.0
LEAST_RADIUS, MOST_RADIUS = 10.0, 500.0  # m
_USUAL = (40.0, 80.0)  # m, least and largest usual radius
_SECONDS = 2.2  # at the drive's top speed to the view's edge
AHEAD = 0.35  # of the radius, by which the view is centred ahead of the vehicle
_SCENE = (12, 40, 846, 566)  # left, bottom, width, height in pixels at the usual resolution
_STRIPS = ((922, 462, 340, 140), (922, 266, 340, 140), (922, 70, 340, 140))
_HEAD, _FIRST, _BETWEEN = 20, 46, 18  # pixels, from the top to the headline and the lines below
_HEAD_FONT, _FONT = 17, 12  # pixels
_ABOVE = 20  # pixels, from a vehicle to its label
_SCALE = (16, 14)  # pixels, from the scene's lower left corner to the scale


def usual_radius(drive: Drive) -> float:
    """A radius [m] that shows some seconds of the fastest part of a drive."""
    fastest = float(drive.trajectory.states[:, State.V].max())
    return float(np.clip(_SECONDS * fastest, *_USUAL))


class Screen:
    """Draws time steps of a drive."""

    def __init__(
        self, run: Run, index: int, replanned: Replanned, radius: float,
        labels: bool = False, finer: float = 1.0,
    ) -> None:  # fmt: skip
        """Draws what all pictures have in common.

        Args:
            run: what was driven.
            index: of the drive.
            replanned: what its cycles considered.
            radius: distance [m] from the view's centre to its nearer edges.
            labels: whether all others are labelled, not only those who are feared.
            finer: pixels per usual pixel; widths and heights are rounded to even numbers.
        """
        self._run, self._drive, self._replanned = run, run.drives[index], replanned
        self._radius = radius
        width, height = (2 * round(finer * side / 2) for side in SIZE)
        self.size = width, height
        dpi = DPI * finer
        self._figure = Figure(figsize=(width / dpi, height / dpi), dpi=dpi)
        self._canvas = FigureCanvasAgg(self._figure)
        self._place = [round(finer * side) for side in _SCENE]
        scene = self._axes(self._place)
        scene.set_facecolor("none")
        scene.set_xticks([])
        scene.set_yticks([])
        scene.set_autoscale_on(False)
        across, up = self._place[2:]
        self._ground = Ground(run, index, min(across, up) / 2 / radius, (across, up), dpi)
        strips = [self._axes([round(finer * side) for side in place]) for place in _STRIPS]
        self._scene = scene
        self._road = MovingRoad(scene, self._drive, labels)
        self._strips = MovingStrips(strips[:2], run, index)
        self._look = LookAhead(strips[2], replanned, run.loaded.dt)
        self._finer = finer
        draw_legend(self._figure)
        scene.set_animated(True)
        self._canvas.draw()
        self._still = self._canvas.copy_from_bbox(self._figure.bbox)

    def draw(self, step: int) -> Array:
        """(height, width, 3) the picture of a time step that was driven, as bytes."""
        now = moment(self._drive, self._replanned, step)
        self._canvas.restore_region(self._still)
        self._move_to(now.driven.states[-1])
        renderer = self._canvas.get_renderer()
        moving = [*self._road.show(now), *self._strips.show(now), *self._look.show(now)]
        for artist in moving:
            artist.draw(renderer)
        picture = np.asarray(self._canvas.buffer_rgba())
        self._write(picture, now)
        return np.asarray(Image.fromarray(picture).convert("RGB"))

    def _axes(self, place: Sequence[int]) -> Axes:
        """Axes that cover whole pixels (left, bottom, width, height)."""
        width, height = self.size
        left, bottom, across, up = place
        return self._figure.add_axes((left / width, bottom / height, across / width, up / height))

    def _write(self, picture: Array, now: Moment) -> None:
        """The words above and on the road, and the frame around it."""
        finer = self._finer
        x = self._place[0]
        head = headline(now, self._run.loaded.id, self._drive)
        stamp(picture, head, (x, finer * _HEAD), finer * _HEAD_FONT, bold=True)
        for i, line in enumerate(plan_lines(now, self._replanned.missing)):
            y = finer * (_FIRST + i * _BETWEEN)
            colour = colours.ALARM if line.alarming else "black"
            stamp(picture, line.text, (x, y), finer * _FONT, colour)
        left, bottom, width, height = self._place
        low = self.size[1] - bottom
        inside = (left + 2, low - height + 2, left + width - 2, low - 2)
        for label in self._road.labels(now):
            at = self._scene.transData.transform(label.at)
            place = (at[0], self.size[1] - at[1] - finer * _ABOVE)
            colour = colours.ALARM if label.alarming else "black"
            stamp(picture, label.text, place, finer * _FONT, colour, label.alarming, True, inside)
        self._write_scale(picture, left + finer * _SCALE[0], low - finer * _SCALE[1])
        picture[[low - height, low - 1], left : left + width, :3] = 0
        picture[low - height : low, [left, left + width - 1], :3] = 0

    def _write_scale(self, picture: Array, x: float, y: float) -> None:
        """A bar of so many metres, from a pixel to the right."""
        metres = scale_length(self._radius)
        pixels = metres * min(self._place[2:]) / 2 / self._radius
        thick = max(round(2 * self._finer), 1)
        picture[round(y) : round(y) + thick, round(x) : round(x + pixels), :3] = 0
        stamp(picture, f"{metres} m", (x, y - self._finer * 10), self._finer * _FONT)

    def _move_to(self, state: Array) -> None:
        """Has the view follow the vehicle, and puts the road below it."""
        psi = state[State.PSI]
        ahead = AHEAD * self._radius * np.array([np.cos(psi), np.sin(psi)])
        centre = centres(state[None])[0] + ahead
        low, high = self._ground.limits(centre)
        self._scene.set_xlim(low[0], high[0])
        self._scene.set_ylim(low[1], high[1])
        left, bottom, width, height = self._place
        top = self.size[1] - bottom - height
        buffer = np.asarray(self._canvas.buffer_rgba())
        buffer[top : top + height, left : left + width] = self._ground.view(centre)
