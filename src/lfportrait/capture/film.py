"""A video's film: its stream, its decoded frames, and these as upright pictures in sRGB."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from ..arrays import UInt8
from ..media.colors import ColorSpace, coded_space, from_space

__all__ = ["decoded", "film_of", "space_of", "turns_of", "upright_frame"]

# The number of what a stream does not say (ITU-T H.273).
_UNSPECIFIED = 2


def film_of(container: Any) -> Any:
    """The stream of the film: not that of a cover picture, of several the one FFmpeg takes."""
    import av

    films = [stream for stream in container.streams.video
             if not stream.disposition & av.stream.Disposition.attached_pic]
    best = container.streams.best("video")
    return best if any(stream is best for stream in films) else next(iter(films), None)


def decoded(path: Path) -> Iterator[tuple[float, float, Any]]:
    """The frame rate, the width of a pixel over its height, and decoded frames."""
    import av

    with av.open(str(path)) as container:
        stream = film_of(container)
        if stream is None:
            raise ValueError("it has no video stream, or a cover picture alone")
        stream.thread_type = "AUTO"
        rate = float(stream.average_rate or 30)
        aspect = float(stream.sample_aspect_ratio or 1)
        for frame in container.decode(stream):
            yield rate, aspect, frame


def space_of(frame: Any) -> ColorSpace:
    """The color space that a decoded frame names; sRGB's where it says nothing."""
    codes = (int(frame.color_primaries or _UNSPECIFIED), int(frame.color_trc or _UNSPECIFIED))
    source = "" if codes == (_UNSPECIFIED, _UNSPECIFIED) else "its stream"
    return replace(coded_space(*codes), source=source)


def _pixels(frame: Any, max_side: int) -> UInt8:
    """A decoded frame in sRGB, uint8 [H, W, 3]."""
    space = space_of(frame)
    if space.curve not in ("pq", "hlg"):
        if space.curve == "srgb":  # what says nothing has a film's curve
            space = replace(space, curve="bt709")
        # What says nothing is BT.709 from 720 lines on, as players take it, else BT.601.
        unsaid = int(frame.colorspace) == _UNSPECIFIED and frame.format.name.startswith("yuv")
        matrix = "ITU709" if unsaid and min(frame.width, frame.height) >= 720 else None
        return from_space(np.asarray(frame.to_ndarray(format="rgb24", src_colorspace=matrix)),
                          space)
    ratio = min(1.0, max_side / max(frame.width, frame.height)) if max_side else 1.0
    deep = frame.to_ndarray(format="rgb48le", width=max(1, round(ratio * frame.width)),
                            height=max(1, round(ratio * frame.height)))
    return from_space(deep, space)


def _square(picture: UInt8, ratio: float) -> UInt8:
    """A picture [H, W, 3] with square pixels, from ones whose width over height is ``ratio``.

    The shorter way is lengthened, so that nothing is lost.
    """
    if not 0.1 < ratio < 10 or abs(ratio - 1) < 1e-3:
        return picture
    height, width = picture.shape[:2]
    size = ((round(width * ratio), height) if ratio > 1 else (width, round(height / ratio)))
    return np.asarray(Image.fromarray(picture).resize(size, Image.Resampling.LANCZOS))


def turns_of(frame: Any) -> int:
    """Counter-clockwise quarter turns that bring a decoded frame upright, 0 to 3."""
    return round(getattr(frame, "rotation", 0) / 90) % 4


def upright_frame(frame: Any, max_side: int, aspect: float) -> UInt8:
    """A decoded frame as uint8 [H, W, 3], turned upright and reduced."""
    turns = turns_of(frame)
    pixels = _square(_pixels(frame, max_side), aspect)
    upright = np.ascontiguousarray(np.rot90(pixels, turns))
    if not max_side or max(upright.shape[:2]) <= max_side:
        return upright
    picture = Image.fromarray(upright)
    if max(picture.size) > max_side:
        ratio = max_side / max(picture.size)
        picture = picture.resize((max(1, round(picture.width * ratio)),
                                  max(1, round(picture.height * ratio))),
                                 Image.Resampling.LANCZOS)
    return np.asarray(picture)
