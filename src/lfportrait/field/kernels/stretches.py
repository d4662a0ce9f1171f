"""The layout for slices of a field: sixteen lattice points on end along x, side by side in memory.

A slice is nearly level: it reads rows of the lattice, at nearly one height. In bricks (`bricks`)
these are scattered, and a slice of a head took most of its time to wait for them; here all that
lies at one height is together. Of stretches without any point nothing is kept but one of zeros,
which stands for all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arrays import Float32, Int32
from ...simd.decorators import kernel, lean_kernel
from ...simd.interleaved import store_half
from ...simd.threads import shared
from ...simd.vectors import LANES

__all__ = ["Places", "Stretches", "build_stretches", "fill_stretches", "place_stretches"]

_load = LANES.load


@dataclass(frozen=True)
class Stretches:
    """A field laid out for slices, in S stretches.

    Attributes
    ----------
    places
        int32 [Y, Z, ceil(X / 16)], the number of each stretch; S where it has no point.
    occupied
        uint64 [Y, Z], bit b where stretch b of the row has a point; from 63 on they share a bit.
    values
        uint16 [(S + 1) * (1 + 3 B) * 16], float16 bit patterns: of each stretch the sixteen
        densities, then coefficients of red, of green, of blue, sixteen each.
    """

    places: Int32
    occupied: NDArray[np.uint64]
    values: NDArray[np.uint16]

    @property
    def nbytes(self) -> int:
        """Memory taken, in bytes."""
        return int(self.places.nbytes + self.occupied.nbytes + self.values.nbytes)


@dataclass(frozen=True)
class Places:
    """Where a lattice has stretches: as in `Stretches`, and ``count``, their number S."""

    places: Int32
    occupied: NDArray[np.uint64]
    count: int


@shared("places")
@lean_kernel
def _count(since, until, links, places, occupied, counts):
    """Number the stretches at each height from 0, -1 where there is no point."""
    for j in range(since, until):
        many = 0
        for k in range(links.shape[0]):
            for block in range(places.shape[2]):
                some = False
                for i in range(16 * block, min(16 * block + 16, links.shape[2])):
                    some |= links[k, j, i] >= 0
                places[j, k, block] = many if some else -1
                if some:
                    many += 1
                    occupied[j, k] |= np.uint64(1) << np.uint64(min(block, 63))
        counts[j] = many


@shared("places")
@kernel
def _fill(since, until, links, density, sh, none, places, values):
    """Copy what is at the points; ``none`` is the number of stretches without any."""
    lines = 1 + sh.shape[1]
    most = np.float32(6e4)
    scratch = np.zeros((lines, 16), np.float32)
    flat = scratch.reshape(lines * 16)
    for j in range(since, until):
        for k in range(links.shape[0]):
            for block in range(places.shape[2]):
                number = places[j, k, block]
                if number == none:
                    continue
                scratch[:] = np.float32(0.0)
                for lane in range(min(16, links.shape[2] - 16 * block)):
                    row = links[k, j, 16 * block + lane]
                    if row < 0:
                        continue
                    scratch[0, lane] = min(max(density[row], -most), most)
                    for part in range(lines - 1):
                        scratch[1 + part, lane] = min(max(np.float32(sh[row, part]), -most), most)
                for line in range(lines):
                    store_half(values, np.uintp((np.int64(number) * lines + line) * 16),
                               _load(flat, np.uintp(16 * line)))


def build_stretches(links: Int32, density: Float32,
                    sh: NDArray[np.floating]) -> Stretches:
    """Lay a field out for slices.

    Parameters
    ----------
    links
        int32 [Z, Y, X], row of each lattice point or -1.
    density
        float32 [N], per world unit.
    sh
        float [N, 3, B], spherical-harmonic coefficients.
    """
    return fill_stretches(place_stretches(links), links, density, sh)


def place_stretches(links: Int32) -> Places:
    """Where a lattice, int32 [Z, Y, X], has stretches."""
    depth, height, width = links.shape
    places = np.empty((height, depth, -(-width // 16)), np.int32)
    occupied = np.zeros((height, depth), np.uint64)
    counts = np.zeros(height, np.int64)
    _count(links, places, occupied, counts)
    first = np.zeros(height + 1, np.int32)
    np.cumsum(counts, out=first[1:])
    # The number of each height's first stretch is added; those without any point come last.
    places = np.where(places < 0, first[-1], places + first[:-1, None, None])
    return Places(places, occupied, int(first[-1]))


def fill_stretches(where: Places, links: Int32, density: Float32,
                   sh: NDArray[np.floating]) -> Stretches:
    """A field laid out in the stretches of its lattice; arguments as `build_stretches`."""
    lines = 1 + 3 * sh.shape[2]
    values = np.empty((where.count + 1) * lines * 16, np.uint16)
    values[-lines * 16:] = 0
    _fill(links, density, sh.reshape(len(sh), lines - 1), np.int32(where.count), where.places,
          values)
    return Stretches(where.places, where.occupied, values)
