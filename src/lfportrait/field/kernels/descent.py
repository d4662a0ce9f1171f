"""One gradient step on the rows that rays touched, and total variation on runs of rows.

Color is linear in its coefficients, so that a step need not be guessed. As in SART, the
simultaneous algebraic reconstruction technique (Andersen & Kak 1984), a lattice point takes up the
mean error of the rays that it colors, weighted by how much of each ray's light it gives: the
slopes are divided by the sum of those weights, and the sum is remembered, up to a bound, so that
many rays are averaged. One number a point replaces RMSProp's 27, and colors are right after tens
of rays, where steps of a fixed length take thousands. Density is not linear and keeps RMSProp.

What packets of rays found comes as records (`packet`), and each is taken up by
itself, one after the other, as in Kaczmarz's method, of which SART is the simultaneous form: there
is no gradient as large as the lattice. A row keeps what is remembered of it in its last two values:
the weight of its rays, and the running mean of the density's squared slope. Rows are 16 or 32
values wide and go through the lanes of `lfportrait.simd.vectors`, 16 at a time.
"""

import numpy as np

from ...simd.decorators import lean, lean_kernel
from ...simd.interleaved import prefetch
from ...simd.threads import share_out
from ...simd.vectors import LANES

_floats, _sqrt = LANES.floats, LANES.sqrt
_load, _store = LANES.load, LANES.store
_FAINT = np.float32(0.02)
"""Weight of rays below which a color is not trusted: it takes up less of their error."""
_TINY = np.float32(1e-8)
_AHEAD = 6  # Records that rows are asked for ahead.


@lean
def _step_density(row, place, slope, density, rows, rate, decay, lowest):
    """RMSProp on one density; ``place`` is where its row keeps the mean squared slope."""
    square = decay * rows[place] + (np.float32(1.0) - decay) * slope * slope
    rows[place] = square
    density[row] = max(density[row] - rate * slope / (np.sqrt(square) + _TINY), lowest)


@lean
def _take_up(keys, values, count, density, rows, width, bases, rate, decay, lowest, gains, memory):
    """Take up the first ``count`` records of one worker for one owner."""
    first_gain = _load(gains, np.uintp(0))
    rest_gain = _load(gains, np.uintp(width - 16))
    for number in range(count):
        ahead = np.uintp(keys[np.uintp(min(number + _AHEAD, count - 1)), 0])
        prefetch(rows, ahead * np.uintp(width))
        prefetch(rows, ahead * np.uintp(width) + np.uintp(16))
        prefetch(density, ahead)
        row, basis = np.uintp(keys[number, 0]), np.uintp(keys[number, 1]) << np.uintp(6)
        weight = values[number, 3]
        start = row * np.uintp(width)
        end = start + np.uintp(width)
        known = max(min(rows[end - np.uintp(2)] + weight, memory), weight)
        square = rows[end - np.uintp(1)]
        scale = np.float32(1.0) / (known + _FAINT)
        red, green, blue = (scale * values[number, 0], scale * values[number, 1],
                            scale * values[number, 2])
        if width == 32:
            change = red * _load(bases, basis) + green * _load(bases, basis + np.uintp(16))
            _store(rows, start, _load(rows, start) - first_gain * change)
            change = (green * _load(bases, basis + np.uintp(32))
                      + blue * _load(bases, basis + np.uintp(48)))
            _store(rows, start + np.uintp(16),
                   _load(rows, start + np.uintp(16)) - rest_gain * change)
        else:
            change = (red * _load(bases, basis) + green * _load(bases, basis + np.uintp(16))
                      + blue * _load(bases, basis + np.uintp(32)))
            _store(rows, start, _load(rows, start) - first_gain * change)
        rows[end - np.uintp(2)], rows[end - np.uintp(1)] = known, square
        _step_density(row, end - np.uintp(1), values[number, 4], density, rows, rate, decay, lowest)


def descend(density, rows, width, records, bases, rate, decay, lowest, gains, memory):
    """Take up the records of a step.

    Parameters
    ----------
    density, rows : float32 [N + 1] and [(N + 1) * width], the parameters; the last row stays as
        it is. A row's last two values are no parameters but its state: remembered weight of
        rays, and running mean of the density's squared slope.
    width : Row width, 16 or 32.
    records : Keys, values, counts and scratch of `packet.Records`.
    bases : float32 [tiles, 64], each packet's harmonics.
    rate, decay : Learning rate of the density, and decay of the running mean (0.95).
    lowest : Densities are kept at or above this.
    gains : float32 [width], what a coefficient's slope is multiplied with to be its change for
        rays of weight one; zero for what is no color.
    memory : Weight of rays that a color is a running mean of, at most. The weight of a record's
        own rays counts in full whatever the bound.
    """
    keys, values, counts, _ = records
    share_out(take_up_all, len(counts), keys, values, counts, density, rows, width,
              bases.reshape(-1), rate, decay, lowest, gains, memory)


@lean_kernel
def take_up_all(since, until, keys, values, counts, density, rows, width, bases, rate, decay,
                 lowest, gains, memory):
    """Take up all records for some owners."""
    for owner in range(since, until):
        for worker in range(len(counts)):
            _take_up(keys[worker, owner], values[worker, owner], counts[worker, owner], density,
                     rows, width, bases, rate, decay, lowest, gains, memory)


def smooth(density, rows, width, slopes, first, last, rate, decay, lowest, gains):
    """Take up the slopes of the total variation on a run of rows.

    Parameters
    ----------
    density, rows, width, rate, decay, lowest, gains : As in `descend`.
    slopes : float32 [last - first] of densities, or [(last - first) * width] of colors.
    first, last : Range of rows.
    """
    share_out(smooth_rows, last - first, density, rows, width, slopes, first, last, rate, decay,
              lowest, gains)


@lean_kernel
def smooth_rows(since, until, density, rows, width, slopes, first, last, rate, decay, lowest,
                 gains):
    """`smooth` of some rows, counted from the first."""
    colors = len(slopes) > last - first
    for row in range(first + since, first + until):
        end = np.uintp((row + 1) * width)
        if not colors:
            _step_density(row, end - np.uintp(1), slopes[row - first], density, rows, rate, decay,
                          lowest)
            continue
        scale = np.float32(1.0) / (rows[end - np.uintp(2)] + _FAINT)
        for block in range(width // 16):
            place = np.uintp(row * width + 16 * block)
            slope = _load(slopes, np.uintp((row - first) * width + 16 * block))
            _store(rows, place, _load(rows, place)
                   - scale * _load(gains, np.uintp(16 * block)) * slope)


def total_variation(neighbours, first, last, values, width, weight, scale, slopes):
    """Gradient of total variation (Shen et al. 2023, Eq. 3) on a run of rows.

    Each row gathers its own gradient from the differences that it takes part in, so that no two
    threads write the same place.

    Parameters
    ----------
    neighbours : int32 [rows, 6]: next along x, y, z, previous along x, y, z; empty ones give the
        row itself.
    first, last : Range of rows.
    values : float32 [rows * width], colors, or [rows], densities with a width of 1.
    width : 1, 16 or 32.
    weight : Weight of the loss, divided by the number of rows in the range.
    scale : Difference between neighbours is multiplied by this (resolution / 256).
    slopes : float32 [(last - first) * width], written.
    """
    share_out(vary_rows, last - first, neighbours, first, values, width, np.float32(weight),
              np.float32(scale), slopes)


@lean_kernel
def vary_rows(since, until, neighbours, first, values, width, weight, factor, slopes):
    """`total_variation` of some rows, counted from the first."""
    share = weight * factor
    for row in range(first + since, first + until):
        if width == 1:
            slopes[row - first] = share * _pull(neighbours, row, values, factor)
            continue
        for block in range(width // 16):
            slope = _pull_row(neighbours, row, values, width, 16 * block, factor)
            _store(slopes, np.uintp((row - first) * width + 16 * block), share * slope)


@lean
def _length(ex, ey, ez):
    return np.sqrt(ex * ex + ey * ey + ez * ez + np.float32(1e-9))


@lean
def _differences(neighbours, row, values, scale):
    """Differences of a value to the next ones along x, y, z."""
    here = values[row]
    x, y, z = neighbours[row, 0], neighbours[row, 1], neighbours[row, 2]
    return (values[x] - here) * scale, (values[y] - here) * scale, (values[z] - here) * scale


@lean
def _pull(neighbours, row, values, scale):
    """Slope of the lengths of all differences that one value takes part in."""
    ex, ey, ez = _differences(neighbours, row, values, scale)
    slope = -(ex + ey + ez) / _length(ex, ey, ez)
    for axis in range(3):
        before = neighbours[row, 3 + axis]
        if before != row:
            ex, ey, ez = _differences(neighbours, before, values, scale)
            own = ex if axis == 0 else (ey if axis == 1 else ez)
            slope += own / _length(ex, ey, ez)
    return slope


@lean
def _row_differences(neighbours, row, values, width, start, scale):
    """The same for 16 values of a row from ``start`` on."""
    here = _load(values, np.uintp(row) * np.uintp(width) + np.uintp(start))
    return ((_load(values, np.uintp(neighbours[row, 0] * width + start)) - here) * scale,
            (_load(values, np.uintp(neighbours[row, 1] * width + start)) - here) * scale,
            (_load(values, np.uintp(neighbours[row, 2] * width + start)) - here) * scale)


@lean
def _pull_row(neighbours, row, values, width, start, scale):
    """`_pull` for 16 values of a row."""
    small = np.float32(1e-9)
    ex, ey, ez = _row_differences(neighbours, row, values, width, start, scale)
    slope = _floats(np.float32(0.0)) - (ex + ey + ez) / _sqrt(ex * ex + ey * ey + ez * ez + small)
    x, y, z = neighbours[row, 3], neighbours[row, 4], neighbours[row, 5]
    if x != row:
        ex, ey, ez = _row_differences(neighbours, x, values, width, start, scale)
        slope = slope + ex / _sqrt(ex * ex + ey * ey + ez * ez + small)
    if y != row:
        ex, ey, ez = _row_differences(neighbours, y, values, width, start, scale)
        slope = slope + ey / _sqrt(ex * ex + ey * ey + ez * ez + small)
    if z != row:
        ex, ey, ez = _row_differences(neighbours, z, values, width, start, scale)
        slope = slope + ez / _sqrt(ex * ex + ey * ey + ez * ez + small)
    return slope
