"""Where the demo's files lie, and their pictures made smaller."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

__all__ = ["DATA", "resized"]

DATA = Path(__file__).parent / "data"
"""The folder of them; `scripts/make_demo_data.py` writes it."""


def resized(picture: NDArray[Any], width: int, height: int) -> NDArray[Any]:
    """A picture at another size; colors of an alpha picture count by their alpha.

    Parameters
    ----------
    picture
        [H, W], [H, W, 3] or, with straight alpha, [H, W, 4].
    width, height
        Of the result in pixels.
    """
    if picture.shape[:2] == (height, width):
        return picture
    smaller = height < picture.shape[0]
    kind = Image.Resampling.BOX if smaller else Image.Resampling.BICUBIC
    return np.array(Image.fromarray(picture).resize((width, height), kind))
