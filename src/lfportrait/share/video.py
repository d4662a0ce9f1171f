"""Videos as H.264 in the form that every browser and player opens.

Fixed encoder settings on one thread and no time stamps in the file: the same frames give the same
bytes. Colours are converted and tagged as BT.709, so that players show what the pictures hold.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import UserError
from ..files import atomic_path

__all__ = ["write_video"]

_BT709 = 1


def _even(frame: NDArray[Any]) -> NDArray[np.uint8]:
    """One frame as uint8 with even sides, the last row and column repeated where needed."""
    if frame.ndim != 3 or frame.shape[2] < 3:
        raise ValueError(f"a frame must be [H, W, 3], not {list(frame.shape)}")
    frame = frame[..., :3]
    if frame.dtype != np.uint8:
        frame = (np.clip(frame, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    height, width = frame.shape[:2]
    return np.ascontiguousarray(
        np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge"))


def write_video(path: str | Path, frames: Iterable[NDArray[Any]], fps: float = 30.0, *,
                quality: int = 17) -> int:
    """Write a video (H.264, 4:2:0).

    Parameters
    ----------
    path
        ``.mp4``, ``.mov`` or ``.mkv``; it appears when it is complete.
    frames
        Frames [H, W, 3] of one size, uint8 or float in [0, 1]; taken one at a time, so a generator
        needs the memory of one frame only. Odd sides grow by one pixel.
    fps
        Frames per second.
    quality
        x264's constant rate factor, 0 (lossless) to 51; 17 looks like the original.

    Returns
    -------
    count
        Number of frames written.

    Raises
    ------
    UserError
        If there are no frames, the format is unknown or the file can't be written.
    """
    import av

    if fps <= 0:
        raise UserError(f"a video needs more than {fps:g} frames per second")
    suffix = Path(path).suffix.lower()
    if suffix not in (".mp4", ".mov", ".mkv"):
        raise UserError(f"can't write a video named {path}; end the name in .mp4")
    count, size = 0, None
    with atomic_path(path) as temporary:
        options = {"movflags": "+faststart"} if suffix != ".mkv" else {}
        with av.open(str(temporary), "w", options=options) as container:
            bitexact: Any = av.container.Flags.bitexact.value  # no time of writing in the file
            container.flags |= bitexact
            stream: Any = None
            for frame in frames:
                picture = _even(frame)
                if stream is None:
                    size = picture.shape
                    stream = _stream(container, size, fps, quality)
                if picture.shape != size:
                    raise ValueError(f"frame {count} is {picture.shape}, the first {size}")
                video_frame = av.VideoFrame.from_ndarray(picture, format="rgb24").reformat(
                    format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG")
                video_frame.pts = count
                container.mux(stream.encode(video_frame))
                count += 1
            if stream is None:
                raise UserError(f"there are no frames for {path}")
            container.mux(stream.encode(None))
    return count


def _stream(container: Any, size: tuple[int, ...], fps: float, quality: int) -> Any:
    """The video stream: size and speed, colours tagged, encoder fixed."""
    rate = Fraction(fps).limit_denominator(1001)
    stream = container.add_stream("libx264", rate=rate)
    stream.height, stream.width = size[0], size[1]
    stream.pix_fmt = "yuv420p"
    context = stream.codec_context
    context.thread_count = 1
    context.colorspace = context.color_primaries = context.color_trc = _BT709
    context.color_range = 1  # 16..235
    # Without the macroblock tree: for small frames it gives other bytes from run to run.
    stream.options = {"crf": str(quality), "preset": "medium", "threads": "1",
                      "x264-params": "mbtree=0"}
    return stream
