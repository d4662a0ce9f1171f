"""Coded pictures in files, and whether they are their panel's.

In memory a coded picture is as the viewer sees the panel. A panel that shows its picture mirrored
needs it mirrored; that happens here, on the way to a file and back, and nowhere else.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..arrays import UInt8
from ..errors import UserError
from ..files import write_image
from ..media.pictures import read_image
from .display import Display


def check_size(image: UInt8, display: Display) -> None:
    """Raise `UserError` if a picture does not have the panel's size."""
    if image.shape[:2] != (display.height, display.width):
        raise UserError(f"the picture is {image.shape[1]} x {image.shape[0]} pixels, but the "
                        f"display {display.name} has {display.width} x {display.height}: a coded "
                        "picture must not be scaled")


def lossless(path: str | Path) -> Path:
    """The path, if its format keeps every sub-pixel."""
    path = Path(path)
    if path.suffix.lower() not in (".png", ".tif", ".tiff", ".bmp"):
        raise UserError("a coded picture must keep every sub-pixel: write it as .png, not "
                        f"{path.suffix or 'without a suffix'}")
    return path


def read_coded(path: str | Path, display: Display) -> UInt8:
    """A coded picture as the viewer sees the panel, uint8 [H, W, 3]."""
    image = np.ascontiguousarray(read_image(path)[..., :3])
    check_size(image, display)
    return display.to_panel(image)


def write_coded(path: str | Path, image: UInt8, display: Display) -> None:
    """Write a coded picture, uint8 [H, W, 3] as seen, so that the panel shows it right."""
    check_size(image, display)
    write_image(lossless(path), display.to_panel(image), fast=True)
