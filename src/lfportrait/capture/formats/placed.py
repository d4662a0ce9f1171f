"""A photo with its camera from a photogrammetry program, and the lens models of these files."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Set
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..distortion import Lens

__all__ = ["Placed", "brown", "centred", "fisheye", "resizable", "warn_left_out",
           "warn_unmatched"]

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

    So Metashape, RealityCapture and nerfstudio bend; OpenCV's fourth term is another one.
    """
    return replace(lens, model="brown", k=k) if k[3] else replace(lens, model="opencv", k=k[:3])


def fisheye(lens: Lens, k: tuple[float, float, float, float]) -> Lens:
    """The fisheye lens with the tangential terms ``lens.p``, of the bent coordinates.

    So Metashape and nerfstudio bend; OpenCV's fisheye has no such terms.
    """
    return replace(lens, model="thin_prism" if any(lens.p) else "fisheye", k=k)


def warn_left_out(count: int, total: int, file: Path, why: str = "are not aligned") -> None:
    """Say in one line that ``count`` of the ``total`` photos of a file are left out.

    Where that is none, nothing is to be said; where it is all, the reader says more.
    """
    if 0 < count < total:
        warnings.warn(f"{count} of {total} photos in {file} {why} and are left out", stacklevel=3)


def warn_unmatched(pictures: Set[str], cameras: Set[str], folder: Path, place: Path) -> None:
    """Say which pictures of a folder have no camera, and which cameras no picture: a line each.

    Parameters
    ----------
    pictures, cameras
        The names by which they belong together; hidden files don't count.
    folder, place
        Where the pictures and the cameras are.
    """
    pictures, cameras = ({name for name in names if not name.startswith(".")}
                         for names in (pictures, cameras))
    warn_left_out(len(pictures - cameras), len(pictures), folder, f"have no camera in {place}")
    lost = len(cameras - pictures)
    if lost:
        warnings.warn(f"{lost} of {len(cameras)} cameras in {place} have no photo in {folder} and "
                      "are left out", stacklevel=3)
