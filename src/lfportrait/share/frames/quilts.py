"""Quilts for a display that a name asks for: their layout, size and files."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import UserError
from ...field import VoxelField
from ...files import atomic_write
from ...lightfield import Display, EncodeConfig, QuiltLayout, quilt_of
from .config import FrameConfig
from .metadata import SECONDS, quilt_exif, quilt_settings
from .names import PICTURES, QuiltName
from .pictures import check_picture, picture_bytes

__all__ = ["QUILTS", "QuiltPlan", "write_quilt"]

QUILTS = PICTURES
"""Endings of the formats that quilts are written in with all that goes with them."""
_MOST_PIXELS = 8192
"""Pixels a side that the graphics cards of all who look at quilts take."""
_SAME = 0.01
"""Names give the aspect in a few digits."""


@dataclass(frozen=True)
class QuiltPlan:
    """A quilt that is to be made.

    Attributes
    ----------
    display
        The panel, with the quilt's size in ``quilt_size``.
    layout
        Columns, rows and aspect.
    """

    display: Display
    layout: QuiltLayout

    @staticmethod
    def of(name: str, config: FrameConfig, *, display: Display | None = None) -> QuiltPlan:
        """The quilt that a file's name and the parameters ask for.

        Parameters
        ----------
        name
            The file's name.
        config
            Its display and pixels.
        display
            The panel, where it is known; otherwise the parameters name it, or the layout does.

        Raises
        ------
        UserError
            If the name's aspect is not the display's, or no known display has it.
        """
        asked = QuiltName.of(name)
        if display is None:
            display = Display.resolve(config.display) if config.display else _fitting(asked)
        if asked.aspect and abs(asked.aspect / display.aspect - 1) > _SAME:
            raise UserError(f"{name} asks for views of the aspect {asked.aspect:g}, but those of "
                            f"{display.name} have {display.aspect:.4g}: change the name, or "
                            "--display")
        columns, rows = (asked.columns, asked.rows) if asked.columns else display.quilt
        layout = QuiltLayout(columns, rows, asked.aspect or display.aspect)
        size = config.pixels if config.pixels[0] else _size(display, layout)
        if size[0] < columns or size[1] < rows:
            raise UserError(f"a quilt of {columns} x {rows} views needs more than {size[0]} x "
                            f"{size[1]} pixels")
        return QuiltPlan(replace(display, quilt=(columns, rows), quilt_size=size), layout)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the quilt in pixels."""
        return self.display.quilt_size

    def picture(self, field: VoxelField, encode: EncodeConfig) -> NDArray[np.uint8]:
        """The quilt of a field, uint8 [H, W, 3]; view 0, the leftmost, is at the bottom left."""
        return quilt_of(field, self.display, encode, name=f"x{self.layout.suffix()}")[0]


def _fitting(asked: QuiltName) -> Display:
    """The preset for a layout: one with this very quilt, or at least of this aspect."""
    if not asked.aspect:
        return Display.preset("lookingglass-portrait")
    known = [Display.preset(name) for name in Display.names() if name.startswith("lookingglass")]
    fits = [panel for panel in known if abs(asked.aspect / panel.aspect - 1) <= _SAME]
    if not fits:
        raise UserError(f"no Looking Glass shows views of the aspect {asked.aspect:g}: name your "
                        "display with --display")
    # The smallest of them: frames at home are small.
    return min(fits, key=lambda panel: (panel.quilt != (asked.columns, asked.rows),
                                        panel.panel_height))


def _size(display: Display, layout: QuiltLayout) -> tuple[int, int]:
    """Size of a quilt: the customary one, or as many customary tiles as may lie side by side."""
    if (layout.columns, layout.rows) == display.quilt:
        return display.quilt_size
    tile = [display.quilt_size[axis] / display.quilt[axis] for axis in (0, 1)]
    whole = layout.columns * tile[0], layout.rows * tile[1]
    factor = min(1.0, _MOST_PIXELS / max(whole))
    # Whole tiles: a rest at the edge would belong to no view.
    return (layout.columns * max(1, int(tile[0] * factor)),
            layout.rows * max(1, int(tile[1] * factor)))


def write_quilt(path: Path, quilt: NDArray[np.uint8], layout: QuiltLayout, *,
                seconds: float = SECONDS, beside: bool = True) -> dict[str, Any]:
    """Write a quilt as PNG, JPEG or WebP with its EXIF block, and its side file ``PATH.json``.

    Parameters
    ----------
    path
        The quilt's file.
    quilt
        uint8 [H, W, 3].
    layout
        Its layout.
    seconds
        How long a frame shows it, in seconds; written into the side file.
    beside
        Whether there is to be a side file.

    Returns
    -------
    figures
        ``bytes`` of what was written.

    Raises
    ------
    UserError
        If the format can't hold the picture, or the files can't be written.
    """
    check_picture(path, quilt.shape[1], quilt.shape[0])
    contents = picture_bytes(path.suffix, quilt, quilt_exif(layout))
    if not beside:
        with atomic_write(path) as stream:
            stream.write(contents)
        return {"bytes": len(contents)}
    side = (json.dumps(quilt_settings(layout, seconds=seconds), indent=1) + "\n").encode()
    # Both are whole under their temporary names before either gets its own.
    with (atomic_write(path.with_name(path.name + ".json")) as second,
          atomic_write(path) as first):
        first.write(contents)
        second.write(side)
        second.flush()
    return {"bytes": len(contents) + len(side)}
