"""Orientation of calibrated pictures: match EXIF rotation, calibration and mask.

A phone stores what its sensor sees and notes beside it how to turn that (EXIF). Some programs
calibrate the stored pixels, others the upright ones, and few say which. The size that the program
noted decides where a quarter turn changes it; where it can't (square pictures, half turns, no size)
the pixels are taken as stored, as COLMAP, Metashape, Meshroom, nerfstudio and instant-ngp read
them. Whatever was calibrated, pictures are upright from here on: pose and lens turn with them.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...errors import UserError
from ...media.masks import read_mask
from ...media.pictures import open_picture
from ..distortion import Lens
from ..exif import noted

__all__ = ["calibrated_turns", "mask_for", "noted_turns", "turned_upright", "turns_by_up"]

Float64 = NDArray[np.float64]

# The camera's axes after its picture was turned clockwise by a quarter turn.
_QUARTER = np.array([[0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0],
                     [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def same_shape(first: tuple[int, int], second: tuple[int, int]) -> bool:
    """Whether one size is the other, reduced and rounded."""
    return abs(first[0] * second[1] - first[1] * second[0]) <= 2 * max(*first, *second)


def noted_turns(path: Path) -> int:
    """Quarter turns (counter-clockwise) from the upright picture to the stored pixels, 0 to 3."""
    try:
        with open_picture(path) as picture:
            return noted(picture.getexif(), picture.size).turns
    except (OSError, ValueError, SyntaxError):
        return 0


def calibrated_turns(upright: tuple[int, int], turns: int, size: tuple[int, int] | None,
                     name: str) -> int:
    """Quarter turns (counter-clockwise) from the upright picture to the calibrated one, 0 to 3.

    Parameters
    ----------
    upright
        Width and height of the upright picture.
    turns
        As the file notes them: see `noted_turns`.
    size
        Width and height that were calibrated, or None where the program does not say; a picture may
        be a reduced copy.
    name
        Of the picture, for the message.

    Raises
    ------
    UserError
        If the picture fits neither way.
    """
    stored = upright[::-1] if turns % 2 else upright
    if size is None or same_shape(size, stored):
        return turns
    if same_shape(size, upright):
        return 0
    raise UserError(f"{name} has {upright[0]} x {upright[1]} pixels, its camera {size[0]} x "
                    f"{size[1]}: it was turned or cropped after it was calibrated; put the photo "
                    "there that the program saw")


def turned_upright(pose: Float64, lens: Lens, turns: int) -> tuple[Float64, Lens]:
    """Pose [4, 4] and lens of a picture after so many clockwise quarter turns."""
    for _ in range(turns % 4):
        pose, lens = pose @ _QUARTER, lens.turned()
    return pose, lens


def turns_by_up(pose: Float64, up: Float64) -> int:
    """Clockwise quarter turns after which the picture's upper edge is nearest to ``up``, 0 to 3."""
    sides = [-pose[:3, 1], -pose[:3, 0], pose[:3, 1], pose[:3, 0]]
    heights = [float(side @ up) for side in sides]
    best = int(np.argmax(heights))
    # A camera that looks straight up or down has no upper edge to speak of.
    return best if heights[best] > 0.5 * float(np.linalg.norm(up)) else 0


def mask_for(picture: NDArray[np.uint8], place: Path, turns: int) -> NDArray[np.uint8]:
    """A mask file as it lies on an upright picture, uint8 [H, W].

    A mask of another size, for a reduced picture, is resized. One that lies as the stored pixels do
    is turned with them. Where sizes and notes leave more than one way, or the photo lost its note,
    that is taken on whose outline the picture changes most.

    Parameters
    ----------
    picture
        uint8 [H, W, C], upright.
    place
        The mask's file; white is kept.
    turns
        What the photo's file notes: see `noted_turns`.

    Raises
    ------
    UserError
        If the mask is of another shape, or can't be read.
    """
    mask = read_mask(place)
    height, width = picture.shape[:2]
    ways = [0] if not turns else [turns, 0]
    fitting = [way for way in ways if same_shape(_size(np.rot90(mask, -way)), (width, height))]
    if not fitting:
        fitting = [way for way in (1, 3) if same_shape(_size(np.rot90(mask, -way)),
                                                       (width, height))]
    if not fitting:
        raise UserError(f"the mask {place} is not of its picture's size")
    turned = [_resized(np.rot90(mask, -way), width, height) for way in fitting]
    if len(turned) == 1:
        return turned[0]
    return max(turned, key=lambda one: _outline_contrast(picture, one))


def _size(array: NDArray[np.uint8]) -> tuple[int, int]:
    return array.shape[1], array.shape[0]


def _resized(mask: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    if mask.shape == (height, width):
        return np.ascontiguousarray(mask)
    picture = Image.fromarray(np.ascontiguousarray(mask))
    return np.asarray(picture.resize((width, height), Image.Resampling.BOX))


def _outline_contrast(picture: NDArray[np.uint8], mask: NDArray[np.uint8]) -> float:
    """How much a picture changes on average along a mask's outline."""
    factor = min(1.0, 512 / max(mask.shape))
    grey = cv2.resize(np.ascontiguousarray(picture[..., :3].mean(axis=2).astype(np.float32)), None,
                      fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    small = cv2.resize(mask.astype(np.float32), grey.shape[::-1], interpolation=cv2.INTER_AREA)
    down, across = np.gradient(small)
    outline = np.hypot(down, across)
    if outline.sum() == 0:
        return 0.0
    return float((np.hypot(*np.gradient(np.asarray(grey))) * outline).sum() / outline.sum())
