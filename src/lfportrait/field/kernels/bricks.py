"""Layouts of a lattice: its rows, bricks for casting rays, stretches for slices.

A lattice is a table of links into rows: of each point that has one, a density and colors. Which are
next to each other, those of a finer lattice and means of states are found here; bricks and
stretches hold the same in half precision.

The lattice is cut into bricks of 4x4x4 cells. An occupied brick owns copies of its 5x5x5 lattice
points (one shared layer, so that every cell finds its eight corners in one brick, padded to 128):
their densities as float16 and the numbers of their color rows. A table with one entry per brick
holds the brick's number, or, where the brick is empty, minus its Chebyshev distance in bricks to
the nearest occupied one: a ray may leap over everything that is nearer.

Color rows are float16, 16 or 32 wide (3 channels x 1, 4 or 9 coefficients, zero-padded), so that
a row is loaded as one or two vectors; the last row is zero and stands for empty lattice points.
They are laid out when colors are first asked for: what needs densities alone does not wait.

A slice is nearly level: it reads rows of the lattice, at nearly one height. In bricks these are
scattered; a stretch is sixteen lattice points on end along x, and all that lies at one height is
together. Of stretches without any point one of zeros is kept, which stands for all of them.
"""

import functools
import uuid
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ...arrays import Array, Bool, Float16, Float32, Floats, Int32, UInt16, UInt64
from ...simd.decorators import kernel, lean_kernel
from ...simd.interleaved import store_half
from ...simd.threads import shared
from ...simd.vectors import LANES

_LINE = 1 << 14  # Numbers that one thread takes at a time.
_LARGEST = 6e4  # What is larger becomes this: half precision ends at 65504.

_load, _load_half, _store, _floats = LANES.load, LANES.load_half, LANES.store, LANES.floats
_minimum, _maximum = LANES.minimum, LANES.maximum


@shared("lines")
@kernel
def _round(since, until, lines, values, largest, out):
    """Lines of `_LINE` numbers of ``values``, as bits in ``out``; both hold multiples of 16."""
    for start in range(since * _LINE, min(until * _LINE, len(out)), 16):
        value = _maximum(_minimum(_load(values, np.uintp(start)), _floats(largest)),
                         _floats(-largest))
        store_half(out, np.uintp(start), value)


@shared("lines")
@kernel
def _widen(since, until, lines, bits, out):
    """Lines of `_LINE` numbers in half precision as float32; both hold multiples of 16."""
    for start in range(since * _LINE, min(until * _LINE, len(out)), 16):
        _store(out, np.uintp(start), _load_half(bits, np.uintp(start)))


def halves(values: Floats) -> Float16:
    """Numbers, none NaN, in half precision as NumPy rounds them; those beyond 60000 become that."""
    flat = np.ascontiguousarray(values, np.float32).reshape(-1)
    out, whole = np.empty(len(flat), np.uint16), len(flat) // 16 * 16
    _round(-(-whole // _LINE), flat[:whole], np.float32(_LARGEST), out[:whole])
    out[whole:] = np.clip(flat[whole:], -_LARGEST, _LARGEST).astype(np.float16).view(np.uint16)
    return out.view(np.float16).reshape(values.shape)


def floats_of(values: Float16) -> Float32:
    """Numbers in half precision as float32."""
    bits = np.ascontiguousarray(values).reshape(-1).view(np.uint16)
    out, whole = np.empty(len(bits), np.float32), len(bits) // 16 * 16
    _widen(-(-whole // _LINE), bits[:whole], out[:whole])
    out[whole:] = bits[whole:].view(np.float16)
    return out.reshape(values.shape)


BRICK = 4  # Cells along a brick's edge.
SLOTS = 128  # Lattice points that a brick has room for: 5^3 rounded up.


def row_width(basis: int) -> int:
    """Width of a color row for ``basis`` coefficients a channel: 16 up to 4, 32 for 9."""
    return 16 if 3 * basis <= 16 else 32


@dataclass(frozen=True)
class Bricks:
    """A field laid out for casting."""

    table: Int32  # int32 [BZ, BY, BX], brick numbers or minus distances.
    # int32 [bricks * 128], color row of each lattice point (N, the zero row, where empty).
    links: Int32
    density: UInt16  # uint16 [bricks * 128 + 2], float16 bit patterns.
    sh: Floats  # float [N, 3, B], the coefficients that ``rows`` are made of.
    shape: tuple[int, int, int]  # Lattice points along z, y, x.

    @property
    def basis(self) -> int:
        """Coefficients a channel: 1, 4 or 9."""
        return int(self.sh.shape[2])

    @property
    def width(self) -> int:
        """Row width, 16 or 32."""
        return row_width(self.basis)

    @functools.cached_property
    def rows(self) -> UInt16:
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


def bright_table(table: Int32, brick_links: Int32, density: Float32, least: float) -> Int32:
    """The table without the bricks in which no density is above ``least``, as `brick_table`'s.

    Parameters
    ----------
    table, brick_links : From `brick_table`; bricks keep their numbers.
    density : float32 [N + 1].
    least : Per world unit.
    """
    found = np.zeros(len(brick_links) // SLOTS, np.bool_)
    _brighter(brick_links, density, np.float32(least), found)
    bright = (table >= 0) & found[np.maximum(table, 0)]
    return np.where(bright, table, _distances(bright)).astype(np.int32)


def brick_table(links: Int32, rows: int) -> tuple[Int32, Int32]:
    """Table and links of the bricks of a lattice.

    Parameters
    ----------
    links : int32 [Z, Y, X], row of each lattice point or -1.
    rows : Number of rows N; empty points link to row N.

    Returns
    -------
    table : int32 [BZ, BY, BX].
    brick_links : int32 [bricks * 128].
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


def build_bricks(links: Int32, density: Float32, sh: Array) -> Bricks:
    """Lay a field out for casting.

    Parameters
    ----------
    links : int32 [Z, Y, X].
    density : float32 [N], per world unit.
    sh : float [N, 3, B], spherical-harmonic coefficients.
    """
    count = len(sh)
    table, brick_links = brick_table(links, count)
    values = np.zeros(count + 1, np.float16)
    values[:count] = halves(density)
    packed = np.zeros(len(brick_links) + 2, np.uint16)
    packed[:-2] = values.view(np.uint16)[brick_links]
    return Bricks(table, brick_links, packed, sh,
                  (links.shape[0], links.shape[1], links.shape[2]))


@dataclass(frozen=True)
class Stretches:
    """A field laid out for slices, in S stretches."""

    # int32 [Y, Z, ceil(X / 16)], the number of each stretch; S where it has no point.
    places: Int32
    # uint64 [Y, Z], bit b where stretch b of the row has a point; from 63 on they share a bit.
    occupied: UInt64
    # uint16 [(S + 1) * (1 + 3 B) * 16], float16 bit patterns: of each stretch the sixteen
    # densities, then coefficients of red, of green, of blue, sixteen each.
    values: UInt16

    @property
    def nbytes(self) -> int:
        """Memory taken, in bytes."""
        return int(self.places.nbytes + self.occupied.nbytes + self.values.nbytes)


@dataclass(frozen=True)
class Places:
    """Where a lattice has stretches: as in `Stretches`, and ``count``, their number S."""

    places: Int32
    occupied: UInt64
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


def fill_stretches(where: Places, links: Int32, density: Float32, sh: Floats) -> Stretches:
    """Lay a field out in the stretches of its lattice, for slices.

    Parameters
    ----------
    links : int32 [Z, Y, X], row of each lattice point or -1.
    density : float32 [N], per world unit.
    sh : float [N, 3, B], spherical-harmonic coefficients.
    """
    lines = 1 + 3 * sh.shape[2]
    values = np.empty((where.count + 1) * lines * 16, np.uint16)
    values[-lines * 16:] = 0
    _fill(links, density, sh.reshape(len(sh), lines - 1), np.int32(where.count), where.places,
          values)
    return Stretches(where.places, where.occupied, values)


@shared("links")
@lean_kernel
def fill_neighbours(since, until, links, found):
    """Fill int32 [N, 6]: next along x, y, z, previous along x, y, z; the row itself without one.

    ``links`` int32 [Z, Y, X] has the row of each lattice point, or -1.
    """
    depth, height, width = links.shape
    for z in range(since, until):
        for y in range(height):
            for x in range(width):
                row = links[z, y, x]
                if row < 0:
                    continue
                for side in range(6):
                    step = 1 if side < 3 else -1
                    k = z + step if side % 3 == 2 else z
                    j = y + step if side % 3 == 1 else y
                    i = x + step if side % 3 == 0 else x
                    other = row
                    inside = 0 <= k < depth and 0 <= j < height and 0 <= i < width
                    if inside and links[k, j, i] >= 0:
                        other = links[k, j, i]
                    found[row, side] = other


@shared("links")
@lean_kernel
def mark_points(since, until, links, rows, points):
    """Fill bool [Z, Y, X], the points of marked rows, bool [N + 1]."""
    _, height, width = links.shape
    for z in range(since, until):
        for y in range(height):
            for x in range(width):
                row = links[z, y, x]
                points[z, y, x] = row >= 0 and rows[max(row, 0)]


def refine_rows(links, density, rows, keep, low, part, shape):
    """Density and color rows of a finer lattice: a point lives where a corner of its cell does.

    Parameters
    ----------
    links : int32 [Z, Y, X], row of each coarse point or -1.
    density, rows : float32 [N + 1] and [N + 1, width].
    keep : bool [Z, Y, X], the coarse points about which fine ones live.
    low, part : Coarse cell and place inside it of each fine plane, per axis (z, y, x): int64 and
        float32 [3, longest side].
    shape : Fine points along z, y, x.

    Returns
    -------
    links, density, rows : int32 [Z', Y', X'], float32 [M + 1] and [M + 1, width], the last row
        zero. Color is the mean over the corners that exist: empty points have none to mix in.
    """
    fine = np.empty(shape, np.int32)
    counts = np.empty(shape[0], np.int64)
    _find(keep, low, fine, counts)
    ends = np.cumsum(counts)
    total = int(ends[-1])
    fine_density, fine_rows = np.empty(total + 1, np.float32), np.empty((total + 1, rows.shape[1]),
                                                                        np.float32)
    fine_density[total], fine_rows[total] = 0.0, 0.0
    _refine(links, density, rows, ends - counts, low, part, fine, fine_density, fine_rows)
    return fine, fine_density, fine_rows


@shared("fine")
@lean_kernel
def _find(since, until, keep, low, fine, counts):
    """Mark fine points that live by 0 and others by -1; count those of each plane."""
    for z in range(since, until):
        count = 0
        for y in range(fine.shape[1]):
            for x in range(fine.shape[2]):
                k, j, i = low[0, z], low[1, y], low[2, x]
                lives = (keep[k, j, i] | keep[k, j, i + 1] | keep[k, j + 1, i]
                         | keep[k, j + 1, i + 1] | keep[k + 1, j, i] | keep[k + 1, j, i + 1]
                         | keep[k + 1, j + 1, i] | keep[k + 1, j + 1, i + 1])
                fine[z, y, x] = 0 if lives else -1
                count += lives
        counts[z] = count


@shared("fine")
@lean_kernel
def _refine(since, until, links, density, rows, firsts, low, part, fine, fine_density, fine_rows):
    """Number the fine points, those of each plane from its first number on; fill their rows."""
    width, one = rows.shape[1], np.float32(1.0)
    for z in range(since, until):
        point = firsts[z]
        for y in range(fine.shape[1]):
            for x in range(fine.shape[2]):
                if fine[z, y, x] < 0:
                    continue
                fine[z, y, x] = point
                mass, dense = np.float32(0.0), np.float32(0.0)
                for i in range(width):
                    fine_rows[point, i] = np.float32(0.0)
                for corner in range(8):
                    dz, dy, dx = corner >> 2, (corner >> 1) & 1, corner & 1
                    row = links[low[0, z] + dz, low[1, y] + dy, low[2, x] + dx]
                    if row < 0:
                        continue
                    weight = ((part[0, z] if dz else one - part[0, z])
                              * (part[1, y] if dy else one - part[1, y])
                              * (part[2, x] if dx else one - part[2, x]))
                    dense += weight * density[row]
                    mass += weight
                    for i in range(width):
                        fine_rows[point, i] += weight * rows[row, i]
                scale = one / max(mass, np.float32(1e-6))
                for i in range(width):
                    fine_rows[point, i] *= scale
                fine_density[point] = dense
                point += 1


@shared("sums")
@lean_kernel
def put_means(since, until, sums, columns, count, rows, first):
    """Write means into the first columns of rows; one state is written as it is.

    Parameters
    ----------
    sums : float32 [M, columns or more].
    count : Number of states, a float32.
    rows : float32 [first + M or more, columns or more], written.
    first : The row that the first sums belong to.
    """
    for row in range(since, until):
        for column in range(columns):
            rows[first + row, column] = sums[row, column] / count


@shared("sums")
@lean_kernel
def add_rows(since, until, sums, rows):
    """Add the first columns of rows, float32 [N, width], to sums, float32 [N, columns]."""
    for row in range(since, until):
        for column in range(sums.shape[1]):
            sums[row, column] += rows[row, column]
