"""Videos: their frames as upright sRGB pictures; sharp ones at even camera positions are chosen.

Who films a head walks now faster, now slower, and stands still at times. Frames at even time would
give many photos from one place and gaps between others. So a first pass follows features from frame
to frame and adds up by how much they move in the picture, and notes how sharp each frame is; the
way is divided in equal parts, and a second pass reads the sharpest frame of each.
"""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from PIL import Image

from ..arrays import Bool, Float32, Float64, UInt8
from ..errors import UserError
from ..media.colors import ColorSpace, coded_space, from_space
from ..media.pictures import reduced
from .photos import Photo, fineness, is_video, read_photos, relative_sharpness

# Features are followed in pictures of this longer side, about so many times a second.
_SIDE, _RATE = 384, 5.0
# A video whose features move less than this part of the picture altogether stands still.
_STILL = 0.02


@dataclass(frozen=True)
class _Scan:
    """What the first pass finds: float64 [F] each, and the error that ended it early, if any.

    ``way`` is the displacement since the start, in parts of the picture's longer side; ``time`` in
    seconds (phones film at a rate that varies); ``sharp`` the frames' relative sharpness.
    """

    way: Float64
    time: Float64
    sharp: Float64
    broken: str


def _followed(before: UInt8, after: UInt8, points: Float32) -> tuple[Float32, Bool]:
    """Where points [K, 1, 2] of one picture are in another, and which were found."""
    place, found, _ = cv2.calcOpticalFlowPyrLK(before, after, points, points.copy(),
                                               winSize=(15, 15), maxLevel=4)
    return np.asarray(place, np.float32), np.asarray(found).ravel() == 1


def _moved(before: UInt8, after: UInt8) -> float:
    """Median displacement of features in parts of the longer side; NaN where too few are found."""
    points = cv2.goodFeaturesToTrack(before, 200, 0.01, 6)
    if points is None or len(points) < 10:
        return float("nan")
    first = np.asarray(points, np.float32)
    there, found = _followed(before, after, first)
    back, returned = _followed(after, before, there)
    sure = found & returned & (np.linalg.norm((back - first)[:, 0], axis=1) < 0.7)
    if sure.sum() < 10:
        return float("nan")
    away = np.linalg.norm((there - first)[sure, 0], axis=1)
    return float(np.median(away)) / max(before.shape)


def _scan(path: Path) -> _Scan:
    import av

    details: list[Float64] = []
    times: list[float] = []
    nodes, moves = [0], []
    last: UInt8 | None = None
    broken = ""
    try:
        for index, (rate, _, frame) in enumerate(decoded(path)):
            grey = frame.to_ndarray(format="gray")
            details.append(fineness(grey, 640))
            times.append(index / rate if frame.time is None else float(frame.time))
            if index % max(1, round(rate / _RATE)) == 0:
                factor = min(1.0, _SIDE / max(grey.shape))
                small = np.asarray(cv2.resize(np.ascontiguousarray(grey), None, fx=factor,
                                              fy=factor, interpolation=cv2.INTER_AREA), np.uint8)
                if last is not None:
                    moves.append(_moved(last, small))
                    nodes.append(index)
                last = small
    except (av.error.FFmpegError, OSError, ValueError) as error:
        # A video that breaks off (a camera switched off) is good up to there.
        if not details:
            raise UserError(f"the video {path} can't be read: {error}") from error
        broken = str(error)
    if not details:
        raise UserError(f"the video {path} has no frames")
    steps = np.array(moves)
    if np.isnan(steps).any():
        # Where features are lost, the picture moved fast or was covered.
        steps[np.isnan(steps)] = np.nanquantile(steps, 0.9) if np.isfinite(steps).any() else 0.0
    way = np.interp(np.arange(len(details)), nodes, np.concatenate([[0.0], np.cumsum(steps)]))
    return _Scan(way, np.maximum.accumulate(times),
                 relative_sharpness(np.array(details), reach=8), broken)


def _chosen(scan: _Scan, count: int, spacing: str) -> list[int]:
    """The sharpest frame of each of ``count`` equal parts of the way or of time."""
    frames = len(scan.sharp)
    if frames <= count:
        return list(range(frames))
    place = (np.arange(frames) + 0.5) / frames
    if spacing == "parallax" and scan.way[-1] > _STILL:
        place = scan.way / scan.way[-1]
    elif scan.time[-1] > scan.time[0]:
        place = (scan.time - scan.time[0]) / (scan.time[-1] - scan.time[0])
    part = np.minimum((place * count).astype(int), count - 1)
    best: dict[int, int] = {}
    for index in range(frames):
        kept = best.get(int(part[index]))
        if kept is None or scan.sharp[index] > scan.sharp[kept]:
            best[int(part[index])] = index
    return sorted(best.values())


def read_video(path: Path, count: int = 80, max_side: int = 0,
               spacing: Literal["parallax", "time"] = "parallax") -> list[Photo]:
    """Take sharp frames from a video.

    Raises `UserError` if the file is missing or is no video that can be decoded.

    Parameters
    ----------
    count : Number of frames wanted; a shorter video gives all it has, one with sudden movements
        fewer.
    max_side : Frames are reduced to this many pixels on their longer side; 0 keeps them.
    spacing : At even distances by how much the picture moves (``"parallax"``), or at even time.
    """
    import av

    if not path.is_file():
        raise UserError(f"there is no video {path}")
    scan = _scan(path)
    if scan.broken:
        warnings.warn(f"{path.name} is damaged after {len(scan.sharp)} frames: {scan.broken}",
                      stacklevel=2)
    wanted = set(_chosen(scan, max(1, count), spacing))
    photos: list[Photo] = []
    try:
        for index, (_, aspect, frame) in enumerate(decoded(path)):
            if index in wanted:
                photos.append(Photo(f"frame_{len(photos):04d}.png",
                                    upright_frame(frame, max_side, aspect)))
            if len(photos) == len(wanted):
                break
    except (av.error.FFmpegError, OSError, ValueError) as error:
        if not photos:
            raise UserError(f"the video {path} can't be read: {error}") from error
    return photos


def video_frames(path: Path) -> tuple[float, Iterator[UInt8]]:
    """Frames per second of a video, and its upright frames (uint8 [H, W, 3]) one at a time.

    Raises `UserError` if the file is missing or is no video; while the frames are taken, if it is
    damaged.
    """
    import av

    if not path.is_file():
        raise UserError(f"there is no video {path}")
    try:
        with av.open(str(path)) as container:
            stream = film_of(container)
            if stream is None:
                raise UserError(f"{path} has no film in it")
            rate = float(stream.average_rate or 30)
    except (av.error.FFmpegError, OSError, ValueError) as error:  # names that are no UTF-8, too
        raise UserError(f"the video {path} can't be read: {error}") from error

    def frames() -> Iterator[UInt8]:
        try:
            for _, aspect, frame in decoded(path):
                yield np.ascontiguousarray(upright_frame(frame, 0, aspect))
        except (av.error.FFmpegError, OSError, ValueError) as error:
            raise UserError(f"the video {path} can't be read to its end: {error}") from error

    return rate, frames()


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
    """All of a picture [H, W, 3] with square pixels; ``ratio`` is width over height of its own."""
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
    pixels = _square(_pixels(frame, max_side), aspect)
    upright = np.ascontiguousarray(np.rot90(pixels, turns_of(frame)))
    if not max_side or max(upright.shape[:2]) <= max_side:
        return upright
    return np.asarray(reduced(Image.fromarray(upright), max_side))


def read_source(path: Path, max_side: int = 0, frames: int = 80) -> list[Photo]:
    """Photos of a folder, or frames of a video (`read_photos`, `read_video`)."""
    return (read_video(path, frames, max_side) if is_video(path)
            else read_photos(path, max_side))
