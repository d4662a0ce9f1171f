"""What a mask is, and where it lies.

Programs write masks as black and white, as 0 and 1, as labels with a palette (VOC: index 1 is dark
red), as labels of the parts of a face, or in the alpha channel of a cut-out. A mask here is gray:
white is the person.

- The alpha channel is the mask where it varies, unless the colors are black and white themselves.
- Labels, which are few and dark values, or a palette or colors that are not gray: any but zero (or
  black) is the person.
- Gray values that reach white are kept: hair has soft edges.
- Anything else is no mask, and a line says so.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from PIL import Image, ImageOps

from ..arrays import Bool, Float64, UInt8
from ..errors import UserError
from .folders import Finder
from .pictures import open_picture

_LABELS = 64
"""More values than programs have labels, fewer than soft edges have gray values."""
_BRIGHT = 128
"""A mask whose person is darker than this is none, or is of labels."""


def read_mask(path: Path) -> UInt8:
    """A mask's file as a mask, turned upright by its EXIF orientation.

    Returns
    -------
    mask : uint8 [H, W], 255 is the person.

    Raises
    ------
    UserError
        If the file is missing, damaged, or no mask.
    """
    try:
        with open_picture(path) as picture:
            picture.load()
            upright: Image.Image = ImageOps.exif_transpose(picture)
            return mask_values(upright, str(path))
    except FileNotFoundError as error:
        raise UserError(f"no such file: {path}") from error
    except (OSError, ValueError, SyntaxError, RuntimeError, MemoryError) as error:
        raise UserError(f"can't read the mask {path}: {error}") from error


def mask_values(picture: Image.Image, name: str) -> UInt8:
    """A decoded picture of any mode as a mask, uint8 [H, W], 255 is the person.

    Raises
    ------
    UserError
        If it is no mask.
    """
    if picture.mode == "P" and "transparency" not in picture.info:
        return _of_palette(picture, name)
    if picture.mode.startswith(("I", "F")):
        return _of_gray(np.asarray(picture, np.float64), name)
    if picture.mode in ("1", "L"):
        return _of_gray(np.asarray(picture.convert("L")).astype(np.float64), name)
    whole = np.asarray(picture.convert("RGBA"))
    alpha, colors = whole[..., 3], whole[..., :3]
    gray = colors.max(axis=2)
    is_gray = bool((gray - colors.min(axis=2) <= 8).all())
    if alpha.min() < alpha.max():
        shown = gray[alpha > 0]
        two = is_gray and shown.min() < 32 and shown.max() > 223 and (
            (shown < 32) | (shown > 223)).mean() > 0.9
        if not two:
            return np.ascontiguousarray(alpha)
        gray = np.asarray(gray * (alpha / 255.0) + 0.5, np.uint8)
    if is_gray:
        return _of_gray(gray.astype(np.float64), name)
    return _of_colors(colors, name)


def _of_palette(picture: Image.Image, name: str) -> UInt8:
    """Of a picture with a palette: gray values, or labels by their index."""
    index = np.asarray(picture)
    palette = np.array(picture.getpalette() or [], np.uint8).reshape(-1, 3)
    used = np.unique(index)
    if len(palette) > used.max():
        colors = palette[used]
        if (np.ptp(colors.astype(np.int32), axis=1) <= 8).all() and colors.max() >= _BRIGHT:
            return _of_gray(palette[index].max(axis=2).astype(np.float64), name)
    return _white(np.asarray(index > 0))


def _of_gray(values: Float64, name: str) -> UInt8:
    values = np.where(np.isfinite(values), values, 0.0)
    most = float(values.max(initial=0.0))
    if most <= 0 or values.min(initial=0.0) < 0:
        return _white(values > 0)
    if most <= 1:
        # From 0 to 1 in floating point, or the labels 0 and 1.
        return np.asarray(values * 255 + 0.5, np.uint8)
    full = 255.0 if most <= 255 else 65535.0
    some = np.unique(values[::max(1, values.shape[0] // 512)])
    if most < _BRIGHT * full / 255 and len(some) <= _LABELS:
        return _white(values > 0)
    if most < _BRIGHT * full / 255:
        raise UserError(f"{name} is no mask: its brightest value is {most:g} of {full:g}, and it "
                        "has too many values for labels; make the person white")
    return np.asarray(np.clip(values * (255 / full), 0, 255) + 0.5, np.uint8)


def _of_colors(colors: UInt8, name: str) -> UInt8:
    """Of colored labels: what is not black."""
    code = (colors.astype(np.int32) @ np.array([1 << 16, 1 << 8, 1])).ravel()
    if len(np.unique(code[::max(1, code.size // 250_000)])) <= _LABELS:
        return _white(np.asarray(colors.any(axis=2)))
    # Compressed labels: nearly black and clearly colored, hardly anything between.
    bright = colors.max(axis=2)
    if ((bright < 24) | (bright > 64)).mean() > 0.97 and (bright < 24).mean() > 0.05:
        return _white(bright > 44)
    raise UserError(f"{name} is no mask but a picture in color; make the person white and the "
                    "rest black")


def _white(person: Bool) -> UInt8:
    return np.asarray(person, np.uint8) * np.uint8(255)


def mask_places(finder: Finder, folders: Iterable[Path], name: str) -> Path | None:
    """The file of a photo's mask, of any kind of picture, by the customs of other programs.

    ``NAME.EXT.png`` (COLMAP), ``NAME.png`` (nerfstudio), ``NAME_mask.png`` (Metashape),
    ``NAME.mask.png``, in the first folder that has one.

    Parameters
    ----------
    finder : Looks names up.
    folders : Where masks may lie.
    name : The photo's file name, with folders if it has some there.
    """
    base = Path(name)
    for folder in folders:
        if not folder.is_dir():
            continue
        for stem in (name, str(base.with_suffix("")), f"{base.with_suffix('')}_mask",
                     f"{base.with_suffix('')}.mask"):
            found = finder.find_picture(folder, stem)
            if found is not None:
                return found
    return None
