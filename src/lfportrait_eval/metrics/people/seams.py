"""Straight steps of light in a painted face: where two pieces of paint meet and do not belong.

The face is looked at upright. Along every nearly vertical line the light on its right is compared
with that on its left, row by row. Strokes and wrinkles step to and fro, shading is as steep beside
the line, and an edge of the sitter's own is in the real view too; a seam is none of these.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.color import rgb2lab
from skimage.draw import polygon2mask

from lfportrait.example import Exemplar, FaceFrame
from lfportrait.face import face_mask

from .forehead import BARE_TOP

__all__ = ["face_seams", "seam_found", "seams", "upright"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Mask = NDArray[np.bool_]

PIXELS = 120
"""Of the upright picture, per face height (brows to chin)."""
BOX = (-0.5, 0.5), (-0.6, 0.75)
"""What is looked at of the face: right and down of the brows' middle, in its height."""
BAND, GAP = 0.05, 0.02
"""Width of what is compared on both sides of a line, and how far from it it begins."""
LIGHT = 0.5
"""So much light and shade count against hue and chroma, as in `forehead`."""
LOWEST = 0.62
"""Down to here (chin 1): further down beards have edges."""
ACROSS = 0.27, 0.36
"""How far from the middle forehead and cheeks are looked at, over the face's width: its sides turn
away, and hair begins at the temples."""
BESIDE = 0.12
"""Shading is as steep so far beside a line."""
NEAR = 0.06
"""Within so much an edge of the sitter is the same."""
LEAN = 0.2
"""Lines lean by this at most, right over down."""
LENGTH, LEAST = 0.5, 0.22
"""Length of the lines, and of that what must be seen: eyes, nose and mouth are left out."""
_FEATURES = (slice(17, 22), slice(22, 27), slice(36, 42), slice(42, 48), slice(27, 36),
             slice(48, 60))


def upright(plane: NDArray[np.floating], frame: FaceFrame, order: int = 1) -> Float64:
    """A plane [H, W] sampled in a face's upright frame over `BOX`, float64 [h, w]."""
    (left, right), (top, bottom) = BOX
    x = np.arange(left, right, 1 / PIXELS) + 0.5 / PIXELS
    y = np.arange(top, bottom, 1 / PIXELS) + 0.5 / PIXELS
    places = frame.point(*np.meshgrid(x, y))
    return np.asarray(ndimage.map_coordinates(
        plane, [places[..., 1] - 0.5, places[..., 0] - 0.5], order=order, mode="nearest"))


def _bare(image: NDArray[np.uint8], landmarks: Float64, frame: FaceFrame) -> Mask:
    """Plain skin of a face in its upright frame: no features, hair or outline; bool [h, w]."""
    shape = image.shape[:2]
    right, down = frame.local(shape)
    regions = Exemplar(image, landmarks).regions()
    mask = (face_mask(image, landmarks) > 0.9) & (down < LOWEST)
    if regions.hair is not None:
        mask &= regions.hair < 0.2
    else:  # a bald sitter may be given the painter's hair
        mask &= down > BARE_TOP
    mask &= np.abs(right) < np.where(down < 0, *ACROSS) * frame.width / frame.height
    for part in _FEATURES:
        hull = landmarks[part]
        if part.start in (17, 22):  # a brow is a line
            hull = np.concatenate([hull - 0.05 * frame.height * frame.down,
                                   hull[::-1] + 0.07 * frame.height * frame.down])
        elif part.start == 27:
            side = 0.04 * frame.height * frame.right  # the nose's shade falls beside it
            hull = np.concatenate([landmarks[[27, 31]] - side, landmarks[[48, 57, 54]],
                                   landmarks[[35, 27]] + side])
        grown = hull.mean(axis=0) + 1.25 * (hull - hull.mean(axis=0))
        mask &= ~polygon2mask(shape, grown[:, ::-1] - 0.5)
    small = upright(mask.astype(np.float32), frame) > 0.5
    return np.asarray(ndimage.binary_erosion(small, iterations=2))


def _colors(image: NDArray[np.uint8], frame: FaceFrame) -> Float64:
    """Lab colors in the upright frame, light weighed by `LIGHT`, float64 [3, h, w]."""
    sigma = 0.4 / PIXELS * frame.height
    planes = [upright(ndimage.gaussian_filter(image[..., c] / np.float32(255), sigma), frame)
              for c in range(3)]
    lab = rgb2lab(np.clip(np.stack(planes, axis=-1), 0, 1)) * (LIGHT, 1, 1)
    return np.asarray(np.moveaxis(lab, -1, 0), np.float64)


def _mean(values: Float64, weights: Float64, size: int, shift: int) -> tuple[Float64, Float64]:
    """Means of ``size`` columns whose middle lies ``shift`` to the right, and their weights."""
    total = ndimage.uniform_filter1d(values * weights, size, axis=1, mode="constant")
    weight = ndimage.uniform_filter1d(weights, size, axis=1, mode="constant")
    mean = np.roll(total / np.maximum(weight, 1e-6), -shift, axis=1)
    return mean, np.roll(weight, -shift, axis=1)


def _steps(colors: Float64, bare: Mask) -> tuple[Float64, Mask]:
    """Step to the right at every pixel, [C, h, w], and where both sides are bare."""
    size = max(round(BAND * PIXELS), 1)
    shift = round((GAP + BAND / 2) * PIXELS)
    weights = bare.astype(np.float64)
    pairs = [(_mean(plane, weights, size, shift), _mean(plane, weights, size, -shift))
             for plane in colors]
    (_, sure), (_, other) = pairs[0]
    known = (sure > 0.6) & (other > 0.6)
    known[:, :size + shift] = known[:, -size - shift:] = False
    return np.stack([right - left for (right, _), (left, _) in pairs]) * known, known


def seams(colors: Float64, bare: Mask) -> Float64:
    """How strong a seam is on every line, [leans, h, w] by its lean and middle.

    Parameters
    ----------
    colors
        [C, h, w] in the upright frame.
    bare
        bool [h, w], where plain skin is.

    Returns
    -------
    step of the colors along the line, less what is as steep beside it, times how steady it is.
    """
    steps, known = _steps(colors, bare)
    aside, size = round(BESIDE * PIXELS), round(LENGTH * PIXELS)
    rows, columns = np.indices(bare.shape)
    size_of = np.linalg.norm(steps, axis=0)

    def along(plane: Float64) -> Float64:
        moved = ndimage.map_coordinates(plane, at, order=1)
        return np.asarray(ndimage.uniform_filter1d(moved, size, axis=0, mode="constant"))

    found = []
    for lean in np.linspace(-LEAN, LEAN, 5):
        at = [rows, columns + lean * (rows - rows.mean())]
        seen = along(known.astype(np.float64))
        mean = np.stack([along(plane) for plane in steps]) / np.maximum(seen, 1e-6)
        step = np.linalg.norm(mean, axis=0)
        steady = step * seen / np.maximum(along(size_of), 1e-6)
        way = mean / np.maximum(step, 1e-6)
        shading = sum(np.maximum((way * np.roll(mean, by, axis=2)).sum(axis=0), 0)
                      for by in (-aside, aside))
        value = np.maximum(step - 0.5 * shading, 0) * np.minimum(steady, 1) ** 2
        found.append(np.where(seen * LENGTH >= LEAST * 0.999, value, 0.0))
    return np.stack(found)


def face_seams(image: NDArray[np.uint8], landmarks: NDArray[np.floating],
               bare: Mask | None = None) -> Float64:
    """Strength of the seams of one face by their middle, [h, w] in its upright frame.

    Parameters
    ----------
    image, landmarks
        uint8 [H, W, 3] and [68, 2].
    bare
        bool [h, w], where plain skin is; by default what the picture itself shows.
    """
    points = np.asarray(landmarks, np.float64)
    frame = FaceFrame.of(points)
    if bare is None:
        bare = _bare(image, points, frame)
    return np.asarray(seams(_colors(image, frame), bare).max(axis=0))


def seam_found(painted: NDArray[np.uint8], real: NDArray[np.uint8],
               landmarks: NDArray[np.floating]) -> dict[str, float]:
    """The strongest seam of a painted face that the sitter has not.

    Parameters
    ----------
    painted, real
        uint8 [H, W, 3], the same view.
    landmarks
        [68, 2] pixels of the real view.

    Returns
    -------
    figures
        ``seam`` (delta E, light weighed by `LIGHT`), and its middle ``seam_right``, ``seam_down``
        of the brows' in face heights.
    """
    points = np.asarray(landmarks, np.float64)
    bare = _bare(real, points, FaceFrame.of(points))
    # An edge of the sitter may lie a little aside in paint.
    own = ndimage.maximum_filter(face_seams(real, points, bare), round(NEAR * PIXELS))
    value = face_seams(painted, points, bare) - own
    y, x = np.unravel_index(int(value.argmax()), value.shape)
    return {"seam": max(float(value[y, x]), 0.0), "seam_right": BOX[0][0] + float(x) / PIXELS,
            "seam_down": BOX[1][0] + float(y) / PIXELS}
