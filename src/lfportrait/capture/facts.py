"""What is known of pictures, videos and calibrated data sets before they are decoded."""

from __future__ import annotations

from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..errors import UserError
from ..measure import usable_cores
from ..media import pictures
from ..media.colors import named_colors
from ..media.depth import DepthMap, read_depth
from ..media.folders import Finder
from .formats import find_views
from .formats.assembly import Shot, mask_of
from .photos import Noted, noted
from .video import decoded, film_of, space_of, turns_of, upright_frame


@dataclass(frozen=True)
class DepthFacts:
    """Of the depth that a picture's file keeps."""

    source: str  # As in `DepthMap`.
    size: tuple[int, int]  # Width and height of the map, upright.
    # nearest, farthest: Range of its distances, in metres or in no known unit; None where none is
    # known.
    nearest: float | None
    farthest: float | None
    metric: bool  # Whether they are metres.
    confidence: bool  # Whether the file says how sure each distance is.

    @staticmethod
    def of(depth: DepthMap) -> DepthFacts:
        """The facts of a map."""
        distances, metric = depth.distance()
        known = distances[np.isfinite(distances)]
        near, far = (float(known.min()), float(known.max())) if known.size else (None, None)
        return DepthFacts(depth.source, (depth.values.shape[1], depth.values.shape[0]), near, far,
                          metric, depth.confidence is not None)


@dataclass(frozen=True)
class PictureFacts:
    """Of one picture's file."""

    path: Path  # The file.
    # Why it can't be read, in one line; empty where it can. Nothing else is known then.
    fault: str = ""
    format: str = ""  # As Pillow names it: ``"JPEG"``, ``"HEIF"``, ...
    mode: str = ""  # Pillow's mode: ``"RGB"``, ``"RGBA"``, ``"CMYK"``, ``"I;16"``, ...
    # stored, upright: Width and height in pixels, in the file and as it is read.
    stored: tuple[int, int] = (0, 0)
    upright: tuple[int, int] = (0, 0)
    orientation: int = 1  # As noted, 1 to 8 as in EXIF.
    # colors, colors_by: The color space that its numbers are read by, and what says so (empty:
    # nothing does).
    colors: str = ""
    colors_by: str = ""
    noted: Noted = field(default_factory=Noted)  # Lens and focal length by its EXIF data.
    depth: DepthFacts | None = None  # Of its depth, or None.


def picture_facts(path: Path) -> PictureFacts:
    """Look at a picture's file; whatever is wrong with it is its ``fault``."""
    fault = pictures.fault_of(path)
    if fault:
        return PictureFacts(path, fault)
    try:
        with pictures.open_header(path) as picture:
            colors, colors_by = named_colors(picture, pictures.file_of(picture))
            stored, upright = pictures.sizes_of(picture)
            found = PictureFacts(
                path, format=picture.format or "", mode=picture.mode, stored=stored,
                upright=upright, orientation=pictures.orientation_of(picture), colors=colors,
                colors_by=colors_by, noted=noted(picture.getexif(), picture.size))
    except pictures.UNREADABLE as error:
        return PictureFacts(path, pictures.one_line(error))
    depth = read_depth(path)
    return found if depth is None else replace(found, depth=DepthFacts.of(depth))


@dataclass(frozen=True)
class VideoFacts:
    """Of a video's film."""

    path: Path  # The file.
    # Why it can't be read; empty where its first frame can. Nothing else is known then.
    fault: str = ""
    codec: str = ""  # As FFmpeg names it.
    # stored, upright: Width and height in pixels, in the stream and as frames are read.
    stored: tuple[int, int] = (0, 0)
    upright: tuple[int, int] = (0, 0)
    aspect: float = 1.0  # Width of a stored pixel over its height.
    turns: int = 0  # Counter-clockwise quarter turns that bring a frame upright, 0 to 3.
    rate: float = 0.0  # Frames a second, on average.
    # frames, seconds: As the file notes them, or one by the other and the rate; 0 where it notes
    # neither.
    frames: int = 0
    seconds: float = 0.0
    # colors, colors_by: The color space that frames are read by, and what says so (empty: nothing
    # does).
    colors: str = ""
    colors_by: str = ""


def video_facts(path: Path) -> VideoFacts:
    """Look at a video: its head, and its first frame."""
    import av

    try:
        codec, frames, seconds = _lengths(path)
        rate, aspect, frame = next(decoded(path))
        height, width = upright_frame(frame, 0, aspect).shape[:2]
    except (av.error.FFmpegError, OSError, ValueError, StopIteration) as error:
        return VideoFacts(path, str(error) or "it has no frames")
    space = space_of(frame)
    return VideoFacts(path, "", codec, (frame.width, frame.height), (width, height), aspect,
                      turns_of(frame), rate, frames or round(seconds * rate),
                      seconds or frames / rate, space.name, space.source)


def _lengths(path: Path) -> tuple[str, int, float]:
    """Codec of a film, and its frames and seconds as noted; 0 where they are not."""
    import av

    with av.open(str(path)) as container:
        stream = film_of(container)
        if stream is None:
            raise ValueError("it has no video stream, or a cover picture alone")
        seconds = 0.0
        if stream.duration and stream.time_base:
            seconds = float(stream.duration * stream.time_base)
        elif container.duration:
            seconds = container.duration / av.time_base
        return stream.codec_context.name, stream.frames, seconds


@dataclass(frozen=True)
class DataSetFacts:
    """Of a calibrated data set."""

    path: Path  # As it was given.
    fault: str = ""  # Why it can't be read; empty where it can. Nothing else is known then.
    format: str = ""  # The program or format whose files it has.
    source: Path | None = None  # The file or folder with the cameras.
    lenses: dict[str, int] = field(default_factory=dict)  # Views by their lens model, as text.
    masks: int = 0  # Views whose mask was found.
    test: int = 0  # Views that the data set itself holds out.
    pictures: list[PictureFacts] = field(default_factory=list)  # Of each view's file.


def data_set_facts(path: Path) -> DataSetFacts:
    """Look at a calibrated data set (`is_calibrated`).

    Warnings say what is missing in it, as when it is read.
    """
    try:
        found = find_views(path)
    except UserError as error:
        return DataSetFacts(path, str(error))
    with ThreadPoolExecutor(usable_cores()) as threads:
        views = list(threads.map(picture_facts, [shot.path for shot in found.shots]))
    finder = Finder()
    lenses = Counter(_lens_model(shot, one) for shot, one in zip(found.shots, views))
    return DataSetFacts(path, "", found.format, found.source, dict(lenses),
                        sum(mask_of(shot, finder) is not None for shot in found.shots),
                        sum(bool(shot.test) for shot in found.shots), views)


def _lens_model(shot: Shot, picture: PictureFacts) -> str:
    """A shot's lens in a word or two."""
    if picture.fault:
        return "unknown, as the picture can't be read"
    try:
        lens = shot.lens(*(shot.size or picture.stored))
    except (TypeError, ValueError, UserError) as error:
        return f"can't be read: {error}"
    return lens.model if lens.distorts else "pinhole"
