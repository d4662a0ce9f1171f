"""Skin around eyes, brows, nostrils and lips: no plain skin for a neck, a chest or a crown.

Labels end where a feature ends. What frames it does not: the folds of lids, the bags below an eye,
the shade under a lip and beside a nostril. On a chest they would still be read as lids and lips. So
features reach further, where skin is taken from for other places than the face.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from ..exemplar import face_size
from ..guides.blurs import gaussian_blur
from .picture_materials import FEATURES, SKIN

__all__ = ["plain_skin"]

Float32 = NDArray[np.float32]
Points = NDArray[np.floating]

AROUND = 0.09
"""How far around a feature skin is not plain, over the face's size: about a patch's reach."""
BAG = 0.45
"""So far below an eye its bags reach, over its width."""
SOFT = 0.03
"""Blur of the edge, over the face's size."""
LEFT = 0.35, 0.5
"""If less of the skin than this would be left all stays; from the second on all of it is spared:
a little skin, used again and again, is worse."""
EVERY = 2
"""Drawn at every Nth pixel."""


def plain_skin(shares: Float32, landmarks: Points) -> Float32:
    """Shares with features that reach as far as they are seen.

    Parameters
    ----------
    shares
        float32 [h, w, 7] by `MATERIALS`, of an exemplar.
    landmarks
        [68, 2], its own.

    Returns
    -------
    float32 [h, w, 7], another array.
    """
    points = np.asarray(landmarks, np.float64)
    size = face_size(points)
    height, width = shares.shape[:2]
    picture = Image.new("L", (-(-width // EVERY), -(-height // EVERY)))
    draw = ImageDraw.Draw(picture)
    for outline in _features(points):
        _fill(draw, outline / EVERY, AROUND * size / EVERY)
    near = gaussian_blur(np.asarray(picture, np.float32) / np.float32(255),
                         max(SOFT * size / EVERY, 0.5))
    near = near.repeat(EVERY, 0).repeat(EVERY, 1)[:height, :width]
    skin = shares[..., SKIN]
    left = 1 - float((skin * near).sum()) / max(float(skin.sum()), 1.0)
    taken = skin * near * np.float32(np.clip((left - LEFT[0]) / (LEFT[1] - LEFT[0]), 0, 1))
    out = shares.copy()
    out[..., SKIN] -= taken
    out[..., FEATURES] += taken
    return out


def _features(points: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Outlines [N, 2] of what is seen of eyes with their brows, nostrils and mouth."""
    out = []
    for brow, eye in ((points[17:22], points[36:42]), (points[22:27], points[42:48])):
        across = eye[3] - eye[0]
        down = BAG * np.array([-across[1], across[0]])
        low = [eye[n] + down * part for n, part in ((0, 0.4), (5, 1.0), (4, 1.0), (3, 0.4))]
        out.append(np.concatenate([brow, np.array(low)[::-1]]))
    out += [points[31:36], points[48:60]]
    return out


def _fill(draw: ImageDraw.ImageDraw, outline: NDArray[np.float64], radius: float) -> None:
    """Fill an outline [N, 2] and what is within a radius of it."""
    corners = [(float(x), float(y)) for x, y in outline - 0.5]
    if not np.isfinite(outline).all():
        return
    draw.polygon(corners, fill=255)
    draw.line([*corners, corners[0]], fill=255, width=max(1, round(2 * radius)), joint="curve")
    for x, y in corners:
        draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=255)
