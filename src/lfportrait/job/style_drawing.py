"""The page that `styles check` draws: a painting, its mesh, what it becomes, and a preview."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw

from ..arrays import UInt8
from ..capture import FAIR, GOOD, INK, PAPER, font
from ..example import head_mesh
from .photo_check import wrapped
from .style_check import StyleCheck

__all__ = ["draw_faces", "draw_mesh", "style_picture"]

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
