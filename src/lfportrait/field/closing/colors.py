"""Colors of what is closed beside what photos show, in the same light and with the same grain.

Where photos end, their colors go on: a membrane hangs from the last cells that they show well
(Laplace's equation: the smooth colors with the photos' own at the border, Perez et al. 2003 with no
gradients within). Hair and skin keep apart. A membrane alone is flat: hair beside its strands would
look like a cap, so their detail is laid on as in a mirror that stands where photos end.
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
    out[hair] += _mirrored(colors - smoothed(colors, well & hair, STRANDS), well & hair)[hair]
    return out


def _mirrored(detail: Float64, shown: Bools) -> Float64:
    """Detail [V, U, C] beyond the shown cells, as a mirror at their border shows it; 0 else."""
    rows, columns = shown.shape
    if not shown.any():
        return np.zeros_like(detail)
    around = np.tile(shown, 3)
    nearest = ndimage.distance_transform_edt(~around, return_distances=False, return_indices=True)
    row, column = (2 * found - place for found, place in zip(nearest, np.indices(around.shape)))
    row, column = (part[:, columns:2 * columns] for part in (row, column))
    inside = (row >= 0) & (row < rows) & ~shown
    row, column = np.clip(row, 0, rows - 1), column % columns
    inside &= shown[row, column]
    return np.where(inside[..., None], detail[row, column], 0.0)
