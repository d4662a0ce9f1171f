"""What fields of the same links and densities lay out alike, whatever their colors are.

A painted head has the lattice of the photographed one, and so has each mix of it: only its colors
are new. What depends on the lattice alone is made once for all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Float32, Int32, UInt8
from .kernels.bricks import (
    Bricks,
    Places,
    Stretches,
    build_bricks,
    fill_stretches,
    place_stretches,
)
from .texture import SurfaceTexture, texture_cells

__all__ = ["Layouts"]

_NO_COLORS = np.zeros((0, 3, 1), np.float32)


@dataclass(eq=False)
class Layouts:
    """The layouts of a lattice, each made when it is first asked for.

    Attributes
    ----------
    extent
        `VoxelField.solid_extent`, once it is known.
    """

    extent: tuple[float, float, float] | None = None
    _bricks: Bricks | None = None
    _places: Places | None = None
    _cells: tuple[UInt8, Int32] | None = None

    def bricks(self, links: Int32, density: Float32,
               sh: NDArray[np.floating[Any]]) -> Bricks:
        """The layout for casting, in the colors ``sh``, float [N, 3, B]."""
        if self._bricks is None:
            built = build_bricks(links, density, sh)
            self._bricks = replace(built, sh=_NO_COLORS)
            return built
        return replace(self._bricks, sh=sh)

    def stretches(self, links: Int32, density: Float32,
                  sh: NDArray[np.floating[Any]]) -> Stretches:
        """The layout for slices, in the colors ``sh``, float [N, 3, B]."""
        if self._places is None:
            self._places = place_stretches(links)
        return fill_stretches(self._places, links, density, sh)

    def cells(self, texture: SurfaceTexture, bricks: Bricks) -> Int32:
        """`texture_cells`; those of the last charts are kept."""
        if self._cells is None or self._cells[0] is not texture.charts:
            self._cells = texture.charts, texture_cells(texture, bricks)
        return self._cells[1]
