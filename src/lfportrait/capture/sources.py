"""Pictures of a person from wherever they come: a folder of photos, or a video."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .photos import is_video, read_photos
from .video import read_video

__all__ = ["load_photos"]


def load_photos(path: str | Path) -> list[tuple[str, NDArray[np.uint8]]]:
    """Names and pictures (uint8 [H, W, 3 or 4], upright) of a folder of photos or a video.

    Raises
    ------
    UserError
        If there is nothing that can be read.
    """
    path = Path(path)
    photos = read_video(path) if is_video(path) else read_photos(path)
    return [(photo.name, photo.image) for photo in photos]
