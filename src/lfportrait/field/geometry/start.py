"""The lattice that a reconstruction starts from: the mattes' visual hull, or a room's surfaces."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ...arrays import Bool, Float32, Float64, Int64, UInt8
from ...capture import Camera, Capture, lattice_votes
from ...errors import UserError
from ..background import Background
from ..config import Settings
from ..training.lattice import Lattice, box_shape
from ..training.pixels import TrainingPixels
from .exposure import exposure_gains
from .head_surface import HeadSurface, distance_outside
from .sweep import fuse, scene_box, small_view, sweep_depth


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
_SELDOM = 0.2  # Share of all views below which a point is hardly shown.


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


def hull_box(cameras: Camera, alphas: list[UInt8]) -> tuple[Float64, Float64]:
    """Center and radius [3] of a box about what the mattes show, within 1.8 of the origin.

    A head lies inside [-1, 1]^3, its shoulders need not. Points count that at least two fifths of
    the views have in the picture, so that the box does not follow the hull's tail away from the
    cameras.
    """
    size, reach = 72, 1.8
    center, radius = np.zeros(3), np.full(3, reach)
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
REACH = 3.0  # A room's lattice ends at most so far from the origin, in world units.


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


_DENSE, _THIN = 2.0, 0.03  # Optical depth of a voxel inside of such a surface, and before it.


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
