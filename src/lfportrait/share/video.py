"""Videos: as H.264 that every browser and player opens, with every sub-pixel kept, as HEVC, VP9.

Fixed encoder settings on one thread and no time stamps in the file: the same frames give the same
bytes. Colors are converted and tagged as BT.709, so that players show what the pictures hold.

Pictures coded for a light-field panel need more than the usual 4:2:0, which keeps colors at half
the size: neighbouring sub-pixels belong to different views. ``444`` keeps all colors, ``lossless``
all values, as RGB. Browsers play neither; mpv, VLC and ffplay do.

HEVC and VP9 are for what is larger than H.264 takes, and for panels that play nothing else.
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
from ..measure import usable_cores

__all__ = ["ENCODERS", "Codec", "has_encoder", "write_video"]

Codec = Literal["h264", "hevc", "vp9"]
ENCODERS: dict[Codec, str] = {"h264": "libx264", "hevc": "libx265", "vp9": "libvpx-vp9"}
"""FFmpeg's encoders."""
_BT709 = 1
_FORMATS = {"420": "yuv420p", "444": "yuv444p", "lossless": "rgb24"}
_SUFFIXES = {".mp4", ".mov", ".mkv"}


def has_encoder(codec: Codec) -> bool:
    """Whether the installed FFmpeg codes this."""
    import av

    return ENCODERS[codec] in av.codecs_available


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
                preset: Literal["medium", "veryfast", "superfast"] = "medium",
                codec: Codec = "h264", comment: str = "") -> int:
    """Write a video.

    Parameters
    ----------
    path
        ``.mp4``, ``.mov`` or ``.mkv``, or ``.webm`` for VP9; it appears when it is complete.
    frames
        Frames [H, W, 3] of one size, uint8 or float in [0, 1]; taken one at a time, so a generator
        needs the memory of one frame only. With ``"420"`` odd sides grow by one pixel.
    fps
        Frames per second.
    quality
        The encoder's constant rate factor, 0 (finest) to 51 (VP9: 63); 17 looks like the original.
        Not used where ``coding`` is ``"lossless"``.
    coding
        ``"420"`` for people; ``"444"`` and ``"lossless"`` for pictures coded for a panel. The
        latter two hold no frames back, which would take gigabytes at a panel's size. Only H.264
        has them.
    preset
        How thoroughly ``"420"`` is coded: ``"veryfast"`` takes less than half the time of
        ``"medium"`` for files that are a twentieth larger, ``"superfast"`` a quarter of it for
        files that are a third larger. H.264 alone.
    codec
        ``"h264"``, ``"hevc"`` or ``"vp9"``.
    comment
        Written into the file's metadata.

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
    if suffix not in (_SUFFIXES | {".webm"} if codec == "vp9" else _SUFFIXES):
        raise UserError(f"can't write a video named {path}; end the name in .mp4")
    if codec != "h264" and coding != "420":
        raise ValueError(f"{codec} is written as 4:2:0 only")
    count, size = 0, None
    with atomic_path(path) as temporary:
        options = {"movflags": "+faststart"} if suffix in (".mp4", ".mov") else {}
        with av.open(str(temporary), "w", options=options) as container:
            bitexact: Any = av.container.Flags.bitexact.value  # no time of writing in the file
            container.flags |= bitexact
            if comment:
                container.metadata["comment"] = comment
            stream: Any = None
            for frame in frames:
                picture = _picture(frame, coding == "420")
                if stream is None:
                    size = picture.shape
                    stream = (_stream(container, size, fps, quality, coding, preset)
                              if codec == "h264" else
                              _large_stream(container, size, fps, quality, codec))
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


def _added(container: Any, encoder: str, size: tuple[int, ...], fps: float, coding: str) -> Any:
    """A stream with its size and speed, and its colors tagged."""
    stream = container.add_stream(encoder, rate=Fraction(fps).limit_denominator(1001))
    stream.height, stream.width = size[0], size[1]
    stream.pix_fmt = _FORMATS[coding]
    context = stream.codec_context
    context.color_primaries = context.color_trc = _BT709
    context.colorspace = 0 if coding == "lossless" else _BT709
    context.color_range = 2 if coding == "lossless" else 1  # 0..255, 16..235
    return stream


def _large_stream(container: Any, size: tuple[int, ...], fps: float, quality: int, codec: Codec,
                  ) -> Any:
    """HEVC or VP9. A quilt's frame has up to 100 MB: few of them are held back."""
    stream = _added(container, ENCODERS[codec], size, fps, "420")
    if codec == "hevc":
        stream.codec_context.codec_tag = "hvc1"  # by which Apple's players know it
        # Without B-frames: at the end of one or two frames libx265's threads now and then hand on
        # what the container refuses.
        stream.options = {
            "crf": str(quality), "preset": "fast", "x265-params":
            "log-level=error:frame-threads=1:rc-lookahead=5:bframes=0:info=0"}
    else:
        stream.codec_context.thread_count = usable_cores()
        stream.options = {"crf": str(quality), "b": "0", "deadline": "good", "cpu-used": "4",
                          "lag-in-frames": "5", "tile-columns": "4"}
    return stream


def _stream(container: Any, size: tuple[int, ...], fps: float, quality: int, coding: str,
            preset: str) -> Any:
    """An H.264 stream with a fixed encoder."""
    lossless = coding == "lossless"
    stream = _added(container, "libx264rgb" if lossless else "libx264", size, fps, coding)
    stream.codec_context.thread_count = 1
    # Without the macroblock tree: for small frames it gives other bytes from run to run.
    options = {"crf": str(quality), "preset": preset, "threads": "1", "x264-params": "mbtree=0"}
    if coding != "420":
        options |= {"preset": "superfast", "tune": "zerolatency"}
    if lossless:
        del options["crf"]
        options["qp"] = "0"
    stream.options = options
    return stream
