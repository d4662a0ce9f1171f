"""Where the search for a ground's patches begins: pieces of the exemplar's background."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

__all__ = ["first_places"]

Float32 = NDArray[np.float32]
Bools = NDArray[np.bool_]

PART = 8
"""Above and below a background goes on as this part of its height does."""


def first_places(there: Bools, inside: Bools, middle: NDArray[np.float64], shape: tuple[int, int],
                 side: int, rng: np.random.Generator,
                 ) -> tuple[Float32, NDArray[np.int64]]:
    """Places of the exemplar where the search begins, and each row's own height in it.

    Where the exemplar has background it stays where it is. Beyond, whole pieces of it lie side by
    side, each from about its own height; what is not background in them comes from smaller pieces.

    Parameters
    ----------
    there, inside
        bool [h, w], where the exemplar is background, and where a patch is as a whole.
    middle
        Place (x, y) between its eyes, which the ground's middle lies behind.
    shape, side
        Of the ground, and of a piece.
    rng
        Chooses pieces.

    Returns
    -------
    start
        float32 [H, W, 2], (x, y).
    level
        int64 [H], row of the exemplar that is as high.
    """
    rows, columns = np.nonzero(inside if inside.any() else there)
    left, top = (round(float(v)) for v in middle - np.array(shape[::-1]) / 2)
    level = _folded(np.arange(shape[0]) + top, int(rows.min()), int(rows.max()))
    y, x = np.indices(shape)
    u, v = x + left, y + top
    order = np.argsort(rows, kind="stable")
    for piece in (side, max(side // 3, 6), 6):
        missing = ~_within(there, u, v)
        moved = _pieces(rows[order], columns[order], level, piece, shape, rng)
        u, v = np.where(missing, moved[0], u), np.where(missing, moved[1], v)
    missing = ~_within(there, u, v)
    _, nearest = distance_transform_edt(~there, return_indices=True)
    at = np.clip(v, 0, len(nearest[0]) - 1), np.clip(u, 0, nearest.shape[2] - 1)
    u, v = np.where(missing, nearest[1][at], u), np.where(missing, nearest[0][at], v)
    return np.asarray(np.stack([u, v], axis=-1) + 0.5, np.float32), level


def _folded(rows: NDArray[np.int64], first: int, last: int) -> NDArray[np.int64]:
    """Rows of the picture that stand for rows above and below its background, int64 [H].

    There the nearest part of it is gone up and down: one row again and again would be stripes.
    """
    part = max((last - first) // PART, 1)

    def fold(beyond: NDArray[np.int64]) -> NDArray[np.int64]:
        turned = beyond % (2 * part)
        return np.minimum(turned, 2 * part - turned)

    out = np.where(rows < first, first + fold(first - rows), rows)
    return np.asarray(np.where(rows > last, last - fold(rows - last), out), np.int64)


def _within(there: Bools, u: NDArray[np.int64], v: NDArray[np.int64]) -> Bools:
    """Whether places (column u, row v) lie in the picture and in a mask."""
    height, width = there.shape
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    inside[inside] = there[v[inside], u[inside]]
    return inside


def _pieces(rows: NDArray[np.int64], columns: NDArray[np.int64], level: NDArray[np.int64],
            side: int, shape: tuple[int, int], rng: np.random.Generator,
            ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Columns and rows [H, W] of a ground of square pieces, each from about its height.

    ``rows`` and ``columns`` are the places that pieces may have their middles at, from above; every
    second line of pieces is half a piece aside.
    """
    y, x = np.indices(shape)
    line = y // side
    count = int(line.max()) + 1, -(-shape[1] // side) + 1
    middle = level[np.minimum(np.arange(count[0]) * side + side // 2, shape[0] - 1)]
    # One of those that are at most half a piece, or a twentieth of them all, above or below.
    few = len(rows) // 20
    at = np.searchsorted(rows, middle)
    first = np.minimum(np.searchsorted(rows, middle - side // 2), np.maximum(at - few, 0))
    last = np.maximum(np.searchsorted(rows, middle + side // 2), np.minimum(at + few, len(rows)))
    chosen = first[:, None] + (rng.random(count) * (last - first)[:, None]).astype(np.int64)
    chosen = np.minimum(chosen, len(rows) - 1)
    aside = x + line % 2 * (side // 2)
    one = chosen[line, aside // side]
    return (columns[one] + aside % side - side // 2, rows[one] + y % side - side // 2)
