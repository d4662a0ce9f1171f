"""Filters of pictures: blurs, block means, morphology; the appearance guide, and where it counts.

The appearance guide (Shen et al. 2023, Fig. 4) is grey minus its Gaussian blur; the target's values
are distributed as the exemplar's inside the head (histogram matching). Where a painting is drawn in
lines, the sitter's light does not choose among its paint.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...arrays import Array, Bool, Float32, Float64, Floats, UInt8, box_about
from ...color import to_lab
from ..kernels.guides import blur_difference, count_values, map_values, shrink
from ..kernels.labels import luma

FINE, AROUND = 0.03, 0.04
"""Sigma of the blur that takes a drawn line out, and how far around it counts, over the face's
size."""
DRAWN, USUAL, FAINT = 0.12, 3.0, 0.03
"""Contrast (root mean square, in [0, 1]) at which a line halves the weight of the appearance, and
the same over that of most of the face, where that is less (a cartoon's skin is flat), but no less
than the last."""


def gaussian_taps(sigma: float) -> Float32:
    """Gaussian of unit sum, cut at 3 sigma, float32 [2 R + 1]; ``sigma`` in pixels."""
    radius = max(1, int(np.ceil(3 * sigma)))
    taps = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    return np.asarray(taps / taps.sum(), np.float32)


def gaussian_blur(image: Float32, sigma: float) -> Float32:
    """Gaussian blur of [H, W] with mirrored borders; kernel cut at 3 sigma."""
    taps = gaussian_taps(sigma)
    return np.asarray(cv2.sepFilter2D(image, -1, taps, taps, borderType=cv2.BORDER_REFLECT),
                      np.float32)


def broad_blur(image: Float32, sigma: float) -> Float32:
    """`gaussian_blur` of [H, W] for wide kernels: on block means, and bilinear between.

    The blocks are at most half of ``sigma`` wide, so the result is within a hundredth of the
    largest step in the picture.
    """
    factor = int(sigma / 2)
    if factor < 2:
        return gaussian_blur(image, sigma)
    # Block means and the interpolation blur, too.
    rest = np.sqrt(max(sigma ** 2 - factor ** 2 / 4, 0.25)) / factor
    return enlarged(gaussian_blur(shrunk(image, factor), rest), factor, image.shape)


def blurred_within(picture: Float32, share: Array, sigma: float) -> Float32:
    """`broad_blur` of a picture [H, W, 3] by what is of a part alone.

    ``share`` [H, W] in [0, 1] (or bool) is how much each pixel is of it; far from it all is 0.
    """
    weight = np.ascontiguousarray(share, np.float32)
    total = np.maximum(broad_blur(weight, sigma), np.float32(1e-3))
    return np.stack([broad_blur(np.ascontiguousarray(picture[..., channel] * weight), sigma) / total
                     for channel in range(3)], axis=-1)


def shrunk(image: Float32, factor: int) -> Float32:
    """Means of blocks of ``factor`` x ``factor`` pixels, float32 [ceil(H / f), ceil(W / f)]."""
    if factor == 1:
        return image
    out = np.empty((-(-image.shape[0] // factor), -(-image.shape[1] // factor)), np.float32)
    shrink(np.ascontiguousarray(image, np.float32), factor, out)
    return out


def smaller(picture: Array, size: tuple[int, ...]) -> Float32:
    """A picture [H, W(, C)] at a smaller size (width, height), float32: means of areas."""
    return np.asarray(cv2.resize(np.asarray(picture, np.float32), size,
                                 interpolation=cv2.INTER_AREA), np.float32)


def enlarged(image: Float32, factor: int, shape: tuple[int, ...]) -> Float32:
    """Means of blocks [h, w] at all pixels of a picture of ``shape``, bilinear, float32 [H, W].

    A block is ``factor`` pixels wide and high.
    """
    image = np.ascontiguousarray(image, np.float32)
    if factor == 1:
        return image
    size = image.shape[1] * factor, image.shape[0] * factor
    whole = cv2.resize(image, size, interpolation=cv2.INTER_LINEAR)[:shape[0], :shape[1]]
    # Where the blocks end before the picture, their last value goes on.
    down, across = (shape[axis] - whole.shape[axis] for axis in (0, 1))
    return np.asarray(cv2.copyMakeBorder(whole, 0, down, 0, across, cv2.BORDER_REPLICATE),
                      np.float32)


def disk(radius: float) -> UInt8:
    """A filled disk for morphology, uint8 [n, n]; ``radius`` in pixels, at least 1."""
    side = 2 * max(1, round(radius)) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)


def dilated(part: Bool, radius: float) -> Bool:
    """A part of a picture, bool [h, w], with all that is as near as ``radius`` pixels."""
    return np.asarray(cv2.dilate(part.astype(np.uint8), disk(radius)) > 0)


def grey(image: Array) -> Float32:
    """Luma (Rec. 601) in [0, 1] of a picture, uint8 or float in [0, 1], [H, W, 3]."""
    out = np.empty(image.shape[:2], np.float32)
    luma(image, np.float32(1 / 255 if image.dtype == np.uint8 else 1), out)
    return out


def appearance_guide(image: Array, sigma: float, grain: float = 0.0) -> Float32:
    """Grey minus its Gaussian blur (Fig. 4), float32 [H, W] in [-1, 1].

    Slower changes of light than ``sigma`` pixels are taken out; the guide itself is blurred by
    ``grain`` pixels. The picture is uint8 or float in [0, 1].
    """
    luma = grey(image)
    out = np.empty_like(luma)
    if grain > 0.3:
        # Two Gaussians one after the other are one of the summed variances.
        both = gaussian_taps(float(np.hypot(sigma, grain)))
        blur_difference(luma, gaussian_taps(grain), both, out)
    else:
        blur_difference(luma, np.ones(1, np.float32), gaussian_taps(sigma), out)
    return out


@dataclass(frozen=True)
class Distribution:
    """Distribution of an appearance guide's values over [-1, 1]."""

    share: Float64  # float64 [bins + 1], share of the values below each of the bins' borders.

    @staticmethod
    def of(values: Float32, inside: Array | None = None, bins: int = 4096) -> Distribution:
        """Distribution of ``values`` [H, W] where ``inside`` [H, W] exceeds one half."""
        if inside is None:
            values = np.ascontiguousarray(values, np.float32).reshape(1, -1)
            inside = np.ones(values.shape, np.float32)
        counts = np.zeros((8, bins), np.int64)
        # What may not be written has a kernel of its own, which is not compiled ahead.
        inside = np.require(inside, np.float32, ["C", "W"])
        count_values(values, inside, np.float32(0.5), np.float32(1), counts)
        total = counts.sum(axis=0)
        if total.sum() == 0:
            return Distribution.of(values, None, bins)
        return Distribution(np.concatenate([[0], np.cumsum(total)]) / total.sum())


def match_histogram(values: Float32, reference: Float32 | Distribution, inside: Array) -> Float32:
    """Map values [H, W] in [-1, 1] so that those inside are distributed as a reference (Fig. 4 g).

    Values where ``inside`` exceeds one half count; all are mapped. ``reference`` is the wanted
    distribution, or values that have it.
    """
    if not isinstance(reference, Distribution):
        reference = Distribution.of(reference)
    wanted = reference.share
    own = Distribution.of(values, inside, len(wanted) - 1).share
    # A little slope everywhere makes both distributions invertible where they have gaps.
    ramp = np.linspace(0, 1e-6, len(wanted))
    table = np.interp(own + ramp, wanted + ramp, np.linspace(-1, 1, len(wanted)))
    out = values.copy()
    map_values(out, table.astype(np.float32), np.float32(1))
    return out


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
    # What blurs and neighbourhood reach around the face.
    part = box_about(face, int(np.ceil((4 * FINE + 2 * AROUND) * size)))
    if part is None:
        return lines
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


def skin_distance(colors: Floats, face: Bool, light: float = 0.4) -> Float32:
    """How far colors are from those of the face, in standard deviations, float32 [...].

    Colors [..., 3] are sRGB in [0, 1], ``face`` bool [...] is its skin; ``light`` is how much light
    and shade count against hue and chroma.
    """
    values = to_lab(colors).astype(np.float32)
    values *= np.array([light, 1.0, 1.0], np.float32)
    if face.sum() < 50:
        return np.zeros(colors.shape[:-1], np.float32)
    sample = values[face]
    spread = np.cov(sample.T) + np.diag([9.0, 9.0, 9.0])
    away = (values - np.median(sample, axis=0)).reshape(-1, 3)
    root = np.linalg.cholesky(np.linalg.inv(spread)).astype(np.float32)
    return np.asarray(np.sqrt(((away @ root) ** 2).sum(axis=1)), np.float32).reshape(
        colors.shape[:-1])
