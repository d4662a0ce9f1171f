"""Plain photos as upright RGB pictures, before anything is known of the cameras.

A picture that can't be read is left out with a warning: one damaged file among sixty is no reason
to stop. What the camera wrote into the file (EXIF) is kept, as calibration starts from it: the
focal length, which lens it was, how the camera was held. HEIC, which phones write, is read by
pillow-heif.
"""

from __future__ import annotations

import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from PIL import Image

from ..arrays import UInt8
from ..errors import UserError
from ..measure import usable_cores
from ..media.colors import color_space, srgb_from
from ..media.depth import DepthMap, read_depth
from ..media.folders import RAW_PHOTOS, Listing, folders_below, list_pictures, say_left_out
from ..media.kinds import damage_of, kind_of
from ..media.pictures import file_of, open_picture
from .exif import noted

__all__ = ["Photo", "is_video", "photo_listing", "picture_files", "read_photos"]

_ORIENTATION = 0x0112


@dataclass(frozen=True)
class Photo:
    """One upright photo.

    Attributes
    ----------
    name
        File name without folder, unique in its set.
    image
        uint8 [H, W, 3], or [H, W, 4] with straight alpha.
    focal
        Focal length in pixels as the camera noted it, or None.
    lens
        Camera, lens and focal length in millimetres as noted: equal for photos of one lens.
    turns
        Quarter turns (counter-clockwise) from this picture to how the sensor saw it, 0 to 3.
    depth
        What the file keeps of depth, upright as the picture, of a size of its own; or None.
    """

    name: str
    image: UInt8
    focal: float | None = None
    lens: str = ""
    turns: int = 0
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
    if max_side and max(upright.size) > max_side:
        ratio = max_side / max(upright.size)
        size = [max(1, round(side * ratio)) for side in upright.size]
        upright = upright.resize((size[0], size[1]), Image.Resampling.LANCZOS)
    focal = notes.focal * max(upright.size) if notes.focal else None
    return Photo(path.name, np.asarray(upright), focal, notes.lens, notes.turns,
                 read_depth(path))


def _reduced(picture: Image.Image, times: int) -> Image.Image:
    """A picture reduced by a whole number, with its notes and profile."""
    if picture.mode not in ("L", "LA", "RGB", "RGBA", "CMYK"):
        return picture
    smaller = picture.reduce(times)
    smaller.info = dict(picture.info)
    smaller.getexif()[_ORIENTATION] = picture.getexif().get(_ORIENTATION, 1)
    return smaller


def photo_listing(folder: Path) -> Listing:
    """The pictures of a folder, or of its subfolder ``images``, or of the only one with pictures.

    Cameras keep photos in ``DCIM/100NAME``. Several folders are several people, or an error.

    Raises
    ------
    UserError
        If several folders in it have photos.
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

    Parameters
    ----------
    folder
        Folder with pictures, or with a subfolder ``images``; or one picture.
    say
        Whether a warning says which other files are left out, and why.

    Raises
    ------
    UserError
        If the folder is missing or holds none.
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

    Parameters
    ----------
    folder
        Folder with pictures, or with a subfolder ``images``.
    max_side
        Pictures are reduced to this many pixels on their longer side; 0 keeps them.

    Returns
    -------
    photos
        Those that could be read; for each other one a warning says why.

    Raises
    ------
    UserError
        If the folder is missing, or holds no picture that can be read.
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
    except (OSError, ValueError, SyntaxError, RuntimeError, MemoryError) as error:
        return str(error).splitlines()[0] if str(error) else type(error).__name__


def is_video(path: Path) -> bool:
    """Whether a path names a video file, by its content."""
    return path.is_file() and kind_of(path) == "video"
