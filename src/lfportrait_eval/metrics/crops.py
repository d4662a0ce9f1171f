"""Square crops of pictures, for networks that want many small pictures of the same things."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["spread_crops"]


def spread_crops(pictures: list[NDArray[np.uint8]], masks: list[NDArray[np.bool_]], size: int,
                 count: int, seed: int) -> list[NDArray[np.uint8]]:
    """Square crops whose middles lie where the masks are set, spread evenly over the pictures.

    Parameters
    ----------
    pictures, masks
        uint8 [H, W, 3] and bool [H, W] each.
    size
        Side in pixels; a smaller picture gives smaller crops.
    count
        How many; fewer where a mask is empty.
    seed
        Of their places.
    """
    generator = np.random.default_rng(seed)
    crops = []
    for index in range(count):
        picture, mask = pictures[index % len(pictures)], masks[index % len(pictures)]
        height, width = picture.shape[:2]
        side = min(size, height, width)
        rows, columns = np.nonzero(mask)
        if not len(rows):
            continue
        pick = generator.integers(len(rows))
        y = int(np.clip(rows[pick] - side // 2, 0, height - side))
        x = int(np.clip(columns[pick] - side // 2, 0, width - side))
        crops.append(picture[y:y + side, x:x + side])
    return crops


