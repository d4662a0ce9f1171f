"""What is known of a video by its head and its first frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .video import decoded, film_of, space_of, turns_of, upright_frame

__all__ = ["VideoFacts", "video_facts"]


@dataclass(frozen=True)
class VideoFacts:
    """Of a video's film.

    Attributes
    ----------
    path
        The file.
    fault
        Why it can't be read; empty where its first frame can. Nothing else is known then.
    codec
        As FFmpeg names it.
    stored, upright
        Width and height in pixels, in the stream and as frames are read.
    aspect
        Width of a stored pixel over its height.
    turns
        Counter-clockwise quarter turns that bring a frame upright, 0 to 3.
    rate
        Frames a second, on average.
    frames, seconds
        As the file notes them, or one by the other and the rate; 0 where it notes neither.
    colors, colors_by
        The color space that frames are read by, and what says so (empty: nothing does).
    """

    path: Path
    fault: str = ""
    codec: str = ""
    stored: tuple[int, int] = (0, 0)
    upright: tuple[int, int] = (0, 0)
    aspect: float = 1.0
    turns: int = 0
    rate: float = 0.0
    frames: int = 0
    seconds: float = 0.0
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
