"""Lens distortion: the OpenCV models, and pictures resampled as a pinhole would have taken them.

With normalised image coordinates (x, y) = (X/Z, Y/Z), r^2 = x^2 + y^2:

- ``opencv``: x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
  + 2 p1 x y + p2 (r^2 + 2 x^2), and y' likewise with p1 and p2 exchanged;
- ``fisheye``: theta = atan r, theta' = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6
  + k4 theta^8), (x', y') = theta'/r (x, y).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

__all__ = ["Lens", "undistort"]

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Lens:
    """A camera's intrinsics with its distortion.

    Attributes
    ----------
    width, height
        Picture size in pixels.
    focal, center
        (x, y) in pixels.
    model
        ``"opencv"`` or ``"fisheye"``.
    k
        Radial coefficients: up to 6 (opencv) or 4 (fisheye).
    p
        Tangential coefficients p1, p2 (opencv).
    """

    width: int
    height: int
    focal: tuple[float, float]
    center: tuple[float, float]
    model: str = "opencv"
    k: tuple[float, ...] = ()
    p: tuple[float, float] = (0.0, 0.0)

    @property
    def distorts(self) -> bool:
        """Whether any coefficient differs from zero; a fisheye always bends."""
        return self.model == "fisheye" or any(self.k) or any(self.p)

    def resized(self, width: int, height: int) -> Lens:
        """The lens of the same picture at another size, in pixels."""
        ratio = width / self.width, height / self.height
        return Lens(width, height, (self.focal[0] * ratio[0], self.focal[1] * ratio[1]),
                    (self.center[0] * ratio[0], self.center[1] * ratio[1]), self.model, self.k,
                    self.p)

    def distort(self, points: Float) -> Float:
        """Normalised pinhole coordinates [..., 2] -> normalised coordinates on the sensor."""
        x, y = points[..., 0], points[..., 1]
        r2 = x * x + y * y
        if self.model == "fisheye":
            k = (*self.k, 0.0, 0.0, 0.0, 0.0)[:4]
            r = np.sqrt(r2)
            theta = np.arctan(r)
            t2 = theta * theta
            bent = theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))))
            ratio = np.where(r > 1e-12, bent / np.maximum(r, 1e-12), 1.0)
            return points * ratio[..., None]
        k = (*self.k, *([0.0] * 6))[:6]
        radial = (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[2]))) / (
            1 + r2 * (k[3] + r2 * (k[4] + r2 * k[5])))
        p1, p2 = self.p
        return np.stack([x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                         y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], axis=-1)

    def source_pixels(self) -> Float:
        """For each pixel of the pinhole picture, where it lies in the photo: [H, W, 2] (x, y)."""
        x, y = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        focal, center = np.array(self.focal), np.array(self.center)
        flat = (np.stack([x, y], -1) - center) / focal
        return self.distort(flat) * focal + center


def undistort(image: NDArray[Any], lens: Lens) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Resample a photo as the pinhole camera with the same focal length and centre sees it.

    Parameters
    ----------
    image
        uint8 [H, W, C].
    lens
        The photo's lens.

    Returns
    -------
    image, inside
        uint8 [H, W, C], and bool [H, W]: which pixels the photo covers.
    """
    if not lens.distorts:
        return image, np.ones(image.shape[:2], bool)
    place = lens.source_pixels()
    rows, columns = place[..., 1] - 0.5, place[..., 0] - 0.5
    inside = ((rows >= -0.5) & (rows <= lens.height - 0.5)
              & (columns >= -0.5) & (columns <= lens.width - 0.5))
    planes = [ndimage.map_coordinates(image[..., channel].astype(np.float32), [rows, columns],
                                      order=1, mode="nearest")
              for channel in range(image.shape[2])]
    return np.clip(np.stack(planes, -1) + 0.5, 0, 255).astype(np.uint8), inside
