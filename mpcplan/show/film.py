"""Pictures one after the other as a film: GIF by Pillow, MP4 (H.264) by ffmpeg."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgba_array
from PIL import Image

from mpcplan.errors import InputError
from mpcplan.show import colours
from mpcplan.trajectory import Array

KINDS = (".mp4", ".gif")
MOST_FPS = 100.0  # a GIF counts hundredths of a second
_COLOURS = 256
_BAND = 16  # pixels
_QUALITY = 8  # of 10
_PRESET = "veryfast"  # of x264, else it takes longer to encode a frame than to draw it
_EXTRA = "writing .mp4 needs imageio-ffmpeg: pip install 'mpcplan[video]'; .gif works without it"


def check_kind(path: Path) -> None:
    """Whether a film can be written to a file of this name.

    Raises:
        InputError: its extension is none of :data:`KINDS`, it is a folder, or what writes it is not
            installed.
    """
    if path.suffix not in KINDS:
        raise InputError(f"{path}: a film is an {' or a '.join(KINDS)} file")
    if path.is_dir():
        raise InputError(f"cannot write {path}: it is a folder")
    if path.suffix == ".mp4":
        _ffmpeg()


def write_film(frames: Iterable[Array], path: Path, fps: float, typical: Sequence[Array]) -> None:
    """Writes a film, whole or not at all.

    Args:
        frames: (height, width, 3) bytes each, all of one even size.
        path: the file; its extension selects the kind.
        fps: frames per second.
        typical: some of the frames, whose colours a GIF gets.

    Raises:
        InputError: the kind is not known, or the file cannot be written.
    """
    check_kind(path)
    partial = path.with_name(f".partial.{os.getpid()}.{path.name}")
    try:
        with _closing(partial):
            if path.suffix == ".gif":
                _write_gif(frames, partial, fps, typical)
            else:
                _write_mp4(frames, partial, fps)
            os.replace(partial, path)
    except OSError as error:  # ffmpeg's too
        reason = " ".join(str(error.strerror or error).split())
        raise InputError(f"cannot write {path}: {reason}") from error


@contextmanager
def _closing(partial: Path) -> Iterator[None]:
    try:
        yield
    finally:
        partial.unlink(missing_ok=True)


def _write_gif(frames: Iterable[Array], path: Path, fps: float, typical: Sequence[Array]) -> None:
    """With one palette for all frames, so that what stands still does not flicker."""
    sheet = np.concatenate([*typical, _swatches(typical[0].shape[1])])
    palette = Image.fromarray(sheet).quantize(_COLOURS, dither=Image.Dither.NONE)
    images = (
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in frames
    )
    first = next(images)
    first.save(
        path, format="GIF", save_all=True, append_images=images, duration=round(1000 / fps), loop=0
    )


def _swatches(width: int) -> Array:
    """Bands of the colours that have a meaning: few pixels of a frame may have them."""
    meant = [
        "white", *colours.PROBLEMS, colours.TRAFFIC, colours.GOAL, colours.ALARM, colours.ACCEPTED,
        colours.REFUSED, colours.CORRIDOR, colours.ROAD,
    ]  # fmt: skip
    bands = np.rint(255 * to_rgba_array(meant)[:, :3]).astype(np.uint8)
    return np.repeat(np.repeat(bands, _BAND, axis=0)[:, None], width, axis=1)


def _write_mp4(frames: Iterable[Array], path: Path, fps: float) -> None:
    writer = None
    try:
        for frame in frames:
            if writer is None:
                writer = _ffmpeg().write_frames(
                    str(path), frame.shape[1::-1], fps=fps, quality=_QUALITY, macro_block_size=2,
                    ffmpeg_log_level="error", output_params=["-preset", _PRESET],
                )  # fmt: skip
                writer.send(None)
            writer.send(np.ascontiguousarray(frame))
    finally:
        if writer is not None:
            writer.close()


def _ffmpeg():  # type: ignore[no-untyped-def]
    """The module that brings ffmpeg; raises InputError."""
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise InputError(_EXTRA) from error
    return imageio_ffmpeg
