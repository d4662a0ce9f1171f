"""Pictures of every kind that is read, as upright eight-bit sRGB.

What a file is, its content says (`kinds`); what its numbers mean, `colors`.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..errors import UserError
from ..measure import usable_cores
from .colors import srgb
from .damage import damage_of
from .kinds import file_format, kind_of

__all__ = ["file_of", "open_picture", "read_image", "read_images"]

_LARGEST = 2 << 30
"""Bytes of a decoded picture beyond which a file is taken for a decompression bomb."""


def _read_heic() -> None:
    try:
        import pillow_heif
    except ImportError as error:
        raise OSError("HEIC pictures need pillow-heif (pip install pillow-heif), or export them "
                      "as JPEG") from error
    pillow_heif.register_heif_opener()


class _PixelBound:
    """Pillow's bound on pixels, raised to what `_LARGEST` allows while any thread reads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._readers = 0
        self._usual: int | None = None

    def __enter__(self) -> None:
        with self._lock:
            if not self._readers:
                self._usual = Image.MAX_IMAGE_PIXELS
                Image.MAX_IMAGE_PIXELS = _LARGEST
            self._readers += 1

    def __exit__(self, *error: object) -> None:
        with self._lock:
            self._readers -= 1
            if not self._readers:
                Image.MAX_IMAGE_PIXELS = self._usual


_PIXEL_BOUND = _PixelBound()


@contextlib.contextmanager
def _usual_errors() -> Iterator[None]:
    """Errors that belong to none of the usual classes, as an OSError: too many pixels, an end."""
    try:
        yield
    except (Image.DecompressionBombError, EOFError) as error:
        raise OSError(str(error)) from error


@contextlib.contextmanager
def open_picture(path: str | os.PathLike[str]) -> Iterator[Image.Image]:
    """Open a picture by Pillow, not yet decoded; HEIC, which phones write, by pillow-heif.

    Pillow's own bound on pixels (89 million, 179 for an error) is in the way of cameras of today;
    what counts is what a picture takes when decoded, 2 GiB at most.

    Raises
    ------
    OSError, ValueError, SyntaxError
        If it is missing, no picture, damaged, too large, or a raw photo.
    """
    path = Path(path)
    kind = kind_of(path)
    if kind in ("raw", "unread"):
        # Pillow would take some for a TIFF and show their thumbnail.
        what = "raw photos are" if kind == "raw" else "pictures of this kind are"
        raise OSError(f"{what} not read; export it as JPEG or TIFF")
    if file_format(path) == "heic":
        _read_heic()
    # A stream is not mapped: Pillow maps the rows of a TIFF that is to be turned by a wrong width.
    with _PIXEL_BOUND, _usual_errors(), open(path, "rb") as stream, Image.open(stream) as picture:
        size = picture.width * picture.height * max(3, len(picture.getbands()))
        if size > _LARGEST:
            raise OSError(f"it has {picture.width} x {picture.height} pixels, which would take "
                          f"{size / 2 ** 30:.1f} GiB; reduce it first")
        # Pillow lets go of the file when it has decoded the picture.
        picture.lfportrait_file = stream  # type: ignore[attr-defined]
        yield picture


def file_of(picture: Image.Image) -> BinaryIO | None:
    """The open file of a picture that `open_picture` yields, for what Pillow does not read."""
    stream = getattr(picture, "lfportrait_file", None)
    return cast(BinaryIO, stream) if stream is not None else None


def read_image(path: str | os.PathLike[str]) -> NDArray[np.uint8]:
    """Read a picture, turned upright by its EXIF orientation, in sRGB by its profile.

    Returns
    -------
    image
        uint8 [H, W, 3] (sRGB) or [H, W, 4] (straight alpha) where the file has an alpha channel.

    Raises
    ------
    UserError
        If the file is missing, not a picture or damaged.
    """
    try:
        with open_picture(path) as picture:
            picture.load()
            damage = damage_of(Path(path))
            if damage:
                raise OSError(f"it is damaged: {damage}; copy it again from the camera")
            return np.asarray(srgb(picture, file_of(picture)))
    except FileNotFoundError as error:
        raise UserError(f"no such file: {path}") from error
    except (OSError, ValueError, SyntaxError, RuntimeError, MemoryError) as error:
        raise UserError(f"can't read the picture {path}: {error}") from error


def read_images(paths: Iterable[str | os.PathLike[str]],
                ) -> Iterator[NDArray[np.uint8] | UserError]:
    """Read pictures in order, several at a time: `read_image`'s pictures, or its errors."""
    def read(path: str | os.PathLike[str]) -> NDArray[np.uint8] | UserError:
        try:
            return read_image(path)
        except UserError as error:
            return error

    with ThreadPoolExecutor(usable_cores()) as threads:  # decoders let go of Python's lock
        yield from threads.map(read, paths)
