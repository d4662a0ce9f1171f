"""Where a painting is drawn in lines: there the sitter's light does not choose among its paint."""

from __future__ import annotations

import cv2
import numpy as np

from ...arrays import UInt8
from .filters import broad_blur, grey

FINE, AROUND = 0.03, 0.04
"""Sigma of the blur that takes a drawn line out, and how far around it counts, over the face's
size."""
DRAWN, USUAL, FAINT = 0.12, 3.0, 0.03
"""Contrast (root mean square, in [0, 1]) at which a line halves the weight of the appearance, and
the same over that of most of the face, where that is less (a cartoon's skin is flat), but no less
than the last."""


def drawn_lines(image: UInt8, face: UInt8, size: float) -> UInt8:
    """How far a painted face is drawn in lines at a place, uint8 [h, w]: 255 at them, 0 elsewhere.

    The sitter's light and shade choose among the paint around a place. Across a line, or a brow
    and eyes in flat colors, that breaks them into crumbs: what is drawn is copied whole.

    Parameters
    ----------
    image : uint8 [h, w, 3].
    face, size : uint8 [h, w], where the face is (`soft_face`), and its size (`face_size`).
    """
    lines = np.zeros(image.shape[:2], np.uint8)
    rows, columns = np.flatnonzero(face.any(axis=1)), np.flatnonzero(face.any(axis=0))
    if not len(rows):
        return lines
    # What blurs and neighbourhood reach around the face.
    margin = int(np.ceil((4 * FINE + 2 * AROUND) * size))
    part = (slice(max(rows[0] - margin, 0), rows[-1] + margin + 1),
            slice(max(columns[0] - margin, 0), columns[-1] + margin + 1))
    light, inside = grey(np.ascontiguousarray(image[part])), face[part]
    fine = light - broad_blur(light, FINE * size)
    contrast = np.sqrt(broad_blur(fine * fine, FINE * size))
    usual = float(np.median(contrast[inside > 127])) if (inside > 127).any() else 0.0
    half = min(DRAWN, max(USUAL * usual, FAINT))
    around = cv2.dilate(contrast, np.ones((2 * int(AROUND * size) + 1,) * 2, np.uint8))
    drawn = broad_blur(np.asarray(around, np.float32), AROUND * size / 2)
    # To the jaw, whose line is whole, too; hair and clothes follow no guide as exactly.
    ratio = np.square(np.square(drawn / np.float32(half)))
    lines[part] = np.rint(ratio / (1 + ratio) * np.minimum(inside.astype(np.float32) * 2, 255))
    return lines
