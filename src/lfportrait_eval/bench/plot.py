"""A line plot as a picture, for what changes over time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

__all__ = ["line_plot"]

_INK, _GRID = (40, 40, 44), (226, 226, 230)
_COLORS = ((31, 98, 180), (200, 82, 20), (40, 130, 70), (130, 60, 150))


def _ticks(low: float, high: float, wanted: int = 6) -> list[float]:
    """Round numbers from ``low`` to ``high``."""
    raw = max(high - low, 1e-9) / wanted
    unit = 10.0 ** math.floor(math.log10(raw))
    step = next(unit * size for size in (1, 2, 2.5, 5, 10) if unit * size >= raw)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [step * k for k in range(first, last + 1)]


def line_plot(curves: dict[str, tuple[Sequence[float], Sequence[float]]], *, across: str, up: str,
              title: str = "", size: tuple[int, int] = (960, 600)) -> NDArray[np.uint8]:
    """Draw curves over a common axis.

    Parameters
    ----------
    curves
        Name and points (x, y) of each curve.
    across, up
        What the axes show, with units.
    title
        Line above the plot.
    size
        Width and height in pixels.

    Returns
    -------
    picture
        uint8 [H, W, 3].
    """
    points = {name: np.array(sorted(zip(*curve))).reshape(-1, 2) for name, curve in curves.items()}
    shown = np.concatenate(list(points.values()))
    if not len(shown):
        raise ValueError("a plot needs points")
    low, high = shown.min(0), np.maximum(shown.max(0), shown.min(0) + 1e-6)
    low[0] = min(low[0], 0.0)
    margin = 0.04 * (high[1] - low[1])
    low[1], high[1] = low[1] - margin, high[1] + margin
    left, top, right, bottom = 76, 52, size[0] - 24, size[1] - 62
    image = Image.new("RGB", size, (255, 255, 255))
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(16)

    def place(x: float, y: float) -> tuple[float, float]:
        return (left + (right - left) * (x - low[0]) / (high[0] - low[0]),
                bottom - (bottom - top) * (y - low[1]) / (high[1] - low[1]))

    for x in _ticks(float(low[0]), float(high[0])):
        column = place(x, low[1])[0]
        draw.line([(column, top), (column, bottom)], _GRID)
        draw.text((column, bottom + 8), f"{x:g}", _INK, font, anchor="mt")
    for y in _ticks(float(low[1]), float(high[1])):
        row = place(low[0], y)[1]
        draw.line([(left, row), (right, row)], _GRID)
        draw.text((left - 8, row), f"{y:g}", _INK, font, anchor="rm")
    draw.rectangle([left, top, right, bottom], outline=_INK)
    for index, (name, curve) in enumerate(points.items()):
        color = _COLORS[index % len(_COLORS)]
        path = [place(float(x), float(y)) for x, y in curve]
        draw.line(path, color, 3, joint="curve")
        if len(path) < 60:
            for x, y in path:
                draw.ellipse([x - 4, y - 4, x + 4, y + 4], color)
        row = bottom - 22 - 22 * (len(points) - 1 - index)
        draw.line([(right - 240, row), (right - 210, row)], color, 3)
        draw.text((right - 200, row), name, _INK, font, anchor="lm")
    draw.text((left, 24), f"{up}      {title}".rstrip(), _INK, font, anchor="lm")
    draw.text(((left + right) / 2, size[1] - 16), across, _INK, font, anchor="mm")
    return np.asarray(image)
