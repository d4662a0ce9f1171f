"""Pictures as PNG, JPEG or WebP, with what these formats can't hold told before the work."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...errors import UserError
from ...files import atomic_write
from ...png import write_png
from .names import PICTURES

__all__ = ["check_picture", "picture_bytes", "write_picture"]

_LARGEST = {".webp": 16383, ".jpg": 65500, ".jpeg": 65500}
"""Pixels a side. JPEG's format has 35 more; libjpeg, which all use, does not write them."""
_MOST = 2 << 30
"""Bytes of a decoded picture: what is larger, most programs refuse to open."""
_OPTIONS: dict[str, dict[str, int]] = {
    ".webp": {"quality": 92, "method": 4},
    # Colors at full size: a quilt's tiles are small, and anaglyphs and depth live in colors.
    ".jpg": {"quality": 94, "subsampling": 0}, ".jpeg": {"quality": 94, "subsampling": 0}}


def check_picture(path: Path, width: int, height: int) -> None:
    """Whether the format that a name gives holds a picture of this size.

    Raises
    ------
    UserError
        If not.
    """
    suffix = path.suffix.lower()
    if suffix not in PICTURES:
        raise UserError(f"can't write a picture named {path.name}; end the name in .png, .jpg or "
                        ".webp")
    most = _LARGEST.get(suffix)
    if most is not None and max(width, height) > most:
        raise UserError(f"a {suffix} file holds at most {most} pixels a side, not {width} x "
                        f"{height}: use .png, or make it smaller with --pixels")
    if width * height * 3 > _MOST:
        raise UserError(f"a picture of {width} x {height} pixels would take "
                        f"{width * height * 3 / 2 ** 30:.1f} GiB; make it smaller with --pixels")


def picture_bytes(suffix: str, image: NDArray[np.uint8], exif: Image.Exif | None = None) -> bytes:
    """A picture [H, W, 3] as the contents of a file with this suffix."""
    suffix = suffix.lower()
    buffer = io.BytesIO()
    if suffix == ".png":
        # Before the pixels; Pillow puts EXIF behind them, where few look.
        blocks = () if exif is None else ((b"eXIf", exif.tobytes().removeprefix(b"Exif\0\0")),)
        write_png(buffer, image, blocks)
    else:
        more = {} if exif is None else {"exif": exif}
        Image.fromarray(image).save(buffer, format=Image.registered_extensions()[suffix],
                                    **_OPTIONS[suffix], **more)
    return buffer.getvalue()


def write_picture(path: Path, image: NDArray[np.uint8], exif: Image.Exif | None = None) -> None:
    """Write a picture [H, W, 3]; it appears when it is complete."""
    check_picture(path, image.shape[1], image.shape[0])
    contents = picture_bytes(path.suffix, image, exif)
    with atomic_write(path) as stream:
        stream.write(contents)
