"""Quilts rendered from a field: all views as tiles of one picture.

The views' eyes lie on one level line, and their pictures in one plane: rows of the same height are
seen through one slice of the field (`views`).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ..capture import Camera
from ..device import gpu_adapter
from ..field import VoxelField
from ..gpu import attempted
from .coding import view_camera
from .composition import composed
from .display import Display
from .gpu.calling import pictures_on_gpu
from .ground import ground_of
from .placement import EncodeConfig
from .quilts import QuiltLayout
from .views import eight_bit, render_views

__all__ = ["quilt_of"]


def quilt_of(field: VoxelField, display: Display, config: EncodeConfig | None = None, *,
             name: str | None = None, device: str = "cpu") -> tuple[NDArray[np.uint8], str]:
    """Render a quilt of a field for a display.

    Parameters
    ----------
    field, display, config
        As for `lfportrait.lightfield.coding`.
    name
        File name that gives columns and rows, and may give the aspect; by default the layout is the
        display's customary one.
    device
        Where to compute (`lfportrait.device.gpu_adapter`).

    Returns
    -------
    quilt, name
        uint8 [H, W, 3], and a file name ``quilt_qsCxRaA.png``.
    """
    config = composed(field, display, config or EncodeConfig())
    ground = ground_of(field, display, config)
    layout = QuiltLayout.of_name(name, display) if name else None
    if layout is None:
        layout = QuiltLayout.of_display(display)
    full_width, full_height = display.quilt_size
    width, height = full_width // layout.columns, full_height // layout.rows
    quilt = np.zeros((full_height, full_width, 3), np.uint8)
    count = layout.columns * layout.rows
    eyes = display.eye_reach * (2.0 * (np.arange(count) + 0.5) / count - 1.0)
    cameras = Camera.concatenate([view_camera(display, config, float(eye), width=width,
                                              height=height) for eye in eyes])
    pictures: Iterable[NDArray[np.uint8]] | None
    pictures = attempted(gpu_adapter(device), lambda process: pictures_on_gpu(
        process, field, cameras, background=max(config.background, 0.0), ground=ground))
    if pictures is None:
        pictures = (eight_bit(seen.color) for seen in render_views(
            field, cameras, background=config.background, ground=ground))
    for view, seen in enumerate(pictures):
        row, column = divmod(view, layout.columns)
        top = full_height - (row + 1) * height
        quilt[top:top + height, column * width:(column + 1) * width] = seen
    return quilt, f"quilt{layout.suffix()}.png"
