"""How a field's lattice shows in the charts of its skin: what a texture adds to.

With the density frozen a chart is linear in the lattice's colours. The weights are found once for a
skin and a resolution; what the colours of any painting show is a product with them.
"""

from __future__ import annotations

import functools

import cv2
import numpy as np
from numpy.typing import NDArray

from ..example import Skin
from ..field import SampleWeights, VoxelField
from .kernels.linear import gather_colors
from .skin_fit import chart_camera, chart_pixels

__all__ = ["ChartLattice", "chart_lattice"]

Float32 = NDArray[np.float32]

MARGIN = 12
"""Pixels kept around what a chart owns, so that cells at a border find theirs in either chart."""
SOLID = 0.9
"""Where a chart's own view is clearer than this, nothing is known of the surface's colour."""


Map = tuple[tuple[slice, slice], SampleWeights]
"""Rows and columns of the atlas that a chart fills, and the weights of its pixels."""


class ChartLattice:
    """The charts of a skin as linear maps of a field's colours.

    Parameters
    ----------
    field
        Its densities count.
    skin
        Of the field.
    step
        Every so many pixels of the atlas. At the full resolution each chart's map is made when it
        is needed: all of them take four times the room of a preview's.

    Attributes
    ----------
    near
        bool [H, W] of the atlas at that resolution: what charts own, and a margin around it.
    """

    def __init__(self, field: VoxelField, skin: Skin, step: int) -> None:
        self.density = field.density
        atlas = skin.atlas
        shape = atlas.depth.shape[0] // step, atlas.depth.shape[1] // step
        own = atlas.own[::step, ::step][:shape[0], :shape[1]]
        around = np.ones((2 * MARGIN // step + 1,) * 2, np.uint8)
        self.near = cv2.dilate(own.astype(np.uint8), around) > 0
        self._maps = [_chart_map(field, skin, step, n, self.near) if step > 1
                      else functools.partial(_chart_map, field, skin, step, n, self.near)
                      for n in range(len(atlas.boxes))]

    def left_out(self, picture: Float32, colors: Float32) -> Float32:
        """What lattice colours [N, 3] leave out of a picture of the atlas, float32 [H, W, 3].

        0 where nothing solid is near.
        """
        out = np.zeros_like(picture)
        for kept in self._maps:
            there, weights = kept() if callable(kept) else kept
            shown = np.empty((len(weights.alpha), 3), np.float32)
            gather_colors(weights.indptr, weights.rows, weights.weights, colors, shown)
            alpha = weights.alpha[:, None]
            shown /= np.maximum(alpha, np.float32(SOLID))
            shown = np.where(alpha > SOLID, picture[there].reshape(-1, 3) - shown, 0)
            out[there] = shown.reshape(out[there].shape)
        return out


def chart_lattice(field: VoxelField, skin: Skin, step: int) -> ChartLattice:
    """The maps of a field's colours to every ``step``-th pixel of its skin's charts.

    Those of previews are kept with the skin.
    """
    if step == 1:
        return ChartLattice(field, skin, step)
    kept: dict[int, ChartLattice] = skin.once("lattices", dict)
    if step not in kept or kept[step].density is not field.density:
        kept[step] = ChartLattice(field, skin, step)
    return kept[step]


def _chart_map(field: VoxelField, skin: Skin, step: int, n: int, near: NDArray[np.bool_]) -> Map:
    camera = chart_camera(skin, n, step)
    top, left = (part.start // step for part in chart_pixels(skin, n, 1))
    there = (slice(top, top + int(camera.height[0])), slice(left, left + int(camera.width[0])))
    # As views are rendered; a preview takes longer strides.
    stride = 0.5 if step == 1 else 1.0
    return there, field.sample_weights(camera, 0, step=stride, inside=near[there])
