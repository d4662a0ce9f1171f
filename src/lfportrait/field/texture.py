"""Surface texture of a field: detail finer than its lattice, added where rays end.

A painted head carries, beside the colors of its lattice, what these leave out of the painting: the
difference, in a few far pictures of the head (charts), side by side. A ray is composited as ever
(Shen et al. 2023, Eq. 1); where its transmittance passes one half, it has met the surface, and the
texture's difference there is added to its color, by its opacity. The pictures are far and nearly
parallel to the surface, so that a small error of the depth does not move a stroke.

What looks from further away than the texture was painted for takes a coarser one, as texture
pyramids do (Williams 1983), in steps of a quarter of an octave. Where the surface is turned away
from a rendered pixel, several look-ups share its long piece of surface; a coded sub-pixel takes
one.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..arrays import Float32, Float64, Floats, Int8, Int32, UInt8
from .kernels.bricks import Bricks
from .kernels.texture import NONE, cell_charts, halve

OCTAVES = 6  # Octaves of the pyramid; at the last one a texel is as large as eight lattice points.
STEPS = 4  # Levels in each octave.
FULL = 254.0
"""Texels per full scale: differences up to one half either way are kept exactly enough."""

TextureRows = tuple[Int32, Float32, Int32]
"""What kernels take (`kernels.texture.make_detail`): charts of cells, projections, texels."""

NO_TEXTURE: TextureRows = (np.zeros(0, np.int32), np.zeros((0, 12), np.float32),
                           np.zeros((0, 0), np.int32))
"""The same for a field without a texture."""


@dataclass(frozen=True)
class SurfaceTexture:
    """Differences to the lattice's colors over the surface of a field of N rows."""

    # int8 [H, W, 3], differences of sRGB in 254ths; 0 where nothing is known.
    texels: Int8
    # float64 [C, 3, 4], from the world to texels (x, y; homogeneous), one for each chart. The
    # middle of the first texel lies at (0.5, 0.5).
    projections: Float64
    charts: UInt8  # uint8 [N], the chart that shows each row's place; 255 where none does.
    pixels: float  # Texels per world unit.

    def __post_init__(self) -> None:
        count = len(self.projections)
        if (self.texels.ndim != 3 or self.texels.shape[2] != 3 or self.texels.dtype != np.int8
                or self.projections.shape != (count, 3, 4) or not 0 < count < NONE
                or self.charts.ndim != 1 or self.charts.dtype != np.uint8
                or not np.isfinite(self.projections).all() or not 0 < self.pixels < math.inf):
            raise ValueError("a texture needs texels int8 [H, W, 3], projections [C, 3, 4] of at "
                             "most 254 charts, their numbers uint8 [N] and its resolution")
        if (self.charts[self.charts != NONE] >= count).any():
            raise ValueError(f"rows name charts beyond the {count} of the texture")

    @staticmethod
    def of(detail: Floats, projections: Floats, charts: UInt8, pixels: float) -> SurfaceTexture:
        """A texture of differences [H, W, 3] of sRGB; those beyond one half are clipped."""
        texels = np.clip(np.rint(detail * np.float32(FULL)), -127, 127).astype(np.int8)
        return SurfaceTexture(texels, np.asarray(projections, np.float64), charts, float(pixels))

    @property
    def detail(self) -> Float32:
        """Differences of sRGB, float32 [H, W, 3]."""
        return self.texels * np.float32(1 / FULL)

    def with_texels(self, texels: Int8) -> SurfaceTexture:
        """The same places with other texels, int8 [H, W, 3]."""
        return replace(self, texels=texels)

    @functools.cached_property
    def _octaves(self) -> list[Int32]:
        """Texels as the kernels take them, int32 [h, w], each half the size of the one before."""
        height, width = self.texels.shape[:2]
        first = np.zeros((height, width, 4), np.int8)
        first[..., :3] = self.texels
        octaves = [first]
        while len(octaves) < OCTAVES and min(octaves[-1].shape[:2]) >= 4:
            height, width, _ = octaves[-1].shape
            octaves.append(np.zeros((height // 2, width // 2, 4), np.int8))
            halve(octaves[-2], octaves[-1])
        return [octave.view("<i4")[..., 0] for octave in octaves]

    @functools.cached_property
    def _between(self) -> dict[int, Int32]:
        """Levels between the octaves that were asked for before."""
        return {}

    def level(self, footprint: float, whole: bool = False) -> int:
        """The level whose detail is nearest to ``footprint``, world units, in width.

        In level n that is 2^(n / `STEPS`) texels of the texture; ``whole``: of those that are
        octaves.
        """
        wanted = math.log2(max(footprint * self.pixels, 1e-9))
        level = STEPS * round(wanted) if whole else round(wanted * STEPS)
        return min(max(level, 0), (len(self._octaves) - 1) * STEPS)

    def width(self, footprint: float) -> float:
        """Width of the detail, in world units, of the level nearest to ``footprint``."""
        return float(2.0 ** (self.level(footprint) / STEPS) / self.pixels)

    def words(self, level: int) -> Int32:
        """Texels of a level as the kernels take them, int32 [h, w] of its octave; kept once made.

        Between two octaves they are the finer one's, and by the share of the way the coarser one's
        looked up there: what looking up both would give (trilinear filtering), in one look-up.
        """
        octave, part = divmod(level, STEPS)
        if part == 0:
            return self._octaves[octave]
        if level not in self._between:
            self._between[level] = _mixed(self._octaves[octave], self._octaves[octave + 1],
                                          part / STEPS)
        return self._between[level]

    def rows(self, cells: Int32, lattice: Float64,
             footprint: float, whole: bool = False) -> TextureRows:
        """Arrays for the kernels; ``cells`` are charts of the layout's cells (`texture_cells`).

        ``footprint`` is the width of the detail that is wanted, world units; ``whole``: look up an
        octave.
        """
        level = self.level(footprint, whole)
        world = np.eye(4)
        world[:3, :3] = np.diag(1.0 / lattice[3:6])
        world[:3, 3] = -lattice[6:9] / lattice[3:6]
        maps = self.projections @ world
        maps[:, :2] *= 0.5 ** (level // STEPS)
        return cells, np.ascontiguousarray(maps.reshape(-1, 12), np.float32), self.words(level)


def _mixed(fine: Int32, coarse: Int32, share: float) -> Int32:
    """Texels of an octave [h, w] mixed with ``share`` of the next one's, looked up between them."""
    # OpenCV's fast paths are for unsigned bytes.
    one, other = (np.ascontiguousarray(words).view(np.uint8).reshape(*words.shape, 4)
                  ^ np.uint8(128) for words in (fine, coarse))
    # Middles of texels: (x + 0.5) / 2 - 0.5.
    places = np.array([[0.5, 0, -0.25], [0, 0.5, -0.25]])
    wide = cv2.warpAffine(other, places, fine.shape[::-1],
                          flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                          borderMode=cv2.BORDER_REPLICATE)
    out = np.asarray(cv2.addWeighted(one, 1 - share, wide, share, 0), np.uint8) ^ np.uint8(128)
    return np.ascontiguousarray(out).view("<i4")[..., 0]


def texture_cells(texture: SurfaceTexture, bricks: Bricks) -> Int32:
    """Charts of the cells of a field's layout, int32 [bricks * 128]."""
    out = np.empty(len(bricks.links), np.int32)
    cell_charts(bricks.links, np.append(texture.charts, np.uint8(NONE)), out)
    return out
