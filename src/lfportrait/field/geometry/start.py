"""Initialise a reconstruction: from the visual hull of the mattes, or a room's surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Float64, Int64
from ...capture import Capture
from ...errors import UserError
from ..background import Background
from ..config import Settings
from ..training.lattice import Lattice, box_shape
from ..training.pixels import TrainingPixels
from .exposure import exposure_gains
from .head_surface import HeadSurface, distance_outside
from .hull import hull_box, visual_hull
from .sweep import fuse, scene_box, small_view, sweep_depth

__all__ = ["Start", "start_person", "start_room"]

BACKGROUND_ROWS = 256
"""Rows of the spheres' maps at the last level; they have twice as many columns."""
REACH = 3.0
"""A room's lattice ends at most so far from the origin, in world units."""


@dataclass(frozen=True)
class Start:
    """The first lattice and what else is known before the first step.

    Attributes
    ----------
    lattice
        Matter of low density where there may be any.
    background
        Spheres behind it, or None.
    gains, test_gains
        float64 [V, 3] and [W, 3], exposures of training and held-out photos.
    haze
        Whether the lattice is a whole cube because nothing is known of the surfaces.
    """

    lattice: Lattice
    background: Background | None
    gains: Float64
    test_gains: Float64
    haze: bool = False


_DENSE, _THIN = 2.0, 0.03
"""Optical depth of a voxel inside of such a surface, and before it."""


def start_person(capture: Capture, views: Int64, resolution: int, width: int,
                 opacity: float, surface: HeadSurface | None = None) -> Start:
    """The visual hull of the mattes, each voxel of which takes ``opacity`` of the light.

    With a ``surface`` the hull only bounds: what lies before the surface is clear but for a thin
    layer, what lies behind it is dense.

    Raises
    ------
    UserError
        If the mattes have no common volume.
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
