"""A field as streams of bytes for a page: which lattice points are kept, densities, colors.

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
    Where the field has a texture (`texels`): one byte a row, the chart that shows its place.

Densities and colors are stored as residuals of their neighbours' prediction (`kernels.residuals`).
Lattice points that are not kept have density 0 and the color 0.5, as in the renderer.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...errors import UserError
from ...field import C0
from .colors import ColorSet
from .kernels.residuals import code_rows

__all__ = ["Lattice", "Packed", "code_values", "pack"]

_FAINTEST = 1e-2
"""Density up to which the renderer skips a sample: points near which there is no more are left
out."""
_CLEAR = 0.05
"""Part of the light that a voxel must take before its color is kept as exactly as asked; what
takes less is seen less, and may be rounded more."""
_LOOSEST = 24
"""Largest tolerance, in 255ths, for what is hardly seen."""
_OPAQUE = 9.0
"""Optical depth of a voxel that lets 1/8000 of the light through: larger values are clipped."""
_HOLLOW = 0.3
"""Nor is an optical depth below minus this: what the trained floor of densities is, at most."""


@dataclass(frozen=True)
class Lattice:
    """A field on its lattice, as it is packed.

    Attributes
    ----------
    filled
        bool [Z, Y, X], where rows are; rows are numbered in this order, x fastest.
    density
        float32 [N], per world unit.
    sets
        Color sets over these rows.
    center, radius
        float64 [3] (x, y, z), as a `VoxelField` has them.
    charts
        uint8 [N], chart of the texture that shows each row's place, 255 for none; or None.
    """

    filled: NDArray[np.bool_]
    density: NDArray[np.float32]
    sets: list[ColorSet]
    center: NDArray[np.float64]
    radius: NDArray[np.float64]
    charts: NDArray[np.uint8] | None = None

    @property
    def voxel(self) -> float:
        """Mean distance of lattice points in world units."""
        return float((2.0 * self.radius / self.filled.shape[::-1]).mean())

    def dense(self, values: NDArray[Any]) -> NDArray[np.float32]:
        """Values of the rows [N] at their lattice points, float32 [Z, Y, X], 0 elsewhere."""
        out = np.zeros(self.filled.shape, np.float32)
        out[self.filled] = values
        return out

    @staticmethod
    def of(links: NDArray[np.int32], density: NDArray[np.float32], sets: list[ColorSet],
           center: NDArray[np.float64], radius: NDArray[np.float64],
           charts: NDArray[np.uint8] | None = None) -> Lattice:
        """Rows in the lattice's order, without those that no sample meets.

        Raises
        ------
        UserError
            If nothing is left.
        """
        matter = np.append(density, np.float32(0.0)).astype(np.float32)[links]
        filled = (links >= 0) & (_largest_around(matter) > _FAINTEST)
        if not filled.any():
            raise UserError("the field is empty: there is nothing to show on a page")
        rows = links[filled]
        return Lattice(filled, matter[filled],
                       [ColorSet(each.name, each.kind, each.sh[rows]) for each in sets],
                       np.asarray(center, np.float64), np.asarray(radius, np.float64),
                       None if charts is None else charts[rows])


@dataclass(frozen=True)
class Packed:
    """A field as a page holds it.

    Attributes
    ----------
    header
        What the page's script needs to read the streams; plain values for JSON.
    streams
        Deflated bytes by name.
    shown
        The lattice as it is read back: what the page shows.
    """

    header: dict[str, Any]
    streams: dict[str, bytes] = field(repr=False)
    shown: Lattice = field(repr=False)

    @property
    def size(self) -> int:
        """Bytes of the streams in a page, as base64."""
        return sum(4 * -(-len(data) // 3) for data in self.streams.values())


def _largest_around(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """The largest among each value and its 26 neighbours, float32 [Z, Y, X].

    It is `scipy.ndimage.maximum_filter` by a cube, in a tenth of the time.
    """
    square = np.ones((3, 3), np.uint8)
    out = np.empty_like(values)
    last = here = cv2.dilate(values[0], square)
    for k in range(len(values)):
        following = cv2.dilate(values[k + 1], square) if k + 1 < len(values) else here
        np.maximum(np.maximum(last, here), following, out=out[k])
        last, here = here, following
    return out


def code_values(filled: NDArray[np.bool_], values: NDArray[np.uint8],
                tolerance: NDArray[np.uint8]) -> tuple[bytes, NDArray[np.uint8]]:
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

    Parameters
    ----------
    lattice
        The field.
    tolerance
        Largest error of colors and of the root of densities in 255ths of their range; 0 rounds
        them to bytes and no more.
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
    around = _largest_around(lattice.dense(lattice.density))[filled]
    taken = -np.expm1(-np.maximum(around, 0.0) * np.float32(lattice.voxel))
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


def _density_codes(density: NDArray[np.float32], top: float, hollow: float,
                   ) -> tuple[NDArray[np.uint8], int]:
    """Bytes of densities from ``-hollow`` to ``top``, and the byte of a density of zero."""
    lowest = np.sqrt(min(max(-float(density.min(initial=0.0)), 0.0), hollow) / top)
    zero = int(np.ceil(255.0 * lowest / (1.0 + lowest)))
    root = np.sign(density) * np.sqrt(np.abs(density) / np.float32(top))
    return (np.clip(zero + root * (255 - zero), 0.0, 255.0) + 0.5).astype(np.uint8), zero


def _range(values: NDArray[np.float32], taken: NDArray[np.float32], band: int,
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
