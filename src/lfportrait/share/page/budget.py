"""The finest packing of a field within a number of bytes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...errors import UserError
from .colors import ColorSet
from .packing import Lattice, Packed, pack
from .texels import PackedTexels, PageTexture, pack_texels, with_texels

__all__ = ["coarser", "fit"]

_PLAIN = ((1, 0, 0), (2, 0, 0), (3, 0, 0), (4, 0, 0), (6, 0, 0))
"""What is tried, in this order: largest errors of the lattice's values in 255ths, and two numbers
for a texture. One is enough: on the built-in head it leaves 65 dB between a view and the same view
of the field as it was."""
_TEXTURED = ((1, 1, 0), (2, 2, 0), (3, 3, 0), (4, 4, 0), (4, 6, 0), (6, 8, 0), (3, 1, 1),
             (4, 2, 1), (6, 4, 1))
"""The same for a field with a texture: largest errors of the lattice's values, of the texture's in
254ths, and how many times that is halved. It is halved late: rounded to 8/254 it is still 35 dB
from what it was on two heads, at half the resolution it is 30 to 32 dB."""
_COARSE = (4, 4)
"""Tolerances of lattice and texture where the lattice is made coarser."""
_SHRINKS = (0.8, 0.64, 0.5, 0.4, 0.32, 0.25)
"""Sides of the lattice over those of the field's, tried next."""
_HALVED = (1, 1, 2, 2, 3, 3)
"""How many times the texture is halved with each of them."""


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
    """Pack a field, with its texture, into at most ``most`` bytes, as they stand in a page.

    Raises
    ------
    UserError
        If even the coarsest packing is larger.
    """
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

    def resampled(values: NDArray[np.float32]) -> NDArray[np.float32]:
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
