"""A solid as a voxel field: lattice points in a shell around its surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...field import VoxelField
from .solid import Solid

__all__ = ["Shell", "shell_of"]

Float64 = NDArray[np.float64]

OUTSIDE, INSIDE = 2.0, 4.0
"""Voxels before and behind the surface that are kept."""
COARSE = 4
"""Voxels to a step of the lattice that the surface is looked for on."""
STEEP = 4.0
"""Optical depth of a voxel one voxel below the surface; at most twice that."""
REACH = np.array([1.35, 1.45, 1.15])
"""Half edges of the box that may hold something, portrait units."""


class Shell:
    """Lattice points around a surface.

    Attributes
    ----------
    links
        int32 [Z, Y, X], rows of the points.
    points
        float64 [N, 3].
    away
        float64 [N], signed distances, positive outside.
    owner
        uint8 [N], what they belong to (`solid.HEAD`, `HAIR`, `BODY`).
    normals
        float64 [N, 3], outward.
    center, radius
        Of the lattice's box.
    voxel
        Distance of points.
    """

    def __init__(self, solid: Solid, voxel: float) -> None:
        self.voxel = voxel
        step = COARSE * voxel
        half = np.ceil(REACH / step).astype(int)
        axes = [(np.arange(2 * count + 1) - count) * step for count in half]
        coarse, _ = _on_lattice(solid, axes, step)
        box = np.argwhere(np.abs(coarse) < 2 * step)
        low = np.maximum(box.min(axis=0) - 1, 0)
        high = np.minimum(box.max(axis=0) + 1, np.array(coarse.shape) - 1)
        coarse = coarse[tuple(slice(a, b + 1) for a, b in zip(low, high, strict=True))]
        first = np.array([axis[a] for axis, a in zip(axes, low[::-1], strict=True)])
        self._fill(solid, coarse, first)

    def _fill(self, solid: Solid, coarse: Float64, first: Float64) -> None:
        """The fine lattice over a coarse one [z, y, x] whose first point is ``first``."""
        voxel = self.voxel
        size = (np.array(coarse.shape) - 1) * COARSE + 1
        limit = (INSIDE + 2.5) * voxel
        band = np.zeros(size, bool)
        # Trilinear distances are off by a fraction of a coarse step near edges alone.
        rough = _enlarged(coarse, size)
        band = (rough > -limit) & (rough < (OUTSIDE + 2.5) * voxel)
        z, y, x = np.nonzero(band)
        points = first + voxel * np.stack([x, y, z], axis=1)
        away, owner = solid.distance(points, 3 * COARSE * voxel)
        rough[z, y, x] = np.clip(away, -limit, limit)
        kept = (away > -INSIDE * voxel) & (away < OUTSIDE * voxel)
        self.normals = _gradients(rough, z[kept], y[kept], x[kept])
        z, y, x = z[kept], y[kept], x[kept]
        self.links = np.full(size, -1, np.int32)
        self.links[z, y, x] = np.arange(len(z), dtype=np.int32)
        self.points, self.away, self.owner = points[kept], away[kept], owner[kept]
        extent = size[::-1] * voxel
        self.center = first - 0.5 * voxel + 0.5 * extent
        self.radius = 0.5 * extent

    @property
    def on(self) -> Float64:
        """The surface's places nearest to the points, float64 [N, 3]."""
        return np.asarray(self.points - self.away[:, None] * self.normals, np.float64)

    def field(self, sh: NDArray[np.float32]) -> VoxelField:
        """The field with coefficients [N, 3, B]."""
        deep = -self.away / self.voxel
        density = np.clip(STEEP * deep, 0.0, 2.0 * STEEP) / self.voxel
        return VoxelField(self.links, density.astype(np.float32), sh, self.center, self.radius)


def _on_lattice(solid: Solid, axes: list[Float64], step: float) -> tuple[Float64, None]:
    """Signed distances [z, y, x] on a lattice, clipped at some steps from the surface."""
    x, y, z = axes
    grid = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).transpose(2, 1, 0, 3)
    points = grid.reshape(-1, 3)
    found, _ = solid.distance(points, 3 * step)
    out = np.clip(np.where(np.isfinite(found), found, 3 * step), -3 * step, 3 * step)
    shape = grid.shape[:3]
    out = out.reshape(shape)
    # Deep within the head no sample is near: all that free space does not reach is inside.
    free, _ = ndimage.label(out > 0)
    out[(out > 0) & (free != free[0, 0, 0])] = -3 * step
    return out, None


def _enlarged(coarse: Float64, size: NDArray[np.int64]) -> Float64:
    """A lattice [z, y, x] between its points, at ``size`` points."""
    out = coarse.astype(np.float32)
    for axis in range(3):
        count = int(size[axis])
        place = np.arange(count) / COARSE
        low = np.minimum(place.astype(int), coarse.shape[axis] - 2)
        share = (place - low).astype(np.float32)
        share = share.reshape([-1 if k == axis else 1 for k in range(3)])
        out = np.take(out, low, axis) * (1 - share) + np.take(out, low + 1, axis) * share
    return out


def _gradients(distance: Float64, z: NDArray[np.int64], y: NDArray[np.int64],
               x: NDArray[np.int64]) -> Float64:
    """Unit gradients [N, 3] (x, y, z) of a lattice at some of its points, smoothed a little."""
    parts = []
    size = distance.shape
    for axis, place in ((2, x), (1, y), (0, z)):
        total = np.zeros(len(x))
        for reach in (1, 2):
            ends = []
            for sign in (1, -1):
                at = [z, y, x]
                at[axis] = np.clip(place + sign * reach, 0, size[axis] - 1)
                ends.append(distance[tuple(at)])
            total += (ends[0] - ends[1]) / (2 * reach)
        parts.append(total)
    normal = np.stack(parts, axis=1)
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-9)[:, None])


def shell_of(solid: Solid, points: int) -> Shell:
    """The shell of a solid on a lattice of ``points`` points to two units."""
    return Shell(solid, 2.0 / points)
