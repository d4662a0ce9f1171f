"""The upright frame of a face in a picture: where it is, how large, and how it is turned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["FaceFrame"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class FaceFrame:
    """The upright frame of a face: origin between the eyes' height and the brows, unit = chin.

    Attributes
    ----------
    origin
        [2], middle of the brows.
    right, down
        [2] each, the face's axes in the picture, orthonormal.
    height
        Distance from the brows to the chin in pixels.
    width
        Distance of the jaw's ends in pixels.
    """

    origin: Float64
    right: Float64
    down: Float64
    height: float
    width: float

    @staticmethod
    def of(landmarks: NDArray[np.floating]) -> FaceFrame:
        """Frame of 68 landmarks; roll is taken out by the line of eyes and chin."""
        points = np.asarray(landmarks, np.float64)
        brows = np.nanmean(points[17:27], axis=0)
        eyes = np.nanmean(points[42:48], axis=0) - np.nanmean(points[36:42], axis=0)
        chin = points[8] - brows
        # The chin alone would lean with the yaw, the eyes alone vanish in profile.
        down = chin / np.linalg.norm(chin) + np.array([-eyes[1], eyes[0]]) / max(
            float(np.linalg.norm(chin)), 1e-9)
        down /= np.linalg.norm(down)
        right = np.array([down[1], -down[0]])
        extent = points[[0, 16]] @ right
        return FaceFrame(brows, right, down, float(chin @ down), float(abs(extent[1] - extent[0])))

    def local(self, shape: tuple[int, ...]) -> tuple[Float32, Float32]:
        """Coordinates of all pixels of a picture in units of ``height``: (right, down)."""
        y, x = (np.arange(n, dtype=np.float32) + np.float32(0.5) - np.float32(at)
                for n, at in zip(shape[:2], self.origin[::-1]))
        # Row and column by themselves: no products of whole pictures.
        along, below = (np.asarray(way / self.height, np.float32)
                        for way in (self.right, self.down))
        return x * along[0] + (y * along[1])[:, None], x * below[0] + (y * below[1])[:, None]

    def point(self, right: NDArray[np.floating], down: NDArray[np.floating]) -> Float64:
        """Picture coordinates [N, 2] of local ones."""
        return np.asarray(self.origin + self.height * (
            np.multiply.outer(right, self.right) + np.multiply.outer(down, self.down)), np.float64)

    def turn(self, landmarks: NDArray[np.floating]) -> float:
        """How far the nose lies to the right of the middle of the jaw's ends, over half the width.

        0 seen from the front, about 1.25 for a head turned by 50 degrees.
        """
        across = np.asarray(landmarks, np.float64) @ self.right
        return float((across[30] - 0.5 * (across[0] + across[16])) / max(0.5 * self.width, 1e-9))
