"""A surface texture with the details of a painting that the lattice can't hold.

The painted atlas minus what the lattice shows in its charts (`chart_lattice`): added where a ray
meets the surface, it shows the painting itself, as sharp as it was painted.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..example import Painting, Skin
from ..field import C0, SurfaceTexture, VoxelField
from .chart_lattice import ChartLattice, chart_lattice
from .mixing.texels import BLOCK

__all__ = ["row_charts", "surface_texture", "texel_rows"]

Float32 = NDArray[np.float32]

KEEN = 0.1
"""Looking up between texels blurs: on average, over where a look-up falls, detail of four texels
keeps 2/3 of its energy, of two 1/3. The texture makes up for it (generalised sampling): neighbours
on either side are taken off with this weight. So views are nearest to what was painted, looked up
by a filter of eight texels (Lanczos)."""


def surface_texture(styled: VoxelField, painting: Painting,
                    lattice: ChartLattice | None = None) -> SurfaceTexture:
    """The texture that makes a field show a painting of its skin.

    Parameters
    ----------
    styled
        The field with its colors after the painting, the same in all directions.
    painting
        On the field's skin.
    lattice
        How the field shows in its charts at the painting's resolution, where that is known.
    """
    skin, step = painting.skin, painting.step
    lattice = lattice or chart_lattice(styled, skin, step)
    colors = np.asarray(C0 * styled.sh[:, :, 0] + 0.5, np.float32)
    detail = _keen(lattice.left_out(painting.color, colors))
    detail *= lattice.near[..., None]
    charts = skin.once("row charts", lambda: row_charts(skin))
    return SurfaceTexture.of(detail, projections(skin, step), charts,
                             skin.pixels / step)


def _keen(detail: Float32) -> Float32:
    """Differences [H, W, 3] that a bilinear look-up shows as sharp as they were."""
    row = np.array([-KEEN, 1 + 2 * KEEN, -KEEN], np.float32)
    return np.asarray(cv2.sepFilter2D(detail, -1, row, row), np.float32)


def projections(skin: Skin, step: int = 1) -> NDArray[np.float64]:
    """From the world to the atlas at every ``step``-th pixel, float64 [C, 3, 4]."""
    cameras, boxes = skin.atlas.cameras, skin.atlas.boxes
    out = np.empty((len(boxes), 3, 4))
    for n, (x0, y0, _, _, dx, dy) in enumerate(boxes.tolist()):
        lens = np.eye(3)
        lens[[0, 1], [0, 1]] = cameras.focal[n] / step
        # Whole blocks of the atlas: as `chart_pixels` has them.
        corner = np.array([(x0 + dx) // step, (y0 + dy) // step])
        lens[:2, 2] = (cameras.center[n] - [x0, y0]) / step + corner
        turn = cameras.pose[n, :3, :3].T
        out[n] = lens @ np.concatenate([turn, -(turn @ cameras.pose[n, :3, 3])[:, None]], axis=1)
    return out


def row_charts(skin: Skin) -> NDArray[np.uint8]:
    """The chart that shows each lattice row's place, uint8 [R]; 255 where none does."""
    out = np.full(len(skin.rows), 255, np.uint8)
    x, y = np.ascontiguousarray(skin.rows.T)
    for n, (x0, y0, x1, y1, dx, dy) in enumerate(skin.atlas.boxes.tolist()):
        # A comparison with NaN is false.
        out[(x >= x0 + dx) & (x < x1 + dx) & (y >= y0 + dy) & (y < y1 + dy)] = n
    return out


def texel_rows(skin: Skin, texture: SurfaceTexture) -> NDArray[np.int32]:
    """A lattice row for each block of texels, int32 [H / 4, W / 4] rounded up: that nearest to it.

    ``texture`` is of the skin, with which they are kept.
    """
    shape = tuple(-(-size // BLOCK) for size in texture.texels.shape[:2])
    return skin.once(("texel rows", texture.pixels, shape),
                     lambda: _block_rows(skin, texture, shape))


def _block_rows(skin: Skin, texture: SurfaceTexture, shape: tuple[int, ...]) -> NDArray[np.int32]:
    found = np.full(shape, -1, np.int32)
    known = np.flatnonzero(np.isfinite(skin.rows[:, 0]))
    scale = texture.pixels / skin.pixels / BLOCK
    block = (skin.rows[known] * scale).astype(np.int64)
    block = np.minimum(block, np.array(shape[::-1]) - 1)
    found[block[:, 1], block[:, 0]] = known
    _, labels = cv2.distanceTransformWithLabels(
        (found < 0).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5,
        labelType=cv2.DIST_LABEL_PIXEL)
    # A label is a number of its own for each block that has a row.
    row_of = np.zeros(int(labels.max()) + 1, np.int32)
    row_of[labels[found >= 0]] = found[found >= 0]
    return np.asarray(row_of[labels], np.int32)
