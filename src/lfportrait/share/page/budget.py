"""The finest packing of a field that keeps within a number of bytes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...errors import UserError
from .colors import ColorSet
from .packing import Lattice, Packed, pack

__all__ = ["coarser", "fit"]

_TOLERANCES = (1, 2, 3, 4, 6)
"""Largest errors in 255ths that are tried, in this order. One is enough: on the built-in head it
leaves 65 dB between a view and the same view of the field as it was."""
_SHRINKS = (0.8, 0.64, 0.5, 0.4, 0.32, 0.25)
"""Sides of the lattice over those of the field's, tried next, with the last tolerance but one."""


def fit(lattice: Lattice, most: float) -> Packed:
    """Pack a field into at most ``most`` bytes, as they stand in a page.

    Raises
    ------
    UserError
        If even the coarsest packing is larger.
    """
    packed = pack(lattice, _TOLERANCES[0])
    for tolerance in _TOLERANCES[1:]:
        if packed.size <= most:
            return packed
        # The coarsest saves less than half: what is twice too large needs another lattice.
        if packed.size > 2 * most:
            break
        packed = pack(lattice, tolerance)
    least = packed.size
    for shrink in _SHRINKS:
        if least <= most:
            return packed
        if packed.size * (shrink / 1.0) ** 2 > 1.6 * most and shrink != _SHRINKS[-1]:
            continue
        packed = pack(coarser(lattice, shrink), _TOLERANCES[-2])
        least = packed.size
    if least <= most:
        return packed
    raise UserError(f"the portrait does not fit into that size: at its coarsest it takes "
                    f"{least / 1e6:.1f} MB; choose a larger --max-size or fewer styles")


def coarser(lattice: Lattice, shrink: float) -> Lattice:
    """The field on a lattice whose sides have ``shrink`` times as many points.

    Densities are averaged over the larger voxels, and colours are, weighed by density: what is
    empty has no colour to give.
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

    # A trace of weight everywhere gives rows without density the colour of their surroundings.
    weight = lattice.density + np.float32(1e-3)
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
    return replace(lattice, filled=filled, density=density[filled], sets=sets)
