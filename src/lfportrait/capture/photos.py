"""Plain photos as upright RGB pictures, with what their files say and how sharp they are.

A picture that can't be read is left out with a warning. HEIC is read by pillow-heif. What the
camera wrote into the file (EXIF) is kept: which lens it was, how the camera was held, and the focal
length in pixels, which follows, in this order, from

1. the focal length of an equal lens on 35-mm film (phones and most cameras),
2. the focal length and the pixels to an inch or a centimetre of the sensor,
3. the focal length and the width of the sensor, which COLMAP's table of cameras knows for some
   thousand models (pycolmap).

A picture that was cropped or stitched later still has the sensor's EXIF data; so it is only an
initial value.

Sharpness is the energy of the second derivative at a fine scale over that at a coarse one: exposure
and contrast cancel. A moving camera blurs in one direction only, so it is taken in four, of which
the worst counts. It is relative to the photos taken before and after: what the scene itself has in
fine detail cancels.
"""

import contextlib
import math
import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from ..arrays import Float32, Float64, UInt8
from ..errors import UserError
from ..measure import usable_cores
from ..media.colors import color_space, srgb_from
from ..media.depth import DepthMap, read_depth
from ..media.folders import RAW_PHOTOS, Listing, folders_below, list_pictures, say_left_out
from ..media.kinds import damage_of, kind_of
from ..media.pictures import UNREADABLE, file_of, one_line, open_picture, reduced
from ..simd.threads import side_by_side
from ..temporary import temporary_folder

_TURNED = 0x0112


@dataclass(frozen=True)
class Photo:
    """One upright photo."""

    name: str  # File name without folder, unique in its set.
    image: UInt8  # uint8 [H, W, 3], or [H, W, 4] with straight alpha.
    focal: float | None = None  # Focal length in pixels as the camera noted it, or None.
    # Camera, lens and focal length in millimetres as noted: equal for photos of one lens.
    lens: str = ""
    # Quarter turns (counter-clockwise) from this picture to how the sensor saw it, 0 to 3.
    turns: int = 0
    # What the file keeps of depth, upright as the picture, of a size of its own; or None.
    depth: DepthMap | None = None


def _read_photo(path: Path, max_side: int) -> Photo:
    """Read, turn upright and reduce one picture; raises what Pillow raises."""
    damage = damage_of(path)
    if damage:
        raise OSError(f"it is damaged: {damage}; copy it again from the camera")
    with open_picture(path) as picture:
        notes = noted(picture.getexif(), picture.size)
        profile, space = picture.info.get("icc_profile"), color_space(picture, file_of(picture))
        if max_side:
            # A JPEG can be read at a half or a quarter of its size, in a fraction of the time.
            ratio = max_side / max(picture.size)
            picture.draft(None, (int(picture.width * ratio), int(picture.height * ratio)))
        picture.load()
        # Of a picture of 200 megapixels no second whole copy is made.
        times = min(picture.size) // 4 and max(picture.size) // (2 * max_side) if max_side else 0
        upright = srgb_from(_reduced(picture, times) if times > 1 else picture, profile, space)
    upright = reduced(upright, max_side)
    focal = notes.focal * max(upright.size) if notes.focal else None
    return Photo(path.name, np.asarray(upright), focal, notes.lens, notes.turns,
                 read_depth(path))


def _reduced(picture: Image.Image, times: int) -> Image.Image:
    """A picture reduced by a whole number, with its notes and profile."""
    if picture.mode not in ("L", "LA", "RGB", "RGBA", "CMYK"):
        return picture
    smaller = picture.reduce(times)
    smaller.info = dict(picture.info)
    smaller.getexif()[_TURNED] = picture.getexif().get(_TURNED, 1)
    return smaller


def photo_listing(folder: Path) -> Listing:
    """The pictures of a folder, or of its subfolder ``images``, or of the only one with pictures.

    Cameras keep photos in ``DCIM/100NAME``. Several folders are several people, or an error. Raises
    `UserError` if several folders in it have photos.
    """
    first = Listing([])
    for place in (folder, folder / "images"):
        found = list_pictures(place, photos=True)
        if found.files:
            return found
        first = first if first.left_out else found
    below = {place: found for place in folders_below(folder)
             if (found := list_pictures(place, photos=True)).files}
    if len(below) > 1:
        names = [str(place.relative_to(folder)) for place in below]
        raise UserError(f"{folder} has photos in several folders ({', '.join(names[:4])}"
                        f"{', ...' if len(names) > 4 else ''}); name one of them, or use "
                        "`lfportrait batch` for several people")
    return next(iter(below.values()), first)


def picture_files(folder: Path, *, say: bool = True) -> list[Path]:
    """The pictures of a folder of photos in the order of their names, none of them read.

    They lie in it, or in a subfolder ``images``; or it is one picture. A warning may say which
    other files are left out, and why. Raises `UserError` if the folder is missing or holds none.
    """
    if not folder.exists():
        raise UserError(f"there is no folder {folder}; name the folder of your photos")
    if folder.is_file() and kind_of(folder) == "picture":
        return [folder]
    if not folder.is_dir():
        raise UserError(f"{folder} is neither a photo, nor a folder of photos, nor a video")
    listing = photo_listing(folder)
    if listing.files:
        if say:
            say_left_out(listing, folder, stacklevel=2)
        return listing.files
    if RAW_PHOTOS in listing.left_out:
        raise UserError(f"the photos in {folder} are raw; export them as JPEG or TIFF")
    other = [path for files in listing.left_out.values() for path in files]
    if other and all(kind_of(path) == "video" for path in other):
        raise UserError(f"{folder} holds a video and no photos; name the video itself: {other[0]}")
    raise UserError(f"{folder} has no photos in it; put 20 to 100 photos of one person there "
                    "(JPEG, HEIC or PNG)")


def read_photos(folder: Path, max_side: int = 0) -> list[Photo]:
    """Read the photos of a folder in the order of their names.

    Warnings say which can't be read, and why. Pictures are reduced to ``max_side`` pixels on their
    longer side; 0 keeps them. Raises `UserError` if the folder is missing, or holds no picture that
    can be read.
    """
    files = picture_files(folder)
    # Decoding lets other threads run.
    with ThreadPoolExecutor(min(4, usable_cores())) as readers:
        tried = list(readers.map(partial(_tried, max_side=max_side), files))
    photos = [photo for photo in tried if isinstance(photo, Photo)]
    for path, reason in zip(files, tried):
        if isinstance(reason, str):
            warnings.warn(f"{path.name} can't be read and is left out: {reason}", stacklevel=2)
    if not photos:
        reasons = {reason for reason in tried if isinstance(reason, str)}
        raise UserError(f"none of the {len(files)} pictures in {folder} can be read: "
                        f"{reasons.pop() if len(reasons) == 1 else 'are the files damaged?'}")
    return photos


def _tried(path: Path, max_side: int) -> Photo | str:
    """A photo, or why it can't be read."""
    try:
        return _read_photo(path, max_side)
    except UNREADABLE as error:
        return one_line(error)


def is_video(path: Path) -> bool:
    """Whether a path names a video file, by its content."""
    return path.is_file() and kind_of(path) == "video"


_MAKE, _MODEL, _ORIENTATION, _IFD = 0x010F, 0x0110, 0x0112, 0x8769
_FOCAL, _FOCAL_35MM, _LENS = 0x920A, 0xA405, 0xA434
_PLANE_X, _PLANE_Y, _PLANE_UNIT, _PIXELS_X, _PIXELS_Y = 0xA20E, 0xA20F, 0xA210, 0xA002, 0xA003
# Millimetres of a unit of the focal plane's resolution.
_UNITS = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
# Quarter turns counter-clockwise from the upright picture to the sensor's, by EXIF's orientation.
_TURNS = {6: 1, 3: 2, 8: 3}
# Longer side of a sensor in millimetres: from the smallest phone's to large format. A note that
# leads outside is wrong.
_SENSORS = (2.0, 150.0)
_FILM = 36.0


@dataclass(frozen=True)
class Noted:
    """EXIF data of one picture."""

    # Focal length over the picture's longer side; None where nothing usable is noted.
    focal: float | None = None
    # Where it is from: ``"35 mm"``, ``"focal plane"``, ``"camera model"``; or empty.
    source: str = ""
    # Camera, lens and focal length in millimetres: equal for photos of one lens, not zoomed.
    lens: str = ""
    # Quarter turns (counter-clockwise) from the upright picture to the sensor's, 0 to 3.
    turns: int = 0


def _number(value: Any) -> float:
    """A positive number that a tag holds, else 0."""
    with contextlib.suppress(TypeError, ValueError, ZeroDivisionError):
        number = float(value)
        return number if math.isfinite(number) and number > 0 else 0.0
    return 0.0


def _text(value: Any) -> str:
    return str(value).strip(" \0") if isinstance(value, str) else ""


def _by_plane(tags: Any, length: float, side: int) -> float:
    """Focal length over the longer side by the focal plane's resolution, or 0.

    The resolution is that of the picture as it was taken (``PixelXDimension``); a reduced copy
    keeps both tags.
    """
    unit = _UNITS.get(int(_number(tags.get(_PLANE_UNIT))) or 2, 0.0)
    density = _number(tags.get(_PLANE_X)) or _number(tags.get(_PLANE_Y))
    taken = max(_number(tags.get(_PIXELS_X)), _number(tags.get(_PIXELS_Y))) or float(side)
    if not (unit and density and length):
        return 0.0
    sensor = taken / density * unit
    return length / sensor if _SENSORS[0] < sensor < _SENSORS[1] else 0.0


def _by_model(make: str, model: str, length: float, size: tuple[int, int]) -> float:
    """Focal length over the longer side by COLMAP's table of sensors, or 0."""
    if not (make and model and length):
        return 0.0
    try:
        import pycolmap
    except ImportError:
        return 0.0
    pycolmap.logging.minloglevel = pycolmap.logging.Level.FATAL.value
    exif = Image.Exif()
    exif[_MAKE], exif[_MODEL] = make, model
    exif.get_ifd(_IFD)[_FOCAL] = IFDRational(round(1000 * length), 1000)
    shape = (36, 24) if size[0] >= size[1] else (24, 36)
    with temporary_folder(4096) as folder:
        path = Path(folder) / "note.jpg"
        Image.new("L", shape).save(path, exif=exif)
        found = pycolmap.Bitmap.read(path, True)
        focal = None if found is None else found.exif_focal_length()
    return 0.0 if not focal else float(focal) / max(shape)


_MODELS: dict[tuple[str, str, float], float] = {}
"""Found by `_by_model`: photos of one set repeat themselves."""


def noted(exif: Image.Exif, size: tuple[int, int]) -> Noted:
    """Read the EXIF data of a picture of this width and height in pixels, as Pillow has it.

    What is noted and makes sense; damaged tags count as missing.
    """
    try:
        tags: Any = exif.get_ifd(_IFD)
    except (KeyError, TypeError, ValueError, SyntaxError, OSError):
        tags = {}
    make, model = _text(exif.get(_MAKE)), _text(exif.get(_MODEL))
    length, film = _number(tags.get(_FOCAL)), _number(tags.get(_FOCAL_35MM))
    focal, source = film / _FILM, "35 mm"
    if not focal:
        focal, source = _by_plane(tags, length, max(size)), "focal plane"
    if not focal and length:
        key = make, model, length
        if key not in _MODELS:
            _MODELS[key] = _by_model(make, model, length, size)
        focal, source = _MODELS[key], "camera model"
    if not 0.2 < focal < 50:
        focal, source = 0.0, ""
    # The orientation is a whole number wherever it is anything.
    turns = _TURNS.get(int(_number(exif.get(_ORIENTATION))), 0)
    lens = " ".join(part for part in (make, model, _text(tags.get(_LENS)),
                                      f"{length:.4g} mm" if length else "",
                                      f"({film:.4g} mm)" if film else "") if part)
    return Noted(focal or None, source, lens, turns)


_SIDE = 960
_FINE, _COARSE = 0.8, 2.4
_NEIGHBOURS = 4


def _second_derivatives(grey: Float32, sigma: float) -> list[Float32]:
    """xx, xy and yy of the picture smoothed by ``sigma`` pixels."""
    reach = int(np.ceil(4 * sigma))
    x = np.arange(-reach, reach + 1) / sigma
    bell = np.exp(-0.5 * x * x)
    bell /= bell.sum()
    smooth, slope, bend = bell, -x * bell, (x * x - 1) * bell
    bend = bend - bend.mean()
    found = []
    for along, across in ((bend, smooth), (slope, slope), (smooth, bend)):
        plane = cv2.sepFilter2D(grey, cv2.CV_32F, along, across, borderType=cv2.BORDER_REPLICATE)
        found.append(np.asarray(plane, np.float32))
    return found


def fineness(image: UInt8, side: int = _SIDE) -> Float64:
    """Fine over coarse detail along 0, 45, 90 and 135 degrees, float64 [4].

    Of uint8 [H, W], or of the first three channels of [H, W, 3 or more]; reduced first to ``side``
    pixels on the longer side.
    """
    grey = image if image.ndim == 2 else cv2.cvtColor(
        np.ascontiguousarray(image[..., :3]), cv2.COLOR_RGB2GRAY)
    factor = side / max(grey.shape)
    if factor < 1:
        grey = cv2.resize(np.ascontiguousarray(grey), None, fx=factor, fy=factor,
                          interpolation=cv2.INTER_AREA)
    energies = []
    for sigma in (_FINE, _COARSE):
        xx, xy, yy = _second_derivatives(grey.astype(np.float32), sigma)
        # The second derivative along (c, s) is c^2 xx + 2 c s xy + s^2 yy.
        energies.append([float(np.mean(np.square(plane))) for plane in (
            xx, 0.5 * (xx + yy) + xy, yy, 0.5 * (xx + yy) - xy)])
    # A flat picture has no detail at all: the small term keeps its ratio finite.
    return (np.array(energies[0]) + 1e-6) / (np.array(energies[1]) + 1e-6)


def relative_sharpness(measures: Float64, groups: Sequence[Any] | None = None,
                       reach: int = _NEIGHBOURS) -> Float64:
    """Sharpness of each picture relative to its neighbours, float64 [V]; 1 is usual.

    By the `fineness` of each, float64 [V, 4], among ``reach`` neighbours on either side that are of
    the same of ``groups``, as their size; by default all are.
    """
    groups = [0] * len(measures) if groups is None else groups
    found = np.ones(len(measures))
    for index, own in enumerate(measures):
        before = [i for i in range(index) if groups[i] == groups[index]][-reach:]
        after = [i for i in range(index + 1, len(measures)) if groups[i] == groups[index]][:reach]
        if before or after:
            found[index] = float((own / np.median(measures[before + after], axis=0)).min())
    return found


def blurred(images: Sequence[UInt8], threshold: float) -> list[int]:
    """Indices of the pictures that are blurred relative to their neighbours, in order.

    The pictures, uint8 [H, W, 3 or 4], are in the order in which they were taken. Blurred are those
    whose fine detail, in their worst direction, is below the part ``threshold`` of their
    neighbours'; the worst, a quarter of the pictures at most; of fewer than six, too few to
    compare, none.
    """
    if threshold <= 0 or len(images) < 6:
        return []
    sharp = relative_sharpness(np.array(side_by_side(fineness, images)),
                               [image.shape[:2] for image in images])
    worst = np.argsort(sharp, kind="stable")[:len(images) // 4]
    return sorted(int(index) for index in worst if sharp[index] < threshold)
