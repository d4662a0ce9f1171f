"""Appearance guide (Shen et al. 2023, Fig. 4): grey minus its Gaussian blur.

The target's values are distributed as the exemplar's inside the head (histogram matching).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..kernels.guides import blur_difference, count_values, map_values
from ..kernels.labels import luma
from .blurs import gaussian_taps

__all__ = ["Distribution", "appearance_guide", "grey", "match_histogram", "skin_distance"]

Float32 = NDArray[np.float32]


def grey(image: NDArray[np.generic]) -> Float32:
    """Luma (Rec. 601) in [0, 1] of a picture, uint8 or float in [0, 1], [H, W, 3]."""
    out = np.empty(image.shape[:2], np.float32)
    luma(image, np.float32(1 / 255 if image.dtype == np.uint8 else 1), out)
    return out


def appearance_guide(image: NDArray[np.generic], sigma: float, grain: float = 0.0) -> Float32:
    """Grey minus its Gaussian blur (Fig. 4), float32 [H, W] in [-1, 1].

    Parameters
    ----------
    image
        uint8 or float in [0, 1], [H, W, 3].
    sigma
        Of the blur, in pixels: slower changes of light are taken out.
    grain
        Sigma in pixels of a blur of the guide itself; 0 keeps the finest detail.
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
    """Distribution of an appearance guide's values over [-1, 1].

    Attributes
    ----------
    share
        float64 [bins + 1], share of the values below each of the bins' borders.
    """

    share: NDArray[np.float64]

    @staticmethod
    def of(values: Float32, inside: NDArray[np.generic] | None = None,
           bins: int = 4096) -> Distribution:
        """Distribution of ``values`` [H, W] where ``inside`` [H, W] exceeds one half."""
        if inside is None:
            values = np.ascontiguousarray(values, np.float32).reshape(1, -1)
            inside = np.ones(values.shape, np.float32)
        counts = np.zeros((8, bins), np.int64)
        count_values(values, np.asarray(inside, np.float32), np.float32(0.5), np.float32(1), counts)
        total = counts.sum(axis=0)
        if total.sum() == 0:
            return Distribution.of(values, None, bins)
        return Distribution(np.concatenate([[0], np.cumsum(total)]) / total.sum())


def match_histogram(values: Float32, reference: Float32 | Distribution,
                    inside: NDArray[np.generic]) -> Float32:
    """Map ``values`` so that those ``inside`` are distributed as ``reference`` (Fig. 4 g).

    Parameters
    ----------
    values
        float32 [H, W] in [-1, 1].
    reference
        The wanted distribution, or values in [-1, 1] that have it.
    inside
        [H, W]: values where it exceeds one half count; all values are mapped.
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


def skin_distance(colors: NDArray[np.floating], face: NDArray[np.bool_],
                  light: float = 0.4) -> Float32:
    """How far colors are from those of the face, in standard deviations, float32 [...].

    Parameters
    ----------
    colors
        float [..., 3], sRGB in [0, 1].
    face
        bool [...], skin of the face.
    light
        How much light and shade count against hue and chroma.
    """
    from skimage.color import rgb2lab

    values = rgb2lab(np.clip(colors, 0, 1)).astype(np.float32)
    values *= np.array([light, 1.0, 1.0], np.float32)
    if face.sum() < 50:
        return np.zeros(colors.shape[:-1], np.float32)
    sample = values[face]
    spread = np.cov(sample.T) + np.diag([9.0, 9.0, 9.0])
    away = (values - np.median(sample, axis=0)).reshape(-1, 3)
    root = np.linalg.cholesky(np.linalg.inv(spread)).astype(np.float32)
    return np.asarray(np.sqrt(((away @ root) ** 2).sum(axis=1)), np.float32).reshape(
        colors.shape[:-1])
