"""What in a painting will show in portraits after it, found before one is painted.

Each finding is a line for the user: what is there, what it will do, and what to do about it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from scipy import ndimage

from .. import models
from ..arrays import Float64, UInt8
from ..capture import BAD, FAIR
from ..example import PROFILE, Exemplar, Regions, shut_eyes
from ..stylize import PARTED, mouth_opening

__all__ = ["Finding", "findings", "oval_frame"]


SMALL = 300
"""A face of so many pixels from chin to brows, or less, has coarse strokes on any panel."""
HALF = 45.0
"""From so many degrees on about half of a face is its mirror image."""
CORNER, GRAIN, LIKE = 0.04, 4.0, (8.0, 24.0)
"""Size of the corners that a frame is looked for in, over the picture's shorter side. A pixel is of
their color if it is no further from it than their grain (`GRAIN` of its deviations), within
limits, of 255."""
OVAL, FILLED = 0.95, (0.72, 0.85)
"""How much of an ellipse and what is inside a frame must overlap, over both together; and the share
of its box that an ellipse fills, about."""
SHADE, DEEP = 0.52, 75.0
"""A half of a face is in deep shadow if it is darker than this share of the other, and than this
luma of 255."""
UNSURE, NEITHER = 0.36, (0.3, 0.7)
"""A hair matte is unsure if so much of it lies between hair and none."""
HAND = 0.04
"""Share of the face that must be skin of the body for a hand to be there."""


@dataclass(frozen=True)
class Finding:
    """One thing that will show.

    Attributes
    ----------
    name
        For ``--json``.
    text
        A line for the user.
    value
        A figure of it.
    grade
        Color of the line's grade.
    """

    name: str
    text: str
    value: Any = True
    grade: tuple[int, int, int] = FAIR


def findings(exemplar: Exemplar, yaw: float, rows: int) -> list[Finding]:
    """What is found in a painting besides its pose.

    Parameters
    ----------
    exemplar
        The painting with its landmarks.
    yaw
        How its face is turned, in degrees.
    rows
        Rows that a 4K panel shows of a face from chin to brows.
    """
    image, points = exemplar.image, exemplar.landmarks
    regions = exemplar.regions()
    found = [_coarse(points, rows), _oval(image, exemplar.mask is not None), _half(yaw),
             _shadow(image, points), _hair(regions), _eyes(points, image), _mouth(points),
             _hand(image, points)]
    return [one for one in found if one is not None]


def _coarse(points: Float64, rows: int) -> Finding | None:
    """Strokes of a small face."""
    pixels = float(np.ptp(points[:, 1]))
    if pixels > SMALL:
        return None
    times = rows / max(pixels, 1.0)
    return Finding("coarse", f"Small face ({pixels:.0f} pixels from chin to brows): on a 4K panel "
                   f"its strokes are {times:.1f} times coarser than the panel's pixels; use a "
                   "larger picture of it", round(times, 2), BAD if times > 4 else FAIR)


def oval_frame(image: UInt8) -> tuple[int, int, int, int] | None:
    """Box (left, top, right, bottom) of an oval or round frame with plain corners, or None.

    Parameters
    ----------
    image
        uint8 [H, W, 3].
    """
    height, width = image.shape[:2]
    factor = max(1, round(max(height, width) / 500))
    small = image[::factor, ::factor].astype(np.float32)
    rows, columns = small.shape[:2]
    side = max(3, round(CORNER * min(rows, columns)))
    corners = np.stack([small[y, x].reshape(-1, 3) for y in (slice(side), slice(-side, None))
                        for x in (slice(side), slice(-side, None))])
    middles = np.median(corners, axis=1)
    like = float(np.clip(GRAIN * corners.std(axis=1).max(), *LIKE))
    if np.ptp(middles, axis=0).max() > like:
        return None
    color = np.median(middles, axis=0)
    framed = ndimage.binary_fill_holes(np.abs(small - color).max(axis=-1) > like)
    framed = ndimage.binary_opening(framed, np.ones((3, 3)), iterations=2)
    there = np.argwhere(framed)
    if not len(there):
        return None
    (top, left), (bottom, right) = there.min(axis=0), there.max(axis=0) + 1
    box = framed[top:bottom, left:right]
    if not FILLED[0] < box.mean() < FILLED[1] or box.sum() < 0.25 * framed.size:
        return None
    y, x = ((np.arange(n) + 0.5) / n * 2 - 1 for n in box.shape)
    ellipse = np.hypot(x[None], y[:, None]) < 1
    if (box & ellipse).sum() < OVAL * (box | ellipse).sum():
        return None
    left, top, right, bottom = (int(one) * factor for one in (left, top, right, bottom))
    return left, top, min(right, width), min(bottom, height)


def _oval(image: UInt8, masked: bool) -> Finding | None:
    """A frame whose corners would be painted."""
    box = oval_frame(image)
    if box is None or masked:
        return None
    left, top, right, bottom = box
    # The largest box of the same shape within an ellipse.
    x, y = (0.5 * (1 - 0.5 ** 0.5) * n for n in (right - left, bottom - top))
    inner = [round(n) for n in (left + x, top + y, right - x, bottom - y)]
    return Finding("oval", "An oval frame: its plain corners become background of photos, and its "
                   f"edge shows there. Crop it to what lies inside, for example from {inner[0]} "
                   f"{inner[1]} to {inner[2]} {inner[3]}", list(box))


def _half(yaw: float) -> Finding | None:
    """A face of which half is a mirror image; profiles are refused."""
    if not HALF < abs(yaw) <= PROFILE:
        return None
    return Finding("half_mirrored", f"Turned by {abs(yaw):.0f} degrees: the far half of the face "
                   "is made of the near one; one that is turned less gives more of the painter's "
                   "own", round(abs(yaw), 1))


def _shadow(image: UInt8, points: Float64) -> Finding | None:
    """A half of the face that is in deep shadow."""
    middle = points[[27, 28, 29, 30]]
    sides = []
    for jaw, brow in ((points[1:7], points[17:21]), (points[15:9:-1], points[26:22:-1])):
        outline = np.concatenate([jaw, points[[57]], middle[::-1], brow[::-1]])
        inside = np.zeros(image.shape[:2], np.uint8)
        cv2.fillPoly(inside, [np.round(outline).astype(np.int32)], 1)
        light = image[inside > 0] @ np.array([0.299, 0.587, 0.114])
        sides.append(float(np.median(light)) if len(light) else np.nan)
    dark, light = min(sides), max(sides)
    if not (dark < SHADE * light and dark < DEEP):
        return None
    side = "left" if sides[0] == dark else "right"
    return Finding("half_in_shadow", f"The half of the face on the picture's {side} lies in deep "
                   "shadow: portraits have it, too, and landmarks there may be off: look at them "
                   "with `styles add`", round(dark / max(light, 1.0), 2))


def _hair(regions: Regions) -> Finding | None:
    """Hair that is not known for sure."""
    if regions.hair is None:
        return Finding("hair_unsure", "Its hair can't be told from its skin: hair may be painted "
                       "with skin, and skin with hair", "none")
    there, sure = ((regions.hair > limit).sum() for limit in NEITHER)
    share = 1 - float(sure) / max(float(there), 1.0)
    if share < UNSURE:
        return None
    return Finding("hair_unsure", f"Where its hair ends is unsure for {100 * share:.0f} % of it: "
                   "strokes of skin may lie in hair and of hair on skin; a larger or sharper "
                   "picture helps", round(share, 2))


def _eyes(points: Float64, image: UInt8) -> Finding | None:
    """Eyes that the painter painted closed."""
    shut = shut_eyes(points, image)
    if not any(shut):
        return None
    what = "The eyes are" if all(shut) else "One eye is"
    return Finding("eyes_closed", f"{what} closed: open eyes of a sitter are painted with lids; "
                   "--keep eyes leaves the photo's", list(shut))


def _mouth(points: Float64) -> Finding | None:
    """An open mouth."""
    opening = mouth_opening(points)
    if not opening > PARTED:
        return None
    return Finding("mouth_open", "The mouth is open: teeth or a gap are pressed between closed "
                   "lips; --keep lips leaves the photo's", round(opening, 2))


def _hand(image: UInt8, points: Float64) -> Finding | None:
    """A hand at the face, where the network of parts is at hand."""
    if models.missing(["multiclass-segmentation"]):
        return None
    from ..face import parts

    inside = np.zeros(image.shape[:2], np.uint8)
    # Not the lowest part of the jaw: a throat is body, too.
    outline = points[[*range(1, 6), 57, *range(11, 16), *range(26, 16, -1)]]
    cv2.fillPoly(inside, [np.round(outline).astype(np.int32)], 1)
    body = parts(image)["body-skin"]
    share = float((body[inside > 0] > 0.5).mean()) if inside.any() else 0.0
    if share < HAND:
        return None
    return Finding("hand", "A hand seems to lie at the face: it is painted as skin of the face; "
                   "use a picture without it", round(share, 3))
