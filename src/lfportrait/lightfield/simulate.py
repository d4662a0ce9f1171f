"""What an eye in front of the panel sees, views taken apart again, and test patterns.

Every sub-pixel is seen through the lens above it in the direction of its view's eye point. An eye
elsewhere sees, at each place of the panel, the view whose eye point lies on its line of sight
through that place: a picture sampled once per lens along each row, which is then filled in along
the row.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import UserError
from ..kernels.panel import lens_of, see_panel
from .coded import check_size
from .display import Display

__all__ = ["pattern", "simulate"]

PATTERNS = ("views", "slant", "fringe", "depth")


def simulate(image: NDArray[np.uint8], display: Display, eye: Sequence[float] = (0.0,), *,
             crosstalk: float = 0.0, distance: float | None = None) -> NDArray[np.float32]:
    """What an eye sees of a coded picture.

    Parameters
    ----------
    image
        uint8 [H, W, 3], coded for ``display``.
    display
        The panel.
    eye
        (x,) or (x, y) of the eye in half panel heights; only x matters to lenses without vertical
        parallax, y shifts the phase along slanted lenses by nothing.
    crosstalk
        Sigma in views of the Gaussian lobe with which other views leak in; 0 = none.
    distance
        Distance of the eye; the viewing distance by default.

    Returns
    -------
    picture
        float32 [H, W, 3] in [0, 1].
    """
    check_size(image, display)
    far = display.distance if distance is None else distance
    x = display.aspect * (2.0 * (np.arange(display.width * 3) + 0.5) / (3 * display.width) - 1.0)
    # Where the line from each place through the eye meets the eye line, as a view.
    received = x + (float(eye[0]) - x) * display.distance / far
    wanted = 0.5 * (received / display.eye_reach + 1.0) * display.views
    picture = np.empty(image.shape, np.float32)
    order = np.array([display.channel(place) for place in range(3)])
    # Views mix as light, not as stored values.
    light = ((np.arange(256) / 255.0) ** display.gamma).astype(np.float32)[image]
    see_panel(light, wanted, order, display.steps(), lens_of(display), float(crosstalk), picture)
    return np.clip(picture, 0, 1) ** np.float32(1.0 / display.gamma)


def pattern(display: Display, kind: str = "views") -> NDArray[np.uint8]:
    """A test picture coded for a panel.

    Parameters
    ----------
    display
        The panel.
    kind
        ``"views"``: each view a grey level from black (left) to white (right), every eighth view
        tinted; ``"slant"``: white in the middle view only, so that a wrong pitch or slant shows as
        bands; ``"fringe"``: red, green and blue thirds of the views, which must not mix;
        ``"depth"``: vertical bars at five depths from behind the panel to in front of it.

    Returns
    -------
    image
        uint8 [H, W, 3].
    """
    if kind not in PATTERNS:
        raise UserError(f"there is no pattern {kind!r}; choose {', '.join(PATTERNS)}")
    rows, columns = np.ogrid[:display.height, :display.width]
    image = np.empty((display.height, display.width, 3), np.uint8)
    eyes = display.eyes()
    for place in range(3):
        channel = display.channel(place)
        view = np.floor(display.view_of(rows, columns, place)).astype(np.int64)
        if kind == "views":
            level = view / max(1, display.views - 1)
            tinted = (view % 8 == 0) & (channel != 0)
            value = np.where(tinted, 0.3 * level, level)
        elif kind == "slant":
            value = (view == display.views // 2).astype(float)
        elif kind == "fringe":
            value = (view * 3 // display.views == channel).astype(float)
        else:
            x = display.aspect * (2 * (columns + (place + 0.5) / 3) / display.width - 1)
            value = np.zeros(view.shape)
            for band, z in enumerate((-0.6, -0.3, 0.0, 0.3, 0.6)):
                inside = (rows * 5 // display.height) == band
                # The ray from the eye through this place meets depth z at x_z.
                x_z = eyes[view] + (x - eyes[view]) * (display.distance - z) / display.distance
                bars = (np.floor(x_z * 6) % 2 == 0).astype(float)
                value = np.where(inside, bars, value)
        image[..., channel] = np.uint8(np.clip(value, 0, 1) * 255 + 0.5)
    return image
