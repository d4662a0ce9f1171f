"""Quilts: all views as tiles of one picture, the exchange format of Looking Glass displays.

View 0, the leftmost, is the bottom left tile; views run to the right, then up. A quilt's file name
ends in ``_qsCOLSxROWSaASPECT``, e.g. ``portrait_qs8x6a0.75.png``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import UserError
from ..field import VoxelField
from .display import Display
from .encode import EncodeConfig, view_camera

__all__ = ["QuiltLayout", "interlace", "quilt_of", "quilt_tiles"]


@dataclass(frozen=True)
class QuiltLayout:
    """Columns and rows of a quilt and the aspect (width over height) of its views."""

    columns: int
    rows: int
    aspect: float

    @staticmethod
    def of_name(name: str) -> QuiltLayout | None:
        """The layout that a file name tells, or None."""
        found = re.search(r"_qs(\d+)x(\d+)a(\d+(?:\.\d+)?)", name)
        if not found:
            return None
        columns, rows, aspect = int(found[1]), int(found[2]), float(found[3])
        if columns < 1 or rows < 1 or aspect <= 0:
            raise UserError(f"the quilt name {name!r} tells an impossible layout")
        return QuiltLayout(columns, rows, aspect)

    def suffix(self) -> str:
        """The end of a file name for this layout."""
        return f"_qs{self.columns}x{self.rows}a{self.aspect:.4g}"


def quilt_tiles(quilt: NDArray[np.uint8], layout: QuiltLayout) -> NDArray[np.uint8]:
    """The views of a quilt, view 0 first: uint8 [columns * rows, h, w, 3]."""
    height, width = quilt.shape[0] // layout.rows, quilt.shape[1] // layout.columns
    tiles = [quilt[quilt.shape[0] - (row + 1) * height:quilt.shape[0] - row * height,
                   column * width:(column + 1) * width]
             for row in range(layout.rows) for column in range(layout.columns)]
    return np.stack(tiles)


def quilt_of(field: VoxelField, display: Display, config: EncodeConfig | None = None, *,
             name: str | None = None) -> tuple[NDArray[np.uint8], str]:
    """Render a quilt of a field for a display.

    Parameters
    ----------
    field, display, config
        As for `lfportrait.lightfield.encode`.
    name
        File name that tells columns and rows; the display's customary layout by default.

    Returns
    -------
    quilt, name
        uint8 [H, W, 3], and a file name ``quilt_qsCxRaA.png``.
    """
    config = config or EncodeConfig()
    layout = QuiltLayout.of_name(name) if name else None
    if layout is None:
        layout = QuiltLayout(*display.quilt, display.aspect)
    full_width, full_height = display.quilt_size
    width, height = full_width // layout.columns, full_height // layout.rows
    quilt = np.zeros((full_height, full_width, 3), np.uint8)
    count = layout.columns * layout.rows
    reach = display.distance * np.tan(np.radians(display.cone) / 2)
    for view in range(count):
        eye = reach * (2.0 * (view + 0.5) / count - 1.0)
        camera = view_camera(display, config, eye, width=width, height=height)
        picture = np.clip(field.render(camera, 0, background=config.background).color, 0, 1)
        row, column = divmod(view, layout.columns)
        top = full_height - (row + 1) * height
        quilt[top:top + height, column * width:(column + 1) * width] = picture * 255 + 0.5
    return quilt, f"quilt{layout.suffix()}.png"


def interlace(views: NDArray[np.uint8], display: Display) -> NDArray[np.uint8]:
    """Code pictures of views for a panel: each sub-pixel from its view, at its own place.

    Parameters
    ----------
    views
        uint8 [V, h, w, 3], view 0 leftmost; V and the size need not be the panel's.
    display
        The panel.

    Returns
    -------
    image
        uint8 [H, W, 3].
    """
    count, height, width = views.shape[:3]
    rows = np.arange(display.height)[:, None]
    columns = np.arange(display.width)[None]
    source_row = np.minimum((rows + 0.5) * height / display.height, height - 1).astype(np.intp)
    image = np.empty((display.height, display.width, 3), np.uint8)
    for place in range(3):
        channel = display.channel(place)
        view = display.view_of(rows, columns, place) * (count / display.views)
        index = np.minimum(view.astype(np.intp), count - 1)
        source_column = np.minimum((columns + (place + 0.5) / 3) * width / display.width,
                                   width - 1).astype(np.intp)
        image[..., channel] = views[index, source_row, source_column, channel]
    return image
