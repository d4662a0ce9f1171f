"""Simulate the view of an eye in front of the panel.

Every sub-pixel is seen through the lens above it in the direction of its view's eye point. An eye
elsewhere sees, at each place of the panel, the view whose eye point lies on its line of sight
through that place: a picture sampled once per lens along each row, which is then filled in along
the row. Outside of its cone a panel repeats its views.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .coded import check_size
from .display import Display
from .kernels.panel import lens_of, see_panel

__all__ = ["simulate"]


def simulate(image: NDArray[np.uint8], display: Display, eye: Sequence[float] = (0.0,), *,
             crosstalk: float = 0.0, distance: float | None = None, block: int = 1,
             ) -> NDArray[np.float32]:
    """Simulate an eye's view of a coded picture.

    Parameters
    ----------
    image
        uint8 [H, W, 3], coded for ``display``.
    display
        The panel.
    eye
        (x,) or (x, y) of the eye in half panel heights; lenses have no vertical parallax, so only x
        matters.
    crosstalk
        Sigma in views of the Gaussian lobe with which other views leak in, as light; 0 = none. At
        the cone's edges the views of its other edge leak in, too, as through real lenses.
    distance
        Distance of the eye; the viewing distance by default.
    block
        A pixel of the picture is the mean light of a square of so many pixels of the panel, as
        eyes see those that are too fine for them.

    Returns
    -------
    picture
        float32 [H // block, W // block, 3] in [0, 1].
    """
    check_size(image, display)
    far = display.distance if distance is None else distance
    x = display.aspect * (2.0 * (np.arange(display.width * 3) + 0.5) / (3 * display.width) - 1.0)
    # Where the line from each place through the eye meets the eye line, as a view.
    received = x + (float(eye[0]) - x) * display.distance / far
    wanted = np.mod(0.5 * (received / display.eye_reach + 1.0) * display.views, display.views)
    picture = np.empty((display.height // block, display.width // block, 3), np.float32)
    order = np.array([display.channel(place) for place in range(3)])
    # Views mix as light, not as stored values.
    light = ((np.arange(256) / 255.0) ** display.gamma).astype(np.float32)
    # Of arrays that can be written to, the kernel would be compiled once more.
    panel = np.ascontiguousarray(image).view()
    panel.flags.writeable = False
    see_panel(panel, light, wanted, order, display.steps(), lens_of(display), float(crosstalk),
              block, picture)
    np.clip(picture, 0, 1, out=picture)
    return np.power(picture, np.float32(1.0 / display.gamma), out=picture)
