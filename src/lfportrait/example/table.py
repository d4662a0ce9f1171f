"""The look-up table of Eq. 6: for every (x, y, appearance) the nearest pixel of the exemplar.

FaceBlit fills it by searching a window around every cell (over a minute). Both readings of the
error are separable, so a distance transform that carries the arg-min gives the exact table over the
whole exemplar in a fraction of a second.

Exact means: the exemplar's guides are quantised to cells, and no cell's pixel is worse than any
other pixel of the exemplar. Equal costs go to the pixel that comes first in scan order (for the
weighted L1 form; for the squared form any pixel of least cost, always the same one).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from ..arrays import Float32, Int32
from ..files import UNREADABLE_ARRAYS, atomic_write
from .kernels.table import extract_indices, scatter_pixels, sweep_linear, sweep_squared

FIXED = 64.0
"""Costs are whole numbers of 1 / FIXED."""


@dataclass(frozen=True)
class TableConfig:
    """Error of the look-up table (Eq. 6) and its resolution."""

    form: Literal["linear", "squared"] = "linear"
    """linear: weighted L1 as FaceBlit has it; squared: the paper's Eq. 6."""
    position_weight: float = 10.0
    """Weight of one position unit (1/50 of the face's size, about 3 pixels of a 768 x 1024
    exemplar), 1 to 30: high keeps pixels in place, low lets look-ups move far."""
    appearance_weight: float = 1.25
    """Weight of one grey level (of 255) of the appearance, 0 to 4: low keeps patches of the
    exemplar whole, high keeps the likeness; above 2, noise of the photo scatters the look-ups."""
    cell: int = 3
    """Side of a table cell in exemplar pixels, 1 to 8."""
    levels: int = 64
    """Number of appearance levels, 8 to 256."""


@dataclass
class LookUpTable:
    """Nearest exemplar pixel of every cell.

    Attributes
    ----------
    indices
        int32 [rows, columns, levels], flat pixel index y * width + x.
    cell
        Side of a cell in exemplar pixels.
    low, step
        Appearance of level 0, and the distance of levels.
    """

    indices: Int32
    cell: int
    low: float
    step: float


def quantise(appearance: Float32,
             levels: int) -> tuple[Int32, float, float]:
    """Levels of an appearance guide: (int32 [H, W], value of level 0, distance of levels)."""
    reach = float(max(np.abs(appearance).max(), 1e-3))
    step = 2 * reach / (levels - 1)
    index = np.rint((appearance + np.float32(reach)) / np.float32(step)).astype(np.int32)
    return np.clip(index, 0, levels - 1), -reach, step


def integer_costs(config: TableConfig, unit: float, step: float) -> tuple[int, int]:
    """Cost of one cell along x or y, and of one appearance level, in 1 / FIXED; at least 1.

    So where the appearance has no weight it still decides among equals.
    """
    grey_levels = 255.0 * step
    if config.form == "squared":
        position = config.position_weight * (config.cell / unit) ** 2
        appearance = config.appearance_weight * grey_levels ** 2
    else:
        position = config.position_weight * config.cell / unit
        appearance = config.appearance_weight * grey_levels
    return max(1, round(FIXED * position)), max(1, round(FIXED * appearance))


def build_table(appearance: Float32, config: TableConfig, unit: float) -> LookUpTable:
    """Build the exact table of one exemplar (Eq. 6).

    Parameters
    ----------
    appearance
        float32 [H, W], the exemplar's appearance guide.
    config
        Weights and resolution.
    unit
        Position unit in exemplar pixels.
    """
    height, width = appearance.shape
    if height * width >= 1 << 28:
        raise ValueError("exemplar too large for a table")
    level, low, step = quantise(appearance, config.levels)
    shape = (config.levels, -(-height // config.cell), -(-width // config.cell))
    keys = np.empty(shape, np.int64)
    scatter_pixels(level, config.cell, keys)
    position, look = integer_costs(config, unit, step)
    sweep = sweep_squared if config.form == "squared" else sweep_linear
    sweep(keys, position, position, look)
    indices = np.empty((*shape[1:], shape[0]), np.int32)
    extract_indices(keys, indices)
    return LookUpTable(indices, config.cell, low, step)


def cached_table(appearance: Float32, config: TableConfig, unit: float,
                 cache: Path | None) -> LookUpTable:
    """`build_table`, kept in the folder ``cache`` under a hash of all that it depends on."""
    if cache is None:
        return build_table(appearance, config, unit)
    digest = hashlib.sha256(np.ascontiguousarray(appearance).tobytes())
    digest.update(repr((appearance.shape, config, round(unit, 6), "table 2")).encode())
    path = Path(cache) / f"table-{digest.hexdigest()[:24]}.npz"
    if path.exists():
        try:
            with np.load(path, allow_pickle=False) as stored:
                return LookUpTable(stored["indices"], int(stored["cell"]), float(stored["low"]),
                                   float(stored["step"]))
        except UNREADABLE_ARRAYS:
            path.unlink(missing_ok=True)
    table = build_table(appearance, config, unit)
    with atomic_write(path) as stream:
        np.savez(stream, indices=table.indices, cell=table.cell, low=table.low, step=table.step)
    return table
