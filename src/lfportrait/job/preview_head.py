"""The embedded head on which a painting is tried; its skin is drawn once, then read from the cache.

It is the same head for every painting, and drawing its skin takes longer than painting it.
"""

from __future__ import annotations

from pathlib import Path

from ..cache import user_cache
from ..capture import Capture
from ..demo import HEAD, demo_capture, demo_head
from ..example import Skin
from ..field import VoxelField
from ..stylize import kept_skin

__all__ = ["preview_head"]


def preview_head(pixels: float, cache: Path | None = None) -> tuple[VoxelField, Capture, Skin]:
    """The embedded head, its capture, and its skin.

    Parameters
    ----------
    pixels
        Of the skin, per world unit.
    cache
        Folder for what is kept; None: the user's cache. If nothing can be written there, the skin
        is drawn each time.

    Returns
    -------
    field, capture, skin
        In the portrait frame; the capture has 12 small photos.
    """
    field, capture = demo_head(), demo_capture(size=256, views=12)
    kept = (cache or user_cache("heads")) / "embedded.skin.npz"
    return field, capture, kept_skin(HEAD, field, capture, pixels, kept)
