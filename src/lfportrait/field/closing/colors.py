"""Colors of what is closed beside what photos show, in the same light and with the same grain.

Where photos end, their colors go on: a membrane hangs from the last cells that they show well
(Laplace's equation: the smooth colors with the photos' own at the border, Perez et al. 2003 with no
gradients within). Hair and skin keep apart. A membrane alone is flat: hair beside its strands would
look like a cap, so their detail is laid on as in mirrors that stand where photos end.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..geometry.plate import continued, smoothed

__all__ = ["continued_colors"]

Float64 = NDArray[np.float64]
Bools = NDArray[np.bool_]

BORDER = 1.5
"""Sigma, in cells, of the colors that the membrane hangs from: finer, each cell's noise would begin
a streak; broader, the border would show as a step."""
STRANDS = 3.0
"""Sigma, in cells, of the colors that the detail of hair is what is left of."""
GRAIN = 0.8
"""Sigma, in cells, of what in that detail is noise."""


def continued_colors(colors: Float64, well: Bools, upwards: Float64 | float,
                     hair: Bools | None) -> Float64:
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


def _mirrored(detail: Float64, shown: Bools) -> Float64:
    """Detail [V, U, C] beyond the shown cells, as mirrors at their ends show it; 0 else.

    The mirrors stand left and right where hair ends in most rows, so that strands stay whole, and
    at the highest row.
    """
    rows, columns = shown.shape
    out = np.zeros_like(detail)
    some = np.flatnonzero(shown.any(axis=1))
    if not len(some):
        return out
    row = np.abs(np.arange(rows) - some[-1])
    row = np.clip(some[-1] - row, some[0], None)
    ends = np.stack([shown[some].argmax(axis=1), columns - 1 - shown[some, ::-1].argmax(axis=1)])
    low, high = (int(np.median(part)) for part in ends)
    width = max(high - low, 1)
    # There and back again, as between two mirrors.
    place = (np.arange(columns)[None] - low) % (2 * width)
    column = np.clip(low + np.where(place > width, 2 * width - place, place), 0, columns - 1)
    row, column = np.broadcast_arrays(row[:, None], column)
    found = ~shown & shown[row, column]
    out[found] = detail[row, column][found]
    return out
