"""What is found in a painting: its faces, its regions, and what it will give."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ... import models
from ...arrays import Float64
from ...capture import FAIR, GOOD
from ...errors import UserError
from ...example import Exemplar
from ...face import GENERIC_LANDMARKS, detect_faces, write_landmarks
from ...files import write_image, write_json
from ...job import check_style, chosen_face
from ...labels import BY_HAND
from ...media.pictures import read_image
from .sitting import Sitting

__all__ = ["PAINTING_ANSWERS", "usual_face"]

Facts = Mapping[str, Any]
_NOSE = 30
"""Its tip among the 68."""


def _faces(sitting: Sitting, facts: Facts) -> dict[str, Any]:
    """All faces of a picture, kept in a file."""
    path = Path(facts["style"])
    if path.is_file():
        image = np.ascontiguousarray(read_image(path)[..., :3])
        if not models.available("face-landmarker"):  # all points are set by hand
            return {"width": image.shape[1], "height": image.shape[0], "faces": []}
        found = detect_faces(image)
    else:
        exemplar = sitting.exemplar(str(path))
        image, found = exemplar.image, [exemplar.landmarks]
    data = {"width": image.shape[1], "height": image.shape[0],
            "faces": [np.round(points, 2).tolist() for points in found]}
    write_json(facts["file"], data)
    return data


def _choose(sitting: Sitting, facts: Facts) -> dict[str, Any]:
    """Write the landmarks of the face that is meant beside the painting."""
    path = Path(facts["style"])
    image = np.ascontiguousarray(read_image(path)[..., :3])
    at = facts.get("at")
    if at is None:
        points, _ = chosen_face(path, image, int(facts.get("face", 0)))
    else:
        place = float(at[0]), float(at[1])
        try:
            points, _ = chosen_face(path, image, 0, place)
        except UserError:  # not even there: then all points are set by hand, from a usual face
            points = usual_face(place, image.shape[1], image.shape[0])
    write_landmarks(path.with_suffix(".landmarks.txt"), points)
    return {"points": points.tolist()}


def usual_face(place: tuple[float, float], width: int, height: int) -> Float64:
    """Landmarks of a usual face with the tip of its nose at a place, to be corrected by hand.

    Parameters
    ----------
    place
        x and y in pixels.
    width, height
        Of the picture: the face takes two fifths of the shorter side, or less near the border.

    Returns
    -------
    points
        float64 [68, 2], in the picture as far as the place allows it.
    """
    nose = np.clip(place, 0, [width - 1, height - 1])
    face = (GENERIC_LANDMARKS[:, :2] - GENERIC_LANDMARKS[_NOSE, :2]) * [1, -1]
    reach = np.array([-face.min(0), face.max(0)])
    room = np.array([nose, [width - 1, height - 1] - nose]) / reach
    scale = 0.4 * min(width, height) / np.ptp(face[:, 1])
    points: Float64 = nose + face * max(min(scale, room.min()), 0.25 * scale)
    return points


def _check(sitting: Sitting, facts: Facts) -> dict[str, Any]:
    """What a painting will give, without a preview."""
    found = check_style(facts["style"], preview=False)
    return {"facts": [{"grade": "good" if color == GOOD else "fair" if color == FAIR else "bad",
                       "text": text} for color, text in found.facts],
            "pose": found.figures["pose"], "face_pixels": found.figures["face_pixels"]}


def _regions(sitting: Sitting, facts: Facts) -> dict[str, Any]:
    """Write what the detectors see in a painting as a picture of regions."""
    style = facts["style"]
    path = Path(style)
    exemplar = sitting.exemplar(style)
    if path.is_file():
        # Without what was painted over by hand.
        exemplar = Exemplar(exemplar.image, exemplar.landmarks, exemplar.name)
    regions = exemplar.regions()
    value = {name: number for number, name in enumerate(BY_HAND)}
    picture = np.full(exemplar.image.shape[:2], value["background"], np.uint8)
    person = regions.person > 0.5
    picture[person] = value["skin"]
    height, width = exemplar.image.shape[:2]
    _, down = regions.frame.local((height, width))
    picture[person & (down > 1.02)] = value["neck"]
    if regions.hair is not None:
        picture[person & (regions.hair > 0.5)] = value["hair"]
    write_image(facts["file"], picture)
    return {"width": width, "height": height}


def _copy(sitting: Sitting, facts: Facts) -> dict[str, Any]:
    """Copy a style as a picture with its landmarks beside it."""
    exemplar = sitting.exemplar(facts["style"])
    target = Path(facts["file"])
    write_image(target, exemplar.image)
    write_landmarks(target.with_suffix(".landmarks.txt"), exemplar.landmarks)
    if exemplar.mask is not None:
        write_image(target.with_suffix(".mask.png"), exemplar.mask)
    return {}


PAINTING_ANSWERS: dict[str, Callable[[Sitting, Facts], dict[str, Any]]] = {
    "faces": _faces, "choose": _choose, "check_style": _check, "regions": _regions,
    "copy_style": _copy}
