"""What covers a head and is not seen as hair: hats, scarves, and hair that the network misses.

The fitted skull says where a head ends. What a matte shows beyond it, over the crown, is worn there
or grows there: GrabCut (Rother et al. 2004) says by its colors how far it goes on over forehead,
ears and neck. It is made and painted as hair is.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ...arrays import Bool, Float64, UInt8
from ..head_fit import HeadFit, ear_to_ear

__all__ = ["headwear", "skull_in"]

FINE = 160.0
"""Pixels of a face's width where its extent is found, at most."""
LEVEL = 0.095
"""Height of the ears' middles (metres, `HeadPrior.rest`)."""
BESIDE = 0.04
"""What lies no further outside of the skull may be the skull's, widths of a face."""
THIN = 0.02
"""What is twice so thin is a shred of the matte, widths of a face."""
CROWN = 60.0
"""Degrees to both sides of straight up that are above a head."""
LEAST, ABOVE = 0.045, 0.25
"""Squares of a face's width that it covers there, at least, and which part of it lies there."""
OF_GROUND, ACROSS = 10.0, 0.03
"""Difference in CIELAB between both sides of its outline, so far from it (widths of a face), up to
which it is ground that a matte kept."""
UNLIKE = 10.0
"""Difference in CIELAB from the face up to which it is a tall skull's skin."""
SECTORS = 120
"""Of the circle around a head's middle."""
ROUNDS = 4
DOWN, CLOTHES = 0.25, 0.6
"""How far below the chin it may go on, and how far down clothes are looked at, widths of a face."""


def skull_in(fit: HeadFit, view: int) -> tuple[Float64, Float64]:
    """Pixels of a head above its ears' middles, [N, 2], and the middle between the ears, [2]."""
    height = fit.prior.rest[:, 1]
    places = fit.views[view].project(fit.vertices(view))
    return places[height > LEVEL], places[np.abs(height - LEVEL) < 0.004].mean(axis=0)


def headwear(image: UInt8, matte: NDArray[np.floating], hair: NDArray[np.floating],
             landmarks: Float64, skull: tuple[Float64, Float64]) -> Bool | None:
    """Where a photo shows what covers a head besides hair that was seen, bool [H, W], or None.

    Parameters
    ----------
    image : uint8 [H, W, 3], sRGB.
    matte, hair : [H, W] in [0, 1].
    landmarks : [68, 2] in pixels.
    skull : Of `skull_in`.
    """
    factor = min(1.0, FINE / ear_to_ear(landmarks))
    size = (max(2, round(factor * image.shape[1])), max(2, round(factor * image.shape[0])))
    small, soft, curls = (cv2.resize(one, size, interpolation=cv2.INTER_AREA)
                          for one in (image, np.asarray(matte, np.float32),
                                      np.asarray(hair, np.float32)))
    face, person = landmarks * factor, soft > 0.5
    beyond = _beyond(np.asarray(small, np.uint8), np.asarray(soft, np.float32), curls > 0.5, face,
                     (skull[0] * factor, skull[1] * factor))
    if beyond is None:
        return None
    found = _spread(np.asarray(small, np.uint8), person, beyond, curls > 0.5, face,
                    skull[1] * factor)
    whole = cv2.resize(found.astype(np.float32), image.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray((whole > 0.5) & (np.asarray(matte) > 0.5))


def _beyond(image: UInt8, soft: NDArray[np.floating], hair: Bool, face: Float64,
            skull: tuple[Float64, Float64]) -> Bool | None:
    """What lies over a crown and is neither skull, nor hair, nor ground, bool [h, w], or None."""
    width = ear_to_ear(face)
    points, middle = skull
    head = _drawn(points, soft.shape)
    away = cv2.distanceTransform((~head).astype(np.uint8), cv2.DIST_L2, 5) / width
    down = (face[8] - face[27]) / max(float(np.linalg.norm(face[8] - face[27])), 1e-9)
    row, column = np.mgrid[:soft.shape[0], :soft.shape[1]] + 0.5
    x, y = column - middle[0], row - middle[1]
    up, beside = -(x * down[0] + y * down[1]), np.abs(x * down[1] - y * down[0])
    loose = (soft > 0.5) & ~hair & (away > BESIDE) & (up > 0)
    radius = max(1, round(THIN * width))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    opened = cv2.morphologyEx(loose.astype(np.uint8), cv2.MORPH_OPEN, disc)
    count, labels = cv2.connectedComponents(opened)
    above = np.degrees(np.arctan2(beside, up)) < CROWN
    lab = np.asarray(cv2.cvtColor(image.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB),
                     np.float32)
    ground = soft < 0.05
    skin = np.median(lab[_drawn(face, soft.shape)], axis=0)
    out = np.zeros(soft.shape, bool)
    for one in range(1, count):
        part = labels == one
        over = (part & above).sum()
        if over >= max(LEAST * width ** 2, ABOVE * part.sum()) and (
                np.linalg.norm(np.median(lab[part], axis=0) - skin) > UNLIKE
                and not _is_ground(part, ground, lab, width)):
            out |= part
    return out if out.any() else None


def _drawn(points: Float64, shape: tuple[int, ...]) -> Bool:
    """The convex hull of points [N, 2] in a picture."""
    out = np.zeros(shape[:2], np.uint8)
    cv2.fillConvexPoly(out, cv2.convexHull(np.rint(points).astype(np.int32)), 1)
    return np.asarray(out > 0)


def _is_ground(part: Bool, ground: Bool, lab: NDArray[np.floating], width: float) -> bool:
    """Whether the photo has no edge where a part of a matte meets the ground."""
    reach = ACROSS * width
    inner, outer = (cv2.distanceTransform((~one).astype(np.uint8), cv2.DIST_L2, 5)
                    for one in (ground, part))
    sides = []
    for side in (part & (inner < 2 * reach) & (inner > reach),
                 ground & (outer < 2 * reach) & (outer > reach)):
        known = side.astype(np.float32)
        blurred = cv2.GaussianBlur(np.dstack([lab * known[..., None], known]), (0, 0), reach)
        sides.append(blurred)
    both = part & (sides[0][..., 3] > 0.02) & (sides[1][..., 3] > 0.02)
    if not both.any():
        return False
    one, two = (side[both][:, :3] / side[both][:, 3:] for side in sides)
    return float(np.median(np.linalg.norm(one - two, axis=1))) < OF_GROUND


def _spread(image: UInt8, person: Bool, beyond: Bool, hair: Bool, face: Float64,
            middle: Float64) -> Bool:
    """All of what covers a head, by the colors of the part ``beyond`` it."""
    width = ear_to_ear(face)
    down = (face[8] - face[27]) / max(float(np.linalg.norm(face[8] - face[27])), 1e-9)
    row, column = np.mgrid[:person.shape[0], :person.shape[1]] + 0.5
    below = (column - face[8, 0]) * down[0] + (row - face[8, 1]) * down[1]
    skin = _drawn(face, person.shape)
    mask = np.where(person, cv2.GC_PR_BGD, cv2.GC_BGD).astype(np.uint8)
    mask[skin] = cv2.GC_BGD
    mask[person & (below > DOWN * width)] = cv2.GC_BGD
    mask[_below_hair(hair, middle) & ~beyond] = cv2.GC_BGD
    mask[beyond | (hair & (mask != cv2.GC_BGD))] = cv2.GC_FGD
    # The ground says nothing: it gets the colors of the face.
    shown = image.copy()
    shown[~person] = np.median(image[skin], axis=0)
    # Clothes further down say nothing, either.
    rows, columns = (slice(int(one.min()), int(one.max()) + 1) for one in np.nonzero(
        person & (below < CLOTHES * width)))
    cut, box = np.ascontiguousarray(mask[rows, columns]), shown[rows, columns, ::-1]
    models = [np.zeros((1, 65)), np.zeros((1, 65))]
    cv2.setRNGSeed(0)
    cv2.grabCut(np.ascontiguousarray(box), cut, (0, 0, 0, 0), models[0], models[1], ROUNDS,
                cv2.GC_INIT_WITH_MASK)
    found = np.zeros(person.shape, np.uint8)
    found[rows, columns] = (cut == cv2.GC_FGD) | (cut == cv2.GC_PR_FGD)
    found[~person] = 0
    radius = max(1, round(THIN * width))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    found = np.asarray(cv2.morphologyEx(found, cv2.MORPH_OPEN, disc), np.uint8)
    labels = cv2.connectedComponents(found)[1]
    held = np.setdiff1d(np.unique(labels[beyond]), [0])
    return np.asarray(np.isin(labels, held))


def _below_hair(hair: Bool, middle: Float64) -> Bool:
    """What lies nearer to a head's middle than hair that was seen, bool [h, w], above the middle.

    There the network says where hair ends.
    """
    row, column = np.mgrid[:hair.shape[0], :hair.shape[1]] + 0.5
    x, y = column - middle[0], row - middle[1]
    sector = np.floor((np.arctan2(y, x) / (2 * np.pi) + 0.5) * SECTORS).astype(int) % SECTORS
    far, last = np.hypot(x, y), np.zeros(SECTORS)
    np.maximum.at(last, sector[hair], far[hair])
    return ~hair & (far < last[sector]) & (y < 0)
