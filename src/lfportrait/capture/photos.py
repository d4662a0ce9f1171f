"""Plain photos as upright RGB pictures, before anything is known of the cameras.

A picture that can't be read is left out with a warning: one damaged file among sixty is no reason
to stop. The focal length that the camera wrote into the file (EXIF) is kept, as calibration starts
from it.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from ..errors import UserError

__all__ = ["Photo", "is_video", "picture_files", "read_photos"]

_PICTURES = {".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".bmp"}
_HEIC = {".heic", ".heif", ".avif"}
_VIDEOS = {".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm"}
_EXIF_IFD, _FOCAL_35MM = 0x8769, 0xA405


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
    """

    name: str
    image: NDArray[np.uint8]
    focal: float | None = None


def _read_photo(path: Path, max_side: int) -> Photo:
    """Read, turn upright and reduce one picture; raises what Pillow raises."""
    with Image.open(path) as picture:
        stated = picture.getexif().get_ifd(_EXIF_IFD).get(_FOCAL_35MM)
        picture.load()
        upright: Image.Image = ImageOps.exif_transpose(picture)
        alpha = "A" in upright.getbands() or "transparency" in upright.info
        upright = upright.convert("RGBA" if alpha else "RGB")
    if max_side and max(upright.size) > max_side:
        ratio = max_side / max(upright.size)
        size = [max(1, round(side * ratio)) for side in upright.size]
        upright = upright.resize((size[0], size[1]), Image.Resampling.LANCZOS)
    focal = None
    try:
        # The 35 mm equivalent is relative to the film's long side of 36 mm.
        if stated and float(stated) > 0:
            focal = float(stated) / 36.0 * max(upright.size)
    except (TypeError, ValueError):
        focal = None
    return Photo(path.name, np.asarray(upright), focal)


def _picture_files(folder: Path) -> list[Path]:
    """The pictures of a folder, or of its subfolder ``images`` where it has none itself."""
    def files(place: Path) -> list[Path]:
        return sorted(path for path in place.iterdir()
                      if path.is_file() and not path.name.startswith(".")
                      and path.suffix.lower() in _PICTURES | _HEIC)

    found = files(folder)
    if not found and (folder / "images").is_dir():
        found = files(folder / "images")
    return found


def _unique(photos: list[Photo]) -> list[Photo]:
    """Names whose stems differ too, as a capture stores every picture as STEM.png."""
    seen: set[str] = set()
    result = []
    for photo in photos:
        stem, suffix = Path(photo.name).stem, Path(photo.name).suffix
        name, number = stem, 1
        while name in seen:
            number += 1
            name = f"{stem}_{number}"
        seen.add(name)
        result.append(Photo(name + suffix, photo.image, photo.focal))
    return result


def picture_files(folder: Path) -> list[Path]:
    """The pictures of a folder of photos in the order of their names, none of them read.

    Raises
    ------
    UserError
        If the folder is missing or holds none.
    """
    if not folder.exists():
        raise UserError(f"there is no folder {folder}; name the folder of your photos")
    if not folder.is_dir():
        raise UserError(f"{folder} is neither a folder of photos nor a video")
    files = _picture_files(folder)
    if not files:
        raise UserError(f"{folder} has no photos in it; put 20 to 100 photos of one person there "
                        "(JPEG or PNG)")
    return files


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
    photos = []
    heic = 0
    for path in files:
        if path.suffix.lower() in _HEIC:
            heic += 1
            continue
        try:
            photos.append(_read_photo(path, max_side))
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            warnings.warn(f"{path.name} can't be read and is left out: {reason}", stacklevel=2)
    if heic:
        advice = "HEIC pictures can't be read; export them as JPEG"
        if not photos:
            raise UserError(f"{folder}: {advice}")
        warnings.warn(f"{heic} pictures are left out: {advice}", stacklevel=2)
    if not photos:
        raise UserError(f"none of the {len(files)} pictures in {folder} can be read; are the files "
                        "damaged?")
    return _unique(photos)


def is_video(path: Path) -> bool:
    """Whether a path names a video file."""
    return path.is_file() and path.suffix.lower() in _VIDEOS
