"""Pictures that jobs show while they work, and the first look at a painting on the head."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from ...arrays import UInt8
from ...capture import Camera, Capture, font
from ...field import VoxelField
from ...job import FirstLook
from ...lightfield import eight_bit, render_views
from ..orders import Order
from ..projects import Project
from .telling import Teller

_PAPER, _INK, _FAINT, _BLUE = (250, 250, 248), (40, 40, 44), (200, 200, 204), (30, 110, 200)
_MARGIN = 1.12
"""Of a head in its picture."""
_DISTANCE = 4.0



def views_of(field: VoxelField, cameras: Sequence[tuple[float, float, float]], size: int) -> Camera:
    """Square cameras on a head, framed so that all of it shows.

    Parameters
    ----------
    field
        The head.
    cameras
        (yaw, pitch, zoom) of each: degrees to its left side and up, and how much nearer than all of
        the head.
    size
        Of the pictures in pixels.
    """
    from ...share import sweep_cameras

    plain = sweep_cameras(0.0, 1, size, field)
    target_y = float(plain.position[0, 1])
    focal = float(plain.focal[0, 0]) / _MARGIN * 1.04
    arcs = [Camera.arc(np.array([yaw]), distance=_DISTANCE, width=size, height=size,
                       focal=focal * zoom, target=(0.0, target_y, 0.0), pitch=pitch)
            for yaw, pitch, zoom in cameras]
    return Camera(*(np.concatenate([getattr(one, name) for one in arcs])
                    for name in ("pose", "focal", "center", "width", "height")))


def head_picture(field: VoxelField, size: int = 320, yaws: Sequence[float] = (-40.0, 0.0, 40.0),
                 ) -> UInt8:
    """A head from some sides, side by side: uint8 [size, size * views, 3].

    From no further aside than it can be looked at.
    """
    most = field.cone / 2 or 360.0
    cameras = views_of(field, [(min(max(yaw, -most), most), 0.0, 1.0) for yaw in yaws], size)
    return np.concatenate([eight_bit(seen.color) for seen in render_views(
        field, cameras, background=1.0)], axis=1)


def cameras_picture(capture: Capture, size: int = 480) -> UInt8:
    """The placed cameras from above, beside the photos of some of them.

    Returns
    -------
    picture
        uint8 [size, 2 * size, 3].
    """
    sheet = Image.new("RGB", (2 * size, size), _PAPER)
    draw = ImageDraw.Draw(sheet)
    places = capture.cameras.position
    reach = 1.12 * float(np.abs(places[:, [0, 2]]).max(initial=1.0))
    middle = 0.5 * size

    def spot(x: float, z: float) -> tuple[float, float]:
        return middle + x / reach * middle, middle + z / reach * middle

    head = max(0.6 / reach * middle, 6.0)
    draw.ellipse((middle - head, middle - head, middle + head, middle + head), outline=_INK,
                 width=2)
    draw.line((middle, middle + head, middle, middle + 1.35 * head), fill=_INK, width=2)
    for place, pose in zip(places, capture.cameras.pose, strict=True):
        x, y = spot(float(place[0]), float(place[2]))
        ahead = pose[[0, 2], 2]
        ahead = ahead / max(float(np.hypot(*ahead)), 1e-9)
        side = np.array([-ahead[1], ahead[0]])
        length = 0.05 * size
        wedge = [(x, y), *((x + length * (ahead[0] + s * 0.4 * side[0]),
                            y + length * (ahead[1] + s * 0.4 * side[1])) for s in (-1, 1))]
        draw.polygon(wedge, outline=_BLUE)
        draw.ellipse((x - 2, y - 2, x + 2, y + 2), fill=_BLUE)
    draw.text((10, size - 24), f"{len(capture)} cameras, from above", fill=_INK, font=font(14))
    _photos(sheet, capture, size)
    return np.asarray(sheet, np.uint8)


def photo_picture(capture: Capture, size: int = 480) -> UInt8:
    """The photos that a head was fitted to, cut out, side by side: uint8 [size, W, 3]."""
    shown = []
    for view in range(len(capture)):
        image = Image.fromarray((np.clip(capture.image_float(view), 0, 1) * 255 + 0.5).astype(
            np.uint8))
        wide = max(1, round(image.width * size / image.height))
        shown.append(image.resize((wide, size), Image.Resampling.LANCZOS))
    return pieces(shown)


def _photos(sheet: Image.Image, capture: Capture, size: int) -> None:
    """Photos from left to right in the right half of a sheet."""
    places = capture.cameras.position
    order = np.argsort(np.arctan2(places[:, 0], places[:, 2]))
    columns = 4
    chosen = order[np.unique(np.linspace(0, len(order) - 1, min(len(order), 16)).astype(int))]
    cell = size // columns
    for number, view in enumerate(chosen):
        image = (np.clip(capture.image_float(int(view)), 0, 1) * 255 + 0.5).astype(np.uint8)
        small = Image.fromarray(image)
        small.thumbnail((cell - 6, cell - 6))
        column, row = number % columns, number // columns
        sheet.paste(small, (size + column * cell + 3, row * cell + 3))


def coded_picture(coded: UInt8, size: int = 320) -> UInt8:
    """The whole coded picture, small, beside a piece of it enlarged four times."""
    height, width = coded.shape[:2]
    wide = round(size * width / height)
    whole = Image.fromarray(coded).resize((wide, size), Image.Resampling.BOX)
    side = size // 4
    y, x = int(0.42 * height), int(0.5 * width)
    piece = Image.fromarray(np.ascontiguousarray(coded[y:y + side, x:x + side])).resize(
        (size, size), Image.Resampling.NEAREST)
    return np.concatenate([np.asarray(whole), np.asarray(piece)], axis=1)


def pieces(images: Sequence[Any]) -> UInt8:
    """Pictures of one height side by side."""
    return np.concatenate([np.asarray(one, np.uint8) for one in images], axis=1)


def turned(number: int) -> float:
    """Yaw in degrees of a head that turns slowly from one picture to the next."""
    return 35.0 * math.sin(0.7 * number)


_EVERY = 1.0
"""Seconds after which it is looked again whether a painting was chosen."""


class EarlyPicture(FirstLook):
    """The first look as the picture of the stage to come, until that has one of its own.

    And as a page that turns.

    A painting is often chosen while the head is being made: the look waits for that.

    Parameters
    ----------
    order
        Of the head.
    teller
        Sends the picture.
    """

    STAGE = "surface"

    def __init__(self, order: Order, teller: Teller) -> None:
        # A picture shows no ground.
        super().__init__("", replace(order.config().stylize, ground=False), time.perf_counter())
        self._project, self._teller = Project(order.folder), teller
        self._asked = -_EVERY

    def wanted(self) -> bool:
        """Whether a painting is chosen."""
        now = time.perf_counter()
        if now - self._asked < _EVERY:
            return False
        self._asked = now
        self.exemplar = str(self._project.settings().get("painting") or "")
        return bool(self.exemplar)

    def show(self, portrait: VoxelField) -> str:
        """Draw it; there is no line to be said."""
        self._teller.picture(self.STAGE, head_picture(portrait))
        self._teller.page(self.STAGE, portrait)
        return ""
