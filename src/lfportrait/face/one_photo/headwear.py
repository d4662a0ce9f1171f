"""What covers a head and is not seen as hair: hats, scarves, and hair that the network misses.

The fitted skull says where a head ends. What a matte shows beyond it, over the crown, is worn there
or grows there: GrabCut (Rother et al. 2004) says by its colors how far it goes on over forehead,
ears and neck. It is made and painted as hair is.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import ConvexHull

from ...arrays import Bool, Float32, Float64, UInt8
from ..head_fit import HeadFit, ear_to_ear

FINE, AROUND = 120.0, 2.75
"""Pixels of a face's width where its extent is found, at most; how far around the face it is looked
for, widths of a face."""
LEVEL = 0.095  # Height of the ears' middles (metres, `HeadPrior.rest`).
BESIDE = 0.04  # What lies no further outside of the skull may be the skull's, widths of a face.
THIN = 0.02  # What is twice so thin is a shred of the matte, widths of a face.
CROWN = 60.0  # Degrees to both sides of straight up that are above a head.
LEAST, ABOVE = 0.045, 0.25
"""Squares of a face's width that it covers there, at least, and which part of it lies there."""
OF_GROUND, ACROSS = 10.0, 0.03
"""Difference in CIELAB between both sides of its outline, so far from it (widths of a face), up to
which it is ground that a matte kept."""
UNLIKE = 10.0  # Difference in CIELAB from the face up to which it is a tall skull's skin.
COVERED, LIGHTNESS, BRIGHT = 18.0, 0.5, 0.3
"""Difference in CIELAB from the face from which on it is no skin in any shade; lightness counts by
the second, by the third where it is more: foreheads shine."""
BROW, HIGH, MOST = 0.3, 0.33, 0.5
"""So far above the brows a crown begins (heights of a face); its highest part; and so much of both
is covered by what goes no further than the fitted skull."""
SECTORS = 120  # Of the circle around a head's middle.
SURE = 0.85  # Hair that the network is so sure of says that what lies below it is none.
INNER = 0.85  # The part of a face's width that no cloth beside it covers.
CLOSE = 0.1  # What is left beside it, beyond the skull, is no farther from it, widths of a face.
ROUNDS, KINDS = 4, 5  # Of GrabCut; and of colors that a part has.
DOWN, CLOTHES = 0.25, 0.6
"""How far below the chin it may go on, and how far down clothes are looked at, widths of a face."""


def skull_in(fit: HeadFit, view: int) -> tuple[Float64, Float64]:
    """Pixels around a head above its ears' middles, [N, 2], and the middle between these, [2]."""
    height = fit.prior.rest[:, 1]
    places = fit.views[view].project(fit.vertices(view))
    high = places[height > LEVEL]
    return high[ConvexHull(high).vertices], places[np.abs(height - LEVEL) < 0.004].mean(axis=0)


def headwear(image: UInt8, matte: NDArray[np.floating], hair: NDArray[np.floating],
             landmarks: Float64, skull: tuple[Float64, Float64], cut_out: bool = False,
             ) -> Bool | None:
    """Where a photo shows what covers a head besides hair that was seen, bool [H, W], or None.

    Parameters
    ----------
    image : uint8 [H, W, 3], sRGB.
    matte, hair : [H, W] in [0, 1].
    landmarks : [68, 2] in pixels.
    skull : Of `skull_in`.
    cut_out : Whether the photo came with its matte, which then has no ground.
    """
    width = ear_to_ear(landmarks)
    low, high = (np.clip(landmarks[27] + side * AROUND * width, 0, image.shape[1::-1]).astype(int)
                 for side in (-1, 1))
    if not (high > low).all():
        return None
    part = np.s_[low[1]:high[1], low[0]:high[0]]
    factor = min(1.0, FINE / width)
    size = [max(2, round(factor * side)) for side in high - low]
    small = np.asarray(cv2.resize(image[part], size, interpolation=cv2.INTER_AREA), np.uint8)
    soft, curls = (np.asarray(cv2.resize(np.asarray(one[part], np.float32), size,
                                         interpolation=cv2.INTER_AREA), np.float32)
                   for one in (matte, hair))
    face, hull, middle = ((one - low) * factor for one in (landmarks, *skull))
    ground = np.zeros(soft.shape, bool) if cut_out else soft < 0.05
    if not _inner(face, soft.shape).any():
        return None
    person, locks = soft > 0.5, curls > 0.5
    known = (_beyond(small, person, ground, locks, face, hull, middle)
             | _crown(small, person & _hull(hull, person.shape), locks, face, middle))
    if not known.any():
        return None
    found = _spread(small, person, known, curls, face, hull, middle)
    whole = np.zeros(image.shape[:2], bool)
    whole[part] = cv2.resize(found.astype(np.float32), high - low,
                             interpolation=cv2.INTER_LINEAR) > 0.5
    return np.asarray(whole & (np.asarray(matte) > 0.5))


def _beyond(image: UInt8, person: Bool, ground: Bool, hair: Bool, face: Float64, skull: Float64,
            middle: Float64) -> Bool:
    """What lies over a crown and is neither skull, nor hair, nor ground, bool [h, w]."""
    width = ear_to_ear(face)
    away = cv2.distanceTransform((~_hull(skull, person.shape)).astype(np.uint8), cv2.DIST_L2, 5)
    down, beside = _along(face, middle, person.shape)
    loose = _opened(person & ~hair & (away > BESIDE * width) & (down < 0), width)
    above = np.degrees(np.arctan2(np.abs(beside), -down)) < CROWN
    lab = np.asarray(cv2.cvtColor(image.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB),
                     np.float32)
    skin = np.median(lab[_hull(face, person.shape)], axis=0)
    count, labels = cv2.connectedComponents(loose.astype(np.uint8))
    out = np.zeros(person.shape, bool)
    for one in range(1, count):
        part = labels == one
        over = (part & above).sum()
        if over >= max(LEAST * width ** 2, ABOVE * part.sum()) and (
                np.linalg.norm(np.median(lab[part], axis=0) - skin) > UNLIKE
                and not _is_ground(part, ground, lab, width)):
            out |= part
    return out


def _crown(image: UInt8, skull: Bool, hair: Bool, face: Float64, middle: Float64) -> Bool:
    """What of a skull is covered over most of the crown, bool [h, w].

    A head that is fitted to the outline of a cap has a skull as high as that.
    """
    width, tall = ear_to_ear(face), float(np.linalg.norm(face[8] - face[27]))
    down, beside = _along(face, middle, skull.shape)
    brows = _along(face, face[17:27].mean(axis=0), skull.shape)[0]
    crown = skull & (brows < -BROW * tall) & (np.degrees(np.arctan2(np.abs(beside), -down)) < CROWN)
    out = _opened(crown & ~hair & _unlike(image, face), width)
    # A forehead may be as bright, but not all that is above it.
    high = crown & (down <= np.quantile(down[crown], HIGH)) if crown.any() else crown
    covered = all(out[part].sum() >= MOST * part.sum() for part in (crown, high))
    return out & bool(covered and out.sum() >= LEAST * width ** 2)


def _unlike(image: UInt8, face: Float64) -> Bool:
    """What is unlike a face's skin, bool [h, w]."""
    lab = np.asarray(cv2.cvtColor(image.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB))
    skin = np.median(lab[_hull(face, image.shape)], axis=0)
    away = lab - skin
    away[..., 0] *= np.where(away[..., 0] > 0, BRIGHT, LIGHTNESS)
    return np.asarray(np.linalg.norm(away, axis=2) > COVERED)


def _along(face: Float64, origin: Float64, shape: tuple[int, ...]) -> tuple[Float64, Float64]:
    """How far down a face's own axis, and beside it, pixels [h, w] lie from a place (x, y)."""
    axis = (face[8] - face[27]) / max(float(np.linalg.norm(face[8] - face[27])), 1e-9)
    row, column = np.mgrid[:shape[0], :shape[1]] + 0.5
    x, y = column - origin[0], row - origin[1]
    return x * axis[0] + y * axis[1], x * axis[1] - y * axis[0]


def _hull(points: Float64, shape: tuple[int, ...]) -> Bool:
    """The convex hull of points [N, 2] in a picture."""
    out = np.zeros(shape[:2], np.uint8)
    cv2.fillConvexPoly(out, cv2.convexHull(np.rint(points).astype(np.int32)), 1)
    return np.asarray(out > 0)


def _opened(mask: Bool, width: float) -> Bool:
    """A mask without its shreds."""
    side = 2 * max(1, round(THIN * width)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, disc) > 0)


def _is_ground(part: Bool, ground: Bool, lab: Float32, width: float) -> bool:
    """Whether the photo has no edge where a part of a matte meets the ground."""
    reach, sides = ACROSS * width, []
    for own, other in ((part, ground), (ground, part)):
        away = cv2.distanceTransform((~other).astype(np.uint8), cv2.DIST_L2, 5)
        known = (own & (away < 2 * reach) & (away > reach)).astype(np.float32)
        sides.append(cv2.GaussianBlur(np.dstack([lab * known[..., None], known]), (0, 0), reach))
    both = part & (sides[0][..., 3] > 0.02) & (sides[1][..., 3] > 0.02)
    if not both.any():
        return False
    one, two = (side[both][:, :3] / side[both][:, 3:] for side in sides)
    return float(np.median(np.linalg.norm(one - two, axis=1))) < OF_GROUND


def _spread(image: UInt8, person: Bool, known: Bool, hair: Float32, face: Float64,
            skull: Float64, middle: Float64) -> Bool:
    """All of what covers a head, by the colors of the part that is ``known``."""
    width, skin = ear_to_ear(face), _inner(face, person.shape)
    down, beside = _along(face, middle, person.shape)
    below, pieces = _along(face, face[8], person.shape)[0], ndimage.label(hair > 0.5)[0]
    curls = (hair > 0.5) & np.isin(pieces, pieces[down < 0])  # else a beard
    mask = np.where(person, cv2.GC_PR_BGD, cv2.GC_BGD).astype(np.uint8)
    mask[person & (below < 0) & _nearer(image, known, skin, width)] = cv2.GC_PR_FGD
    mask[skin | (below > DOWN * width)] = cv2.GC_BGD
    mask[_below_hair(_opened(hair > SURE, width), down, beside) & ~known] = cv2.GC_BGD
    mask[known | (curls & (mask != cv2.GC_BGD))] = cv2.GC_FGD
    # The ground says nothing: it gets the colors of the face; clothes further down neither.
    shown = image[..., ::-1].copy()
    shown[~person] = np.median(shown[skin], axis=0)
    rows, columns = (slice(int(one.min()), int(one.max()) + 1) for one in np.nonzero(
        skin | (person & (below < CLOTHES * width))))
    cut = np.ascontiguousarray(mask[rows, columns])
    cv2.setRNGSeed(0)
    cv2.grabCut(np.ascontiguousarray(shown[rows, columns]), cut, (0, 0, 0, 0), np.zeros((1, 65)),
                np.zeros((1, 65)), ROUNDS, cv2.GC_INIT_WITH_MASK)
    found = np.zeros(person.shape, bool)
    found[rows, columns] = (cut == cv2.GC_FGD) | (cut == cv2.GC_PR_FGD)
    # Beyond the skull nothing is left beside it: it would be no part of the head. Nor are gaps.
    away = cv2.distanceTransform((~found).astype(np.uint8), cv2.DIST_L2, 5)
    found |= person & ~_hull(skull, person.shape) & (down < 0) & (away < CLOSE * width)
    found |= _gaps(found | curls, _unlike(image, face) | (away < CLOSE * width)) & ~skin
    pieces = cv2.connectedComponents(_opened(found & person, width).astype(np.uint8))[1]
    return np.asarray((pieces > 0) & np.isin(pieces, pieces[known]))


def _inner(face: Float64, shape: tuple[int, ...]) -> Bool:
    """A face without its sides, which cloth may cover, bool [h, w]."""
    axis = (face[8] - face[27]) / max(float(np.linalg.norm(face[8] - face[27])), 1e-9)
    across = np.array([axis[1], -axis[0]])
    beside = (face - face[27:36].mean(axis=0)) @ across
    return _hull(face - (1 - INNER) * beside[:, None] * across, shape)


def _nearer(image: UInt8, one: Bool, two: Bool, width: float) -> Bool:
    """What is more like the colors of one part than like those of another, bool [h, w]."""
    lab = np.asarray(cv2.cvtColor(image.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB),
                     np.float32) * np.array([LIGHTNESS, 1, 1], np.float32)
    cv2.setRNGSeed(0)
    away = []
    for part in (one, two):
        count = min(KINDS, int(part.sum()))
        labels = np.zeros((len(lab[part]), 1), np.int32)
        centers = cv2.kmeans(lab[part], count, labels, (cv2.TERM_CRITERIA_MAX_ITER, 10, 0.0), 1,
                             cv2.KMEANS_PP_CENTERS)[2]
        near = np.linalg.norm(lab[..., None, :] - centers, axis=3).min(axis=2)
        away.append(cv2.GaussianBlur(near, (0, 0), THIN * width))
    return np.asarray(away[0] < away[1])


def _gaps(mask: Bool, filling: Bool) -> Bool:
    """Holes in a mask that are of a ``filling`` for the most part, bool [h, w]."""
    labels, count = ndimage.label(ndimage.binary_fill_holes(mask) & ~mask)
    out = np.zeros(mask.shape, bool)
    for one in range(1, count + 1):
        hole = labels == one
        if filling[hole].mean() > 0.5:
            out |= hole
    return out


def _below_hair(hair: Bool, down: Float64, beside: Float64) -> Bool:
    """What lies nearer to the head's middle than hair that was seen, above it, bool [h, w]."""
    sector = np.floor((np.arctan2(down, beside) / (2 * np.pi) + 0.5) * SECTORS).astype(int)
    sector %= SECTORS
    far, last = np.hypot(down, beside), np.zeros(SECTORS)
    np.maximum.at(last, sector[hair], far[hair])
    return np.asarray(~hair & (far < last[sector]) & (down < 0))
