"""How a head comes of what people bring: by what photos share, or fitted to the face.

Structure from motion needs photos of one moment that overlap. One photo or two have nothing to
share; up to nine often do not overlap, or are of different days: then a head is fitted to the face
(`lfportrait.face.one_photo`), which is good for a narrower arc (`head_way`).

Many photos, and videos, share what does not move. Somebody who talks to a camera on a tripod moves,
and is seen from one side: fields of such films were smeared monsters, or empty. The landmarks of a
face in some forty of the pictures tell both (`face_changes`, `arc_of`), before anything else is
computed; a head is then fitted to the best of the pictures (`best_pictures`).
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
import numpy as np
import tyro

from .. import models
from ..arrays import Float64, Floats, UInt8
from ..capture import (
    CalibrateConfig,
    Capture,
    Photo,
    fineness,
    is_calibrated,
    is_video,
    photo_listing,
    read_source,
)
from ..errors import UserError
from ..face import FROM_MEDIAPIPE, face_mesh, face_pose
from ..progress import Progress, note, say

MadeFrom = Annotated[Literal["auto", "face", "photos"], tyro.conf.arg(name="from")]
"""What a head is made from: the face, to which a head is fitted; or what the photos share."""
_FEWEST = 3  # Photos from which on cameras are looked for by what the photos have in common.
_MANY = 10
"""Photos from which on a head is fitted to the best one, and only where that was asked for or the
face decides (`reason_to_fit`)."""


class NotTogether(Exception):
    """A few photos that can't be placed together: a head is to be fitted to the face.

    ``error`` is said where that fails, too.
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
    """Whether these are one photo to nine without cameras."""
    return 0 < _photo_count(photos) < _MANY


def head_way(photos: Path, made_from: str) -> Literal["face", "photos", "either"]:
    """How photos, a video or a calibrated data set become a head by a choice of ``--from``.

    ``"either"``: by what they share, and if they can't be placed together, by the face. Raises
    `UserError` if a head is to be fitted to what has cameras already.
    """
    count = _photo_count(photos)
    if made_from == "face":
        if is_calibrated(photos):
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


def _first_fitted(tries: list[list[Photo]], progress: Progress | None,
                  ) -> tuple[Capture, dict[str, Any]]:
    """A head that is fitted to the first photos that one can be fitted to; figures of the fit."""
    from ..face import portrait_capture

    refused: UserError | None = None
    for photos in tries:
        try:
            return portrait_capture(photos, progress)
        except UserError as error:
            refused = refused or error
    assert refused is not None
    raise refused


def _say_fitted(progress: Progress | None, what: str, why: str, reason: str) -> None:
    """Say what a head is fitted to, and why (`fit_to_face`)."""
    if why:
        say(progress, f"{what} that can't be placed together: a head is fitted to the face (--from "
                      "face)")
    elif reason:
        say(progress, f"{what}, as {reason}: a head is fitted to the face (--from face; --from "
                      "photos uses all)")
    else:
        say(progress, f"{what}: a head is fitted to the face (--from face)")


def fit_to_face(photos: Path, config: CalibrateConfig, progress: Progress | None = None, *,
                why: str = "", reason: str = "", keep_background: bool = False,
                read: list[Photo] | None = None) -> tuple[Capture, dict[str, Any]]:
    """A photo, a folder of some, or a video -> a capture with a head fitted to the face; figures.

    Of more than nine pictures, of a video, and where there is a ``reason``, the best one is taken.
    ``why`` they can't be placed, or the ``reason`` why that was not tried (`reason_to_fit`), is for
    the line that says so; ``read`` are the pictures, where they were read already. Raises
    `UserError` as `lfportrait.face.portrait_capture`, or if none of many pictures shows a face.
    """
    if keep_background:
        warnings.warn("the room behind the person is not kept: a head that is fitted to the face "
                      "has none", stacklevel=3)
    if read is None:
        note(progress, "reading photos")
        read = read_source(photos, config.max_side, config.video_frames)
    count = len(read)
    if count > 1 and (reason or count >= _MANY or is_video(photos)):
        best = best_pictures(read, progress)[:_TRIES]
        capture, fit = _first_fitted([[one] for one in best], progress)
        _say_fitted(progress, f"the best of {count} pictures, {capture.names[0]}", why, reason)
    else:
        _say_fitted(progress, f"{count} photo{'s' * (count > 1)}", why, reason)
        capture, fit = _first_fitted([read], progress)
    for fault in _faults(capture):
        warnings.warn(fault, stacklevel=3)
    figures = {"source": "one photo" if len(capture) == 1 else "a few photos", "fit": fit,
               "mattes": capture.figures["mattes"], "views": len(capture), "held_out": 0}
    said = {"not_together": why, "fitted_because": reason}
    return capture, {**figures, **{name: text for name, text in said.items() if text}}


_LOOKS = 40  # Pictures at most that are looked at to tell how a face moves.
_CHANGED = {"mouth": 0.07, "width": 0.065}
"""Spread (of the middle 80 %) of a mouth's opening and width, over the distance of the outer
corners of the eyes, from which on a face moves. In nine films of faces that do, the first is 0.08
to 0.49 (0.005 where lips are pressed), the second 0.07 to 0.25; of a smile that is held both are
0.057, of heads that hold still up to 0.024 and 0.042."""
_TURN = 60.0
"""Degrees of the arc from which on photos are placed even if a mouth moves in them: all else of
the head is seen from both sides."""
_ONE_SIDE = 6.0
"""Degrees of the arc below which no shape can be seen, however still the head is held."""
_LYING = 45.0  # Degrees by which heads lean in pictures that lie on their side.
_SEEN = 0.6  # Share of the pictures that must show a face for its movements to decide.
_TRIES = 4  # How many of the best pictures are tried.
_FRONTAL = 30.0  # Degrees up to which a mouth's width is compared.


@dataclass(frozen=True)
class FaceLook:
    """A face in one picture, as far as it tells which picture is good."""

    # Degrees by which the head is turned from the camera, and looks up; and how it leans.
    yaw: float
    pitch: float
    roll: float
    eyes: float  # Their opening over their width.
    gaze: float  # How far the irises lie beside the middle of the eyes, over the eyes' width.
    # Over the distance of the outer corners of the eyes: the mouth's opening and width, the height
    # of the brows above the eyes.
    mouth: float
    width: float
    brows: float
    size: float  # That distance in pixels, as of a face that is not turned.
    sharpness: float  # Fine over coarse detail of the face (`lfportrait.capture.fineness`).


def look_at_face(image: UInt8) -> FaceLook | None:
    """What a picture, uint8 [H, W, 3 or 4], shows of its face; None without a face."""
    image = np.ascontiguousarray(image[..., :3])
    mesh = face_mesh(image)
    if mesh is None:
        return None
    points = mesh[FROM_MEDIAPIPE]
    pose = face_pose(points)
    # Where the camera is, in the head's frame: the same in a picture that lies on its side.
    side, above, front = pose.rotation[2]
    yaw, pitch = np.degrees([np.arctan2(-side, front), -np.arcsin(np.clip(above, -1, 1))])
    seen = max(float(np.cos(np.radians(yaw))), 0.5)  # how much of its width is seen

    def apart(one: int, two: int) -> float:
        return float(np.linalg.norm(points[one] - points[two]))

    size = apart(36, 45) / seen
    eyes = np.mean([apart(upper, lower) / max(apart(*corners), 1e-6)
                    for upper, lower, corners in ((37, 41, (36, 39)), (38, 40, (36, 39)),
                                                  (43, 47, (42, 45)), (44, 46, (42, 45)))])
    gaze = np.mean([_along(points[[first, last]], mesh[iris]) - 0.5
                    for first, last, iris in ((36, 39, 468), (42, 45, 473))])
    brows = float(np.linalg.norm(points[17:27].mean(axis=0) - points[36:48].mean(axis=0)))
    low = np.clip(points.min(axis=0), 0, None).astype(int)
    high = points.max(axis=0).astype(int) + 1
    face = image[low[1]:high[1], low[0]:high[0]]
    sharp = float(fineness(face).mean()) if min(face.shape[:2]) > 8 else 0.0
    size = max(size, 1e-6)
    return FaceLook(float(yaw), float(pitch), pose.roll, float(eyes), float(gaze),
                    apart(62, 66) / size, apart(48, 54) / size / seen, brows / size, size, sharp)


def _along(ends: Float64, point: Float64) -> float:
    """Where a point lies along the line between two ends, float64 [2, 2]: 0 to 1."""
    line = ends[1] - ends[0]
    return float((point - ends[0]) @ line / max(float(line @ line), 1e-9))


def face_changes(looks: Sequence[FaceLook]) -> bool:
    """Whether a face's mouth moves from picture to picture."""
    frontal = [one for one in looks if abs(one.yaw) < _FRONTAL]
    return len(frontal) > 2 and any(
        float(np.ptp(np.quantile([getattr(one, what) for one in frontal], [0.1, 0.9]))) > most
        for what, most in _CHANGED.items())


def arc_of(looks: Sequence[FaceLook]) -> float:
    """Degrees of the arc, from side to side or up and down, over which a face is seen."""
    angles = np.array([(one.yaw, one.pitch) for one in looks])
    return float(np.ptp(np.quantile(angles, [0.05, 0.95], axis=0), axis=0).max())


def reason_to_fit(photos: Sequence[Photo], progress: Progress | None = None) -> str:
    """Why a head is fitted to the face in many pictures of a person, in words; empty: it is not."""
    if models.missing(["face-landmarker", "person-segmentation"]):
        return ""
    note(progress, "looking at the face")
    chosen = photos[::max(1, -(-len(photos) // _LOOKS))]
    looks = [one for one in (look_at_face(photo.image) for photo in chosen) if one is not None]
    if len(looks) < max(_SEEN * len(chosen), 3):
        return ""
    if np.median([abs(one.roll) for one in looks]) > _LYING:  # no head is fitted to these
        return ""
    arc = arc_of(looks)
    if arc < _ONE_SIDE:
        return f"they show the face from one side only, over {arc:.0f} degrees"
    if arc < _TURN and face_changes(looks):
        return "the face moves in them"
    return ""


def best_pictures(photos: Sequence[Photo], progress: Progress | None = None) -> list[Photo]:
    """Those of many pictures that show a face, the one first to which a head is fitted best.

    Its face is seen from the front, sharp and large, the eyes open and at the camera, the mouth
    shut and relaxed. Raises `UserError` if none shows a face.
    """
    looks = []
    for number, photo in enumerate(photos):
        note(progress, f"choosing the best picture: {number + 1} of {len(photos)}")
        looks.append(look_at_face(photo.image))
    seen = [index for index, look in enumerate(looks) if look is not None]
    if not seen:
        raise UserError("no face was found; a portrait needs a picture that shows the face from "
                        "the front, upright and in focus")
    costs = _costs([look for look in looks if look is not None])
    return [photos[seen[place]] for place in np.argsort(costs, kind="stable")]


def _costs(faces: Sequence[FaceLook]) -> Float64:
    """How far each picture is from a good one."""
    yaw, pitch, _, eyes, gaze, mouth, width, brows, size, sharp = (
        np.array([getattr(one, field.name) for one in faces]) for field in fields(FaceLook))
    open_wide = eyes - np.quantile(eyes, 0.6)
    relaxed = np.clip(np.median(width), *_RELAXED)
    small = np.log2(size.max() / np.maximum(size, 1e-6))
    blurred = 1.5 * np.log2((sharp.max() + 1e-6) / (sharp + 1e-6))
    terms = (yaw / 10, (pitch - _LEVEL) / 15, np.where(open_wide < 0, 0.06, 0.12) ** -1 * open_wide,
             gaze / 0.08, mouth / 0.08, (width - relaxed) / 0.08,
             (brows - np.quantile(brows, 0.25)) / 0.08, small, blurred)
    return np.asarray(sum(term ** 2 for term in terms), np.float64)


_RELAXED = (0.52, 0.6)
"""Widths of a mouth that neither laughs nor pouts, over the distance of the eyes' corners."""
_LEVEL = 5.0  # Pitch that `face_pose` finds in faces which look straight ahead, degrees.


_COVERED = 0.5  # Share of either half of a face under hair from which it counts.
_HAND = 0.15  # Share of a face that must be skin of the body for a hand to be there.
_STRIP = 0.25  # Share of both halves below which one is not looked at.
_HALVES = ([27, 28, 29, 30, 33, 31, 3, 2, 1, 0, 17, 18, 19, 20, 21],
           [27, 28, 29, 30, 33, 35, 13, 14, 15, 16, 26, 25, 24, 23, 22])
"""Landmarks around the halves of a face between brows and nose: no beard grows there."""
_WHOLE = [*range(1, 6), 57, *range(11, 16), *range(26, 16, -1)]
"""Around a face without the lowest part of the jaw, as a throat is body, too."""


def _share(mask: Floats, points: Float64) -> float:
    """How much of a polygon is covered by a mask."""
    inside = np.zeros(mask.shape, np.uint8)
    cv2.fillPoly(inside, [np.round(points).astype(np.int32)], 1)
    return float((mask[inside > 0] > 0.5).mean()) if inside.any() else 0.0


def hand_at_face(image: UInt8, landmarks: Float64) -> float:
    """Share of a face that is skin of the body; 0 without the network of parts."""
    from ..face import parts

    if models.missing(["multiclass-segmentation"]):
        return 0.0
    return _share(parts(image)["body-skin"], landmarks[_WHOLE])


def face_faults(image: UInt8, landmarks: Float64, name: str) -> list[str]:
    """Sentences about what lies before a face in a photo; empty where nothing does.

    The photo is uint8 [H, W, 3], sRGB, its landmarks float64 [68, 2] in pixels.
    """
    from ..face import IN_PHOTOS, dark_glasses, find_spectacles, hair_mask

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
    if hand_at_face(image, landmarks) > _HAND:
        found.append(f"a hand seems to lie at the face in {name}: it becomes paint on the skin; "
                     "use a photo without it")
    if dark_glasses(image, landmarks):
        found.append(f"dark glasses hide the eyes in {name}: they become paint on the skin; use a "
                     "photo without them")
    elif find_spectacles(image, landmarks, sure=IN_PHOTOS) is not None:
        found.append(f"the glasses in {name} become wires before the eyes; a photo without them "
                     "is better")
    return found
