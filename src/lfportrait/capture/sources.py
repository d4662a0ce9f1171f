"""Read pictures from a folder of photos or a video."""

from __future__ import annotations

from pathlib import Path

from ..arrays import UInt8
from .photos import Photo, is_video, read_photos
from .video import read_video

__all__ = ["load_photos", "read_source"]


def load_photos(path: str | Path) -> list[tuple[str, UInt8]]:
    """Names and pictures (uint8 [H, W, 3 or 4], upright) of a folder of photos or a video.

    Raises
    ------
    UserError
        If there is nothing that can be read.
    """
    return [(photo.name, photo.image) for photo in read_source(Path(path))]


def read_source(path: Path, max_side: int = 0, frames: int = 80) -> list[Photo]:
    """Photos of a folder, or frames of a video (`read_photos`, `read_video`).

    Parameters
    ----------
    path
        Folder or video file.
    max_side
        Pictures are reduced to this many pixels on their longer side; 0 keeps them.
    frames
        How many frames of a video.

    Raises
    ------
    UserError
        If there is nothing that can be read.
    """
    return (read_video(path, frames, max_side) if is_video(path)
            else read_photos(path, max_side))
