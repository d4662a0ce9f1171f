"""Loops over the sub-pixels of a panel: which view each has, coding views, taking them apart.

Every kernel takes the panel as ``steps`` float64 [4, 2, 3] and ``lens`` float64 [7]: pitch, shift,
offset, views, inverted, width over height, breadth (`Display.steps`, `lens_of`). All of them stand
in one file, so that Numba's cache notices when the shared function changes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...lanes.decorators import kernel, lean, lean_kernel
from ...lanes.threads import share_out, shared

__all__ = ["gather_views", "interlace_views", "lens_of", "mask_views", "mix_light", "see_panel"]


def lens_of(display: Any) -> NDArray[np.float64]:
    """The numbers of a `Display` that the kernels take as ``lens``."""
    return np.array([display.pitch, display.shift, display.offset, display.views,
                     display.inverted, display.aspect, display.breadth], np.float64)


@lean
def _view(y, x, k, steps, lens):
    """Fractional view in [0, V) of a sub-pixel; the same operations as `Display.view_of`."""
    raw = 3.0 * x + steps[y % 4, x % 2, k] + y * lens[1] + lens[2]
    phase = raw - lens[0] * np.floor(raw / lens[0])
    if phase >= lens[0]:
        phase = 0.0
    if lens[4] > 0.5 and phase > 0:
        phase = lens[0] - phase
    return phase * (lens[3] / lens[0])


@shared("mask")
@lean_kernel
def mask_views(since, until, mask, steps, lens, first, apart):
    """Fill ``mask`` [H, W, 3] with the nearest view of every sub-pixel.

    Its rows are those of the panel from ``first`` on, ``apart`` from each other.
    """
    width, _ = mask.shape[1:]
    last = int(lens[3]) - 1
    for y in range(since, until):
        for x in range(width):
            for k in range(3):
                mask[y, x, k] = min(int(_view(first + y * apart, x, k, steps, lens)), last)


def mix_light(pictures, light, gamma):
    """The mean of pictures as light, in place of the first one.

    Parameters
    ----------
    pictures
        uint8 [n, h, w].
    light, gamma
        float64 [256], light of each stored value: (value / 255) ** gamma.
    """
    _mix_rows(pictures, light, gamma, pictures[0])


@shared("out")
@lean_kernel
def _mix_rows(since, until, pictures, light, gamma, out):
    """`mix_light` of some rows, into ``out``, the first picture."""
    count, width = len(pictures), out.shape[1]
    for y in range(since, until):
        for x in range(width):
            first = pictures[0, y, x]
            total, same = light[first], True
            for n in range(1, count):
                same = same and pictures[n, y, x] == first
                total += light[pictures[n, y, x]]
            if not same:
                mean = (total / count) ** (1.0 / gamma)
                out[y, x] = np.uint8(mean * 255.0 + 0.5)


@lean
def _sample(views, view, top, left, channel, linear):
    """A view's picture at a place in its pixels; its border is repeated outside of it."""
    height, width = views.shape[1], views.shape[2]
    if not linear:
        row = min(max(int(np.floor(top)), 0), height - 1)
        column = min(max(int(np.floor(left)), 0), width - 1)
        return float(views[view, row, column, channel])
    row, column = np.floor(top - 0.5), np.floor(left - 0.5)
    down, right = top - 0.5 - row, left - 0.5 - column
    y0, x0 = min(max(int(row), 0), height - 1), min(max(int(column), 0), width - 1)
    y1, x1 = min(max(int(row) + 1, 0), height - 1), min(max(int(column) + 1, 0), width - 1)
    upper = (1 - right) * views[view, y0, x0, channel] + right * views[view, y0, x1, channel]
    lower = (1 - right) * views[view, y1, x0, channel] + right * views[view, y1, x1, channel]
    return (1 - down) * upper + down * lower


@shared("out")
@lean_kernel
def interlace_views(since, until, views, steps, places, order, lens, window, linear, blend, out):
    """Code pictures of views for a panel.

    Parameters
    ----------
    views
        uint8 [V, h, w, 3], view 0 leftmost; V need not be the panel's number of views.
    steps, places, order, lens
        The panel; ``order`` int64 [3] is the color of each sub-pixel.
    window
        float64 [3]: width and height of the pictures over the panel's; shift of the last view
        against the middle one, in panel widths to the right.
    linear, blend
        Whether pictures are interpolated between their pixels, and views between their neighbours.
    out
        uint8 [H, W, 3].
    """
    height, width, _ = out.shape
    count, rows, columns = views.shape[0], views.shape[1], views.shape[2]
    for y in range(since, until):
        for x in range(width):
            for k in range(3):
                channel = order[k]
                across = (x + places[y % 4, x % 2, k, 0]) / width - 0.5
                down = (y + places[y % 4, x % 2, k, 1]) / height - 0.5
                if abs(across) > 0.5 * window[0] or abs(down) > 0.5 * window[1]:
                    out[y, x, channel] = 0
                    continue
                place = _view(y, x, k, steps, lens) * (count / lens[3])
                nearest = min(int(place), count - 1)
                first = nearest
                share = 0.0
                if blend:
                    inside = min(max(place - 0.5, 0.0), count - 1.0)
                    first = min(int(inside), max(count - 2, 0))
                    share = inside - first
                value = 0.0
                top = (down / window[1] + 0.5) * rows
                for other in range(2):
                    weight = share if other else 1.0 - share
                    if weight <= 0.0:
                        continue
                    view = min(first + other, count - 1)
                    turn = window[2] * (2.0 * (view + 0.5) / count - 1.0)
                    left = ((across + turn) / window[0] + 0.5) * columns
                    value += weight * _sample(views, view, top, left, channel, linear)
                out[y, x, channel] = np.uint8(min(max(value, 0.0), 255.0) + 0.5)


def gather_views(image, steps, places, order, lens, count, first, value, weight):
    """Collect the sub-pixels of a coded picture by their views.

    Parameters
    ----------
    image
        uint8 [H, W, 3].
    steps, places, order, lens
        As for `interlace_views`.
    count, first
        Number of views that the panel's are spread over; number of the first one wanted.
    value, weight
        float32 [n, h, w, 3], zero at first: sums over the sub-pixels that fall on a pixel of view
        ``first`` + i. A view's own count 1, others' within one sub-pixel's step next to nothing:
        they decide only where there is none of its own.
    """
    share_out(_gather_rows, value.shape[1], image, steps, places, order, lens, count, first, value,
              weight)


@lean_kernel
def _gather_rows(since, until, image, steps, places, order, lens, count, first, value, weight):
    """`gather_views` of some rows of the views."""
    height, width, _ = image.shape
    wanted, rows, columns = value.shape[0], value.shape[1], value.shape[2]
    reach = 0.5 + max(count / lens[0], 1.0)
    for row in range(since, until):
        start = max(int(np.floor(row * height / rows)) - 1, 0)
        stop = min(int(np.ceil((row + 1) * height / rows)) + 1, height)
        for y in range(start, stop):
            for x in range(width):
                for k in range(3):
                    if int((y + places[y % 4, x % 2, k, 1]) * rows / height) != row:
                        continue
                    column = int((x + places[y % 4, x % 2, k, 0]) * columns / width)
                    if column < 0 or column >= columns:
                        continue
                    channel = order[k]
                    shown = min(np.floor(_view(y, x, k, steps, lens)), lens[3] - 1) + 0.5
                    place = shown * count / lens[3]
                    own = min(int(place), count - 1)
                    low = max(int(np.ceil(place - 0.5 - reach)), first)
                    high = min(int(np.floor(place - 0.5 + reach)), first + wanted - 1)
                    for view in range(low, high + 1):
                        share = 1.0
                        if view != own:
                            near = 1.0 - abs(view + 0.5 - place) / (reach + 0.5)
                            share = 1e-4 * near * near
                        value[view - first, row, column, channel] += share * image[y, x, channel]
                        weight[view - first, row, column, channel] += share


@lean
def _aim(image, light, y, place, channel, wanted, steps, lens, crosstalk, sigma, reach, weight,
         value):
    """How nearly a row's sub-pixels are aimed at the eye, and that times their light."""
    aperture = lens[3] / lens[0]
    for x in range(image.shape[1]):
        # A sub-pixel shows its nearest view, seen as if from the middle of that view.
        view = min(np.floor(_view(y, x, place, steps, lens)), lens[3] - 1) + 0.5
        away = abs(view - wanted[3 * x + place])
        if crosstalk <= 0:
            sharp = max(0.0, 1.0 - away / (1.5 * aperture))
            # Next to nothing, so that a place without any near sub-pixel is not black.
            far = 1.0 + (away / aperture) ** 2
            share = sharp * sharp + 1e-6 / (far * far)
        else:
            away = min(away, lens[3] - away)
            share = np.exp(-0.5 * (away / sigma) ** 2)
        weight[x + reach] = share
        value[x + reach] = share * light[image[y, x, channel]]


@shared("out")
@kernel
def see_panel(since, until, image, light, wanted, order, steps, lens, crosstalk, block, out):
    """An eye's view: sub-pixels weighted by how nearly they are aimed at it, filled in by rows.

    Parameters
    ----------
    image
        uint8 [H, W, 3], the coded picture.
    light
        float32 [256], light of each stored value.
    wanted
        float64 [W * 3]: the view that the eye receives at each place of a row.
    order, steps, lens
        The panel.
    crosstalk
        Sigma in views of the lobe with which other views leak in; 0 = none.
    block
        Side of the blocks of pixels whose mean is taken.
    out
        float32 [H // block, W // block, 3].
    """
    width = image.shape[1]
    pitch, aperture = lens[0], lens[3] / lens[0] * lens[6]
    reach = max(1, int(np.ceil(pitch / 1.5)))
    sigma = np.hypot(crosstalk, 0.5 * aperture)
    window = np.empty(2 * reach + 1, np.float32)
    for i in range(2 * reach + 1):
        window[i] = np.exp(-0.5 * ((i - reach) / (pitch / 6.0)) ** 2)
    share = np.float32(1.0 / (block * block))
    # Beyond the ends of a row there is nothing.
    weight = np.zeros(width + 2 * reach, np.float32)
    value = np.zeros(width + 2 * reach, np.float32)
    top, mass = np.empty(width, np.float32), np.empty(width, np.float32)
    for line in range(since, until):
        out[line] = np.float32(0.0)
        for y in range(line * block, line * block + block):
            for place in range(3):
                channel = order[place]
                _aim(image, light, y, place, channel, wanted, steps, lens, crosstalk, sigma, reach,
                     weight, value)
                top[:] = np.float32(0.0)
                mass[:] = np.float32(1e-30)
                for i in range(2 * reach + 1):
                    near = window[i]
                    for x in range(width):
                        top[x] += near * value[x + i]
                        mass[x] += near * weight[x + i]
                for column in range(out.shape[1]):
                    total = np.float32(0.0)
                    for x in range(column * block, column * block + block):
                        total += top[x] / mass[x]
                    out[line, column, channel] += share * total
