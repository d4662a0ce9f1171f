"""Exposure gains of photos, from surfaces that several photos show.

A phone meters every photo separately. Colors of points that a plane sweep found are compared
between neighbouring photos; the medians of their log ratios, pair by pair, are solved for one gain
a photo and channel (least squares, mean zero). A gain in linear light is one in sRGB's power law,
too. Photos with mattes are compared with a field that was trained roughly instead, or, before there
is one, with each other over a surface that was found first (`surface_gains`): in a field that is
trained on photos of a narrow arc that are exposed otherwise each, brightness that changes from
photo to photo becomes matter before the face.
"""

import warnings
from collections.abc import Callable

import cv2
import numpy as np

from ...arrays import Bool, Float32, Float64, Floats, Int64, UInt8
from ...capture import Camera, Capture
from ...simd.threads import side_by_side
from ..grid import VoxelField
from .chart import normals_of
from .head_surface import HeadSurface
from .sweep import DepthMap

_DARK, _FEW, _NEAREST = 0.03, 150, 8
_ALIKE = 0.02  # Photos whose gains differ by less, as a standard deviation, are exposed alike.
_FACED = 0.5  # Cosine to a photo from which on it shows a surface well.
_SMALL = 160  # Height or width of the small copies that photos with mattes are compared in.


def exposure_gains(maps: list[DepthMap], others: list[DepthMap]) -> tuple[Float64, Float64]:
    """Gains of photos, float64 [V, 3] and [W, 3]: photo = gain * color at the mean exposure.

    Photos with depth fix each other's; the others, without, are compared with the former. One where
    a photo shares nothing with the others.
    """
    position = np.stack([item.camera.position[0] for item in maps])
    points = [item.points() for item in maps]
    colors = [item.image[np.isfinite(item.depth)] for item in maps]
    gains = _solved(position, lambda a, b: _ratio(points[a], colors[a], maps[b]))
    found = np.zeros((len(others), 3))
    for index, item in enumerate(others):
        away = np.linalg.norm(position - item.camera.position[0], axis=1)
        votes = [ratio + gains[a] for a in np.argsort(away)[:_NEAREST]
                 if (ratio := _ratio(points[a], colors[a], item)) is not None]
        if votes:
            found[index] = np.median(votes, axis=0)
    return np.exp(gains), np.exp(found)


def _solved(position: Float64, ratio: Callable[[int, int], Float64 | None]) -> Float64:
    """Logarithms of gains, float64 [V, 3], mean zero, by the ratios of neighbouring photos.

    ``position`` [V, 3] are the photos'; ``ratio`` gives the logarithm of the second one's colors
    over the first one's, [3], or None. A drift along an arc is found whole in this way, where
    photos of its ends share nothing.
    """
    count = len(position)
    rows, ratios = [], []
    for a in range(count):
        away = np.linalg.norm(position - position[a], axis=1)
        for b in np.argsort(away)[1:_NEAREST + 1]:
            found = ratio(a, int(b))
            if found is not None:
                row = np.zeros(count)
                row[a], row[b] = -1.0, 1.0
                rows.append(row)
                ratios.append(found)
    gains = np.zeros((count, 3))
    if not rows:
        return gains
    # A weak prior towards one determines gains without pairs.
    matrix = np.concatenate([np.array(rows), 0.01 * np.eye(count)])
    gains = np.linalg.lstsq(matrix, np.concatenate([np.array(ratios), gains]), rcond=None)[0]
    return np.asarray(gains - gains.mean(axis=0))


def _ratio(points: Float64, colors: Float32, other: DepthMap) -> Float64 | None:
    """Median log ratio [3] of another photo's colors to those of points; None if few are seen."""
    pixels, along = other.camera.project(points)
    height, width = other.depth.shape
    x, y = (np.floor(np.nan_to_num(pixels[0, :, axis], nan=-1.0)).astype(int) for axis in (0, 1))
    inside = np.flatnonzero((along[0] > 0) & (x >= 0) & (y >= 0) & (x < width) & (y < height))
    if len(inside) < _FEW:
        return None
    place, depth = y[inside] * width + x[inside], along[0, inside]
    # Only the front of what falls on a pixel is seen there.
    front = np.full(height * width, np.inf)
    np.minimum.at(front, place, depth)
    measured = other.depth.ravel()
    known = np.isfinite(measured)
    front[known] = np.minimum(front[known], measured[known])
    seen = inside[depth < 1.02 * front[place]]
    if len(seen) < _FEW:
        return None
    there = other.image[y[seen], x[seen]]
    return np.asarray(np.median(np.log((there + _DARK) / (colors[seen] + _DARK)), axis=0))


def matte_gains(field: VoxelField, capture: Capture, views: Int64, least: float = _ALIKE,
                ) -> Float64 | None:
    """Gains of photos with mattes by comparison with the field that is being trained on them.

    They are float64 [V, 3]: photo = gain * color of the field; None for photos exposed alike (the
    gains' standard deviation is below ``least``; 0 takes them as they are), and for a field that is
    too inaccurate: one whose brightness is off by more from part to part of a photo than from photo
    to photo.
    """
    # Layouts are built on first use: not by several threads.
    _ = field.bricks.rows
    found = side_by_side(lambda view: _matte_gain(field, capture, view), views.tolist())
    gains, spreads = np.array([one for one, _ in found]), [spread for _, spread in found]
    if least > 0:
        least = max(least, float(np.median(spreads)))
    return np.exp(gains) if gains.mean(axis=1).std() >= least else None


def surface_gains(surface: HeadSurface, capture: Capture, views: Int64, tests: Int64,
                  ) -> tuple[Float64, Float64] | None:
    """Gains of photos with mattes by comparison with each other over a person's surface.

    Parameters
    ----------
    views, tests : Those that are compared with each other, and those that are compared with them.

    Returns
    -------
    gains : float64 [V, 3] and [T, 3], the first one on the mean; None where `matte_gains` would
        give none, either.
    """
    chart = surface.chart
    well = (surface.facing > _FACED) & (surface.knots == 0)
    points = chart.points(surface.distance)[well]
    normals = normals_of(chart, surface.distance)[well]
    if well.sum() < _FEW:
        return None
    part = (np.argwhere(well) // max(4, len(well) // 10)) @ np.array([1000, 1])

    def seen(view: int) -> Float64:
        return _logarithms(capture, view, points, normals)

    def apart_by(one: Float64, other: Float64) -> Float64 | None:
        known = np.isfinite(one).all(axis=1) & np.isfinite(other).all(axis=1)
        return np.median((other - one)[known], axis=0) if known.sum() >= _FEW else None

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # places that no photo shows
        colors = np.stack(side_by_side(seen, views.tolist()))
        gains = _solved(capture.cameras.position[views],
                        lambda a, b: apart_by(colors[a], colors[b]))
        usual = np.nanmedian(colors - gains[:, None], axis=0)
        left = (colors - gains[:, None] - usual).mean(axis=-1)
        spread = [np.nanmedian(left[:, part == one], axis=1) for one in np.unique(part)
                  if (part == one).sum() > 8]
        apart = 1.4826 * float(np.nanmedian(np.abs(spread))) if spread else np.inf
    if gains.mean(axis=1).std() < max(_ALIKE, apart):
        return None
    found = [apart_by(usual, one) for one in side_by_side(seen, tests.tolist())]
    others = np.array([np.zeros(3) if one is None else one for one in found])
    return np.exp(gains), np.exp(others.reshape(-1, 3))


def _small(capture: Capture, view: int) -> tuple[Camera, UInt8, UInt8]:
    """Small copies of a photo and its matte, and their camera."""
    assert capture.alphas is not None
    camera = capture.cameras[view]
    camera = camera.scaled(min(1.0, _SMALL / float(max(camera.width[0], camera.height[0]))))
    size = int(camera.width[0]), int(camera.height[0])
    photo, matte = (np.asarray(cv2.resize(picture[view], size, interpolation=cv2.INTER_AREA),
                               np.uint8) for picture in (capture.images, capture.alphas))
    return camera, photo, matte


def _logarithms(capture: Capture, view: int, points: Float64, normals: Float64) -> Float64:
    """Logarithms of a photo's colors at places of a surface, [N, 3]; NaN where it shows none."""
    camera, photo, matte = _small(capture, view)
    x, y = (camera.project(points)[0][0].astype(np.float32) - 0.5).T
    colors, inside = (cv2.remap(of.astype(np.float32) / 255, x[:, None], y[:, None],
                                cv2.INTER_LINEAR, borderValue=0)[:, 0] for of in (photo, matte))
    way = camera.position[0] - points
    faced = (way * normals).sum(axis=1) > _FACED * np.linalg.norm(way, axis=1)
    return np.where((faced & (inside > 0.98))[:, None], np.log(colors + _DARK), np.nan)


def _matte_gain(field: VoxelField, capture: Capture, view: int) -> tuple[Float64, float]:
    """Logarithm of a photo's gains [3], and how much they differ from part to part of it."""
    camera, photo, matte = _small(capture, view)
    shot = field.render(camera, 0, background=0.0)
    # Well inside the person, where neither matte nor field mixes in what is behind.
    opaque = ((matte > 250) & (shot.alpha > 0.98)).astype(np.uint8)
    inside = cv2.erode(opaque, np.ones((3, 3), np.uint8)) > 0
    if inside.sum() < _FEW:
        return np.zeros(3), 0.0
    ratio = np.log((photo / 255.0 + _DARK) / (np.maximum(shot.color, 0.0) + _DARK))
    return np.median(ratio[inside], axis=0), _spread(ratio.mean(axis=2), inside,
                                                     max(4, max(matte.shape) // 10))


def _spread(ratio: Floats, inside: Bool, side: int) -> float:
    """How much the median of a picture differs between its blocks, as a standard deviation."""
    height, width = ratio.shape
    medians = [np.median(ratio[rows, columns][inside[rows, columns]])
               for rows in (slice(y, y + side) for y in range(0, height, side))
               for columns in (slice(x, x + side) for x in range(0, width, side))
               if inside[rows, columns].sum() > side * side // 4]
    if len(medians) < 3:
        return 0.0
    return 1.4826 * float(np.median(np.abs(np.subtract(medians, np.median(medians)))))
