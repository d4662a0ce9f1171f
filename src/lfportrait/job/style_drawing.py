"""Drawings of a painting: the page that `styles check` draws, and its landmarks to be corrected."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from ..arrays import Float64, UInt8
from ..capture import FAIR, GOOD, INK, PAPER, font
from ..errors import UserError
from ..example import Exemplar, head_mesh
from ..face import face_pose, read_landmarks, write_landmarks
from ..files import write_image
from ..media.pictures import read_image
from .photo_check import wrapped
from .style_check import StyleCheck, chosen_face

_WIDTH, _TALL, _GAP = 1680, 620, 24
_MESH, _TINT = (0, 200, 255), np.array([255.0, 120.0, 40.0])


def draw_mesh(draw: ImageDraw.ImageDraw, check: StyleCheck, factor: float) -> None:
    """The generic head's mesh in the face's pose, on a picture ``factor`` times as large."""
    for line in head_mesh(check.exemplar.landmarks, check.pose):
        draw.line([(float(x) * factor, float(y) * factor) for x, y in line], fill=_MESH, width=1)


def draw_faces(draw: ImageDraw.ImageDraw, check: StyleCheck, factor: float) -> None:
    """A numbered frame around each face, where there are several."""
    if len(check.faces) < 2:
        return
    for number, points in enumerate(check.faces, start=1):
        low, high = points.min(axis=0) * factor, points.max(axis=0) * factor
        color = GOOD if np.array_equal(points, check.exemplar.landmarks) else FAIR
        draw.rectangle((*low, *high), outline=color, width=3)
        draw.text((float(low[0]) + 6, float(low[1]) + 4), str(number), color, font(26),
                  stroke_width=2, stroke_fill=(0, 0, 0))


def _fitted(image: UInt8, width: float) -> tuple[Image.Image, float]:
    """A picture as large as fits, and the factor."""
    factor = min(width / image.shape[1], _TALL / image.shape[0])
    size = max(1, round(image.shape[1] * factor)), max(1, round(image.shape[0] * factor))
    return Image.fromarray(image).resize(size, Image.Resampling.LANCZOS), factor


def style_picture(check: StyleCheck) -> UInt8:
    """Draw what `check_style` found.

    Returns
    -------
    picture
        uint8 [H, W, 3]: the painting with the mesh of its pose; for a turned face the frontal
        picture, mirrored places tinted; what is to be said; the embedded head in the painting's
        manner.
    """
    columns = 2 if check.frontal is not None else 1
    each = (_WIDTH * 0.68 - _GAP * (columns + 1)) / columns if columns > 1 else _WIDTH * 0.42
    painting, factor = _fitted(check.exemplar.image, each)
    draw = ImageDraw.Draw(painting)
    draw_mesh(draw, check, factor)
    draw_faces(draw, check, factor)
    pictures = [painting]
    if check.frontal is not None and check.mirrored is not None:
        share = 0.22 * check.mirrored[..., None]
        tinted = (1 - share) * check.frontal + share * _TINT
        pictures.append(_fitted(np.asarray(tinted + 0.5, np.uint8), each)[0])
    top = 64
    below = top + max(picture.height for picture in pictures) + _GAP
    preview = None if check.preview is None else Image.fromarray(check.preview)
    page = Image.new("RGB", (_WIDTH, below + (preview.height + _GAP if preview else 0)), PAPER)
    draw = ImageDraw.Draw(page)
    draw.text((_GAP, 18), check.exemplar.name, INK, font(30))
    left = _GAP
    for picture in pictures:
        page.paste(picture, (left, top))
        left += picture.width + _GAP
    y = top
    for grade, text in check.facts:
        rows = wrapped(draw, text, _WIDTH - left - 40, 18)
        draw.ellipse((left, y + 6, left + 10, y + 16), fill=grade)
        for row in rows:
            draw.text((left + 22, y), row, INK, font(18))
            y += 25
        y += 9
    if preview:
        page.paste(preview, ((_WIDTH - preview.width) // 2, below))
    return np.asarray(page)


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
