"""Colors of a set of pictures matched to a painting's: mean and full covariance (ARF).

The original counts all pixels, background included, and adds the map's offset to raw coefficients
of the field. Here only the person counts, on both sides, and the map is that of the colors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lfportrait.example import Exemplar

from .photo_views import PhotoView

__all__ = ["ColorMap", "painted_pixels", "person_pixels"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

LEAST = 1e-8
"""Eigenvalues of a covariance are not taken as smaller than this."""


@dataclass(frozen=True)
class ColorMap:
    """An affine map of colors.

    Attributes
    ----------
    matrix
        float64 [3, 3].
    offset
        float64 [3].
    """

    matrix: Float64
    offset: Float64

    @staticmethod
    def between(source: NDArray[np.floating], target: NDArray[np.floating]) -> ColorMap:
        """The map that gives ``source`` [N, 3] mean and covariance of ``target`` [M, 3].

        Matrix: C_t^1/2 C_s^-1/2, with symmetric roots.
        """
        matrix = _root(target, 0.5) @ _root(source, -0.5)
        return ColorMap(matrix, target.mean(0, dtype=np.float64)
                        - matrix @ source.mean(0, dtype=np.float64))

    def colors(self, colors: Float32) -> Float32:
        """Colors [N, 3] moved, in [0, 1]."""
        return np.clip(colors @ self.matrix.T + self.offset, 0.0, 1.0).astype(np.float32)

    def picture(self, picture: Float32, alpha: Float32, background: float) -> Float32:
        """A picture [h, w, 3] on a background moved, the background left as it is."""
        behind = (1 - alpha[..., None]) * background
        moved = (picture - behind) @ self.matrix.T + alpha[..., None] * self.offset + behind
        return np.clip(moved, 0.0, 1.0).astype(np.float32)


def _root(pixels: NDArray[np.floating], power: float) -> Float64:
    values, vectors = np.linalg.eigh(np.cov(pixels.T.astype(np.float64)))
    return (vectors * np.maximum(values, LEAST) ** power) @ vectors.T


def painted_pixels(exemplar: Exemplar) -> Float32:
    """Colors of the painted person, float32 [N, 3] in [0, 1]."""
    person = exemplar.regions().person > 0.5
    if person.sum() < 100:
        person = np.ones(exemplar.image.shape[:2], np.bool_)
    return exemplar.image[person].astype(np.float32) / np.float32(255)


def person_pixels(views: list[PhotoView], pictures: list[Float32]) -> Float32:
    """Colors of the person in pictures of the views, float32 [N, 3]."""
    return np.concatenate([picture[view.inside] for view, picture in zip(views, pictures)])
