"""What of an exemplar's face is no skin: loose strands of hair, and the face's outline.

A lock that hangs over a cheek, a curl, a single stroke: copied onto every sitter it would be a
scratch. It is a thin dark line of the hair's colors that comes from the hair. Wrinkles do not come
from there, and where a face is drawn in lines altogether, lines are its skin.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ...labels import FEATURES as FACE_FEATURES
from ...labels import PICTURE_LABELS
from ..exemplar import Exemplar
from ..guides.filters import broad_blur, disk, grey, skin_distance
from ..guides.regions import soft_face
from .picture_materials import FEATURES, SKIN

__all__ = ["outline", "strands", "unpainted"]

Float32 = NDArray[np.float32]

FACE = 110.0
"""Size of the face in the picture that is looked at."""
THIN = 0.03
"""Strands are no broader than twice this, over the face's size."""
DARK = 0.08
"""So much darker than what is beside it is a line."""
LONG = 0.12
"""Shorter lines, over the face's size, are none."""
UNLIKE = 2.0
"""A strand is so far from the cheek's colors, in standard deviations."""
NEAR = 0.2
"""It comes from hair that is no further away than this, over the face's size."""
INSIDE, FOREHEAD = 0.95, 0.4
"""An outline lies where less than this is face (a soft mask); a forehead, so high over the face's
height, has none."""
BESIDE = 0.08
"""Blur that carries the colors of the face to its outline, over the face's size."""
OFF = 0.1
"""Paint that is so far from them, root mean square of its colors, is outline."""
LINES = 0.06
"""More of a face than this in such lines is a drawing's manner."""


def strands(exemplar: Exemplar, hair: Float32, labels: NDArray[np.uint8]) -> Float32:
    """Where strands hang over an exemplar's face, float32 [h, w] in [0, 1].

    Parameters
    ----------
    exemplar
        The painting.
    hair
        float32 [h, w], its hair in [0, 1].
    labels
        uint8 [h, w, len(PICTURE_LABELS)].
    """
    shape = exemplar.image.shape[:2]
    ratio = min(1.0, FACE / exemplar.size)
    size = max(round(shape[1] * ratio), 16), max(round(shape[0] * ratio), 16)
    face_size = exemplar.size * ratio
    points = exemplar.landmarks * ratio
    image, *parts_of_face = (
        np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_AREA), np.uint8)
        for plane in (exemplar.image, *(labels[..., PICTURE_LABELS.index(name)]
                                        for name in FACE_FEATURES)))
    features = np.maximum.reduce(parts_of_face)
    known = np.asarray(cv2.resize(np.asarray(hair, np.float32), size), np.float32)
    inside = (soft_face(size[::-1], points, 0.3) > 200) & (features < 20)
    skin = inside & (known < 0.3)
    lines = _long(_lines(image, face_size) & inside, LONG * face_size)
    if skin.sum() < 50 or lines.sum() > LINES * skin.sum():
        return np.zeros(shape, np.float32)
    plain = skin & ~lines
    away = np.zeros(size[::-1], np.float32)
    away[inside] = skin_distance(image[inside] / np.float32(255), plain[inside])
    lines = _long(lines & (away > UNLIKE), LONG * face_size)
    bare = np.asarray(known < 0.5, np.uint8)
    from_hair = cv2.distanceTransform(bare, cv2.DIST_L2, 3) < NEAR * face_size
    _, parts = cv2.connectedComponents(lines.astype(np.uint8))
    out = np.isin(parts, np.setdiff1d(parts[from_hair], 0)).astype(np.float32)
    # With its soft edge, and where it ends in a point.
    kernel = disk(1.5 * THIN * face_size)
    return np.asarray(cv2.resize(cv2.dilate(out, kernel), shape[::-1],
                                 interpolation=cv2.INTER_LINEAR), np.float32)


def outline(exemplar: Exemplar) -> NDArray[np.bool_]:
    """The rim of an exemplar's face where that is no paint of a face, bool [h, w].

    A dark stroke along the jaw, a collar, what lies behind: on a sitter's cheek they are crumbs.
    """
    soft = soft_face(exemplar.image.shape, exemplar.landmarks, FOREHEAD)
    inside = np.asarray(soft > 255 * INSIDE, np.float32)
    weight = broad_blur(inside, BESIDE * exemplar.size)
    away = np.zeros(soft.shape, np.float32)
    for channel in range(3):
        paint = np.asarray(exemplar.image[..., channel], np.float32) / np.float32(255)
        beside = broad_blur(np.asarray(paint * inside, np.float32), BESIDE * exemplar.size)
        away += (paint - beside / np.maximum(weight, np.float32(1e-3))) ** 2
    return np.asarray((inside == 0) & (away > 3 * OFF ** 2))


def unpainted(shares: Float32, strand: Float32) -> None:
    """Let skin under strands [h, w] be painted nowhere: in place, in shares [h, w, 7]."""
    shares[..., FEATURES] += shares[..., SKIN] * strand
    shares[..., SKIN] *= 1 - strand


def _long(lines: NDArray[np.bool_], length: float) -> NDArray[np.bool_]:
    """Those of some lines, bool [h, w], that are at least so long."""
    _, parts, boxes, _ = cv2.connectedComponentsWithStats(lines.astype(np.uint8))
    kept = np.hypot(boxes[:, cv2.CC_STAT_WIDTH], boxes[:, cv2.CC_STAT_HEIGHT]) > length
    return np.asarray(lines & kept[parts])


def _lines(image: NDArray[np.uint8], size: float) -> NDArray[np.bool_]:
    """Thin dark lines of a picture [h, w, 3] whose face is of a ``size``, bool [h, w]."""
    kernel = disk(THIN * size)
    return np.asarray(cv2.morphologyEx(grey(image), cv2.MORPH_BLACKHAT, kernel) > DARK)
