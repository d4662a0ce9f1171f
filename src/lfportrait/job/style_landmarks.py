"""Landmarks of a painting: found, written beside it to be corrected, and drawn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from ..arrays import Float64, UInt8
from ..errors import UserError
from ..example import Exemplar
from ..face import face_pose, read_landmarks, write_landmarks
from ..files import write_image
from ..media.pictures import read_image
from .style_check import StyleCheck, chosen_face
from .style_drawing import draw_faces, draw_mesh

__all__ = ["add_style"]

_LINES = ((0, 17), (17, 22), (22, 27), (27, 31), (31, 36), (36, 42), (42, 48), (48, 60), (60, 68))
"""First and last point of each line through the 68 landmarks."""
_CLOSED = {36, 42, 48, 60}


def add_style(path: Path, face: int = 0, at: tuple[float, float] | None = None) -> dict[str, Any]:
    """Landmarks of a painting: found and written beside it, or read from there; and drawn.

    Parameters
    ----------
    path
        The picture.
    face, at
        Which face, as `chosen_face` takes them.

    Returns
    -------
    figures
        ``image``, ``landmarks`` and ``picture`` (the files), ``pose``, ``faces`` (how many were
        found) and ``said``: lines for the user.

    Raises
    ------
    UserError
        If there is no such face, or landmarks are there already and another face is asked for.
    """
    image = np.ascontiguousarray(read_image(path)[..., :3])
    beside, drawn = path.with_suffix(".landmarks.txt"), path.with_suffix(".landmarks.png")
    faces: list[Float64] = []
    if beside.exists():
        if face or at is not None:
            raise UserError(f"{beside} already exists; remove it to use another face")
        points = np.asarray(read_landmarks(beside), np.float64)
        said = [f"{beside} already exists and was drawn; remove it to detect the landmarks again"]
    else:
        points, faces = chosen_face(path, image, face, at)
        write_landmarks(beside, points)
        said = [f"wrote {beside}; look at {drawn.name}, and where points are off correct them "
                "there"]
        if len(faces) > 1:
            said.append(f"{len(faces)} faces, numbered in {drawn.name}: this is number "
                        f"{max(face, 1)}; remove {beside.name} and use --face N for another")
    pose = face_pose(points)
    check = StyleCheck(Exemplar(image, points, path.stem), faces, pose)
    write_image(drawn, draw_landmarks(check), sheet=True)
    return {"image": str(path), "landmarks": str(beside), "picture": str(drawn),
            "pose": pose.angles, "faces": max(len(faces), 1), "said": said}


def draw_landmarks(check: StyleCheck) -> UInt8:
    """The picture with mesh and numbered landmarks, enlarged so that the numbers can be read."""
    image, points = check.exemplar.image, check.exemplar.landmarks
    size = float(np.ptp(points, axis=0).max())
    factor = int(np.clip(np.ceil(900 / max(size, 1.0)), 1, 6))
    picture = Image.fromarray(image).resize((image.shape[1] * factor, image.shape[0] * factor))
    draw = ImageDraw.Draw(picture)
    draw_mesh(draw, check, factor)
    draw_faces(draw, check, factor)
    places = [(float(x) * factor, float(y) * factor) for x, y in points]
    for first, end in _LINES:
        line = places[first:end] + ([places[first]] if first in _CLOSED else [])
        draw.line(line, fill=(0, 160, 255), width=2)
    for number, (x, y) in enumerate(places):
        draw.ellipse((x - 3, y - 3, x + 3, y + 3), fill=(255, 40, 40))
        draw.text((x + 4, y - 5), str(number), fill=(0, 220, 0), stroke_width=2,
                  stroke_fill=(0, 0, 0))
    return np.asarray(picture, np.uint8)
