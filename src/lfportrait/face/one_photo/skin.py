"""Where a photo shows the sides of a face, and where something before or beside them.

No fitted cheek ends exactly where the photo's does: beyond it the photo shows a collar, hair or the
ground, and before it earrings. On the head that would be stains, once more on the mirrored side.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...arrays import Bool, Float32, Float64, box_about
from ...capture import Camera
from ..head_fit import ear_to_ear
from ..landmarks import mouth_opening
from .samples import MeshSamples
from .solid import STANDS, standing_out

CELL = 0.012  # Width of a cell at the head, portrait units (2.5 mm).
SQUARE = 0.6  # Cosine of incidence from which on what lies before the ears is face for sure.
FRONT = 0.030
"""Depth (metres, `HeadPrior.rest`): what lies farther in front is face for sure, if the photo
looks at it squarely."""
SIDE, EYES = 0.068, 0.088
"""Depth and height (metres, `HeadPrior.rest`): what lies farther behind and lower may be hidden by
something. Beside the eyes there are spectacles, and hair that is thin."""
UNDER = 0.042  # How far from the middle (metres, `HeadPrior.rest`) no shadow of the chin lies.
LOWEST, CHIN, HIGHEST = -0.03, -0.004, 0.150
"""Heights (metres, `HeadPrior.rest`) between which the sides of a face and of the neck are, and
where the neck begins. In front that may be clothed."""
AROUND = 0.045  # How far around skin is compared, portrait units.
UNLIKE = 10.0
"""Difference in CIELAB, its lightness by `LIGHTNESS`, from which on it is not the same skin."""
LIGHTNESS = 0.6
WIDE, FAR, FAINT = 0.15, 14.0, 0.5
"""How far the face around is looked at, portrait units; difference from it from which on no shade
makes it unlike it, its lightness by so much less."""
BEARD, SHARE = 0.045, 0.2
"""Height (metres, `HeadPrior.rest`) below which a face may have a beard, which goes on along the
jaw; of how much of it there one counts."""
FACE = 120.0  # Pixels that a face is wide, at most, where clothes are looked for.
PARTED = 0.05
"""Height of the gap between lips over the mouth's width from which on they are open."""
BORDER = 0.024  # How wide the two mix in a photo, portrait units.


def not_skin(colors: Float32, hair: NDArray[np.floating] | None, landmarks: Float64,
             camera: Camera, samples: MeshSamples, worn: Float32 | None = None) -> Float32:
    """How much the photo shows something else where the sides of a face lie, float32 [H, W].

    Skin is followed from the face outwards, as far as it is like what lies around it.

    Parameters
    ----------
    colors : float32 [H, W, 3] in [0, 1], the person's alone (`clean_colors`).
    hair : [H, W] in [0, 1], or None.
    landmarks : float64 [68, 2] in pixels.
    samples : Of the head, in the camera's world.
    worn : float32 [H, W], how much of it is clothes (`clothes_of`), if that is known: below the
        chin, what is not clothes is skin, in any light.
    """
    unit = float(camera.focal[0, 0]) / float(np.linalg.norm(camera.position[0]))
    small = camera.scaled(min(1.0, 1.0 / (CELL * unit)))
    width, height = int(small.width[0]), int(small.height[0])
    cell = float(np.linalg.norm(small.position[0]) / small.focal[0, 0])
    rest, cosine = nearest_samples(small, samples)
    # The head and what lies around it is all that is looked at.
    part = box_about(np.isfinite(cosine), round(3 * WIDE / cell))
    if part is None:
        return np.zeros(colors.shape[:2], np.float32)
    reduced = cv2.resize(colors, (width, height), interpolation=cv2.INTER_AREA)
    lab = np.asarray(cv2.cvtColor(reduced, cv2.COLOR_RGB2LAB), np.float32)
    lab[..., 0] *= LIGHTNESS
    curls = np.zeros((height, width), bool) if hair is None else cv2.resize(
        np.asarray(hair, np.float32), (width, height), interpolation=cv2.INTER_AREA) > 0.25
    ears = (standing_out(rest.reshape(-1, 3)) > STANDS).reshape(height, width)
    there = np.isfinite(cosine) & ~curls & ~ears
    there &= (rest[..., 1] > LOWEST) & (rest[..., 1] < HIGHEST)
    there &= ~features_of(landmarks * np.array([width, height]) / np.array(colors.shape[1::-1]),
                        (height, width))
    side = (rest[..., 2] < SIDE) & (rest[..., 1] < EYES) & (np.abs(rest[..., 0]) > UNDER)
    there &= (rest[..., 1] > CHIN) | (cosine < SQUARE)
    sure = there & (cosine > SQUARE) & (rest[..., 2] > FRONT)
    if worn is not None:
        bare = cv2.resize(worn, (width, height), interpolation=cv2.INTER_AREA) < 0.5
        side &= ~bare | (rest[..., 1] > CHIN)
    lab, rest = lab[part], rest[part]
    there, side, sure = there[part], side[part], sure[part]
    far = _unlike(lab, _mean(lab, sure, WIDE / cell))
    lower, upper = sure & (rest[..., 1] < BEARD), sure & (rest[..., 1] > 1.5 * BEARD)
    if not (lower.any() and upper.any()):
        return np.zeros(colors.shape[:2], np.float32)
    beard = lower & (_unlike(lab, np.median(lab[upper], axis=0)) > FAR)
    if beard.sum() > SHARE * lower.sum():
        as_beard = _unlike(lab, lab[beard].mean(axis=0)) < FAR
        sure |= there & as_beard & (rest[..., 1] < 2 * BEARD)
    skin = _followed(lab, sure, there & ~sure & (far < FAR), AROUND / cell)
    other = np.zeros((height, width), np.uint8)
    # By SciPy: OpenCV's opening moves what it leaves by a cell.
    other[part] = ndimage.binary_opening(there & ~skin & side, np.ones((2, 2)))
    reach = max(1, round(BORDER / cell))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    wide = cv2.dilate(other, disc)
    soft = cv2.GaussianBlur(wide.astype(np.float32), (0, 0), 0.7)
    return np.asarray(np.clip(cv2.resize(soft, colors.shape[1::-1]), 0, 1), np.float32)


def clothes(image: NDArray[np.uint8], hair: NDArray[np.floating], landmarks: Float64) -> Bool:
    """What lies below the ears and is like neither cheeks nor chin, bool [H, W].

    The head's outline is not drawn to that of a collar or a shoulder.

    Parameters
    ----------
    image : uint8 [H, W, 3].
    hair : [H, W] in [0, 1].
    landmarks : float64 [68, 2] in pixels.
    """
    height, width = hair.shape
    factor = min(1.0, FACE / ear_to_ear(landmarks))
    size = (max(1, round(factor * width)), max(1, round(factor * height)))
    reduced = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    lab = np.asarray(cv2.cvtColor(reduced.astype(np.float32) / np.float32(255),
                                  cv2.COLOR_RGB2LAB), np.float32)
    lab[..., 0] *= LIGHTNESS
    places = landmarks * factor
    like, known = np.zeros(size[::-1], bool), False
    for corners in ((31, 2, 41), (35, 14, 46), (48, 4, 6, 57), (54, 12, 10, 57)):
        part = np.zeros(size[::-1], np.uint8)
        cv2.fillConvexPoly(part, np.rint(places[list(corners)]).astype(np.int32), 1)
        if part.any():
            like |= _unlike(lab, np.median(lab[part > 0], axis=0)) < FAR
            known = True
    down = places[8] - places[27]
    along = down[0] * np.arange(size[0]) + down[1] * np.arange(size[1])[:, None]
    out = ~like & known & (along > 0.5 * ((places[2] + places[14]) @ down))
    whole = cv2.resize(out.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    return np.asarray((whole > 0) & (hair < 0.5))


def _unlike(lab: Float32, other: Float32) -> Float32:
    """How unlike colors [h, w, 3] are, whatever shade they lie in, [h, w]."""
    return np.asarray(np.linalg.norm((lab - other) * np.array([FAINT, 1, 1], np.float32), axis=2),
                      np.float32)


def nearest_samples(camera: Camera, samples: MeshSamples) -> tuple[Float64, Float64]:
    """Where the head's nearest samples lie on the mean head [h, w, 3], and cosines of incidence.

    NaN beside the head.
    """
    pixels, depth = camera.project(samples.points)
    column, row = np.floor(pixels[0]).astype(np.int64).T
    width, height = int(camera.width[0]), int(camera.height[0])
    within = np.flatnonzero((column >= 0) & (column < width) & (row >= 0) & (row < height))
    order = within[np.argsort(-depth[0][within])]  # the nearest one is written last
    which = np.full((height, width), -1)
    which[row[order], column[order]] = order
    known = which >= 0
    closed = ndimage.binary_closing(known, np.ones((3, 3)))
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    which = np.where(closed, which[tuple(nearest)], -1)
    to_eye = camera.position[0] - samples.points
    to_eye /= np.linalg.norm(to_eye, axis=1)[:, None]
    cosine = (to_eye * samples.normals).sum(axis=1)
    seen = which >= 0
    return (np.where(seen[..., None], samples.rest[which], np.nan),
            np.where(seen, cosine[which], np.nan))


def open_mouth(landmarks: Float64, shape: tuple[int, ...]) -> Float32 | None:
    """Where lips and what lies between them are, float32 [H, W]; None where they are closed.

    ``landmarks`` are [68, 2] in pixels of a picture [H, W].
    """
    if mouth_opening(landmarks) < PARTED:
        return None
    out = np.zeros(shape[:2], np.float32)
    cv2.fillPoly(out, [np.rint(landmarks[48:60] - 0.5).astype(np.int32)], 1.0)
    width = float(np.linalg.norm(landmarks[54] - landmarks[48]))
    return np.asarray(cv2.GaussianBlur(out, (0, 0), max(0.02 * width, 0.5)), np.float32)


def features_of(landmarks: Float64, shape: tuple[int, int]) -> Bool:
    """Brows, eyes and mouth, bool [h, w]; they are not like the skin around them."""
    out = np.zeros(shape, np.uint8)
    for part, more in (((17, 22), 1.3), ((22, 27), 1.3), ((36, 42), 1.6), ((42, 48), 1.6),
                       ((48, 60), 1.2)):
        corners = landmarks[slice(*part)]
        middle = corners.mean(axis=0)
        hull = cv2.convexHull(np.rint(middle + more * (corners - middle)).astype(np.int32))
        cv2.fillConvexPoly(out, hull, 1)
    return out > 0


def _followed(lab: Float32, sure: Bool, asked: Bool, sigma: float) -> Bool:
    """What of the asked places [h, w] continues those that are sure, place by place outwards."""
    known = sure.copy()
    left = asked.copy()
    for _ in range(sum(lab.shape[:2])):
        ring = left & ndimage.binary_dilation(known, np.ones((3, 3)))
        if not ring.any():
            break
        like = np.linalg.norm(lab - _mean(lab, known, sigma), axis=2) < UNLIKE
        fresh = ring & like
        if not fresh.any():
            break
        known |= fresh
        left &= ~fresh
    return known


def _mean(values: Float32, known: Bool, sigma: float) -> Float32:
    """Means [h, w, 3] of the known values around places, which is half as far as ``sigma``."""
    sums = cv2.GaussianBlur(np.dstack([values * known[..., None], known.astype(np.float32)]),
                            (0, 0), 0.5 * sigma)
    return np.asarray(sums[..., :3] / np.maximum(sums[..., 3:], 1e-9), np.float32)
