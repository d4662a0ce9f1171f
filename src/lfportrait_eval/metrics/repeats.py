"""Whether a painted picture repeats itself where it should not.

Paint that is laid in rows of the same small tile, or that shows one large piece twice, is like
itself moved by some lag. So: the luma inside a region is compared with itself at every lag, by the
correlation coefficient of those samples that lie in the region both times (Padfield 2012, "Masked
object registration in the Fourier domain", IEEE Transactions on Image Processing 21(5): all lags by
a few FFTs), and the highest peak away from lag zero is the figure. 1 is a region that consists of
copies. Lengths are in units of the face's size (`lfportrait.example.face_size`), which the caller
gives in pixels.

What counts as a peak:

* Shading and the region's large shapes are no paint: of the luma, a blur of `COARSE` is taken away,
  inside the region alone, so that its outline does not count. What is finer than `FINE` is blurred
  away: a field's lattice points are 0.03 units apart, so no copy inside a field keeps it.
* Strokes are like themselves moved along: lags connected to zero by correlations above `LOBE` are
  one lobe and left out, whatever its shape. Parallel hair makes a long ridge, and only hairs at
  equal distances are a repeat. The lobe of a picture of small tiles is smaller than a tile, and of
  a large piece as wide as its strokes, so either's copies are seen.
* Then only local maxima count, at least `NEAREST` away: else the lobe's own foot would be the peak.
* The samples common to both must make up a quarter of the region (``overlap``). Of a few samples,
  many agree by chance.

Chance: n samples of independent strokes of effective area a (the sum of the squared correlations
over the lobe; Bartlett 1946) correlate with a standard deviation of sqrt(a / n), and the highest of
N such values is about sqrt(2 ln N) of these. That is 0.2 to 0.4 in regions of a few square units
under strokes as broad as hair, and is reported beside the peak.

It finds copies that are moved as a whole. Pieces that are turned, foreshortened or laid at
distances that differ from pair to pair each make a small peak of their own and are not found.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

__all__ = ["Repeat", "luma", "masked_autocorrelation", "over_exemplar", "repeat_ratio", "repeats",
           "strongest_repeat"]

Float32 = NDArray[np.float32]

COARSE = 0.2
"""Sigma in units of the blur that is taken away: strokes are up to twice as broad."""
FINE = 0.02
"""Sigma in units of the blur that stays."""
LOBE = 0.2
"""Correlation down to which lags are connected to zero. Chance is seldom as high near zero, where
nearly the whole region overlaps: at 0.1 the lobe of a small region grows into the plain around."""
NEAREST = 0.1
"""Least lag in units, 1/26 of a face's width: nearer than that it is the grain of a stroke."""
LEAST_CONTRAST = 2.0 / 255.0
"""Standard deviation added to both sides of a correlation: fainter patterns are not seen."""
LEAST_PEAK = 0.1
"""An exemplar's peak is taken to be at least this."""


class Repeat(NamedTuple):
    """The strongest repeat of a region.

    Attributes
    ----------
    peak
        Correlation in [0, 1] of the region with itself, moved; NaN for an empty region.
    lag
        Down and to the right, in pixels; (0, 0) where there is no peak.
    chance
        In [0, 1], how high a peak independent strokes reach by chance at that overlap.
    """

    peak: float
    lag: tuple[int, int]
    chance: float


def luma(picture: NDArray[Any]) -> Float32:
    """Luma of a picture [H, W, 3], uint8 or float in [0, 1] (Rec. 601), float32 [H, W]."""
    scale = 1.0 / 255.0 if picture.dtype == np.uint8 else 1.0
    return np.asarray(picture[..., :3] @ np.array([0.299, 0.587, 0.114], np.float32)
                      * np.float32(scale), np.float32)


def masked_autocorrelation(values: NDArray[Any], mask: NDArray[np.bool_], *,
                           least: float = LEAST_CONTRAST) -> tuple[Float32, NDArray[np.int64]]:
    """Correlation of a region's values with themselves at every lag.

    Parameters
    ----------
    values
        float [H, W]; what is outside the mask does not count.
    mask
        bool [H, W].
    least
        Standard deviation that is added, squared, to the variances of both sides.

    Returns
    -------
    correlation
        float32 [2 H - 1, 2 W - 1] in [-1, 1], lag zero in the middle: the correlation coefficient
        of ``values[p]`` and ``values[p + lag]`` over the p with both in the mask; 0 without any.
    common
        int64, the same shape: how many there are.
    """
    height, width = mask.shape
    shape = [fft.next_fast_len(2 * side - 1, real=True) for side in (height, width)]
    inside = mask.astype(np.float32)
    # The mean goes first, for the sake of the single precision: no coefficient changes.
    mean = values[mask].mean() if mask.any() else 0.0
    centred = np.where(mask, values - mean, 0.0).astype(np.float32)
    spectra = [fft.rfft2(plane, shape) for plane in (centred, centred * centred, inside)]
    signal, squares, region = spectra

    def lags(first: NDArray[Any], second: NDArray[Any]) -> Float32:
        """The sum over p of first[p] second[p + lag]."""
        raw = fft.irfft2(np.conj(first) * second, shape)
        out = np.empty((2 * height - 1, 2 * width - 1), np.float32)
        # Negative lags stand at the far end.
        for rows, from_rows in ((np.s_[height - 1:], np.s_[:height]),
                                (np.s_[:height - 1], np.s_[shape[0] - height + 1:])):
            out[rows, width - 1:] = raw[from_rows, :width]
            out[rows, :width - 1] = raw[from_rows, shape[1] - width + 1:]
        return out

    common = np.rint(lags(region, region)).astype(np.int64)
    count = np.maximum(common, 1).astype(np.float32)
    # Sums over the common samples, of their values at p + lag; those at p are the same, turned.
    sums, powers = lags(region, signal), lags(region, squares)
    spread = np.sqrt(np.maximum(powers - sums ** 2 / count, 0.0) + count * np.float32(least ** 2))
    covariance = lags(signal, signal) - sums * sums[::-1, ::-1] / count
    correlation = np.divide(covariance, spread * spread[::-1, ::-1],
                            out=np.zeros_like(spread), where=(common > 1) & (spread > 0))
    return np.clip(correlation, -1.0, 1.0), common


def _detail(plane: Float32, mask: NDArray[np.bool_], unit: float) -> Float32:
    """What lies between `FINE` and `COARSE`, of the region's own values alone."""
    # In the Fourier domain: broad blurs cost no more than narrow ones.
    shape = [fft.next_fast_len(side + int(np.ceil(3 * COARSE * unit)), real=True)
             for side in mask.shape]
    spectra = [fft.rfft2(part, shape) for part in
               (np.where(mask, plane, np.float32(0)), mask.astype(np.float32))]

    def blurred(sigma: float) -> Float32:
        """Gaussian blur of the region's own values, over that of the region."""
        down, right = (np.exp(-2 * (np.pi * sigma * frequency) ** 2).astype(np.float32)
                       for frequency in (fft.fftfreq(shape[0]), fft.rfftfreq(shape[1])))
        total, weight = (fft.irfft2(part * down[:, None] * right, shape)[
            :mask.shape[0], :mask.shape[1]] for part in spectra)
        return np.asarray(total / np.maximum(weight, 1e-3), np.float32)

    return np.where(mask, blurred(FINE * unit) - blurred(COARSE * unit), np.float32(0))


def strongest_repeat(picture: NDArray[Any], mask: NDArray[np.bool_], unit: float, *,
                     overlap: float = 0.25) -> Repeat:
    """The highest peak of a region's autocorrelation away from zero, and where it is.

    Parameters
    ----------
    picture
        [H, W, 3], uint8 or float in [0, 1].
    mask
        bool [H, W], the region, without the silhouette.
    unit
        Size of the face in pixels (`lfportrait.example.face_size`), > 0.
    overlap
        Least share in (0, 1] of the region that must lie in the region again when it is moved.

    Returns
    -------
    repeat
        See `Repeat`. Its peak is 0 where no lag but the lobe's overlaps enough, NaN where the mask
        is empty.

    Raises
    ------
    ValueError
        If picture and mask differ in size, or the unit or the overlap is out of range.
    """
    if picture.shape[:2] != mask.shape:
        raise ValueError(f"a picture {picture.shape} needs a mask of its size, not {mask.shape}")
    if not (unit > 0 and 0 < overlap <= 1):
        raise ValueError(f"the unit must be > 0 and the overlap in (0, 1], not {unit}, {overlap}")
    if not mask.any():
        return Repeat(float("nan"), (0, 0), float("nan"))
    box = ndimage.find_objects(mask.astype(np.uint8))[0]
    mask = np.asarray(mask[box], bool)
    correlation, common = masked_autocorrelation(_detail(luma(picture[box]), mask, unit), mask)
    middle = mask.shape[0] - 1, mask.shape[1] - 1
    allowed = common >= overlap * mask.sum()
    correlation = np.where(allowed, correlation, np.float32(0))
    zero = float(correlation[middle])
    if zero <= 0:
        return Repeat(0.0, (0, 0), 1.0)
    # Relative to the value at zero, which is less than 1 in a faint picture.
    connected, _ = ndimage.label(correlation > LOBE * zero, np.ones((3, 3)))
    lobe = connected == connected[middle]
    down, right = (np.arange(-side, side + 1) for side in middle)
    allowed &= np.hypot(down[:, None], right[None]) >= max(NEAREST * unit, 1.0)
    stroke = float((correlation[lobe] ** 2).sum()) / zero ** 2
    peaks = np.where(allowed & ~lobe & (correlation == ndimage.maximum_filter(correlation, 3)),
                     correlation, np.float32(0))
    place = np.unravel_index(int(np.argmax(peaks)), peaks.shape)
    peak = float(peaks[place])
    if peak <= 0:
        return Repeat(0.0, (0, 0), 1.0)
    # A lag and its opposite are one and the same.
    values = max(float(allowed.sum()) / 2 / stroke, np.e)
    chance = min(float(np.sqrt(2 * np.log(values) * stroke / common[place])), 1.0)
    return Repeat(peak, (int(place[0]) - middle[0], int(place[1]) - middle[1]), chance)


def repeats(picture: NDArray[Any], mask: NDArray[np.bool_], unit: float, *,
            overlap: float = 0.25) -> float:
    """How much a region repeats itself, in [0, 1]: the peak of `strongest_repeat`; see there."""
    return strongest_repeat(picture, mask, unit, overlap=overlap).peak


def repeat_ratio(picture: NDArray[Any], mask: NDArray[np.bool_], exemplar: NDArray[Any],
                 exemplar_mask: NDArray[np.bool_], unit: float, *, overlap: float = 0.25) -> float:
    """How much a region repeats itself, over how much the exemplar does in the same material.

    Parameters
    ----------
    picture, mask
        [H, W, 3], uint8 or float in [0, 1], and the region, bool [H, W].
    exemplar, exemplar_mask
        The same of the exemplar, [h, w, 3] and [h, w], resized so that its face has the size of the
        picture's.
    unit
        Size of either face in pixels.
    overlap
        See `strongest_repeat`.

    Returns
    -------
    ratio
        About 1 where the picture repeats itself no more than the exemplar does; NaN where one of
        the regions is empty. The exemplar's peak is taken to be at least `LEAST_PEAK` and at least
        what chance gives in the picture's region: a plain exemplar, or one with a larger region
        under finer strokes, does not make a repeat of what is none.
    """
    ours = strongest_repeat(picture, mask, unit, overlap=overlap)
    theirs = strongest_repeat(exemplar, exemplar_mask, unit, overlap=overlap)
    return over_exemplar(ours, theirs)


def over_exemplar(ours: Repeat, theirs: Repeat) -> float:
    """The ratio of two repeats that are known; see `repeat_ratio`."""
    if np.isnan(ours.peak) or np.isnan(theirs.peak):
        return float("nan")
    return ours.peak / max(theirs.peak, ours.chance, LEAST_PEAK)
