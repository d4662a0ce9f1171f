"""What a reconstruction starts from: the mattes' visual hull or a room's surfaces, and exposures.

A phone meters every photo separately. Colors of points that a plane sweep found are compared
between neighbouring photos; the medians of their log ratios, pair by pair, are solved for one gain
a photo and channel (least squares, mean zero). A gain in linear light is one in sRGB's power law,
too. Photos with mattes are compared with a field that was trained roughly instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ...arrays import Bool, Float32, Float64, Int64, UInt8
from ...capture import Camera, Capture, lattice_votes
from ...errors import UserError
from ...simd.threads import side_by_side
from ..background import Background
from ..config import Settings
from ..grid import VoxelField
from ..training.lattice import Lattice, box_shape
from ..training.pixels import TrainingPixels
from .head_surface import HeadSurface, distance_outside
from .sweep import DepthMap, fuse, scene_box, small_view, sweep_depth


def _votes(cameras: Camera, alphas: Sequence[UInt8], shape: tuple[int, ...], center: Float64,
           radius: Float64, *, wide: bool, limit: float = np.inf,
           asked: Bool | None = None) -> tuple[Float32, Float32]:
    """How many views have each point of a lattice in the picture, and show it empty.

    Empty are pixels with nothing in their mattes within a voxel (``wide``), or not a quarter of
    the light within half a voxel. See `lattice_votes` for ``limit`` and ``asked``.
    """
    edge = 2.0 * float((radius / shape[::-1]).max())

    def covered(view: int) -> Bool:
        distance = float(np.linalg.norm(cameras.position[view] - center))
        voxel = edge * float(cameras.focal[view].max()) / distance
        reach, least = (int(np.ceil(voxel)), 12) if wide else (round(0.5 * voxel), 63)
        near = cv2.dilate(alphas[view], np.ones((2 * reach + 1,) * 2, np.uint8))
        return np.asarray(near > least)

    return lattice_votes(cameras, covered, center, radius, shape, limit, asked)


_CARVED = 0.03
"""Share of the views that have a point in the picture and show nothing within a voxel of it, above
which it is carved away: mattes from a network err now and then."""
_RULED_OUT = 0.08
"""The same of a fine lattice, where less than a quarter of the light is covered within half a
voxel."""
_SELDOM = 0.2
"""Share of all views below which a point is hardly shown."""


def visual_hull(cameras: Camera, alphas: list[UInt8], shape: tuple[int, int, int], center: Float64,
                radius: Float64) -> Bool:
    """Lattice points that (nearly) no matte, uint8 [H, W] a view, rules out: bool [Z, Y, X].

    The lattice has ``shape`` points along z, y, x in its box, float64 [3] each (x, y, z). Points
    that fewer than a twentieth of the pictures show are not in it: nothing would keep them from
    becoming floaters.
    """
    return _hull(cameras, alphas, shape, center, radius)[0]


def _hull(cameras: Camera, alphas: Sequence[UInt8], shape: tuple[int, ...], center: Float64,
          radius: Float64) -> tuple[Bool, Float32]:
    """`visual_hull`, and how many views have each of its points in the picture."""
    seen, against = _votes(cameras, alphas, shape, center, radius, wide=True,
                           limit=_CARVED * len(alphas))
    return (seen >= max(1, round(0.05 * len(alphas)))) & (against <= _CARVED * seen), seen


def ruled_out(cameras: Camera, alphas: Sequence[UInt8], filled: Bool, center: Float64,
              radius: Float64) -> tuple[Bool, Bool]:
    """Points of a fine lattice that mattes rule out, and those that are hardly shown.

    The hull on a coarse lattice held them, bool [Z, Y, X] in a box as for `visual_hull`. Crumbs
    about an outline come from mattes that are a pixel too wide here and there; most other views
    that look past the outline at that place show nothing.
    """
    seen, against = _votes(cameras, alphas, filled.shape, center, radius, wide=False, asked=filled)
    wrong, hardly = np.zeros(filled.shape, bool), np.zeros(filled.shape, bool)
    seen, against = seen[filled], against[filled]
    wrong[filled], hardly[filled] = against > _RULED_OUT * seen, seen < _SELDOM * len(alphas)
    return wrong, hardly


def hull_box(cameras: Camera, alphas: list[UInt8], reach: float = 1.8) -> tuple[Float64, Float64]:
    """Center and radius [3] of a box about what the mattes show, within ``reach`` of the origin.

    A head lies inside [-1, 1]^3, its shoulders need not. Points count that at least two fifths of
    the views have in the picture, so that the box does not follow the hull's tail away from the
    cameras.
    """
    center, radius = np.zeros(3), np.full(3, reach)
    size = 72
    hull, seen = _hull(cameras, alphas, (size,) * 3, center, radius)
    axis = reach * (2.0 * (np.arange(size) + 0.5) / size - 1.0)
    z, y, x = np.nonzero(hull)
    if not len(z):
        return center, np.ones(3)
    points = np.stack([axis[x], axis[y], axis[z]], 1)
    points = points[seen[hull] >= 0.4 * len(alphas)]
    if not len(points):
        return center, np.ones(3)
    margin = 2.5 * reach / size
    low, high = points.min(0) - margin, points.max(0) + margin
    return 0.5 * (low + high), 0.5 * (high - low)


BACKGROUND_ROWS = 256
"""Rows of the spheres' maps at the last level; they have twice as many columns."""
REACH = 3.0
"""A room's lattice ends at most so far from the origin, in world units."""


@dataclass(frozen=True)
class Start:
    """The first lattice and what else is known before the first step."""

    lattice: Lattice  # Matter of low density where there may be any.
    background: Background | None  # Spheres behind it, or None.
    # gains, test_gains: float64 [V, 3] and [W, 3], exposures of training and held-out photos.
    gains: Float64
    test_gains: Float64
    # Whether the lattice is a whole cube because nothing is known of the surfaces.
    haze: bool = False


_DENSE, _THIN = 2.0, 0.03
"""Optical depth of a voxel inside of such a surface, and before it."""


def start_person(capture: Capture, views: Int64, resolution: int, width: int,
                 opacity: float, surface: HeadSurface | None = None) -> Start:
    """The visual hull of the mattes, each voxel of which takes ``opacity`` of the light.

    With a ``surface`` the hull only bounds: what lies before the surface is clear but for a thin
    layer, what lies behind it is dense. Raises `UserError` if the mattes have no common volume.
    """
    assert capture.alphas is not None
    cameras, mattes = capture.cameras[views], [capture.alphas[view] for view in views]
    center, radius = hull_box(cameras, mattes)
    points = visual_hull(cameras, mattes, box_shape(resolution, radius), center, radius)
    if not points.any():
        raise UserError("the mattes of the photos have no common volume inside the "
                        "portrait frame; check the cameras and the mattes")
    if surface is not None:
        outside, clearance = distance_outside(surface, points.shape, center, radius)
        points &= outside < clearance + 1.0 / resolution
    lattice = Lattice.filled(points, 0.5 * opacity * resolution, width, center, radius)
    if surface is not None:
        deep = np.clip(1.0 - 1.5 * outside[points] / lattice.voxel, _THIN, _DENSE)
        lattice.density[lattice.links[points]] = deep / lattice.voxel
    return Start(lattice, None, np.ones((len(views), 3)), np.ones((len(capture.testing()), 3)))


def start_room(capture: Capture, views: Int64, data: TrainingPixels,
               config: Settings, resolution: int, width: int) -> Start:
    """Without mattes: the surfaces that a plane sweep finds, or else a cube of haze."""
    gains, test_gains = np.ones((len(views), 3)), np.ones((len(capture.testing()), 3))
    maps = sweep_depth(capture, views) if config.mvs_init else []
    box = scene_box(maps, 1.0, REACH) if maps else None
    if box is not None and config.exposure:
        held_out = [small_view(capture, int(view)) for view in capture.testing()]
        gains, test_gains = exposure_gains(maps, held_out)
    if box is None:
        center, radius = np.zeros(3), np.ones(3)
        lattice = Lattice.filled(np.ones(box_shape(resolution, radius), bool), 0.1, width,
                                 center, radius)
    else:
        center, radius = box
        surfaces = fuse(maps, resolution, center, radius)
        lattice = Lattice.filled(surfaces.keep, 0.01 * resolution, width, center, radius)
        rows = lattice.links[surfaces.solid]
        lattice.density[rows] = 0.15 * resolution
        for channel in range(3):
            lattice.rows[rows, channel * (config.sh_degree + 1) ** 2] = (
                surfaces.color[surfaces.solid, channel])
    background = None
    if config.background_nlayers:
        coarse = max(16, BACKGROUND_ROWS >> (len(config.resolutions) - 1))
        background = Background.seen(
            [data.cube_rays(data.tiles[part::16], center, radius) for part in range(4)],
            coarse, config.background_nlayers, 1.0)
    return Start(lattice, background, gains, test_gains, haze=box is None)


_DARK, _FEW, _NEAREST = 0.03, 150, 8
_SMALL = 160
"""Height or width of the small copies that photos with mattes are compared in."""


def exposure_gains(maps: list[DepthMap], others: list[DepthMap]) -> tuple[Float64, Float64]:
    """Gains of photos, float64 [V, 3] and [W, 3]: photo = gain * color at the mean exposure.

    Photos with depth fix each other's; the others, without, are compared with the former. One where
    a photo shares nothing with the others.
    """
    position = np.stack([item.camera.position[0] for item in maps])
    points = [item.points() for item in maps]
    colors = [item.image[np.isfinite(item.depth)] for item in maps]
    rows: list[Float64] = []
    ratios: list[Float64] = []
    for a in range(len(maps)):
        away = np.linalg.norm(position - position[a], axis=1)
        for b in np.argsort(away)[1:_NEAREST + 1]:
            ratio = _ratio(points[a], colors[a], maps[b])
            if ratio is not None:
                row = np.zeros(len(maps))
                row[a], row[b] = -1.0, 1.0
                rows.append(row)
                ratios.append(ratio)
    gains = np.zeros((len(maps), 3))
    if rows:
        # A weak prior towards one determines gains without pairs.
        matrix = np.concatenate([np.array(rows), 0.01 * np.eye(len(maps))])
        gains = np.linalg.lstsq(matrix, np.concatenate([np.array(ratios), gains]), rcond=None)[0]
        gains -= gains.mean(axis=0)
    found = np.zeros((len(others), 3))
    for index, item in enumerate(others):
        away = np.linalg.norm(position - item.camera.position[0], axis=1)
        votes = [ratio + gains[a] for a in np.argsort(away)[:_NEAREST]
                 if (ratio := _ratio(points[a], colors[a], item)) is not None]
        if votes:
            found[index] = np.median(votes, axis=0)
    return np.exp(gains), np.exp(found)


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


def matte_gains(field: VoxelField, capture: Capture, views: Int64, least: float = 0.02,
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


def _matte_gain(field: VoxelField, capture: Capture, view: int) -> tuple[Float64, float]:
    """Logarithm of a photo's gains [3], and how much they differ from part to part of it."""
    assert capture.alphas is not None
    camera = capture.cameras[view]
    camera = camera.scaled(min(1.0, _SMALL / float(max(camera.width[0], camera.height[0]))))
    shot = field.render(camera, 0, background=0.0)
    high, wide = shot.alpha.shape
    photo = cv2.resize(capture.images[view], (wide, high), interpolation=cv2.INTER_AREA)
    matte = cv2.resize(capture.alphas[view], (wide, high), interpolation=cv2.INTER_AREA)
    # Well inside the person, where neither matte nor field mixes in what is behind.
    opaque = ((matte > 250) & (shot.alpha > 0.98)).astype(np.uint8)
    inside = cv2.erode(opaque, np.ones((3, 3), np.uint8)) > 0
    if inside.sum() < _FEW:
        return np.zeros(3), 0.0
    ratio = np.log((photo / 255.0 + _DARK) / (np.maximum(shot.color, 0.0) + _DARK))
    return np.median(ratio[inside], axis=0), _spread(ratio.mean(axis=2), inside,
                                                     max(4, max(high, wide) // 10))


def _spread(ratio: NDArray[np.floating], inside: Bool, side: int) -> float:
    """How much the median of a picture differs between its blocks, as a standard deviation."""
    height, width = ratio.shape
    medians = [np.median(ratio[rows, columns][inside[rows, columns]])
               for rows in (slice(y, y + side) for y in range(0, height, side))
               for columns in (slice(x, x + side) for x in range(0, width, side))
               if inside[rows, columns].sum() > side * side // 4]
    if len(medians) < 3:
        return 0.0
    return 1.4826 * float(np.median(np.abs(medians - np.median(medians))))
