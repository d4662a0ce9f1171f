"""What an eye in front of the panel sees, views taken apart again, and test patterns.

Every sub-pixel is seen through the lens above it in the direction of its view's eye point. An eye
elsewhere sees, at each place of the panel, the view whose eye point lies on its line of sight
through that place: a picture sampled once per lens along each row, which is then filled in along
the row.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from ..errors import UserError
from .coded import check_size
from .display import Display

__all__ = ["deinterlace", "pattern", "simulate"]

PATTERNS = ("views", "slant", "fringe", "depth")


def deinterlace(image: NDArray[np.uint8], display: Display, view: int,
                ) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """The sub-pixels of a coded picture that one view owns.

    Parameters
    ----------
    image
        uint8 [H, W, 3], coded for ``display``.
    display
        The panel.
    view
        0 to V_n - 1.

    Returns
    -------
    picture, owned
        uint8 [H, W, 3], zero where the view owns nothing, and bool [H, W, 3].
    """
    check_size(image, display)
    if not 0 <= view < display.views:
        raise UserError(f"the display has views 0 to {display.views - 1}, not {view}")
    rows, columns = np.ogrid[:display.height, :display.width]
    owned = np.zeros(image.shape, bool)
    for place in range(3):
        index = display.view_of(rows, columns, place).astype(np.int64)
        owned[..., display.channel(place)] = index == view
    return np.where(owned, image, 0).astype(np.uint8), owned


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
    reach = display.distance * np.tan(np.radians(display.cone) / 2)
    wanted = 0.5 * (received / reach + 1.0) * display.views
    # One sub-pixel per lens and row lies within half of this of the wanted view.
    aperture = display.views / display.pitch
    picture = np.empty(image.shape, np.float32)
    order = np.array([display.channel(place) for place in range(3)])
    _collect(np.ascontiguousarray(image), wanted, order, display.steps(), display.pitch,
             display.shift, display.offset, display.views, display.inverted, aperture,
             float(crosstalk), picture)
    return picture


@njit(cache=True, parallel=True)
def _collect(image, wanted, order, steps, pitch, shift, offset, views, inverted,  # type: ignore[no-untyped-def]
             aperture, crosstalk, out):
    """Weigh every sub-pixel by how nearly it is aimed at the eye, and fill in along the rows."""
    height, width, _ = image.shape
    reach = max(1, int(np.ceil(pitch / 1.5)))
    sigma = np.hypot(crosstalk, 0.5 * aperture)
    window = np.empty(2 * reach + 1)
    for i in range(2 * reach + 1):
        window[i] = np.exp(-0.5 * ((i - reach) / (pitch / 6.0)) ** 2)
    for y in prange(height):
        weight, value = np.empty(width), np.empty(width)
        for place in range(3):
            channel = order[place]
            for x in range(width):
                raw = 3.0 * x + steps[y % 4, x % 2, place] + y * shift + offset
                phase = raw - pitch * np.floor(raw / pitch)
                if phase >= pitch:
                    phase = 0.0
                if inverted and phase > 0:
                    phase = pitch - phase
                # A sub-pixel shows its nearest view, seen as if from the middle of that view.
                view = np.floor(min(phase * views / pitch, views - 1e-9)) + 0.5
                away = abs(view - wanted[3 * x + place])
                if crosstalk <= 0:
                    sharp = max(0.0, 1.0 - away / (1.5 * aperture))
                    weight[x] = sharp * sharp
                else:
                    weight[x] = np.exp(-0.5 * (away / sigma) ** 2)
                value[x] = weight[x] * image[y, x, channel] / 255.0
            for x in range(width):
                top, mass = 0.0, 1e-12
                for i in range(max(0, x - reach), min(width, x + reach + 1)):
                    share = window[i - x + reach]
                    top += share * value[i]
                    mass += share * weight[i]
                out[y, x, channel] = top / mass


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
