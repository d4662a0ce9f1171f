"""A photo with its camera from a photogrammetry program, and the lens models of these files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..distortion import Lens

__all__ = ["Placed", "brown", "centred", "resizable"]

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Placed:
    """One aligned photo of a program's file.

    Attributes
    ----------
    name
        File name, path or label.
    pose
        float64 [4, 4], camera-to-world, OpenCV axes; a common scale is allowed.
    lens
        Makes the lens of the picture as it was calibrated from its width and height in pixels.
    size
        Width and height that were calibrated, where the file says.
    """

    name: str
    pose: Float64
    lens: Callable[[int, int], Lens]
    size: tuple[int, int] | None = None


def resizable(lens: Lens) -> tuple[Callable[[int, int], Lens], tuple[int, int]]:
    """A lens of known picture size as `Placed` has it: for reduced copies too."""
    return lens.resized, (lens.width, lens.height)


def centred(name: str, focal: float, k: tuple[float, ...]) -> Callable[[int, int], Lens]:
    """A lens whose centre is the picture's, by its focal length in the picture's pixels."""
    if not focal > 0:
        raise ValueError(f"the focal length of {name} is {focal:g}")
    return lambda width, height: Lens(width, height, (focal, focal), (width / 2, height / 2), k=k)


def brown(lens: Lens, k: tuple[float, float, float, float]) -> Lens:
    """The lens with the radial polynomial 1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8.

    `Lens` has a fraction of two cubics in r^2. With k4 that is fitted to the polynomial within the
    picture.

    Raises
    ------
    ValueError
        If no fraction comes within a hundredth of a pixel.
    """
    if not k[3]:
        return Lens(lens.width, lens.height, lens.focal, lens.center, "opencv", k[:3], lens.p)
    corner = np.hypot(max(lens.center[0], lens.width - lens.center[0]) / lens.focal[0],
                      max(lens.center[1], lens.height - lens.center[1]) / lens.focal[1])
    r2 = np.linspace(0.0, 1.1 * corner, 400) ** 2
    powers = r2[:, None] ** np.arange(1, 5)
    ratio = 1 + powers @ np.array(k)
    # a1 s + a2 s^2 + a3 s^3 - ratio (b1 s + b2 s^2 + b3 s^3) = ratio - 1, in units of the corner.
    unit = r2[-1] ** np.arange(1, 4)
    table = powers[:, :3] / unit
    terms = np.linalg.lstsq(np.hstack([table, -ratio[:, None] * table]), ratio - 1, rcond=1e-12)[0]
    above, below = terms[:3] / unit, terms[3:] / unit
    fitted = (1 + powers[:, :3] @ above) / (1 + powers[:, :3] @ below)
    if not np.abs((fitted - ratio) * np.sqrt(r2) * max(lens.focal)).max() < 0.01:
        raise ValueError("its fourth radial term (k4) is too strong; optimise the cameras without")
    return Lens(lens.width, lens.height, lens.focal, lens.center, "opencv",
                (*(float(term) for term in above), *(float(term) for term in below)), lens.p)
