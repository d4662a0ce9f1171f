"""The texture of a field's surface as a page holds it (`lfportrait.field.SurfaceTexture`).

Its charts are cut out and laid closer together: a device holds the whole atlas, also what lies
between them. Of the texels those are kept that any color set has something in, in blocks of 8x8.
They are coded as the lattice's values are, with a row of the atlas for a plane of the lattice. The
streams, each deflated on its own:

texels
    One bit a texel, x fastest, the highest bit of a byte first: which are kept.
texels S
    Three planes of a byte a kept texel: green, red, blue of color set S, 128 for no difference,
    a step for a 254th.

The coarser levels of the pyramid are made by the page.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...field import SurfaceTexture
from .colors import ColorSet
from .packing import Packed, code_values

__all__ = ["PackedTexels", "PageTexture", "pack_texels", "with_texels"]

_BLOCK = 8
"""Texels across a block that is kept as a whole: so the mask is small."""
_ALIGN = 16
"""Charts are moved by multiples of this, so that the first levels of the pyramid stay as they
were."""
_MARGIN = 12
"""Texels kept around a chart's rows, beside a cell: the blur of coarser levels reads them."""
_LONGEST = 4096
"""Side of a texture that every device with WebGL2 of the last years takes."""
_WEIGHTS = (1, 3, 3, 1)


@dataclass(frozen=True)
class PageTexture:
    """Differences to the lattice's colors over the surface, of several color sets.

    Attributes
    ----------
    texels
        int8 [H, W, 3] for each color set, in 254ths, or None for one that has none.
    projections
        float64 [C, 3, 4], from the world to texels, as a `SurfaceTexture` has them.
    pixels
        Texels per world unit.
    """

    texels: list[NDArray[np.int8] | None] = field(repr=False)
    projections: NDArray[np.float64]
    pixels: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the atlas."""
        height, width = next(each for each in self.texels if each is not None).shape[:2]
        return height, width

    @staticmethod
    def of(texture: SurfaceTexture, sets: list[ColorSet], points: NDArray[np.float64],
           cell: float) -> PageTexture:
        """The texture of the color sets, of which one has some, with its charts close together.

        Parameters
        ----------
        texture
            Of the field: places, and texels of what it shows.
        sets
            Color sets with their texels.
        points
            float64 [N, 3], world positions of the field's rows.
        cell
            Length of a lattice cell's diagonal in world units.
        """
        margin = _MARGIN + round(cell * texture.pixels)
        boxes = _chart_boxes(texture, points, margin)
        places, shape = _shelves(boxes[:, 2:] - boxes[:, :2])
        projections = texture.projections.copy()
        # A place in the atlas moves by a vector: x' w = x w + dx w.
        projections[:, :2] += (places - boxes[:, :2])[:, :, None] * projections[:, 2:3]
        moved: list[NDArray[np.int8] | None] = []
        for each in sets:
            if each.texels is None:
                moved.append(None)
                continue
            out = np.zeros((*shape, 3), np.int8)
            for (x0, y0, x1, y1), (x, y) in zip(boxes.tolist(), places.tolist(), strict=True):
                part = each.texels[y0:y1, x0:x1]
                out[y:y + part.shape[0], x:x + part.shape[1]] = part
            moved.append(out)
        return PageTexture(moved, projections, texture.pixels)

    def halved(self) -> PageTexture:
        """The same at half the resolution."""
        projections = self.projections.copy()
        projections[:, :2] *= 0.5
        return replace(self, texels=[None if each is None else _halve(each)
                                     for each in self.texels],
                       projections=projections, pixels=self.pixels / 2)


@dataclass(frozen=True)
class PackedTexels:
    """A texture as a page holds it: header for its script, streams, and what the page shows."""

    header: dict[str, Any]
    streams: dict[str, bytes] = field(repr=False)
    shown: PageTexture = field(repr=False)


def pack_texels(texture: PageTexture, tolerance: int) -> PackedTexels:
    """Pack a texture; no texel is off by more than ``tolerance`` 254ths."""
    height, width = texture.shape
    some = np.zeros((height, width), np.bool_)
    for each in texture.texels:
        if each is not None:
            some |= (np.abs(each.astype(np.int16)) > tolerance).any(axis=2)
    kept = _blocks(some)
    rows = int(kept.sum())
    slack = np.full(rows, tolerance, np.uint8)
    streams = {"texels": zlib.compress(np.packbits(kept).tobytes(), 6)}
    shown: list[NDArray[np.int8] | None] = []
    for number, each in enumerate(texture.texels):
        if each is None:
            shown.append(None)
            continue
        values = (each[kept][:, (1, 0, 2)].astype(np.int16) + 128).astype(np.uint8)
        streams[f"texels{number}"], back = code_values(kept[:, None], values, slack)
        out = np.zeros((height, width, 3), np.int8)
        out[kept] = (back[:, (1, 0, 2)].astype(np.int16) - 128).astype(np.int8)
        shown.append(out)
    header = {"shape": [height, 1, width], "rows": rows, "pixels": texture.pixels,
              "projections": [[round(value, 6) for value in each.ravel().tolist()]
                              for each in texture.projections],
              "sets": [each is not None for each in texture.texels]}
    return PackedTexels(header, streams, replace(texture, texels=shown))


def with_texels(packed: Packed, texels: PackedTexels | None) -> Packed:
    """A packed field with its packed texture."""
    if texels is None:
        return packed
    return replace(packed, header={**packed.header, "texture": texels.header},
                   streams={**packed.streams, **texels.streams})


def _blocks(some: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whole blocks of texels in which there is something."""
    height, width = some.shape
    down, across = -(-height // _BLOCK), -(-width // _BLOCK)
    padded = np.zeros((down * _BLOCK, across * _BLOCK), np.bool_)
    padded[:height, :width] = some
    any_there = padded.reshape(down, _BLOCK, across, _BLOCK).any(axis=(1, 3))
    return any_there.repeat(_BLOCK, 0).repeat(_BLOCK, 1)[:height, :width]


def _chart_boxes(texture: SurfaceTexture, points: NDArray[np.float64], margin: int,
                 ) -> NDArray[np.int64]:
    """Where the rows of each chart lie in the atlas, int64 [C, 4]: left, top, right, bottom.

    Of a chart that shows no row nothing is kept.
    """
    height, width = texture.texels.shape[:2]
    boxes = np.zeros((len(texture.projections), 4), np.int64)
    for number, matrix in enumerate(texture.projections):
        near = points[texture.charts == number]
        if not len(near):
            continue
        homogeneous = near @ matrix[:, :3].T + matrix[:, 3]
        place = homogeneous[:, :2] / homogeneous[:, 2:]
        low = np.floor(place.min(axis=0)).astype(np.int64) - margin
        high = np.ceil(place.max(axis=0)).astype(np.int64) + margin
        boxes[number, :2] = np.clip(low, 0, [width, height]) // _ALIGN * _ALIGN
        boxes[number, 2:] = np.clip(high, 0, [width, height])
    return boxes


def _shelves(sizes: NDArray[np.int64]) -> tuple[NDArray[np.int64], tuple[int, int]]:
    """Places for boxes [C, 2] (width, height) side by side, the tallest first, and the area's size.

    Of all widths of the area the one that wastes least, with sides that devices take.
    """
    whole = -(-sizes // _ALIGN) * _ALIGN
    order = np.argsort(-whole[:, 1], kind="stable")
    found: tuple[tuple[bool, int], NDArray[np.int64], tuple[int, int]] | None = None
    for width in range(int(whole[:, 0].max()), int(whole[:, 0].sum()) + _ALIGN, _ALIGN):
        places = np.zeros_like(whole)
        x, y, tall = 0, 0, 0
        for box in order:
            if x + whole[box, 0] > width:
                x, y, tall = 0, y + tall, 0
            places[box] = x, y
            x += int(whole[box, 0])
            tall = max(tall, int(whole[box, 1]))
        height = y + tall
        cost = (max(width, height) > _LONGEST, width * height)
        if found is None or cost < found[0]:
            found = cost, places, (height, width)
    assert found is not None
    return found[1], found[2]


def _halve(texels: NDArray[np.int8]) -> NDArray[np.int8]:
    """Every second texel, blurred as the levels of a `SurfaceTexture` are."""
    out = texels.astype(np.int32)
    for axis in range(2):
        size = out.shape[axis] // 2
        padded = np.pad(out, [(1, 1) if other == axis else (0, 0) for other in range(3)])
        out = np.zeros([size if other == axis else n for other, n in enumerate(out.shape)],
                       np.int32)
        for step, weight in enumerate(_WEIGHTS):
            out += weight * np.take(padded, np.arange(size) * 2 + step, axis)
    return ((out + 32) >> 6).astype(np.int8)
