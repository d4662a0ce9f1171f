"""Colors of a solid from its photo, and of what the photo does not show.

A place has the photo's color as far as the photo looks at it squarely; beyond, that fades into what
lies around, by parts (hair, all else): the mirrored side's colors, with their light matched, then
means over ever wider surroundings (pull and push, Gortler et al. 1996).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...capture import Camera
from ...field import C0
from .lattice import Shell
from .parts import Parts
from .solid import HAIR

__all__ = ["Shot", "painted"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Bools = NDArray[np.bool_]

LEAST, FULL = 0.25, 0.45
"""Cosines of incidence: below the first (75 degrees) a photo says nothing, from the second on
all."""
CELL = 0.03
"""Of the finest lattice that colors are spread on, portrait units."""
UPWARDS = 1.8
"""Colors come from the sides rather than from above or below."""
MIRRORED = 0.25
"""Weight of what the other side shows."""


@dataclass(frozen=True)
class Shot:
    """A photo that colors a solid.

    Attributes
    ----------
    camera
        One view.
    colors
        float32 [H, W, 3] in [0, 1], the person's alone (`clean_colors`).
    """

    camera: Camera
    colors: Float32

    def look(self, points: Float64, normals: Float64, depth: Float64, voxel: float,
             ) -> tuple[Float64, Float64]:
        """Colors [N, 3] of places, and how well the photo shows them, [N] in [0, 1].

        ``depth`` [h, w] is the solid's in the photo, of any size.
        """
        pixels, far = self.camera.project(points)
        pixels, far = pixels[0], far[0]
        size = np.array(self.colors.shape[1::-1])
        at = pixels[:, ::-1].T - 0.5
        colors = np.stack([Parts.at(self.colors[..., k], at) for k in range(3)], axis=1)
        to_eye = self.camera.position[0] - points
        to_eye /= np.linalg.norm(to_eye, axis=1)[:, None]
        cosine = (normals * to_eye).sum(axis=1)
        share = np.clip((cosine - LEAST) / (FULL - LEAST), 0, 1)
        small = np.floor(pixels / size * np.array(depth.shape[::-1])).astype(np.int64)
        within = (small >= 0).all(axis=1) & (small < np.array(depth.shape[::-1])).all(axis=1)
        small = np.clip(small, 0, np.array(depth.shape[::-1]) - 1)
        seen = within & (far < depth[small[:, 1], small[:, 0]] + 3.0 * voxel)
        return colors.astype(np.float64), np.where(seen, share * share * (3 - 2 * share), 0.0)


def painted(shell: Shell, shots: list[Shot]) -> NDArray[np.float32]:
    """Coefficients [N, 3, 1] of a shell's points."""
    points, normals = shell.on, shell.normals
    bare = shell.field(np.zeros((len(points), 3, 1), np.float32))
    total, weights = np.zeros((len(points), 3)), np.zeros(len(points))
    best = np.zeros(len(points))
    spread, known = np.zeros((len(points), 3)), np.zeros(len(points))
    mirror = np.array([-1.0, 1.0, 1.0])
    for shot in shots:
        factor = min(1.0, 1.0 / (shell.voxel * float(shot.camera.focal[0, 0])
                                 / float(np.linalg.norm(shot.camera.position[0]))))
        small = shot.camera.scaled(factor)
        alpha, depth = bare.depth(small, 0)
        near = _nearest(np.where(alpha > 0.5, depth, np.inf))
        color, weight = shot.look(points, normals, near, shell.voxel)
        total += weight[:, None] * color
        weights += weight
        best = np.maximum(best, weight)
        color, weight = shot.look(points * mirror, normals * mirror, near, shell.voxel)
        spread += weight[:, None] * color
        known += weight
    photo = total / np.maximum(weights, 1e-9)[:, None]
    other = spread / np.maximum(known, 1e-9)[:, None]
    hair = shell.owner == HAIR
    fill = np.empty_like(photo)
    for part in (hair, ~hair):
        if part.any():
            fill[part] = _filled(points[part], photo[part], best[part], other[part],
                                 np.minimum(known[part], 1.0))
    share = best[:, None]
    out = np.clip(share * photo + (1 - share) * fill, 0, 1)
    return np.asarray((out - 0.5) / C0, np.float32)[:, :, None]


def _nearest(depth: NDArray[np.floating]) -> Float64:
    """A depth map whose outline is a pixel wider: there a place lies behind nothing."""
    return np.asarray(np.where(np.isfinite(depth), depth, ndimage.minimum_filter(depth, 3)),
                      np.float64)


def _filled(points: Float64, photo: Float64, weight: Float64, other: Float64,
            known: Float64) -> Float64:
    """Colors [N, 3] of places by those around them and on the other side."""
    light = np.ones_like(photo)
    both = np.minimum(weight, known)
    if both.sum() > 100:
        ratio = np.clip((photo + 0.02) / (other + 0.02), 0.3, 3.0)
        light = _spread(points, np.log(ratio), both, 3)
        light = np.exp(light)
    matched = np.clip(other * light, 0, 1)
    own = MIRRORED * known * (1 - weight)
    both_weights = weight + own
    mixed = ((weight[:, None] * photo + own[:, None] * matched)
             / np.maximum(both_weights, 1e-9)[:, None])
    if both_weights.sum() < 10:
        return np.broadcast_to(photo.mean(axis=0), photo.shape)
    around = _spread(points, mixed, both_weights, 0)
    # Where the other side is seen well, its detail.
    return np.asarray(known[:, None] * matched + (1 - known[:, None]) * around)


def _spread(points: Float64, values: Float64, weights: Float64, finest: int) -> Float64:
    """Values [N, C] everywhere: means of the known ones over ever wider surroundings.

    ``finest`` is the level, in octaves, from which on they are looked at.
    """
    scaled = points * np.array([1.0, UPWARDS, 1.0]) / (CELL * 2 ** finest)
    first = scaled.min(axis=0) - 2
    place = (scaled - first).T
    size = 16 * np.ceil((place.max(axis=1) + 3) / 16).astype(int)
    flat = np.ravel_multi_index(tuple(np.rint(place).astype(int)), tuple(size))
    sums = [np.bincount(flat, weights * values[:, k], int(size.prod())).reshape(size)
            for k in range(values.shape[1])]
    grid = np.stack([*sums, np.bincount(flat, weights, int(size.prod())).reshape(size)], axis=-1)
    result = _pushed(grid)
    return np.stack([ndimage.map_coordinates(result[..., k], place, order=1, mode="nearest")
                     for k in range(values.shape[1])], axis=1)


def _pushed(grid: Float64) -> Float64:
    """Means of a lattice [x, y, z, C + 1] of sums and weights, its gaps filled from coarser."""
    weight = grid[..., -1:]
    if min(grid.shape[:3]) < 2 or any(side % 2 for side in grid.shape[:3]):
        total = grid.reshape(-1, grid.shape[-1]).sum(axis=0)
        coarse = np.broadcast_to(total[:-1] / max(total[-1], 1e-9), (*grid.shape[:3],
                                                                    grid.shape[-1] - 1))
    else:
        x, y, z, c = grid.shape
        halves = grid.reshape(x // 2, 2, y // 2, 2, z // 2, 2, c).sum(axis=(1, 3, 5))
        small = _pushed(halves)
        places = np.meshgrid(*((np.arange(side) - 0.5) / 2 for side in (x, y, z)), indexing="ij")
        coarse = np.stack([ndimage.map_coordinates(small[..., k], places, order=1, mode="nearest")
                           for k in range(c - 1)], axis=-1)
    trust = weight / (weight + 2.0)
    return np.asarray(trust * grid[..., :-1] / np.maximum(weight, 1e-9) + (1 - trust) * coarse)
