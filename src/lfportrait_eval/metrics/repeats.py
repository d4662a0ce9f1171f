"""What became of the paint: whether it repeats itself, in which regions, and how sharp strokes are.

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
* The samples common to both must make up a quarter of the region (`OVERLAP`). Of a few samples,
  many agree by chance.

Chance: n samples of independent strokes of effective area a (the sum of the squared correlations
over the lobe; Bartlett 1946) correlate with a standard deviation of sqrt(a / n), and the highest of
N such values is about sqrt(2 ln N) of these. That is 0.2 to 0.4 in regions of a few square units
under strokes as broad as hair, and is reported beside the peak.

It finds copies that are moved as a whole. Pieces that are turned, foreshortened or laid at
distances that differ from pair to pair each make a small peak of their own and are not found.

A stylised field may carry labels: how far each of its lattice rows lies in each region. Rendered as
if they were colors they give the region's mask in any view, from behind as well, where no picture
of the head could be segmented. The exemplar's regions are those of its own segmentation.

A field is fitted to painted pictures, or colored from a painted chart, and its lattice is coarser
than the paint. Gradient energy is the mean squared difference of neighbouring pixels' luma: the
energy of the picture's spectrum, weighted by frequency squared. Blur lowers it. Rendered over
wanted, 1 keeps all detail; above 1 something was added: seams, noise, steps of the lattice. What
was painted has to be seen through a filter that keeps its detail, too (Lanczos): between pixels a
bilinear look-up loses up to two thirds of the finest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import fft, ndimage

from lfportrait.arrays import Bool, Float32, Int64, UInt8
from lfportrait.capture import Camera
from lfportrait.color import LUMA
from lfportrait.example import Exemplar
from lfportrait.field import C0, VoxelField
from lfportrait.labels import PICTURE_LABELS

from .views import arc_cameras, face_unit

COARSE = 0.2
"""Sigma in units of the blur that is taken away: strokes are up to twice as broad."""
FINE = 0.02
"""Sigma in units of the blur that stays."""
LOBE = 0.2
"""Correlation down to which lags are connected to zero. Chance is seldom as high near zero, where
nearly the whole region overlaps: at 0.1 the lobe of a small region grows into the plain around."""
OVERLAP = 0.25
"""Least share of the region that must lie in the region again when it is moved."""
NEAREST = 0.1
"""Least lag in units, 1/26 of a face's width: nearer than that it is the grain of a stroke."""
LEAST_CONTRAST = 2.0 / 255.0
"""Standard deviation added to both sides of a correlation: fainter patterns are not seen."""
LEAST_PEAK = 0.1
"""An exemplar's peak is taken to be at least this."""


class Repeat(NamedTuple):
    """The strongest repeat of a region."""

    peak: float  # Correlation in [0, 1] of the region with itself, moved; NaN for an empty region.
    lag: tuple[int, int]  # Down and to the right, in pixels; (0, 0) where there is no peak.
    chance: float  # In [0, 1], how high a peak independent strokes reach by chance at that overlap.


def luma(picture: NDArray[Any]) -> Float32:
    """Luma of a picture [H, W, 3], uint8 or float in [0, 1] (Rec. 601), float32 [H, W]."""
    scale = 1.0 / 255.0 if picture.dtype == np.uint8 else 1.0
    return np.asarray(picture[..., :3] @ LUMA * np.float32(scale), np.float32)


def masked_autocorrelation(values: NDArray[Any], mask: Bool, *,
                           least: float = LEAST_CONTRAST) -> tuple[Float32, Int64]:
    """Correlation of a region's values [H, W] with themselves at every lag.

    float32 [2 H - 1, 2 W - 1] in [-1, 1], lag zero in the middle: the correlation coefficient of
    ``values[p]`` and ``values[p + lag]`` over the p with both in the mask, and int64 of the same
    shape, how many there are; 0 without any. ``least`` is a standard deviation that is added,
    squared, to the variances of both sides.
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


def _detail(plane: Float32, mask: Bool, unit: float) -> Float32:
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


def strongest_repeat(picture: NDArray[Any], mask: Bool, unit: float) -> Repeat:
    """The highest peak of a region's autocorrelation away from zero, and where it is.

    Its peak is 0 where no lag but the lobe's overlaps enough, NaN where the mask is empty. Raises
    `ValueError` if picture and mask differ in size, or the unit is out of range.

    Parameters
    ----------
    picture : [H, W, 3], uint8 or float in [0, 1].
    mask : bool [H, W], the region, without the silhouette.
    unit : Size of the face in pixels (`lfportrait.example.face_size`), > 0.
    """
    if picture.shape[:2] != mask.shape:
        raise ValueError(f"a picture {picture.shape} needs a mask of its size, not {mask.shape}")
    if not unit > 0:
        raise ValueError(f"the unit must be > 0, not {unit}")
    if not mask.any():
        return Repeat(float("nan"), (0, 0), float("nan"))
    box = ndimage.find_objects(mask.astype(np.uint8))[0]
    mask = np.asarray(mask[box], bool)
    correlation, common = masked_autocorrelation(_detail(luma(picture[box]), mask, unit), mask)
    middle = mask.shape[0] - 1, mask.shape[1] - 1
    allowed = common >= OVERLAP * mask.sum()
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


def over_exemplar(ours: Repeat, theirs: Repeat) -> float:
    """How much a region repeats itself, over how much the exemplar does in the same material.

    About 1 where the picture repeats itself no more than the exemplar does at the same size of the
    face; NaN where one of the regions is empty. The exemplar's peak is taken to be at least
    `LEAST_PEAK` and at least what chance gives in the picture's region: a plain exemplar, or one
    with a larger region under finer strokes, does not make a repeat of what is none.
    """
    if np.isnan(ours.peak) or np.isnan(theirs.peak):
        return float("nan")
    return ours.peak / max(theirs.peak, ours.chance, LEAST_PEAK)


Masks = dict[str, Bool]

DEGREES = (-20.0, 0.0, 20.0, 90.0, 180.0)
"""Yaws of the views: ends and middle of a display's arc, a profile, and from behind."""
LEAST_AREA = 1.0
"""Square units; in smaller regions chance alone makes high peaks."""
MARGIN = 0.05
"""Units that regions are eroded by: what lies at their borders is neither's paint."""

BODY = ("neck", "clothes")
"""Parts of what an exemplar's labels call the body."""


@dataclass(frozen=True)
class RowLabels:
    """How far the rows of a field lie in each of some regions."""

    weights: UInt8  # uint8 [N, R]; 255 is wholly inside.
    names: tuple[str, ...]  # Names of the R regions, as in `lfportrait.labels.PICTURE_LABELS`.

    @staticmethod
    def of(styled: VoxelField) -> RowLabels | None:
        """Those that a field carries as ``labels`` and ``regions``, or None."""
        weights, names = getattr(styled, "labels", None), getattr(styled, "regions", ())
        return None if weights is None else _with_body(weights, tuple(names))

    @staticmethod
    def joined(weights: UInt8, names: Sequence[str]) -> RowLabels:
        """From labels with separate parts of the body: adds the body as one region."""
        return _with_body(weights, tuple(names))

    @staticmethod
    def read(path: str | Path) -> RowLabels | None:
        """Those that lie beside the field in its file, or None."""
        with np.load(path, allow_pickle=False) as arrays:
            if not {"labels", "region_names"} <= set(arrays.files):
                return None
            return _with_body(arrays["labels"], tuple(map(str, arrays["region_names"].ravel())))

    def masks(self, field: VoxelField, cameras: Camera, names: Sequence[str],
              margin: float = 0.0) -> list[Masks]:
        """Where the regions are seen in some views: for each a bool [H, W] by region.

        They are pixels of the head (opacity over 0.5) that lie in it by more than half. Of the
        regions wanted, those without labels are left out; a region keeps ``margin`` pixels from its
        borders and from the head's silhouette.
        """
        if len(self.weights) != len(field.density):
            raise ValueError(f"labels of {len(self.weights)} rows are not those of a field of "
                             f"{len(field.density)}")
        known = [name for name in names if name in self.names]
        out: list[Masks] = [{} for _ in range(len(cameras))]
        for first in range(0, len(known), 3):  # three regions are the three colors of a field
            three = known[first:first + 3]
            colors = np.zeros((len(self.weights), 3, 1), np.float32)
            for channel, name in enumerate(three):
                colors[:, channel, 0] = self.weights[:, self.names.index(name)] / np.float32(255)
            shown = field.with_sh((colors - 0.5) / C0)
            for view, masks in enumerate(out):
                shot = shown.render(cameras, view, background=0.0)
                opaque = shot.alpha > 0.5
                for channel, name in enumerate(three):
                    inside = opaque & (shot.color[..., channel] > 0.5 * shot.alpha)
                    masks[name] = _eroded(inside, margin)
        return out


def _with_body(weights: UInt8, names: tuple[str, ...]) -> RowLabels:
    """Labels, with the body as one region if its parts are separate."""
    parts = [names.index(name) for name in BODY if name in names]
    if "body" in names or not parts:
        return RowLabels(weights, names)
    body = np.minimum(weights[:, parts].sum(axis=1, dtype=np.int64), 255).astype(np.uint8)
    return RowLabels(np.column_stack([weights, body]), (*names, "body"))


def _eroded(mask: Bool, margin: float) -> Bool:
    """A mask without what is nearer than ``margin`` pixels to its border."""
    if margin <= 0 or mask.all():
        return mask
    return np.asarray(ndimage.distance_transform_edt(mask) > margin, bool)


def exemplar_regions(exemplar: Exemplar, unit: float, names: Sequence[str],
                     margin: float = 0.0) -> tuple[UInt8, Masks]:
    """An exemplar uint8 [h, w, 3], resized to a face of ``unit`` pixels; its regions, bool [h, w].

    Of the regions wanted, others than `lfportrait.labels.PICTURE_LABELS` are left out; one keeps
    ``margin`` pixels from its borders.
    """
    labels = exemplar.regions().labels()
    height, width = exemplar.image.shape[:2]
    scale = unit / exemplar.size
    size = max(round(width * scale), 1), max(round(height * scale), 1)

    def resized(image: UInt8) -> UInt8:
        return np.asarray(Image.fromarray(image).resize(size, Image.Resampling.LANCZOS))

    return resized(exemplar.image), {
        name: _eroded(resized(np.ascontiguousarray(labels[..., PICTURE_LABELS.index(name)])) > 127,
                      margin)
        for name in names if name in PICTURE_LABELS}


def region_repeats(styled: VoxelField, exemplar: Exemplar, labels: RowLabels, *,
                   names: Sequence[str] = ("hair", "body"), degrees: Sequence[float] = DEGREES,
                   size: int = 768, landmarks: NDArray[np.floating] | None = None,
                   ) -> dict[str, dict[str, Any]]:
    """Repetition of paint in a stylised field, per region.

    By region: ``views`` (the peak of `strongest_repeat` by yaw), ``exemplar`` (its own peak at the
    same scale), ``chance`` (of the worst view) and ``ratio``, the worst view's peak over that of
    the exemplar (`over_exemplar`). NaN where a view or the exemplar shows less than `LEAST_AREA` of
    the region; the ratio is then over chance alone.

    Parameters
    ----------
    labels, names : Of the field's rows; ``body`` is neck, shoulders and clothes.
    degrees, size : Yaws of the views, and their width and height in pixels.
    landmarks : [68, 3] in space, for the size of the face; see `face_unit`.
    """
    unit = face_unit(styled, size, landmarks)
    cameras = arc_cameras(styled, degrees, size)
    seen = labels.masks(styled, cameras, names, MARGIN * unit)
    painting, theirs = exemplar_regions(exemplar, unit, names, MARGIN * unit)
    shots = [np.clip(styled.render(cameras, view).color, 0, 1) for view in range(len(cameras))]
    figures = {}
    for name in (name for name in names if name in labels.names):
        ours = [repeat_of(shot, masks[name], unit) for shot, masks in zip(shots, seen)]
        own = repeat_of(painting, theirs.get(name), unit)
        # An exemplar without this material sets no measure but chance.
        measure = Repeat(0.0, (0, 0), 1.0) if np.isnan(own.peak) else own
        ratios = np.array([over_exemplar(one, measure) for one in ours])
        worst = int(np.argmax(np.nan_to_num(ratios, nan=-1.0)))
        figures[name] = {"views": {f"{yaw:g}": one.peak for yaw, one in zip(degrees, ours)},
                         "exemplar": own.peak, "chance": ours[worst].chance,
                         "ratio": float(ratios[worst])}
    return figures


def repeat_of(picture: NDArray[Any], mask: Bool | None, unit: float) -> Repeat:
    """The strongest repeat of a region that is large enough."""
    if mask is None or mask.sum() < LEAST_AREA * unit ** 2:
        return Repeat(float("nan"), (0, 0), float("nan"))
    return strongest_repeat(picture, mask, unit)


def _energy(plane: Float32, counts: Bool) -> float:
    """Mean squared gradient over the pixels that count together with their next two."""
    here = counts[:-1, :-1] & counts[1:, :-1] & counts[:-1, 1:]
    if not here.any():
        return float("nan")
    right = plane[:-1, 1:][here] - plane[:-1, :-1][here]
    down = plane[1:, :-1][here] - plane[:-1, :-1][here]
    return float((right.astype(np.float64) ** 2 + down.astype(np.float64) ** 2).mean())


def gradient_energy(picture: NDArray[Any], mask: Bool) -> float:
    """Mean squared gradient of a picture's luma over a mask bool [H, W] of the same size.

    Luma squared per pixel squared, >= 0, by forward differences: of each pixel that is known and in
    the mask together with those to its right and below. NaN without any. The picture [H, W, 3] is
    uint8 or float in [0, 1]; NaN where it is unknown. A silhouette inside the mask counts as
    detail: erode it.
    """
    if picture.shape[:2] != mask.shape:
        raise ValueError(f"a picture {picture.shape} needs a mask of its size, not {mask.shape}")
    plane = luma(picture)
    return _energy(plane, np.asarray(mask, bool) & np.isfinite(plane))


def sharpness(rendered: NDArray[Any], wanted: NDArray[Any], mask: Bool, *,
              margin: int = 3) -> float:
    """Gradient energy of a rendered view over that of what was painted, seen in the same view.

    >= 0; 1 where both are equally sharp. NaN where nothing is left to compare, or where ``wanted``
    is flat. Raises `ValueError` if the pictures and the mask differ in size.

    Parameters
    ----------
    rendered : [H, W, 3], uint8 or float in [0, 1].
    wanted : [H, W, 3], what was painted; NaN where it is unknown. Its values beside the head don't
        matter.
    mask : bool [H, W], the head.
    margin : Pixels that the mask is eroded by, so that no silhouette counts. Holes of ``wanted``
        are not widened: only differences between known pixels count, the same ones in both
        pictures.
    """
    if not rendered.shape[:2] == wanted.shape[:2] == mask.shape:
        raise ValueError(f"pictures {rendered.shape} and {wanted.shape} and a mask {mask.shape} "
                         "must have one size")
    planes = [luma(picture) for picture in (rendered, wanted)]
    inside = np.asarray(mask, bool)
    if margin > 0:
        # The picture's own border is no silhouette.
        inside = ndimage.binary_erosion(inside, np.ones((3, 3), bool), margin, border_value=1)
    counts = inside & np.isfinite(planes[0]) & np.isfinite(planes[1])
    ours, theirs = (_energy(plane, counts) for plane in planes)
    # A thousandth of a grey level is rounding.
    return ours / theirs if theirs > (1e-3 / 255) ** 2 else float("nan")
