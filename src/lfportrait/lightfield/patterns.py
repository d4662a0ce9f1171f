"""Test patterns that show whether a panel's parameters are right.

What is in them, and what a fault of the panel does to each (docs/displays.md, for people):

views
    Four charts of all view numbers, a lamp below each; those that reach the eye are lit. A wrong
    distance lights others in one chart, a wrong pitch or slant many at once.
slant
    The middle views are white, those to the left of them red, to the right blue. A wrong pitch
    makes bands along the lenses, a wrong slant level ones, a wrong offset one color.
fringe
    Thirds of the views in red, green and blue; black and white bars a little behind the panel,
    whose edges are colored where the order of the sub-pixels is wrong.
depth
    Grids at five depths: on the panel, at the limits of its depth budget, and twice as deep.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from ..arrays import Float32, Float64, Floats, Int64, UInt8
from ..errors import UserError
from .display import Display
from .placement import DepthReport

_ROWS = 128  # Rows of the panel that are worked on at once.

Paint = Callable[[Int64, Float64, Float64, int], Floats]
"""Color in [0, 1] from the view, x, y (half panel heights, y up) and the channel."""


def _painted(display: Display, paint: Paint) -> UInt8:
    """Every sub-pixel painted by its view and its place."""
    image = np.empty((display.height, display.width, 3), np.uint8)
    places = display.places()
    columns = np.arange(display.width)[None]
    for first in range(0, display.height, _ROWS):
        rows = np.arange(first, min(first + _ROWS, display.height))[:, None]
        for place in range(3):
            view = np.floor(display.view_of(rows, columns, place)).astype(np.int64)
            spot = places[rows % 4, columns % 2, place]
            x = display.aspect * (2 * (columns + spot[..., 0]) / display.width - 1)
            y = 1 - 2 * (rows + spot[..., 1]) / display.height
            channel = display.channel(place)
            value = np.clip(paint(view, x, y, channel), 0, 1) * 255 + 0.5
            image[rows[:, 0], :, channel] = value.astype(np.uint8)
    return image


def _font(size: int) -> Any:
    from PIL import ImageFont

    return ImageFont.load_default(max(6, size))


def _word(text: str, height: int, width: int, size: int) -> Float32:
    """A word in white in the middle of black, [height, width]."""
    from PIL import Image, ImageDraw

    picture = Image.new("L", (width, height))
    ImageDraw.Draw(picture).text((width / 2, height / 2), text, 255, _font(size), anchor="mm")
    return np.asarray(picture, np.float32) / np.float32(255)


def _sampled(texture: Float32, down: Float64, right: Float64) -> Float32:
    """A texture [h, w] at places in [0, 1] (from the top left), interpolated; 0 outside."""
    height, width = texture.shape
    padded = np.pad(texture, 1)
    row = np.clip(down * height + 0.5, 0, height + 0.999)
    column = np.clip(right * width + 0.5, 0, width + 0.999)
    y, x = row.astype(np.intp), column.astype(np.intp)
    dy, dx = (row - y).astype(np.float32), (column - x).astype(np.float32)
    upper = padded[y, x] * (1 - dx) + padded[y, x + 1] * dx
    lower = padded[y + 1, x] * (1 - dx) + padded[y + 1, x + 1] * dx
    blended: Float32 = upper * (1 - dy) + lower * dy
    return blended


def _views(display: Display) -> Paint:
    from PIL import Image, ImageDraw

    height, width = max(1, display.height // 2), max(1, display.width // 2)
    # Cells about as wide as high, and enough of them.
    columns = max(1, round((display.views * display.aspect) ** 0.5))
    rows = -(-display.views // columns)
    picture = Image.new("L", (width, height))
    draw = ImageDraw.Draw(picture)
    font = _font(round(min(0.5 * height / rows, 0.5 * width / columns)))
    for view in range(display.views):
        row, column = divmod(view, columns)
        draw.text(((column + 0.5) * width / columns, (row + 0.34) * height / rows), str(view), 255,
                  font, anchor="mm")
    ink = np.asarray(picture, np.float32) / 255
    # Which view's lamp a pixel of the chart is in; -1 outside of them.
    down, across = np.mgrid[:height, :width]
    y, x = (down + 0.5) * rows / height, (across + 0.5) * columns / width
    cell = y.astype(np.int64) * columns + x.astype(np.int64)
    inside = (np.abs(y % 1 - 0.78) < 0.14) & (np.abs(x % 1 - 0.5) < 0.42)
    cell = np.where(inside, cell, -1)

    def paint(view: Int64, x: Float64, y: Float64, channel: int) -> Floats:
        row = (np.clip((1 - y) / 2, 0, 0.999999) * 2 % 1 * height).astype(np.intp)
        column = (np.clip((x / display.aspect + 1) / 2, 0, 0.999999) * 2 % 1 * width).astype(
            np.intp)
        return np.where(cell[row, column] == view, 1.0, 0.7 * ink[row, column])

    return paint


def _slant(display: Display) -> Paint:
    # Wide enough for what the lens of a sub-pixel mixes.
    middle = (display.views - 1) / 2
    half = 0.5 + min(max(display.views / 24, 1.6 * display.views / display.pitch),
                     display.views / 4)

    def paint(view: Int64, x: Float64, y: Float64, channel: int) -> Floats:
        white = np.abs(view - middle) <= half
        side = (view < middle) if channel == 0 else (view > middle) if channel == 2 else view < 0
        return np.where(white, 1.0, np.where(side, 0.6, 0.0))

    return paint


def _fringe(display: Display) -> Paint:
    eyes, depth = display.eyes(), 0.5 * max(DepthReport.of(display).back, -display.distance)

    def paint(view: Int64, x: Float64, y: Float64, channel: int) -> Floats:
        third = (view * 3 // display.views == channel).astype(float)
        x_z = eyes[view] + (x - eyes[view]) * (display.distance - depth) / display.distance
        bars = (np.floor(x_z * 8) % 2 == 0).astype(float)
        return np.where(y > 0, third, bars)

    return paint


def _depth(display: Display) -> Paint:
    report = DepthReport.of(display)
    deep, near = max(report.back, -0.5 * display.distance), min(report.front, display.distance / 4)
    depths = np.array([2 * deep, deep, 0.0, near, 2 * near])
    eyes, count = display.eyes(), len(depths)
    height = 200
    width = max(8, round(height * count * display.aspect))
    textures = []
    for z in depths:
        side = "on the panel" if z == 0 else "behind" if z < 0 else "in front"
        text = side if z == 0 else f"{report.length(float(z)).split(' half')[0]} {side}"
        textures.append(_word(text, height, width,
                              round(min(0.4 * height, 1.4 * width / len(text)))))

    def paint(view: Int64, x: Float64, y: Float64, channel: int) -> Floats:
        band = np.clip(((1 - y) / 2 * count).astype(np.int64), 0, count - 1)
        x, y = np.broadcast_arrays(x, y)
        value = np.zeros(view.shape)
        for number, z in enumerate(depths):
            here = np.broadcast_to(band == number, view.shape)
            if not here.any():
                continue
            eye = eyes[view[here]]
            scale = (display.distance - z) / display.distance
            x_z = eye + (x[here] - eye) * scale
            y_z = display.eye_height + (y[here] - display.eye_height) * scale
            # The middle of the band as the middle eye sees it.
            center = display.eye_height + (1 - (2 * number + 1) / count
                                           - display.eye_height) * scale
            line = 0.008 * scale
            cell = 1.0 / count * scale
            u, v = x_z / cell, (y_z - center) / cell
            lines = ((np.abs(u - np.round(u)) * cell < line)
                     | (np.abs(v - 0.5 - np.round(v - 0.5)) * cell < line))
            ink = _sampled(textures[number], 0.5 - (y_z - center) * count / 2 / scale,
                           0.5 + x_z / (2 * display.aspect) / scale)
            value[here] = np.maximum(np.where(lines, 0.55, 0.0) * (ink < 0.02), ink)
        return value

    return paint


PATTERNS: dict[str, Callable[[Display], Paint]] = {
    "views": _views, "slant": _slant, "fringe": _fringe, "depth": _depth}


def pattern(display: Display, kind: str = "views") -> UInt8:
    """A test picture coded for a panel, uint8 [H, W, 3].

    ``"views"``: each view its number; ``"slant"``: pitch, slant and offset; ``"fringe"``: order of
    the sub-pixels; ``"depth"``: grids at five depths. What to look for is described above.
    """
    if kind not in PATTERNS:
        raise UserError(f"there is no pattern {kind!r}; choose {', '.join(PATTERNS)}")
    return _painted(display, PATTERNS[kind](display))
