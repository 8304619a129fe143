"""Words put onto a picture that is drawn again and again: each is rendered once.

Matplotlib renders every text anew, which takes longer than all lines and boxes of such a picture.
The font is the one that Matplotlib brings.
"""

from functools import cache
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.colors import to_rgb
from PIL import ImageFont

from mpcplan.trajectory import Array

_FONTS = {False: "DejaVuSans.ttf", True: "DejaVuSans-Bold.ttf"}
_HALO = 190  # opacity of the white below a word on the road, of 255


@cache
def _font(size: int, bold: bool) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(
        str(Path(matplotlib.get_data_path(), "fonts", "ttf", _FONTS[bold])), size
    )


@cache
def _ink(text: str, size: int, bold: bool) -> Array:
    """(height, width) how much of each pixel is ink, from 0 to 1."""
    font = _font(size, bold)
    mask = font.getmask(text, mode="L", anchor="ls")
    ink = np.asarray(mask, dtype=float).reshape(mask.size[::-1]) / 255.0
    ink.flags.writeable = False
    return ink


def stamp(
    picture: Array, text: str, at: tuple[float, float], size: float, colour: str = "black",
    bold: bool = False, centred: bool = False, within: tuple[int, int, int, int] | None = None,
) -> None:  # fmt: skip
    """Puts a word onto a picture.

    Args:
        picture: (height, width, 3 or 4) bytes, written to.
        text: one line.
        at: pixel (x, y) of the word's left end and its middle's height, counted from the top left.
        size: of the font in pixels.
        colour: as Matplotlib knows it.
        bold: whether in bold letters.
        centred: whether x is the word's middle instead, and the word stands on a light ground.
        within: left, top, right, bottom beyond which a word is left out; None: it is cut at the
            picture's edges.
    """
    if not text.strip():
        return
    ink = _ink(text, round(size), bold)
    height, width = ink.shape
    left = round(at[0] - (width / 2 if centred else 0.0))
    top = round(at[1] - height / 2)
    x0, y0, x1, y1 = within or (0, 0, picture.shape[1], picture.shape[0])
    if within is not None and (left < x0 or top < y0 or left + width > x1 or top + height > y1):
        return
    cut = ink[: max(y1 - top, 0), : max(x1 - left, 0)]
    if left < x0 or top < y0 or not cut.size:
        return
    if centred:
        _lighten(picture[top - 1 : top + height + 1, left - 1 : left + width + 1, :3])
    place = picture[top : top + cut.shape[0], left : left + cut.shape[1], :3]
    share = cut[..., None]
    place[:] = np.rint(place * (1 - share) + 255.0 * np.array(to_rgb(colour)) * share)


def _lighten(place: Array) -> None:
    share = _HALO / 255.0
    place[:] = np.rint(place * (1 - share) + 255.0 * share)
