"""Hot loops of the soft region labels and of the guides' weights.

Features (brows, eyes, nose, lips, and all that is below the jaw) are soft and come as block means
of the picture; person and hair come at full size. Both loops interpolate the former on the fly.
"""

from __future__ import annotations

import numba
import numpy as np

__all__ = ["luma", "pixel_weights", "soft_labels"]


@numba.njit(cache=True, parallel=True)
def luma(image, scale, out):
    """Rec. 601 luma of ``image`` [H, W, 3 or more], any number type, times ``scale``."""
    red, green, blue = (np.float32(0.299) * scale, np.float32(0.587) * scale,
                        np.float32(0.114) * scale)
    for y in numba.prange(image.shape[0]):
        for x in range(image.shape[1]):
            out[y, x] = (red * np.float32(image[y, x, 0]) + green * np.float32(image[y, x, 1])
                         + blue * np.float32(image[y, x, 2]))


@numba.njit(cache=True, inline="always")
def _place(n, factor, count):
    """Block before pixel ``n`` and the share of the next one, of ``count`` blocks."""
    share = (np.float32(n) + np.float32(0.5)) / np.float32(factor) - np.float32(0.5)
    block = min(max(np.int64(np.floor(share)), 0), max(count - 2, 0))
    return block, min(max(share - np.float32(block), np.float32(0)), np.float32(1))


@numba.njit(cache=True, inline="always")
def _between(planes, k, j, below, i, right, fy, fx):
    """Plane ``k`` of ``planes`` [K, h, w] between four blocks."""
    top = planes[k, j, i] + fx * (planes[k, j, right] - planes[k, j, i])
    low = planes[k, below, i] + fx * (planes[k, below, right] - planes[k, below, i])
    return top + fy * (low - top)


@numba.njit(cache=True, inline="always")
def _byte(value):
    return np.uint8(value * np.float32(255) + np.float32(0.5))


@numba.njit(cache=True, parallel=True)
def soft_labels(person, hair, planes, factor, hair_is_skin, body_is_ground, out):
    """Labels of every pixel, uint8 [H, W, 8], in the order of `regions.LABELS`.

    Parameters
    ----------
    person, hair
        float32 [H, W].
    planes
        float32 [5, h, w], means over blocks of ``factor`` pixels: brows, eyes, nose, lips, body.
    hair_is_skin, body_is_ground
        Give hair to the skin, the body to the background.
    """
    height, width = person.shape
    rows, columns = planes.shape[1:]
    one = np.float32(1)
    for y in numba.prange(height):
        j, fy = _place(y, factor, rows)
        below = min(j + 1, rows - 1)
        busy = np.zeros(columns, np.bool_)
        for k in range(4):
            for i in range(columns):
                busy[i] |= planes[k, j, i] > 0 or planes[k, below, i] > 0
        for x in range(width):
            i, fx = _place(x, factor, columns)
            right = min(i + 1, columns - 1)
            rest = one
            if busy[i] or busy[right]:
                for k in range(4):
                    soft = _between(planes, k, j, below, i, right, fy, fx)
                    out[y, x, k] = _byte(soft * rest)
                    rest *= one - soft
            else:
                out[y, x, 0] = out[y, x, 1] = out[y, x, 2] = out[y, x, 3] = 0
            body = _between(planes, 4, j, below, i, right, fy, fx)
            inside, crown = person[y, x] * rest, hair[y, x]
            if hair_is_skin:
                crown = np.float32(0)
            skin = inside * (one - crown)
            ground = rest - inside
            below_jaw = skin * body
            if body_is_ground:
                ground += below_jaw
                below_jaw = np.float32(0)
            out[y, x, 4] = _byte(skin * (one - body))
            out[y, x, 5] = _byte(inside * crown)
            out[y, x, 6] = _byte(below_jaw)
            out[y, x, 7] = _byte(ground)


@numba.njit(cache=True, parallel=True)
def pixel_weights(person, labels, soft, factor, place, outline, look, hair, body, out):
    """Weights of place and appearance of every pixel, float32 [H, W, 2].

    Parameters
    ----------
    person
        float32 [H, W].
    labels
        uint8 [H, W, 8].
    soft
        float32 [h, w], the person blurred, means over blocks of ``factor`` pixels.
    place, look
        float32 [2] each, weight outside the person and on it.
    outline
        Added to the weight of the place where ``soft`` is one half.
    hair, body
        Factors of the appearance's weight there.
    """
    height, width = person.shape
    rows, columns = soft.shape
    one = np.float32(1)
    less_hair, less_body = (one - hair) / np.float32(255), (one - body) / np.float32(255)
    for y in numba.prange(height):
        j, fy = _place(y, factor, rows)
        below = min(j + 1, rows - 1)
        line = np.empty(columns, np.float32)
        for i in range(columns):
            line[i] = soft[j, i] + fy * (soft[below, i] - soft[j, i])
        for x in range(width):
            i, fx = _place(x, factor, columns)
            edge = line[i] + fx * (line[min(i + 1, columns - 1)] - line[i])
            inside = person[y, x]
            out[y, x, 0] = (place[0] + (place[1] - place[0]) * inside
                            + np.float32(4) * outline * edge * (one - edge))
            share = (one - less_hair * np.float32(labels[y, x, 5])
                     - less_body * np.float32(labels[y, x, 6]))
            out[y, x, 1] = (look[0] + (look[1] - look[0]) * inside) * share
