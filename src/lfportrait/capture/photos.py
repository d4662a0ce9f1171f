"""Plain photos and videos as upright RGB pictures, before anything is known of the cameras.

A picture that can't be read is left out with a warning: one damaged file among sixty is no reason
to stop. The focal length that the camera wrote into the file (EXIF) is kept, as calibration starts
from it.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps
from scipy import ndimage

from ..errors import UserError

__all__ = ["Photo", "is_video", "load_photos", "read_photos", "read_video", "video_frames"]

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
    if not folder.exists():
        raise UserError(f"there is no folder {folder}; name the folder of your photos")
    if not folder.is_dir():
        raise UserError(f"{folder} is neither a folder of photos nor a video")
    files = _picture_files(folder)
    if not files:
        raise UserError(f"{folder} has no photos in it; put 20 to 100 photos of one person there "
                        "(JPEG or PNG)")
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


def load_photos(path: str | Path) -> list[tuple[str, NDArray[np.uint8]]]:
    """Names and pictures (uint8 [H, W, 3 or 4], upright) of a folder of photos or a video.

    Raises
    ------
    UserError
        If there is nothing that can be read.
    """
    path = Path(path)
    photos = read_video(path) if is_video(path) else read_photos(path)
    return [(photo.name, photo.image) for photo in photos]


def is_video(path: Path) -> bool:
    """Whether a path names a video file."""
    return path.is_file() and path.suffix.lower() in _VIDEOS


def sharpness(image: NDArray[Any]) -> float:
    """Mean squared Laplacian of the grey picture: larger is sharper, for pictures of one scene."""
    grey = image[..., :3].astype(np.float32) @ np.array([0.299, 0.587, 0.114], np.float32)
    return float(np.mean(ndimage.laplace(ndimage.gaussian_filter(grey, 0.7)) ** 2))


def _frames(path: Path) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """Upright frames of a video with their place in it, 0 to 1."""
    import av

    with av.open(str(path)) as container:
        if not container.streams.video:
            raise ValueError("it has no video stream")
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        total = stream.frames
        if not total:
            total = sum(1 for packet in container.demux(stream) if packet.size)
            container.seek(0)
        for index, frame in enumerate(container.decode(stream)):
            turns = round(getattr(frame, "rotation", 0) / 90) % 4
            yield index / max(total, 1), np.rot90(frame.to_ndarray(format="rgb24"), turns)


def video_frames(path: Path) -> tuple[float, Iterator[NDArray[np.uint8]]]:
    """Frames per second of a video, and its upright frames (uint8 [H, W, 3]) one at a time.

    Raises
    ------
    UserError
        If the file is missing or is no video; while the frames are taken, if it is damaged.
    """
    import av

    if not path.is_file():
        raise UserError(f"there is no video {path}")
    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise UserError(f"{path} has no pictures in it")
            rate = float(container.streams.video[0].average_rate or 30)
    except (av.error.FFmpegError, OSError) as error:
        raise UserError(f"the video {path} can't be read: {error}") from error

    def frames() -> Iterator[NDArray[np.uint8]]:
        try:
            for _, frame in _frames(path):
                yield np.ascontiguousarray(frame)
        except (av.error.FFmpegError, OSError) as error:
            raise UserError(f"the video {path} can't be read to its end: {error}") from error

    return rate, frames()


def read_video(path: Path, count: int = 80, max_side: int = 0) -> list[Photo]:
    """Take frames from a video: the sharpest one of each of ``count`` equal spans of time.

    Parameters
    ----------
    path
        Video file.
    count
        Number of frames wanted; a shorter video gives all it has.
    max_side
        Frames are reduced to this many pixels on their longer side; 0 keeps them.

    Raises
    ------
    UserError
        If the file is missing or is no video that can be decoded.
    """
    import av

    if not path.is_file():
        raise UserError(f"there is no video {path}")
    best: dict[int, tuple[float, NDArray[np.uint8]]] = {}
    try:
        for place, frame in _frames(path):
            span = min(int(place * count), count - 1)
            step = max(1, max(frame.shape) // 640)
            score = sharpness(frame[::step, ::step])
            if span not in best or score > best[span][0]:
                best[span] = score, frame
    except (av.error.FFmpegError, OSError, ValueError) as error:
        # A video that breaks off (a camera switched off) is good up to there.
        if not best:
            raise UserError(f"the video {path} can't be read: {error}") from error
        warnings.warn(f"{path.name} is damaged after {100 * place:.0f} % of it", stacklevel=2)
    photos = []
    for span, (_, frame) in sorted(best.items()):
        picture = Image.fromarray(np.ascontiguousarray(frame))
        if max_side and max(picture.size) > max_side:
            ratio = max_side / max(picture.size)
            picture = picture.resize((max(1, round(picture.width * ratio)),
                                      max(1, round(picture.height * ratio))),
                                     Image.Resampling.LANCZOS)
        photos.append(Photo(f"frame_{span:04d}.png", np.asarray(picture)))
    if not photos:
        raise UserError(f"the video {path} has no frames")
    return photos
