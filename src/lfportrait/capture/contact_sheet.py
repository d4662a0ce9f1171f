"""Small copies of photos side by side, each with its name and what is wrong with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ..arrays import UInt8

PAPER, INK = (250, 249, 246), (40, 40, 44)
GOOD, FAIR, BAD = (66, 140, 82), (214, 148, 32), (196, 52, 44)
"""Colors of photos that are well, that could be better, that are of no use."""

_CELL, _FOOT, _GAP = (208, 156), 36, 12


def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Pillow's own font, so that sheets look alike on all machines."""
    return ImageFont.load_default(size)


def _shortened(draw: ImageDraw.ImageDraw, text: str, face: ImageFont.FreeTypeFont
               | ImageFont.ImageFont, width: float) -> str:
    """The text, cut so that it fits."""
    if draw.textlength(text, font=face) <= width:
        return text
    while text and draw.textlength(text + "...", font=face) > width:
        text = text[:-1]
    return text + "..."


def contact_sheet(images: Sequence[UInt8], names: Sequence[str], marks: Mapping[str, str], *,
                  fair: Mapping[str, str] | None = None, columns: int = 8) -> UInt8:
    """Draw a contact sheet, uint8 [H, W, 3], of pictures uint8 [H, W, 3 or 4] and their names.

    What is wrong, or could be better, by name, stands in ``marks`` and ``fair``: these photos are
    framed in red and crossed out, or framed in yellow.
    """
    fair = fair or {}
    columns = max(1, min(columns, len(images)))
    rows = -(-len(images) // columns)
    step = _CELL[0] + _GAP, _CELL[1] + _FOOT + _GAP
    sheet = Image.new("RGB", (columns * step[0] + _GAP, rows * step[1] + _GAP), PAPER)
    draw = ImageDraw.Draw(sheet)
    plain, small = font(13), font(12)
    for index, (image, name) in enumerate(zip(images, names)):
        x, y = _GAP + (index % columns) * step[0], _GAP + (index // columns) * step[1]
        picture = Image.fromarray(np.ascontiguousarray(image[..., :3]))
        picture.thumbnail((_CELL[0] - 6, _CELL[1] - 6), Image.Resampling.LANCZOS)
        left = x + (_CELL[0] - picture.width) // 2
        top = y + (_CELL[1] - picture.height) // 2
        sheet.paste(picture, (left, top))
        wrong, could = marks.get(name, ""), fair.get(name, "")
        color = BAD if wrong else FAIR if could else GOOD
        frame = (left - 3, top - 3, left + picture.width + 2, top + picture.height + 2)
        draw.rectangle(frame, outline=color, width=3)
        if wrong:
            draw.line((frame[0], frame[3], frame[2], frame[1]), fill=BAD, width=3)
        draw.text((x, y + _CELL[1] + 1), _shortened(draw, name, plain, _CELL[0]), INK, plain)
        draw.text((x, y + _CELL[1] + 17), _shortened(draw, wrong or could, small, _CELL[0]),
                  color, small)
    return np.asarray(sheet)
