"""The layout for ray casting: a coarse table of bricks over compact rows.

The lattice is cut into bricks of 4x4x4 cells. An occupied brick owns copies of its 5x5x5 lattice
points (one shared layer, so that every cell finds its eight corners in one brick, padded to 128):
their densities as float16 and the numbers of their color rows. A table with one entry per brick
holds the brick's number, or, where the brick is empty, minus its Chebyshev distance in bricks to
the nearest occupied one: a ray may leap over everything that is nearer.

Color rows are float16, 16 or 32 wide (3 channels x 1, 4 or 9 coefficients, zero-padded), so that
a row is loaded as one or two vectors; the last row is zero and stands for empty lattice points.
They are laid out when colors are first asked for: what needs densities alone does not wait.
"""

from __future__ import annotations

import functools
import uuid
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...arrays import Bool, Float32, Int32
from ...simd.decorators import lean_kernel
from ...simd.threads import shared
from .halves import halves

__all__ = ["BRICK", "SLOTS", "Bricks", "brick_table", "bright_table", "build_bricks", "row_width"]

BRICK = 4
"""Cells along a brick's edge."""
SLOTS = 128
"""Lattice points that a brick has room for: 5^3 rounded up."""


def row_width(basis: int) -> int:
    """Width of a color row for ``basis`` coefficients a channel: 16 up to 4, 32 for 9."""
    return 16 if 3 * basis <= 16 else 32


@dataclass(frozen=True)
class Bricks:
    """A field laid out for casting.

    Attributes
    ----------
    table
        int32 [BZ, BY, BX], brick numbers or minus distances.
    links
        int32 [bricks * 128], color row of each lattice point (N, the zero row, where empty).
    density
        uint16 [bricks * 128 + 2], float16 bit patterns.
    sh
        float [N, 3, B], the coefficients that ``rows`` are made of.
    shape
        Lattice points along z, y, x.
    """

    table: Int32
    links: Int32
    density: NDArray[np.uint16]
    sh: NDArray[np.floating[Any]]
    shape: tuple[int, int, int]

    @property
    def basis(self) -> int:
        """Coefficients a channel: 1, 4 or 9."""
        return int(self.sh.shape[2])

    @property
    def width(self) -> int:
        """Row width, 16 or 32."""
        return row_width(self.basis)

    @functools.cached_property
    def rows(self) -> NDArray[np.uint16]:
        """Color rows, uint16 [(N + 1) * width + 32], float16 bit patterns."""
        count, columns = len(self.sh), 3 * self.basis
        rows = np.zeros((count + 1) * self.width + 32, np.float16)
        view = rows[:count * self.width].reshape(count, self.width)
        view[:, :columns] = halves(self.sh).reshape(count, columns)
        return rows.view(np.uint16)

    @functools.cached_property
    def token(self) -> str:
        """A name of its own, by which a copy elsewhere, on a GPU, is known."""
        return uuid.uuid4().hex

    @property
    def nbytes(self) -> int:
        """Memory taken, in bytes."""
        return int(self.table.nbytes + self.links.nbytes + self.density.nbytes + self.rows.nbytes)


@shared("bricks")
@lean_kernel
def _occupied(since, until, links, bricks):
    depth, height, width = links.shape
    for bz in range(since, until):
        for by in range(bricks.shape[1]):
            for bx in range(bricks.shape[2]):
                found = False
                for z in range(4 * bz, min(4 * bz + 5, depth)):
                    for y in range(4 * by, min(4 * by + 5, height)):
                        for x in range(4 * bx, min(4 * bx + 5, width)):
                            if links[z, y, x] >= 0:
                                found = True
                bricks[bz, by, bx] = found


@shared("places")
@lean_kernel
def _fill_links(since, until, links, places, empty, out):
    depth, height, width = links.shape
    for brick in range(since, until):
        bz, by, bx = places[brick]
        for slot in range(128):
            out[brick * 128 + slot] = empty
        for z in range(5):
            for y in range(5):
                for x in range(5):
                    gz, gy, gx = 4 * bz + z, 4 * by + y, 4 * bx + x
                    if gz < depth and gy < height and gx < width and links[gz, gy, gx] >= 0:
                        out[brick * 128 + z * 25 + y * 5 + x] = links[gz, gy, gx]


def _distances(occupied: Bool) -> Int32:
    """Minus the distance to the nearest occupied brick, int32 [BZ, BY, BX]."""
    if not occupied.any():
        return np.full(occupied.shape, -max(occupied.shape), np.int32)
    away = ndimage.distance_transform_cdt(~occupied, metric="chessboard")
    return -np.maximum(away, 1).astype(np.int32)


@shared("found")
@lean_kernel
def _brighter(since, until, links, density, least, found):
    for brick in range(since, until):
        most = np.float32(0.0)
        for slot in range(128):
            most = max(most, density[links[brick * 128 + slot]])
        found[brick] = most > least


def bright_table(table: Int32, brick_links: Int32,
                 density: Float32, least: float) -> Int32:
    """The table without the bricks in which no density is above ``least``, as `brick_table`'s.

    Parameters
    ----------
    table, brick_links
        From `brick_table`; bricks keep their numbers.
    density
        float32 [N + 1].
    least
        Per world unit.
    """
    found = np.zeros(len(brick_links) // SLOTS, np.bool_)
    _brighter(brick_links, density, np.float32(least), found)
    bright = (table >= 0) & found[np.maximum(table, 0)]
    return np.where(bright, table, _distances(bright)).astype(np.int32)


def brick_table(links: Int32, rows: int,
                ) -> tuple[Int32, Int32]:
    """Table and links of the bricks of a lattice.

    Parameters
    ----------
    links
        int32 [Z, Y, X], row of each lattice point or -1.
    rows
        Number of rows N; empty points link to row N.

    Returns
    -------
    table
        int32 [BZ, BY, BX].
    brick_links
        int32 [bricks * 128].
    """
    shape = tuple(max(1, -(-(n - 1) // BRICK)) for n in links.shape)
    occupied = np.zeros(shape, np.bool_)
    _occupied(links, occupied)
    places = np.argwhere(occupied).astype(np.int64)
    table = _distances(occupied)
    table[occupied] = np.arange(len(places), dtype=np.int32)
    brick_links = np.full(max(1, len(places)) * SLOTS, rows, np.int32)
    _fill_links(links, places, np.int32(rows), brick_links)
    return table, brick_links


def build_bricks(links: Int32, density: Float32,
                 sh: NDArray[Any]) -> Bricks:
    """Lay a field out for casting.

    Parameters
    ----------
    links
        int32 [Z, Y, X].
    density
        float32 [N], per world unit.
    sh
        float [N, 3, B], spherical-harmonic coefficients.
    """
    count = len(sh)
    table, brick_links = brick_table(links, count)
    values = np.zeros(count + 1, np.float16)
    values[:count] = halves(density)
    packed = np.zeros(len(brick_links) + 2, np.uint16)
    packed[:-2] = values.view(np.uint16)[brick_links]
    return Bricks(table, brick_links, packed, sh,
                  (links.shape[0], links.shape[1], links.shape[2]))
