"""The mask guide (Shen et al. 2023, 2.3): the view of every sub-pixel, computed once per display.

The views depend on the panel alone, so they are computed once, kept on disk under the display's
hash and mapped into memory when they are needed again.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..cache import key_of, user_cache
from ..files import UNREADABLE_ARRAYS, atomic_write
from .display import Display
from .kernels.panel import lens_of, mask_views

__all__ = ["ViewMask", "row_views"]


def row_views(display: Display, first: int, count: int, apart: int = 1,
              ) -> NDArray[np.unsignedinteger]:
    """The nearest view of the sub-pixels of some rows, as `ViewMask` holds all of them.

    Parameters
    ----------
    display
        The panel.
    first, count, apart
        The first row, how many, and how far apart they are.
    """
    kind = np.dtype(np.uint8 if display.views <= 256 else np.uint16)
    views = np.empty((count, display.width, 3), kind)
    mask_views(views, display.steps(), lens_of(display), first, apart)
    return views


@dataclass(frozen=True)
class ViewMask:
    """The nearest view of every sub-pixel of a panel.

    Attributes
    ----------
    views
        uint8 (uint16 above 256 views) [H, W, 3], sub-pixels as `Display.phase` counts them.
    display
        Hash of the display that it was computed for.
    seconds
        Time that building or loading it took.
    loaded
        Whether it came from the cache.
    """

    views: NDArray[np.unsignedinteger]
    display: str
    seconds: float
    loaded: bool

    @staticmethod
    def build(display: Display, cache: bool | Path = True) -> ViewMask:
        """The mask of a display, from the cache if it is there.

        Parameters
        ----------
        display
            The panel.
        cache
            True keeps masks in the user's cache folder, a path in that folder, False nowhere.
        """
        start = time.perf_counter()
        kind = np.dtype(np.uint8 if display.views <= 256 else np.uint16)
        shape = (display.height, display.width, 3)
        file = None
        if cache is not False:
            folder = user_cache("masks") if cache is True else Path(cache)
            file = folder / f"{key_of(__name__, display.hash())}.npy"
            try:
                stored = np.load(file, mmap_mode="r", allow_pickle=False)
                if stored.shape == shape and stored.dtype == kind:
                    return ViewMask(stored, display.hash(), time.perf_counter() - start, True)
            except UNREADABLE_ARRAYS:
                pass
        views = row_views(display, 0, display.height)
        if file is not None:
            try:
                with atomic_write(file) as stream:
                    np.save(stream, views, allow_pickle=False)
            except Exception:  # a cache that can't be written is no reason to stop
                pass
        return ViewMask(views, display.hash(), time.perf_counter() - start, False)

    @property
    def nbytes(self) -> int:
        """Memory taken, in bytes."""
        return int(self.views.nbytes)
