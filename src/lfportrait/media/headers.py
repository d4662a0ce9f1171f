"""What the head of a picture's file says, without decoding the picture.

Pillow decodes a PNG when it is asked for EXIF data that it has not met yet, as they may come last.
Here the file is looked through first: hardly any has such notes at its end.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from typing import BinaryIO

from PIL import Image, ImageOps

from .pictures import file_of, open_picture

__all__ = ["open_header", "orientation_of", "sizes_of"]

_ORIENTATION = 0x0112
_NOTES = {b"eXIf", b"iTXt", b"tEXt", b"zTXt"}
"""Chunks of a PNG that may hold EXIF data, or XMP with an orientation."""


@contextlib.contextmanager
def open_header(path: str | os.PathLike[str]) -> Iterator[Image.Image]:
    """A picture as `open_picture` opens it, whose notes can be read without decoding it.

    Raises
    ------
    OSError, ValueError, SyntaxError
        As in `open_picture`.
    """
    with open_picture(path) as picture:
        stream = file_of(picture)
        if (picture.format == "PNG" and stream is not None and "exif" not in picture.info
                and "Raw profile type exif" not in picture.info and not _late_notes(stream)):
            picture.info["exif"] = b""
        yield picture


def _late_notes(stream: BinaryIO) -> bool:
    """Whether a PNG has notes behind its pixels, or can't be looked through."""
    place, data = stream.tell(), False
    try:
        stream.seek(8)
        while len(head := stream.read(8)) == 8 and head[4:] != b"IEND":
            if data and head[4:] in _NOTES:
                return True
            data = data or head[4:] == b"IDAT"
            stream.seek(int.from_bytes(head[:4], "big") + 4, os.SEEK_CUR)
        return len(head) < 8  # cut off
    finally:
        stream.seek(place)


def orientation_of(picture: Image.Image) -> int:
    """The orientation that a picture's notes give, 1 to 8 as in EXIF; 1 where they give none."""
    found = picture.getexif().get(_ORIENTATION)
    return found if isinstance(found, int) and 1 <= found <= 8 else 1


def sizes_of(picture: Image.Image) -> tuple[tuple[int, int], tuple[int, int]]:
    """Width and height as stored, and after `srgb` turned the picture by its orientation."""
    exif = Image.Exif()
    exif[_ORIENTATION] = orientation_of(picture)
    small = Image.new("L", (2, 1))
    small.info["exif"] = exif.tobytes()
    found = picture.size
    if ImageOps.exif_transpose(small).size == small.size:
        return found, found
    # Pillow turns a TIFF itself when it decodes it, and says so in its size.
    return (found[::-1], found) if picture.format == "TIFF" else (found, found[::-1])
