"""Why a picture can't be read, without decoding those that can.

Files that are whole in their outline are not decoded: a JPEG whose last scan ends by a marker, a
PNG whose checksums are right, a file as long as its boxes say. Of all others the decoder decides.
"""

from __future__ import annotations

import mmap
import os
import struct
from pathlib import Path

from PIL import Image

from .damage import damage_of, scans_end
from .kinds import file_format
from .pictures import open_picture

__all__ = ["fault_of"]

_SMALLEST = 64
"""Of a JPEG that is decoded to see whether that succeeds, an eighth is enough."""
_ERRORS = (OSError, ValueError, SyntaxError, RuntimeError, MemoryError, EOFError, struct.error)


def fault_of(path: Path) -> str:
    """Why readers refuse a picture, in one line; empty where they read it.

    Parameters
    ----------
    path
        A file whose kind is a picture's (`kind_of`).
    """
    damage = damage_of(path)
    if damage:
        return f"it is damaged: {damage}"
    try:
        with open_picture(path) as picture:
            if _whole(path, picture):
                return ""
        with open_picture(path) as picture:  # Pillow does not decode what it verified
            picture.draft(None, (_SMALLEST, _SMALLEST))
            picture.load()
        return ""
    except _ERRORS as error:
        return str(error).splitlines()[0] if str(error) else type(error).__name__


def _whole(path: Path, picture: Image.Image) -> bool:
    """Whether a file is whole in its outline; False where that is not known."""
    kind, size = file_format(path), os.path.getsize(path)
    try:
        if kind == "png":
            picture.verify()
            return True
        with open(path, "rb") as stream, \
                mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
            if kind == "jpeg":
                return scans_end(data)
            if kind == "webp":
                return int.from_bytes(data[4:8], "little") + 8 <= size
            return kind in ("heic", "avif") and _boxes_fit(data)
    except _ERRORS:
        return False


def _boxes_fit(data: mmap.mmap) -> bool:
    """Whether all boxes of a file end in it (ISO/IEC 14496-12, 4.2)."""
    at = 0
    while at + 8 <= len(data):
        length = int.from_bytes(data[at:at + 4], "big")
        if length == 1:
            length = int.from_bytes(data[at + 8:at + 16], "big")
        if length < 8:
            return length == 0  # up to the end
        at += length
    return at == len(data)
