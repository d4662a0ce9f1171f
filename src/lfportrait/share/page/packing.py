"""A field as streams of bytes for a page: its colors, lattice and texture, as fine as fits.

A page can show one set of colors, or several that share their densities.

The streams, each deflated on its own:

mask
    One bit a lattice point, x fastest, the highest bit of a byte first.
density
    One byte a kept row: ``zero`` and (|density| / top) ** (1/2) * (255 - zero) more, or less where
    the density is negative. Small densities are fog that many samples add up; a linear scale would
    lose it. Negative ones say where between two lattice points the surface is.
set S, band B
    Three planes of a byte a row: green, red, blue of color set S. Band 0 is the color, the others
    are the coefficients of the spherical harmonics above degree 0.
charts
    Where the field has a texture: one byte a row, the chart that shows its place.

Densities and colors are stored as residuals of their neighbours' prediction (`kernels`).
Lattice points that are not kept have density 0 and the color 0.5, as in the renderer.

The texture's charts are cut out and laid closer together: a device holds the whole atlas, also what
lies between them. Of the texels those are kept that any color set has something in, in blocks of
8x8. They are coded as the lattice's values are, with a row of the atlas for a plane of the lattice.
The streams, each deflated on its own:

texels
    One bit a texel, x fastest, the highest bit of a byte first: which are kept.
texels S
    Three planes of a byte a kept texel: green, red, blue of color set S, 128 for no difference,
    a step for a 254th.

The coarser levels of the pyramid are made by the page.
"""

from __future__ import annotations

import functools
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from scipy import ndimage

from ...arrays import Array, Bool, Float32, Float64, Int8, Int32, Int64, UInt8
from ...errors import UserError
from ...field import C0, SurfaceTexture, VoxelField
from ...stylize import StyledField
from ..kernels import code_rows


@dataclass(frozen=True)
class ColorSet:
    """Colors of a field's rows."""

    name: str  # For people.
    # ``"photo"``, ``"style"``, ``"mix"`` (of photo and styles) or ``"field"`` (of a field that has
    # no other).
    kind: str
    sh: Float32 = field(repr=False)  # float32 [N, 3, B], coefficients as a `VoxelField` has them.
    # int8 [H, W, 3], texture of the surface that belongs to them, or None.
    texels: Int8 | None = field(default=None, repr=False)


def _plain(colors: Float32) -> Float32:
    """Colors [N, 3] as coefficients of degree 0, float32 [N, 3, 1]."""
    return ((colors - np.float32(0.5)) * np.float32(1 / C0))[:, :, None]


def color_sets(voxels: VoxelField, degree: int = 0) -> list[ColorSet]:
    """The colors of a field: photo, then what it shows, then its other styles.

    A `StyledField` has several sets, every other field one. ``degree`` of the spherical harmonics
    that are kept, 0 to 2.
    """
    if not 0 <= degree <= 2:
        raise UserError(f"--sh takes the degree 0, 1 or 2, not {degree}")
    if (degree + 1) ** 2 > voxels.basis:
        raise UserError(f"the field's colors have degree {round(voxels.basis ** 0.5) - 1}, not "
                        f"{degree}: leave out --sh, or export the photographed field")
    own = None if voxels.texture is None else voxels.texture.texels
    if not isinstance(voxels, StyledField):
        return [ColorSet("", "field", voxels.sh[:, :, :(degree + 1) ** 2], own)]
    shown: dict[str, Any] = voxels.mixture
    first = shown.get("style", voxels.styles[0])
    order = [first, *(name for name in voxels.styles if name != first)]
    texels = dict(zip(voxels.styles, voxels.painted_texels, strict=True)
                  ) if voxels.painted_texels is not None else {}
    styles = [ColorSet(name, "style", _plain(voxels.painted[voxels.styles.index(name)]),
                       texels.get(name)) for name in order]
    photo = ColorSet("photo", "photo", _plain(voxels.photo))
    pure = (shown.get("strength", 1.0) == 1.0 and not shown.get("identity")
            and not shown.get("regions") and not shown.get("keep_colors")
            and not shown.get("keep"))
    return [photo, *([] if pure else [ColorSet("mixed", "mix", voxels.sh, own)]), *styles]


_FAINTEST = 1e-2
"""Density up to which the renderer skips a sample: points near which there is no more are left
out."""
_CLEAR = 0.05
"""Part of the light that a voxel must take before its color is kept as exactly as asked; what
takes less is seen less, and may be rounded more."""
_LOOSEST = 24  # Largest tolerance, in 255ths, for what is hardly seen.
_OPAQUE = 9.0
"""Optical depth of a voxel that lets 1/8000 of the light through: larger values are clipped."""
_HOLLOW = 0.3
"""Nor is an optical depth below minus this: what the trained floor of densities is, at most."""


@dataclass(frozen=True)
class Lattice:
    """A field on its lattice, as it is packed."""

    filled: Bool  # bool [Z, Y, X], where rows are; rows are numbered in this order, x fastest.
    density: Float32  # float32 [N], per world unit.
    sets: list[ColorSet]  # Color sets over these rows.
    # center, radius: float64 [3] (x, y, z), as a `VoxelField` has them.
    center: Float64
    radius: Float64
    # uint8 [N], chart of the texture that shows each row's place, 255 for none; or None.
    charts: UInt8 | None = None

    @property
    def voxel(self) -> float:
        """Mean distance of lattice points in world units."""
        return float((2.0 * self.radius / self.filled.shape[::-1]).mean())

    @functools.cached_property
    def around(self) -> Float32:
        """The largest density at and around the lattice point of each row, float32 [N]."""
        ends = np.cumsum([int(some.sum()) for some in self.filled])
        planes = (_spread(some, values) for some, values in zip(
            self.filled, np.split(self.density, ends[:-1])))
        return np.concatenate([around[some] for some, around in zip(
            self.filled, _largest_around(planes))])

    def dense(self, values: Array) -> Float32:
        """Values of the rows [N] at their lattice points, float32 [Z, Y, X], 0 elsewhere."""
        return _spread(self.filled, values)

    @staticmethod
    def of(links: Int32, density: Float32, sets: list[ColorSet],
           center: Float64, radius: Float64,
           charts: UInt8 | None = None) -> Lattice:
        """Rows in the lattice's order, without those that no sample meets."""
        matter = np.append(density, np.float32(0.0)).astype(np.float32)
        filled = links >= 0
        for some, around in zip(filled, _largest_around(matter[plane] for plane in links)):
            some &= around > _FAINTEST
        if not filled.any():
            raise UserError("the field is empty: there is nothing to show on a page")
        rows = links[filled]
        return Lattice(filled, matter[rows],
                       [ColorSet(each.name, each.kind, each.sh[rows]) for each in sets],
                       np.asarray(center, np.float64), np.asarray(radius, np.float64),
                       None if charts is None else charts[rows])


@dataclass(frozen=True)
class Packed:
    """A field as a page holds it."""

    # What the page's script needs to read the streams; plain values for JSON.
    header: dict[str, Any]
    streams: dict[str, bytes] = field(repr=False)  # Deflated bytes by name.
    shown: Lattice = field(repr=False)  # The lattice as it is read back: what the page shows.

    @property
    def size(self) -> int:
        """Bytes of the streams in a page, as base64."""
        return sum(4 * -(-len(data) // 3) for data in self.streams.values())


def _spread(filled: Bool, values: Array) -> Float32:
    """Values [N] where it is filled, float32 of its shape, 0 elsewhere."""
    out = np.zeros(filled.shape, np.float32)
    out[filled] = values
    return out


def _largest_around(planes: Iterable[Float32]) -> Iterator[Float32]:
    """The largest among each value of planes on end and its 26 neighbours, plane by plane.

    It is `scipy.ndimage.maximum_filter` by a cube, in a tenth of the time and without the room
    that all planes of a lattice take.
    """
    square = np.ones((3, 3), np.uint8)
    grown = (cv2.dilate(plane, square) for plane in planes)
    last = here = next(grown)
    for following in grown:
        yield np.maximum(np.maximum(last, here), following)
        last, here = here, following
    yield np.maximum(last, here)


def code_values(filled: Bool, values: UInt8, tolerance: UInt8) -> tuple[bytes, UInt8]:
    """Values [N, C] as a deflated stream, and as they are read back; see `code_rows`."""
    # One column of a larger array, or one in another order, would have a kernel of its own.
    values = np.ascontiguousarray(values)
    residual = np.empty(values.shape[::-1], np.uint8)
    decoded = np.empty_like(values)
    code_rows(filled, values, tolerance, residual, decoded)
    # Such numbers hold no strings worth looking for: Huffman's code alone is smaller, and a
    # thirtieth of the time.
    coder = zlib.compressobj(6, zlib.DEFLATED, 15, 9, zlib.Z_HUFFMAN_ONLY)
    return coder.compress(residual.tobytes()) + coder.flush(), decoded


def pack(lattice: Lattice, tolerance: int) -> Packed:
    """Pack a field.

    ``tolerance`` is the largest error of colors and of the root of densities in 255ths of their
    range; 0 rounds them to bytes and no more.
    """
    filled = lattice.filled
    top = float(min(lattice.density.max(), _OPAQUE / lattice.voxel))
    code, zero = _density_codes(lattice.density, top, _HOLLOW / lattice.voxel)
    streams = {"mask": zlib.compress(np.packbits(filled).tobytes(), 6)}
    # What is empty stays empty, and what is not does not become it: the edges of the head, which
    # what is below zero moves most.
    exact = np.where(code <= zero + tolerance, 0, tolerance).astype(np.uint8)
    streams["density"], seen = code_values(filled, code[:, None], exact)
    root = (seen[:, 0] - np.float32(zero)) / np.float32(255 - zero)
    density = (root * np.abs(root) * np.float32(top)).astype(np.float32)
    taken = -np.expm1(-np.maximum(lattice.around, 0.0) * np.float32(lattice.voxel))
    loose = (tolerance + 0.5) * np.clip(_CLEAR / np.maximum(taken, 1e-6), 1.0, None)
    slack = np.minimum(loose, _LOOSEST).astype(np.uint8)
    if lattice.charts is not None:
        streams["charts"] = zlib.compress(lattice.charts.tobytes(), 6)
    heads, shown = [], []
    for number, colors in enumerate(lattice.sets):
        bands: list[dict[str, float]] = []
        read = np.empty_like(colors.sh)
        for band in range(colors.sh.shape[2]):
            values = colors.sh[:, (1, 0, 2), band]
            low, high = _range(values, taken, band)
            levels = np.clip((values - low) / (high - low), 0.0, 1.0) * 255.0 + 0.5
            streams[f"set{number}.{band}"], back = code_values(
                filled, levels.astype(np.uint8), slack)
            # Colors are stored as they are shown, coefficients as they are.
            scale, shift = (C0, 0.5) if band == 0 else (1.0, 0.0)
            bands.append({"low": low * scale + shift, "high": high * scale + shift})
            read[:, (1, 0, 2), band] = back / np.float32(255.0) * (high - low) + low
        heads.append({"name": colors.name, "kind": colors.kind, "bands": bands})
        shown.append(ColorSet(colors.name, colors.kind, read))
    header = {"shape": list(filled.shape), "rows": int(filled.sum()), "top": top, "zero": zero,
              "center": lattice.center.tolist(), "radius": lattice.radius.tolist(), "sets": heads}
    return Packed(header, streams, replace(lattice, density=density, sets=shown))


def _density_codes(density: Float32, top: float, hollow: float,
                   ) -> tuple[UInt8, int]:
    """Bytes of densities from ``-hollow`` to ``top``, and the byte of a density of zero."""
    lowest = np.sqrt(min(max(-float(density.min(initial=0.0)), 0.0), hollow) / top)
    zero = int(np.ceil(255.0 * lowest / (1.0 + lowest)))
    root = np.sign(density) * np.sqrt(np.abs(density) / np.float32(top))
    return (np.clip(zero + root * (255 - zero), 0.0, 255.0) + 0.5).astype(np.uint8), zero


def _range(values: Float32, taken: Float32, band: int,
           ) -> tuple[float, float]:
    """Range of the stored values: all of a painting's, nearly all of a photo's.

    Rows of thin air have wild colors that nobody sees; they would make the steps coarse.
    """
    seen = values[taken > _CLEAR] if (taken > _CLEAR).any() else values
    low, high = (float(value) for value in np.quantile(seen, [0.0002, 0.9998]))
    if band:
        most = max(abs(low), abs(high), 1e-3)
        return -most, most
    # Black to white at the least, so that a painting's colors are the same in all sets.
    return min(low, -0.5 / C0), max(high, 0.5 / C0)


_BLOCK = 8  # Texels across a block that is kept as a whole: so the mask is small.
_ALIGN = 16
"""Charts are moved by multiples of this, so that the first levels of the pyramid stay as they
were."""
_MARGIN = 12
"""Texels kept around a chart's rows, beside a cell: the blur of coarser levels reads them."""
_LONGEST = 4096  # Side of a texture that every device with WebGL2 of the last years takes.
_WEIGHTS = (1, 3, 3, 1)


@dataclass(frozen=True)
class PageTexture:
    """Differences to the lattice's colors over the surface, of several color sets."""

    # int8 [H, W, 3] for each color set, in 254ths, or None for one that has none.
    texels: list[Int8 | None] = field(repr=False)
    # float64 [C, 3, 4], from the world to texels, as a `SurfaceTexture` has them.
    projections: Float64
    pixels: float  # Texels per world unit.

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the atlas."""
        height, width = next(each for each in self.texels if each is not None).shape[:2]
        return height, width

    @staticmethod
    def of(texture: SurfaceTexture, sets: list[ColorSet], points: Float64,
           cell: float) -> PageTexture:
        """The texture of the color sets, of which one has some, with its charts close together.

        ``texture`` is the field's: places, and texels of what it shows; ``points`` float64 [N, 3]
        are world positions of its rows, ``cell`` is the length of a lattice cell's diagonal.
        """
        margin = _MARGIN + round(cell * texture.pixels)
        boxes = _chart_boxes(texture, points, margin)
        places, shape = _shelves(boxes[:, 2:] - boxes[:, :2])
        projections = texture.projections.copy()
        # A place in the atlas moves by a vector: x' w = x w + dx w.
        projections[:, :2] += (places - boxes[:, :2])[:, :, None] * projections[:, 2:3]
        moved: list[Int8 | None] = []
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


def texel_values(texels: Int8, kept: Bool) -> UInt8:
    """Texels as a stream has them: green, red, blue of those that are kept, uint8 [N, 3]."""
    return (texels[kept][:, (1, 0, 2)].astype(np.int16) + 128).astype(np.uint8)


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
    shown: list[Int8 | None] = []
    for number, each in enumerate(texture.texels):
        if each is None:
            shown.append(None)
            continue
        streams[f"texels{number}"], back = code_values(kept[:, None], texel_values(each, kept),
                                                       slack)
        out = np.zeros((height, width, 3), np.int8)
        out[kept] = (back[:, (1, 0, 2)].astype(np.int16) - 128).astype(np.int8)
        shown.append(out)
    header = {"shape": [height, 1, width], "rows": rows, "pixels": texture.pixels,
              "projections": [[round(value, 6) for value in each.ravel().tolist()]
                              for each in texture.projections],
              "sets": [each is not None for each in texture.texels]}
    return PackedTexels(header, streams, replace(texture, texels=shown))


def with_texels(packed: Packed, texels: PackedTexels) -> Packed:
    """A packed field with its packed texture."""
    return replace(packed, header={**packed.header, "texture": texels.header},
                   streams={**packed.streams, **texels.streams})


def _blocks(some: Bool) -> Bool:
    """Whole blocks of texels in which there is something."""
    height, width = some.shape
    down, across = -(-height // _BLOCK), -(-width // _BLOCK)
    padded = np.zeros((down * _BLOCK, across * _BLOCK), np.bool_)
    padded[:height, :width] = some
    any_there = padded.reshape(down, _BLOCK, across, _BLOCK).any(axis=(1, 3))
    return any_there.repeat(_BLOCK, 0).repeat(_BLOCK, 1)[:height, :width]


def _chart_boxes(texture: SurfaceTexture, points: Float64, margin: int,
                 ) -> Int64:
    """Where charts that show rows lie in the atlas, int64 [C, 4]: left, top, right, bottom."""
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


def _shelves(sizes: Int64) -> tuple[Int64, tuple[int, int]]:
    """Places for boxes [C, 2] (width, height) side by side, the tallest first, and the area's size.

    Of all widths of the area the one that wastes least, with sides that devices take.
    """
    whole = -(-sizes // _ALIGN) * _ALIGN
    order = np.argsort(-whole[:, 1], kind="stable")
    found: tuple[tuple[bool, int], Int64, tuple[int, int]] | None = None
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


def _halve(texels: Int8) -> Int8:
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


_PLAIN = ((1, 0, 0), (2, 0, 0), (3, 0, 0), (4, 0, 0), (6, 0, 0))
"""What is tried, in this order: largest errors of the lattice's values in 255ths, and two numbers
for a texture. One is enough: on the built-in head it leaves 65 dB between a view and the same view
of the field as it was."""
_TEXTURED = ((1, 1, 0), (2, 2, 0), (3, 3, 0), (4, 4, 0), (4, 6, 0), (6, 8, 0), (3, 1, 1),
             (4, 2, 1), (6, 4, 1))
"""The same for a field with a texture: largest errors of the lattice's values, of the texture's in
254ths, and how many times that is halved. It is halved late: rounded to 8/254 it is still 35 dB
from what it was on two heads, at half the resolution it is 30 to 32 dB."""
_COARSE = (4, 4)  # Tolerances of lattice and texture where the lattice is made coarser.
_SHRINKS = (0.8, 0.64, 0.5, 0.4, 0.32, 0.25)
"""Sides of the lattice over those of the field's, tried next."""
_HALVED = (1, 1, 2, 2, 3, 3)  # How many times the texture is halved with each of them.


class _Packings:
    """A field and its texture, packed as often as is asked for."""

    def __init__(self, lattice: Lattice, texture: PageTexture | None) -> None:
        self.lattice = lattice
        self.textures = [] if texture is None else [texture]
        self.lattices: dict[tuple[int, float], Packed] = {}
        self.texels: dict[tuple[int, int], PackedTexels] = {}

    def at(self, tolerance: int, rough: int, halvings: int, shrink: float = 1.0) -> Packed:
        """Both as one: the texture so many times halved, the lattice's sides so much shorter."""
        where = (tolerance, shrink)
        if where not in self.lattices:
            lattice = self.lattice if shrink == 1.0 else coarser(self.lattice, shrink)
            self.lattices[where] = pack(lattice, tolerance)
        if not self.textures:
            return self.lattices[where]
        return with_texels(self.lattices[where], self._texels(rough, halvings))

    def _texels(self, tolerance: int, halvings: int) -> PackedTexels:
        while len(self.textures) <= halvings:
            last = self.textures[-1]
            # A texture of a few texels stays as it is.
            self.textures.append(last.halved() if min(last.shape) >= 64 else last)
        key = (tolerance, halvings)
        if key not in self.texels:
            self.texels[key] = pack_texels(self.textures[halvings], tolerance)
        return self.texels[key]


def fit(lattice: Lattice, most: float, texture: PageTexture | None = None) -> Packed:
    """Pack a field, with its texture, into at most ``most`` bytes, as they stand in a page."""
    packings = _Packings(lattice, texture)
    plan = _PLAIN if texture is None else _TEXTURED
    packed = packings.at(*plan[0])
    for step in plan[1:]:
        # The last saves half, with a texture two thirds: what is far too large needs another
        # lattice.
        if packed.size <= most or packed.size > (2 if texture is None else 3) * most:
            break
        packed = packings.at(*step)
    for shrink, halvings in zip(_SHRINKS, _HALVED, strict=True):
        if packed.size <= most:
            return packed
        if packed.size * shrink ** 2 > 1.6 * most and shrink != _SHRINKS[-1]:
            continue
        packed = packings.at(*_COARSE, halvings, shrink)
    if packed.size <= most:
        return packed
    raise UserError(f"the portrait does not fit into that size: at its coarsest it takes "
                    f"{packed.size / 1e6:.1f} MB; choose a larger --max-size or fewer styles")


def coarser(lattice: Lattice, shrink: float) -> Lattice:
    """The field on a lattice whose sides have ``shrink`` times as many points.

    Densities are averaged over the larger voxels, and colors are, weighed by density: what is
    empty has no color to give.
    """
    shape = tuple(max(2, round(n * shrink)) for n in lattice.filled.shape)
    ratio = [n / m for n, m in zip(lattice.filled.shape, shape, strict=True)]
    blur = [0.25 * (r - 1.0) for r in ratio]

    def resampled(values: Float32) -> Float32:
        # Lattice point i of m lies at (i + 1/2) / m of the cube.
        smooth = ndimage.gaussian_filter(values, blur, mode="constant", truncate=3.0)
        place = [(np.arange(m) + 0.5) * r - 0.5 for m, r in zip(shape, ratio, strict=True)]
        out = smooth
        for axis, at in enumerate(place):
            low = np.clip(np.floor(at).astype(int), 0, out.shape[axis] - 2)
            part = np.clip(at - low, 0.0, 1.0).astype(np.float32)
            part = part.reshape([-1 if other == axis else 1 for other in range(3)])
            out = np.take(out, low, axis) * (1 - part) + np.take(out, low + 1, axis) * part
        return np.asarray(out, np.float32)

    # A trace of weight everywhere gives rows without density the color of their surroundings.
    weight = np.maximum(lattice.density, 0.0) + np.float32(1e-3)
    density = resampled(lattice.dense(lattice.density))
    mass = resampled(lattice.dense(weight))
    filled = (mass > 1e-4) & (ndimage.maximum_filter(density, 3) > 1e-2)
    sets = []
    for colors in lattice.sets:
        sh = np.empty((int(filled.sum()), *colors.sh.shape[1:]), np.float32)
        for channel in range(3):
            for band in range(sh.shape[2]):
                amount = resampled(lattice.dense(weight * colors.sh[:, channel, band]))
                sh[:, channel, band] = amount[filled] / mass[filled]
        sets.append(ColorSet(colors.name, colors.kind, sh))
    charts = None
    if lattice.charts is not None:
        # The nearest row's: numbers of charts have no mean.
        known = np.full(lattice.filled.shape, 255, np.uint8)
        known[lattice.filled] = lattice.charts
        near = ndimage.distance_transform_edt(known == 255, return_distances=False,
                                              return_indices=True)
        place = np.ix_(*[np.clip(((np.arange(m) + 0.5) * r - 0.5).round().astype(int), 0, n - 1)
                         for m, r, n in zip(shape, ratio, lattice.filled.shape, strict=True)])
        charts = known[tuple(axis[place] for axis in near)][filled]
    return replace(lattice, filled=filled, density=density[filled], sets=sets, charts=charts)
