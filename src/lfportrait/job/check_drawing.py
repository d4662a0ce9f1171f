"""The picture that `capture-check` draws: the photos' places from above, and a contact sheet."""

from __future__ import annotations

import math

import numpy as np
from PIL import Image, ImageDraw

from ..arrays import UInt8
from ..capture import BAD, FAIR, GOOD, INK, PAPER, contact_sheet, font
from .photo_check import PhotoCheck, PhotoFacts

__all__ = ["check_picture", "wrapped"]

_WIDTH, _HEIGHT, _RADIUS = 1772, 470, 290
_FAINT, _SKIN = (214, 211, 204), (236, 226, 212)


def _place(yaw: float, radius: float) -> tuple[float, float]:
    """Where a camera stands, seen from above: the person looks down the picture."""
    angle = math.radians(yaw)
    return 360 + radius * math.sin(angle), 120 + radius * math.cos(angle)


def _radius(one: PhotoFacts, usual: float) -> float:
    """Farther away where the face is smaller."""
    return _RADIUS * float(np.clip(usual / max(one.face or usual, 1e-3), 0.75, 1.12))


def _arc(draw: ImageDraw.ImageDraw, check: PhotoCheck) -> None:
    """A head from above, the photos around it, and where there are none."""
    x, y = _place(0, 0)
    rim = (x - _RADIUS, y - _RADIUS, x + _RADIUS, y + _RADIUS)
    # Pillow's angles run clockwise from the right; ours run from straight down to the right.
    draw.arc(rim, 0, 180, fill=_FAINT, width=2)
    for first, last in check.gaps:
        draw.pieslice(rim, 90 - last, 90 - first, fill=(250, 226, 222))
        draw.arc(rim, 90 - last, 90 - first, fill=BAD, width=5)
    for yaw in range(-90, 91, 30):
        inner, outer = _place(yaw, _RADIUS + 14), _place(yaw, _RADIUS + 22)
        draw.line((*inner, *outer), fill=INK, width=2)
        draw.text(_place(yaw, _RADIUS + 38), f"{abs(yaw)}", INK, font(14), anchor="mm")
    draw.ellipse((x - 9, y + 38, x + 9, y + 60), fill=_SKIN, outline=INK, width=2)
    draw.ellipse((x - 56, y - 10, x - 40, y + 16), fill=_SKIN, outline=INK, width=2)
    draw.ellipse((x + 40, y - 10, x + 56, y + 16), fill=_SKIN, outline=INK, width=2)
    draw.ellipse((x - 46, y - 50, x + 46, y + 50), fill=_SKIN, outline=INK, width=2)
    sizes = [one.face for one in check.photos if one.face]
    usual = float(np.median(sizes)) if sizes else 1.0
    for one in check.photos:
        if one.yaw is None:
            continue
        color = BAD if one.wrong else FAIR if one.fair else GOOD
        px, py = _place(one.yaw, _radius(one, usual))
        draw.line((px, py, *_place(one.yaw, 70)), fill=(*color, 60), width=1)
        draw.ellipse((px - 7, py - 7, px + 7, py + 7), fill=color, outline=PAPER, width=1)
    unseen = sum(one.yaw is None for one in check.photos)
    if unseen:
        draw.text((24, 440), f"{unseen} photos without a face that is seen (from the side, from "
                  "behind, or hidden) are not drawn here.", INK, font(14))


def wrapped(draw: ImageDraw.ImageDraw, text: str, width: float, size: int) -> list[str]:
    """A text in lines of at most ``width`` pixels."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if draw.textlength(longer, font=font(size)) > width and lines[-1]:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def check_picture(check: PhotoCheck) -> UInt8:
    """Draw what `check_photos` found.

    Returns
    -------
    picture
        uint8 [H, W, 3]: from above on the left, advice on the right, all photos below, those of no
        use crossed out in red, those that could be better framed in yellow.
    """
    top = Image.new("RGB", (_WIDTH, _HEIGHT), PAPER)
    draw = ImageDraw.Draw(top, "RGBA")
    _arc(draw, check)
    left, y = 760, 28
    useful = sum(not one.wrong for one in check.photos)
    draw.text((left, y), f"{len(check.photos)} photos, {useful} of use", INK, font(26))
    y += 48
    for line in check.advice or ["No problems found: these photos are suitable for a portrait."]:
        rows = wrapped(draw, line, _WIDTH - left - 60, 18)
        if y + 25 * len(rows) > _HEIGHT - 10:
            draw.text((left + 22, y), "...", INK, font(18))
            break
        mark = BAD if check.advice else GOOD
        draw.ellipse((left, y + 6, left + 10, y + 16), fill=mark)
        for row in rows:
            draw.text((left + 22, y), row, INK, font(18))
            y += 25
        y += 7
    sheet = contact_sheet(check.images, [one.name for one in check.photos],
                          {one.name: one.wrong for one in check.photos if one.wrong},
                          fair={one.name: one.fair for one in check.photos if one.fair})
    width = max(_WIDTH, sheet.shape[1])
    picture = Image.new("RGB", (width, _HEIGHT + sheet.shape[0]), PAPER)
    picture.paste(top, (0, 0))
    picture.paste(Image.fromarray(sheet), (0, _HEIGHT))
    return np.asarray(picture)
