"""Videos and pictures in formats that every browser shows."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lfportrait.errors import UserError
from lfportrait.share import write_video
from lfportrait.temporary import temporary_folder

__all__ = ["Clip", "clip_of", "picture_bytes"]

_BROWSERS = {("h264", "yuv420p"), ("h264", "yuvj420p"), ("vp8", "yuv420p"), ("vp9", "yuv420p"),
             ("av1", "yuv420p")}
"""Formats that all browsers decode; everything else is re-encoded."""


@dataclass(frozen=True)
class Clip:
    """A video for the page.

    Attributes
    ----------
    data, kind
        The file's bytes, and ``"mp4"`` or ``"webm"``.
    seconds
        How long it lasts.
    size
        Width and height in pixels.
    """

    data: bytes
    kind: str
    seconds: float
    size: tuple[int, int]


def _frames(container: Any) -> Iterator[NDArray[np.uint8]]:
    for frame in container.decode(video=0):
        yield frame.to_ndarray(format="rgb24")


def clip_of(path: Path) -> Clip:
    """Read a video; formats that browsers may not show are re-encoded as H.264.

    Raises
    ------
    UserError
        If it can't be read or has no pictures.
    """
    import av

    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise UserError(f"{path} holds no video")
            stream = container.streams.video[0]
            if stream.codec_context is None:
                raise UserError(f"{path} holds a video of an unknown kind")
            rate = float(stream.average_rate or 30)
            known = (stream.codec_context.name.removeprefix("lib"),
                     str(stream.codec_context.pix_fmt))
            size = (stream.codec_context.width, stream.codec_context.height)
            kind = path.suffix.lower().removeprefix(".").replace("m4v", "mp4")
            if known in _BROWSERS and kind in ("mp4", "webm"):
                data, count = path.read_bytes(), stream.frames
                count = count or sum(1 for _ in container.decode(video=0))
            else:
                with temporary_folder() as folder:
                    fresh = folder / "video.mp4"
                    count = write_video(fresh, _frames(container), rate)
                    data, kind = fresh.read_bytes(), "mp4"
    except (av.FFmpegError, OSError, IndexError, ValueError) as error:
        raise UserError(f"can't read the video {path}: {error}") from error
    return Clip(data, kind, count / rate, size)


def picture_bytes(image: NDArray[np.uint8], longest: int = 640) -> bytes:
    """A picture as WebP, its longer side at most ``longest`` pixels.

    Parameters
    ----------
    image
        uint8 [H, W, 3].
    longest
        Length in pixels.
    """
    picture = Image.fromarray(image)
    picture.thumbnail((longest, longest), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    picture.save(buffer, "WEBP", quality=88, method=6)
    return buffer.getvalue()
