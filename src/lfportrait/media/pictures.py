"""Reading pictures of every kind: whole, their heads alone, or only whether they can be read.

A picture becomes upright eight-bit sRGB. What a file is, its content says (`kinds`); what its
numbers mean, `colors`.

Pillow decodes a PNG when it is asked for EXIF data that it has not met yet, as they may come last.
Here the file is looked through first: hardly any has such notes at its end.

Files that are whole in their outline are not decoded: a JPEG whose last scan ends by a marker, a
PNG whose checksums are right, a file as long as its boxes say. Of all others the decoder decides.

Masks: programs write masks as black and white, as 0 and 1, as labels with a palette (VOC: index 1
is dark red), as labels of the parts of a face, or in the alpha channel of a cut-out. A mask here is
gray: white is the person.

- The alpha channel is the mask where it varies, unless the colors are black and white themselves.
- Labels, which are few and dark values, or a palette or colors that are not gray: any but zero (or
  black) is the person.
- Gray values that reach white are kept: hair has soft edges.
- Anything else is no mask, and a line says so.
"""

import contextlib
import mmap
import os
import struct
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np
from PIL import Image, ImageOps

from ..arrays import Bool, Float64, UInt8
from ..errors import UserError
from ..measure import usable_cores
from .colors import srgb
from .folders import Finder
from .kinds import damage_of, file_format, kind_of, scans_end

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
    what counts is what a picture takes when decoded, 2 GiB at most. Raises `OSError`, `ValueError`
    or `SyntaxError` if it is missing, no picture, damaged, too large, or a raw photo.
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


def read_image(path: str | os.PathLike[str]) -> UInt8:
    """Read a picture, turned upright by its EXIF orientation, in sRGB by its profile.

    Returns
    -------
    image : uint8 [H, W, 3] (sRGB) or [H, W, 4] (straight alpha) where the file has an alpha
        channel.

    Raises
    ------
    UserError : If the file is missing, not a picture or damaged.
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


def reduced(picture: Image.Image, max_side: int) -> Image.Image:
    """A picture with at most so many pixels on its longer side; 0 keeps it."""
    ratio = max_side / max(picture.size)
    if not 0 < ratio < 1:
        return picture
    width, height = (max(1, round(side * ratio)) for side in picture.size)
    return picture.resize((width, height), Image.Resampling.LANCZOS)


def read_images(paths: Iterable[str | os.PathLike[str]]) -> Iterator[UInt8 | UserError]:
    """Read pictures in order, several at a time: `read_image`'s pictures, or its errors."""
    def read(path: str | os.PathLike[str]) -> UInt8 | UserError:
        try:
            return read_image(path)
        except UserError as error:
            return error

    with ThreadPoolExecutor(usable_cores()) as threads:  # decoders let go of Python's lock
        yield from threads.map(read, paths)

_ORIENTATION = 0x0112
_NOTES = {b"eXIf", b"iTXt", b"tEXt", b"zTXt"}
"""Chunks of a PNG that may hold EXIF data, or XMP with an orientation."""


@contextlib.contextmanager
def open_header(path: str | os.PathLike[str]) -> Iterator[Image.Image]:
    """`open_picture` of a picture whose notes can be read without decoding it."""
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

_SMALLEST = 64  # Of a JPEG that is decoded to see whether that succeeds, an eighth is enough.
UNREADABLE = (OSError, ValueError, SyntaxError, RuntimeError, MemoryError, EOFError, struct.error)
"""What decoders raise for damaged pictures."""


def one_line(error: Exception) -> str:
    """The first line of what an error says, or its kind where it says nothing."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]


def fault_of(path: Path) -> str:
    """Why readers refuse a file of a picture's kind (`kind_of`), in one line; empty if not."""
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
    except UNREADABLE as error:
        return one_line(error)


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
    except UNREADABLE:
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


_LABELS = 64  # More values than programs have labels, fewer than soft edges have gray values.
_BRIGHT = 128  # A mask whose person is darker than this is none, or is of labels.


def read_mask(path: Path) -> UInt8:
    """A mask's file, upright by its EXIF orientation, uint8 [H, W], 255 is the person."""
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
    """A decoded picture of any mode as a mask, uint8 [H, W], 255 is the person."""
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
    ``NAME.mask.png``, in the first folder that has one. ``name`` is the photo's file name, with
    folders if it has some there.
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
