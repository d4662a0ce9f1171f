"""Colors of what is closed beside what photos show, in the same light and with the same grain.

Where photos end, their colors go on: a membrane hangs from the last cells that they show well
(Laplace's equation: the smooth colors with the photos' own at the border, Perez et al. 2003 with no
gradients within). Hair and skin keep apart. A membrane alone is flat: hair beside its strands would
look like a cap, so their detail is laid on as in mirrors that stand where photos end.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...arrays import Bool, Float64
from ..geometry.plate import continued, smoothed

__all__ = ["continued_colors"]

BORDER = 1.5
"""Sigma, in cells, of the colors that the membrane hangs from: finer, each cell's noise would begin
a streak; broader, the border would show as a step."""
STRANDS = 3.0
"""Sigma, in cells, of the colors that the detail of hair is what is left of."""
GRAIN = 0.8
"""Sigma, in cells, of what in that detail is noise."""


def continued_colors(colors: Float64, well: Bool, upwards: Float64 | float,
                     hair: Bool | None) -> Float64:
    """Colors [V, U, 3] everywhere, from the cells that photos show well.

    Parameters
    ----------
    colors, well
        float64 [V, U, 3] and bool [V, U]; columns go around.
    upwards
        How strongly a color holds together up and down, over sideways: one, or one a row, [V].
    hair
        bool [V, U]: these cells keep apart from the others; None: one color.
    """
    if hair is None:
        return continued(smoothed(colors, well, BORDER), well, upwards=upwards)
    base = np.empty_like(colors)
    for part in (hair, ~hair):
        base[part] = smoothed(colors, well & part, BORDER)[part]
    out = continued(base, well, upwards=upwards, apart=hair)
    shown = well & hair
    detail = smoothed(colors, shown, GRAIN) - smoothed(colors, shown, STRANDS)
    out[hair] += _mirrored(detail, shown)[hair]
    return out


def _mirrored(detail: Float64, shown: Bool) -> Float64:
    """Detail [V, U, C] beyond the shown cells, as mirrors at their ends show it; 0 else.

    The mirrors stand left and right where hair ends in most rows, so that strands stay whole, and
    where it ends above and below in each column.
    """
    rows, columns = shown.shape
    some = shown.any(axis=1)
    out = np.zeros_like(detail)
    if not some.any():
        return out
    low, high = (int(np.median(ends)) for ends in _ends(shown[some]))
    column = np.clip(_between(np.arange(columns), low, high), 0, columns - 1)
    bottom, top = _ends(shown.T)
    row = _between(np.arange(rows)[:, None], bottom[column], top[column])
    found = ~shown & shown[row, column[None]]
    out[found] = detail[row, column[None]][found]
    return out


def _ends(shown: Bool) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The first and the last shown cell of each line [N, M], [N] each."""
    return shown.argmax(axis=1), shown.shape[1] - 1 - shown[:, ::-1].argmax(axis=1)


def _between(place: NDArray[np.int64], low: NDArray[np.int64] | int,
             high: NDArray[np.int64] | int) -> NDArray[np.int64]:
    """Where places are seen between two mirrors: there and back again."""
    width = np.maximum(np.subtract(high, low), 1)
    way = (place - low) % (2 * width)
    return np.asarray(low + np.where(way > width, 2 * width - way, way), np.int64)
