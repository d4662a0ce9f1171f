"""The embedded head on which a painting is tried: made once, then read from the user's cache.

It is the same head for every painting, and making it (its photographs, its field, its skin) takes
longer than painting it. What is kept is named after the code that makes it, so that another version
makes its own.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..cache import key_of, user_cache
from ..capture import Capture
from ..demo import SITTER, demo_cameras, head_field, landmarks
from ..errors import UserError
from ..example import Skin
from ..field import VoxelField
from ..stylize import kept_skin

__all__ = ["preview_head"]


def _capture() -> Capture:
    """Cameras and landmarks of the head; its pictures are empty, as nothing looks at them."""
    cameras = demo_cameras(256, 12)
    count = len(cameras)
    return Capture(cameras, [np.zeros((256, 256, 3), np.uint8)] * count, None,
                   [str(number) for number in range(count)], np.zeros(count, bool), np.eye(4),
                   landmarks(SITTER))


def _key() -> str:
    """Hash of the code that models the head."""
    return key_of(__name__)


def preview_head(pixels: float, cache: Path | None = None) -> tuple[VoxelField, Capture, Skin]:
    """The embedded head, what is known of it, and its skin.

    Parameters
    ----------
    pixels
        Of the skin, per world unit.
    cache
        Folder for what is kept; None: the user's cache. If nothing can be written there, the head
        is made each time.

    Returns
    -------
    field, capture, skin
        In the portrait frame; the capture's pictures are empty.
    """
    capture, points = _capture(), landmarks(SITTER)
    folder = cache or user_cache("heads")
    file = folder / f"{_key()}.npz"
    try:
        field = VoxelField.load(file)
    except (UserError, OSError):
        field = head_field(SITTER)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            field.save(file)
        except (UserError, OSError):
            return field, capture, Skin.of(field, points, capture.cameras, pixels)
        # A file keeps rounded numbers: continue with the numbers that the next run reads.
        field = VoxelField.load(file)
    return field, capture, kept_skin(file, field, capture, pixels)
