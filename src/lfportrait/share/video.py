"""Videos as H.264: in the form that every browser and player opens, or with every sub-pixel kept.

Fixed encoder settings on one thread and no time stamps in the file: the same frames give the same
bytes. Colors are converted and tagged as BT.709, so that players show what the pictures hold.

Pictures coded for a light-field panel need more than the usual 4:2:0, which keeps colors at half
the size: neighbouring sub-pixels belong to different views. ``444`` keeps all colors, ``lossless``
all values, as RGB. Browsers play neither; mpv, VLC and ffplay do.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import UserError
from ..files import atomic_path

__all__ = ["write_video"]

_BT709 = 1
_FORMATS = {"420": "yuv420p", "444": "yuv444p", "lossless": "rgb24"}


def _picture(frame: NDArray[Any], even: bool) -> NDArray[np.uint8]:
    """One frame as uint8; with even sides, the last row and column are repeated where needed."""
    if frame.ndim != 3 or frame.shape[2] < 3:
        raise ValueError(f"a frame must be [H, W, 3], not {list(frame.shape)}")
    frame = frame[..., :3]
    if frame.dtype != np.uint8:
        frame = (np.clip(frame, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    if not even:
        return np.ascontiguousarray(frame)
    height, width = frame.shape[:2]
    return np.ascontiguousarray(
        np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge"))


def write_video(path: str | Path, frames: Iterable[NDArray[Any]], fps: float = 30.0, *,
                quality: int = 17, coding: Literal["420", "444", "lossless"] = "420",
                preset: Literal["medium", "veryfast", "superfast"] = "medium") -> int:
    """Write a video (H.264).

    Parameters
    ----------
    path
        ``.mp4``, ``.mov`` or ``.mkv``; it appears when it is complete.
    frames
        Frames [H, W, 3] of one size, uint8 or float in [0, 1]; taken one at a time, so a generator
        needs the memory of one frame only. With ``"420"`` odd sides grow by one pixel.
    fps
        Frames per second.
    quality
        x264's constant rate factor, 0 (finest) to 51; 17 looks like the original. Not used where
        ``coding`` is ``"lossless"``.
    coding
        ``"420"`` for people; ``"444"`` and ``"lossless"`` for pictures coded for a panel. The
        latter two hold no frames back, which would take gigabytes at a panel's size.

    preset
        How thoroughly ``"420"`` is coded: ``"veryfast"`` takes less than half the time of
        ``"medium"`` for files that are a twentieth larger, ``"superfast"`` a quarter of it for
        files that are a third larger.

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
                picture = _picture(frame, coding == "420")
                if stream is None:
                    size = picture.shape
                    stream = _stream(container, size, fps, quality, coding, preset)
                if picture.shape != size:
                    raise ValueError(f"frame {count} is {picture.shape}, the first {size}")
                video_frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
                if coding != "lossless":
                    video_frame = video_frame.reformat(
                        format=_FORMATS[coding], dst_colorspace="ITU709", dst_color_range="MPEG")
                video_frame.pts = count
                container.mux(stream.encode(video_frame))
                count += 1
            if stream is None:
                raise UserError(f"there are no frames for {path}")
            container.mux(stream.encode(None))
    return count


def _stream(container: Any, size: tuple[int, ...], fps: float, quality: int, coding: str,
            preset: str) -> Any:
    """The video stream: size and speed, colors tagged, encoder fixed."""
    rate = Fraction(fps).limit_denominator(1001)
    lossless = coding == "lossless"
    stream = container.add_stream("libx264rgb" if lossless else "libx264", rate=rate)
    stream.height, stream.width = size[0], size[1]
    stream.pix_fmt = _FORMATS[coding]
    context = stream.codec_context
    context.thread_count = 1
    context.color_primaries = context.color_trc = _BT709
    context.colorspace = 0 if lossless else _BT709
    context.color_range = 2 if lossless else 1  # 0..255, 16..235
    # Without the macroblock tree: for small frames it gives other bytes from run to run.
    options = {"crf": str(quality), "preset": preset, "threads": "1", "x264-params": "mbtree=0"}
    if coding != "420":
        options |= {"preset": "superfast", "tune": "zerolatency"}
    if lossless:
        del options["crf"]
        options["qp"] = "0"
    stream.options = options
    return stream
