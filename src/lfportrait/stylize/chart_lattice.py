"""Render a field's lattice in the charts of its skin, as the base of the texture.

With the density frozen a chart is linear in the lattice's colors. The weights are found once for a
skin and a resolution; what the colors of any painting show is a product with them. Those of a
preview are kept with the skin, and in the user's cache: they take more room than a job's other
files, and only previews of the same head need them again.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..cache import kept_arrays, key_of
from ..example import Skin
from ..field import SampleWeights, VoxelField
from .kernels.linear import gather_colors
from .skin_fit import chart_camera, chart_pixels

__all__ = ["PREVIEW", "ChartLattice", "chart_lattice"]

Float32 = NDArray[np.float32]

PREVIEW = 2
"""Pixels of the skin per painted pixel in a preview."""
MARGIN = 12
"""Pixels kept around what a chart owns, so that cells at a border find theirs in either chart."""
HEADS = 4
"""So many heads' maps for previews, 50 MB each, stay in the user's cache."""
SOLID = 0.9
"""Where a chart's own view is clearer than this, nothing is known of the surface's color."""


_ARRAYS = "lattice_counts", "lattice_rows", "lattice_weights"
"""Rows a pixel of each chart in turn, uint8; which, int32; how much of each, float16."""

Map = tuple[tuple[slice, slice], SampleWeights]
"""Rows and columns of the atlas that a chart fills, and the weights of its pixels."""


class ChartLattice:
    """The charts of a skin as linear maps of a field's colors.

    Parameters
    ----------
    field
        Its densities count.
    skin
        Of the field.
    step
        Use every ``step``-th pixel of the atlas. At the full resolution each chart's map is made
        when it is needed: all of them take four times the room of a preview's.
    arrays
        From `arrays` of such a lattice, instead of finding the weights again.
    whole
        Keep all maps at the full resolution, too: for several paintings.

    Attributes
    ----------
    near
        bool [H, W] of the atlas at that resolution: what charts own, and a margin around it.
    """

    def __init__(self, field: VoxelField, skin: Skin, step: int,
                 arrays: Mapping[str, NDArray[Any]] | None = None, whole: bool = False) -> None:
        self.density = field.density
        atlas = skin.atlas
        shape = atlas.depth.shape[0] // step, atlas.depth.shape[1] // step
        own = atlas.own[::step, ::step][:shape[0], :shape[1]]
        around = np.ones((2 * MARGIN // step + 1,) * 2, np.uint8)
        self.near = cv2.dilate(own.astype(np.uint8), around) > 0
        charts = range(len(atlas.boxes))
        self._maps: Sequence[Map | functools.partial[Map]]
        if arrays is not None:
            self._maps = _read_maps([_place(skin, n, step) for n in charts], arrays)
        elif step > 1 or whole:
            self._maps = [_chart_map(field, skin, step, n, self.near) for n in charts]
        else:
            self._maps = [functools.partial(_chart_map, field, skin, step, n, self.near)
                          for n in charts]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The weights of all charts as arrays for a file, rounded to float16."""
        weights = [found for _, found in self._made()]
        return dict(zip(_ARRAYS, (
            np.concatenate([np.diff(one.indptr) for one in weights]).astype(np.uint8),
            np.concatenate([one.rows for one in weights]),
            np.concatenate([one.weights for one in weights]).astype(np.float16))))

    def _made(self) -> Iterator[Map]:
        """The charts' maps, one after the other."""
        for kept in self._maps:
            yield kept() if isinstance(kept, functools.partial) else kept

    def left_out(self, picture: Float32, colors: Float32) -> Float32:
        """What lattice colors [N, 3] leave out of a picture of the atlas, float32 [H, W, 3].

        0 where nothing solid is near.
        """
        out = np.zeros_like(picture)
        for there, weights in self._made():
            shown = np.empty((len(weights.alpha), 3), np.float32)
            gather_colors(weights.indptr, weights.rows, weights.weights, colors, shown)
            alpha = weights.alpha[:, None]
            shown /= np.maximum(alpha, np.float32(SOLID))
            shown = np.where(alpha > SOLID, picture[there].reshape(-1, 3) - shown, 0)
            out[there] = shown.reshape(out[there].shape)
        return out


def chart_lattice(field: VoxelField, skin: Skin, step: int) -> ChartLattice:
    """The maps of a field's colors to every ``step``-th pixel of its skin's charts.

    Those of previews are kept with the skin; if that comes from a file, in the user's cache, too.
    """
    if step == 1:
        return ChartLattice(field, skin, step)
    kept = _kept(skin)
    if step not in kept or kept[step].density is not field.density:
        arrays = _cached_arrays(field, skin) if step == PREVIEW and "key" in skin.kept else None
        kept[step] = ChartLattice(field, skin, step, arrays)
    return kept[step]


def _kept(skin: Skin) -> dict[int, ChartLattice]:
    """The lattices that are kept with a skin, by their steps."""
    return skin.once("lattices", dict[int, ChartLattice])


def _cached_arrays(field: VoxelField, skin: Skin) -> dict[str, NDArray[Any]]:
    """What a preview's `chart_lattice` is made of."""
    key = key_of(__name__, skin.kept["key"], field.density)
    return kept_arrays("lattices", key, lambda: ChartLattice(field, skin, PREVIEW).arrays(),
                       most=HEADS)


def _place(skin: Skin, n: int, step: int) -> tuple[slice, slice]:
    """Rows and columns of the atlas, every ``step``-th, that chart ``n`` fills."""
    camera = chart_camera(skin, n, step)
    top, left = (part.start // step for part in chart_pixels(skin, n, 1))
    return slice(top, top + int(camera.height[0])), slice(left, left + int(camera.width[0]))


def _chart_map(field: VoxelField, skin: Skin, step: int, n: int, near: NDArray[np.bool_]) -> Map:
    there = _place(skin, n, step)
    # As views are rendered; a preview takes longer strides.
    stride = 0.5 if step == 1 else 1.0
    return there, field.sample_weights(chart_camera(skin, n, step), 0, step=stride,
                                       inside=near[there])


def _read_maps(places: list[tuple[slice, slice]], arrays: Mapping[str, NDArray[Any]]) -> list[Map]:
    counts, rows, values = (arrays[name] for name in _ARRAYS)
    ends = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])
    values = values.astype(np.float32)
    alpha = np.zeros(len(counts), np.float32)
    filled = counts > 0  # an empty pixel's sum would be its successor's first value
    alpha[filled] = np.add.reduceat(values, ends[:-1][filled])
    maps, since = [], 0
    for there in places:
        until = since + (there[0].stop - there[0].start) * (there[1].stop - there[1].start)
        part = slice(ends[since], ends[until])
        maps.append((there, SampleWeights(ends[since:until + 1] - ends[since], rows[part],
                                          values[part], alpha[since:until])))
        since = until
    return maps
