"""How photos become a head: by what they share, or by a head that is fitted to the face.

Structure from motion needs photos of one moment that overlap. One photo or two have nothing to
share; up to nine often do not overlap, or are of different days: then a head is fitted to the face
(`lfportrait.face.one_photo`), which is good for a narrower arc.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray

from .. import models
from ..arrays import Float64, UInt8
from ..capture import CalibrateConfig, Capture, is_calibrated, is_video, photo_listing, read_photos
from ..errors import UserError
from ..progress import Progress

MadeFrom = Annotated[Literal["auto", "face", "photos"], tyro.conf.arg(name="from")]
"""What a head is made from: the face, to which a head is fitted; or what the photos share."""
_FEWEST = 3
"""Photos from which on cameras are looked for by what the photos have in common."""
_MANY = 10
"""Photos from which on a head is fitted only where that was asked for."""


class NotTogether(Exception):
    """A few photos that can't be placed together: a head is to be fitted to the face.

    Parameters
    ----------
    error : What is said where that fails, too.
    """

    def __init__(self, error: UserError) -> None:
        super().__init__(str(error))
        self.error = error


def _photo_count(photos: Path) -> int:
    """Photos of a file or a folder; none of a video and of a data set with cameras."""
    if not photos.exists() or is_calibrated(photos) or is_video(photos):
        return 0
    return len(photo_listing(photos).files) if photos.is_dir() else 1


def is_few(photos: Path) -> bool:
    """Whether these are one photo to nine without cameras.

    Raises
    ------
    UserError
        If several folders have photos.
    """
    return 0 < _photo_count(photos) < _MANY


def head_way(photos: Path, made_from: str) -> Literal["face", "photos", "either"]:
    """How photos, a video or a calibrated data set become a head.

    Parameters
    ----------
    photos
        Folder, file or data set.
    made_from
        A choice of ``--from``.

    Returns
    -------
    way
        ``"either"``: by what they share, and if they can't be placed together, by the face.

    Raises
    ------
    UserError
        If a head is to be fitted to what has cameras already, or is a video.
    """
    count = _photo_count(photos)
    if made_from == "face":
        if is_video(photos):
            raise UserError(f"--from face takes photos, and {photos} is a video; save one of its "
                            "frames, or leave out --from face")
        if count == 0 and is_calibrated(photos):
            raise UserError(f"--from face takes photos, and {photos} has cameras already; leave "
                            "out --from face")
        return "face"
    if made_from == "photos" or not 0 < count < _MANY:
        return "photos"
    return "face" if count < _FEWEST else "either"


def _faults(capture: Capture) -> list[str]:
    """What lies before the face in the photo that decides how a head looks."""
    if capture.landmarks is None:
        return []
    points = capture.cameras[0].project(np.asarray(capture.landmarks, np.float64))[0][0]
    image = np.ascontiguousarray(capture.images[0])
    if capture.alphas is not None and capture.figures.get("mattes") == "given":
        # What a cut-out photo holds where it is clear is not seen.
        share = capture.alphas[0][..., None] / np.float32(255)
        image = np.rint(image * share + 153 * (1 - share)).astype(np.uint8)
    return face_faults(image, points, capture.names[0])


def fit_to_face(photos: Path, config: CalibrateConfig, progress: Progress | None = None, *,
                why: str = "", keep_background: bool = False) -> tuple[Capture, dict[str, Any]]:
    """Photos -> a capture with a head that is fitted to the face; figures.

    Parameters
    ----------
    photos : A photo, or a folder of some.
    config : Its ``max_side`` counts.
    progress : Progress line.
    why : A reason for this way, for the line that says so.
    keep_background : Warn that the room behind the person is not kept.

    Raises
    ------
    UserError
        As `lfportrait.face.portrait_capture`.
    """
    from ..face import portrait_capture

    if keep_background:
        warnings.warn("the room behind the person is not kept: a head that is fitted to the face "
                      "has none", stacklevel=3)
    read = read_photos(photos, config.max_side)
    if progress is not None:
        count = f"{len(read)} photo{'s' * (len(read) > 1)}"
        if why:
            progress.say(f"{count} that can't be placed together: a head is fitted to the face "
                         "(--from face)")
        else:
            progress.say(f"{count}: a head is fitted to the face (--from face)")
    capture, fit = portrait_capture(read, progress)
    for fault in _faults(capture):
        warnings.warn(fault, stacklevel=3)
    figures = {"source": "one photo" if len(capture) == 1 else "a few photos", "fit": fit,
               "mattes": capture.figures["mattes"], "views": len(capture), "held_out": 0}
    return capture, {**figures, "not_together": why} if why else figures


_COVERED = 0.5
"""Share of either half of a face under hair from which it counts."""
_HAND = 0.15
"""Share of a face that must be skin of the body for a hand to be there."""
_STRIP = 0.25
"""Share of both halves below which one is not looked at."""
_HALVES = ([27, 28, 29, 30, 33, 31, 3, 2, 1, 0, 17, 18, 19, 20, 21],
           [27, 28, 29, 30, 33, 35, 13, 14, 15, 16, 26, 25, 24, 23, 22])
"""Landmarks around the halves of a face between brows and nose: no beard grows there."""
_WHOLE = [*range(1, 6), 57, *range(11, 16), *range(26, 16, -1)]
"""Around a face without the lowest part of the jaw, as a throat is body, too."""


def _share(mask: NDArray[np.floating], points: Float64) -> float:
    """How much of a polygon is covered by a mask."""
    inside = np.zeros(mask.shape, np.uint8)
    cv2.fillPoly(inside, [np.round(points).astype(np.int32)], 1)
    return float((mask[inside > 0] > 0.5).mean()) if inside.any() else 0.0


def face_faults(image: UInt8, landmarks: Float64, name: str) -> list[str]:
    """Sentences about what lies before a face in a photo; empty where nothing does.

    Parameters
    ----------
    image : uint8 [H, W, 3], sRGB.
    landmarks : float64 [68, 2], pixels.
    name : Of the photo.
    """
    from ..example import spectacles
    from ..face import hair_mask, parts

    found = []
    if not models.missing(["hair-segmentation"]):
        hair = hair_mask(image)
        sizes = [cv2.contourArea(landmarks[half].astype(np.float32)) for half in _HALVES]
        # Of a turned face the far half is a strip.
        share = max(_share(hair, landmarks[half]) for half, size in zip(_HALVES, sizes)
                    if size > _STRIP * sum(sizes))
        if share > _COVERED:
            found.append(f"hair covers {100 * share:.0f} % of one half of the face in {name}: it "
                         "becomes paint on the skin; a photo with the hair combed back is better")
    if not models.missing(["multiclass-segmentation"]):
        share = _share(parts(image)["body-skin"], landmarks[_WHOLE])
        if share > _HAND:
            found.append(f"a hand seems to lie at the face in {name}: it becomes paint on the "
                         "skin; use a photo without it")
    if spectacles(image, landmarks).any():
        found.append(f"glasses in {name} become paint on the skin; a photo without them is better")
    return found
