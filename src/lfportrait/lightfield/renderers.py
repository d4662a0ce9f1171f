"""Coding what any renderer shows, by pictures of all views.

A `VoxelField` is coded directly, one ray for each sub-pixel (`coding.encode`). Of other scenes -
splats, a neural field, a mesh, an analytic surface - only pictures are known: each view of the
panel is rendered for its off-axis camera, and the views are interlaced.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..capture import Camera
from ..errors import UserError
from ..field import Rendering
from .coding import view_camera
from .display import Display
from .interlacing import InterlaceConfig, interlace
from .placement import EncodeConfig
from .views import eight_bit

__all__ = ["Renderer", "encode_views"]


class Renderer(Protocol):
    """What can picture a scene: a `VoxelField`, or any object with this one method."""

    def render(self, cameras: Camera, view: int = 0, *, background: float = 1.0) -> Rendering:
        """Picture the scene for one camera.

        Parameters
        ----------
        cameras, view
            A batch of pinhole cameras and which of them: ``cameras.rays(view)`` are its rays. The
            world is the portrait frame: +y up, +z out of the face, the head within [-1, 1]^3.
        background
            Grey level in [0, 1] behind the scene.

        Returns
        -------
        rendering
            Of the camera's size. Coding uses its ``color`` alone.
        """


def encode_views(renderer: Renderer, display: Display, config: EncodeConfig | None = None, *,
                 sampling: InterlaceConfig | None = None, height: int = 0) -> NDArray[np.uint8]:
    """Code what a renderer shows for a display: all its views are rendered and interlaced.

    Parameters
    ----------
    renderer
        The scene.
    display
        The panel.
    config
        Placement of the scene in front of the panel (size, shifts, focus, turn, depth scale) and
        the grey level behind it.
    sampling
        How views are interlaced.
    height
        Rows of a view's picture. By default a view has as many pixels as an eye sees of the panel:
        one for each lens in each row, about as many across as down.

    Returns
    -------
    image
        uint8 [H, W, 3]: show it on the panel pixel for pixel, unscaled.

    Raises
    ------
    UserError
        If the configuration composes the picture, which needs a field, or a picture has another
        size than its camera.
    """
    config = config or EncodeConfig()
    if config.compose:
        raise UserError("a picture is composed about a field's head; place another scene by size, "
                        "shifts and focus")
    height = height or max(1, round(display.height / math.sqrt(max(display.pitch / 3.0, 1.0))))
    width = max(1, round(height * display.aspect))
    views = np.empty((display.views, height, width, 3), np.uint8)
    for view, eye in enumerate(display.eyes()):
        camera = view_camera(display, config, float(eye), width=width, height=height)
        color = renderer.render(camera, 0, background=max(config.background, 0.0)).color
        if color.shape != (height, width, 3):
            raise UserError(f"the renderer made a picture [{', '.join(map(str, color.shape))}] for "
                            f"a camera of {width} x {height} pixels")
        views[view] = eight_bit(np.array(color, np.float32))
    return interlace(views, display, sampling, aspect=display.aspect)
