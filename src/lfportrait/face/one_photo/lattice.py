"""A solid as a voxel field: lattice points in a shell around its surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from ...field import VoxelField
from ...measure import usable_cores
from .solid import HEAD, WORN, Solid, ear_light, scalp
from .wires import Wires

__all__ = ["Shell", "shell_of"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

OUTSIDE, INSIDE = 2.0, 4.0
"""Voxels before and behind the surface that are kept."""
COARSE = 4
"""Voxels to a step of the lattice that the surface is looked for on."""
CLOSE = 3.5
"""Voxels from the surface up to which distances are exact."""
STEEP = 4.0
"""Optical depth of a voxel one voxel below the surface; at most twice that."""
REACH = np.array([1.35, 1.45, 1.15])
"""Half edges of the box that may hold something, portrait units."""


class Shell:
    """Lattice points around a surface.

    Attributes
    ----------
    links : int32 [Z, Y, X], rows of the points.
    points : float64 [N, 3].
    away : float64 [N], signed distances, positive outside.
    owner : uint8 [N], what they belong to (`solid.HEAD`, `HAIR`, `BODY`, `WORN`).
    normals : float64 [N, 3], outward.
    scalp : bool [N], what belongs to the head and lies where hair grows.
    light : float64 [N], how much of it reaches them within ears.
    center, radius : Of the lattice's box.
    voxel : Distance of points.
    """

    def __init__(self, solid: Solid, voxel: float, wires: Wires | None = None) -> None:
        self.voxel = voxel
        distance = _Distance(solid, wires, voxel)
        step = COARSE * voxel
        half = np.ceil(REACH / step).astype(int)
        first, coarse = _coarse(distance, half, step)
        first, coarse = _cropped(first, coarse, step)
        self._fill(distance, *_finer(distance, first, coarse, step))
        self.scalp = self.owner == HEAD
        rest = solid.head.at_rest(self.on[self.scalp])
        self.light = np.ones(len(self.owner))
        self.light[self.scalp] = ear_light(solid.head.rest, rest)
        self.scalp[self.scalp] = scalp(rest)

    def _fill(self, distance: _Distance, first: Float64, middle: Float32) -> None:
        """The fine lattice over one [z, y, x] of twice its step whose first point is ``first``."""
        voxel = self.voxel
        rough = _doubled(middle)
        size = np.array(rough.shape)
        z, y, x = np.nonzero((rough > -(INSIDE + 2) * voxel) & (rough < (OUTSIDE + 2) * voxel))
        points = first + voxel * np.stack([x, y, z], axis=1)
        away = rough[z, y, x].astype(np.float64)
        # The surface itself exactly, what lies around it between the coarser lattice's points.
        close = np.abs(away) < CLOSE * voxel
        away[close], owner = distance(points[close], 2 * CLOSE * voxel)
        away[close] = np.clip(away[close], -2 * CLOSE * voxel, 2 * CLOSE * voxel)
        rough[z, y, x] = away
        # Where distances jump the shell is closed all the same.
        inside = rough < 0
        box = np.ones((3, 3, 3), bool)
        mask = ndimage.binary_dilation(inside, box) & ~ndimage.binary_erosion(inside, box, 2)
        mask |= (rough > -INSIDE * voxel) & (rough < OUTSIDE * voxel)
        exact = np.full(size, -1, np.int16)
        exact[z[close], y[close], x[close]] = owner
        z, y, x = np.nonzero(mask)
        self.links = np.full(size, -1, np.int32)
        self.links[z, y, x] = np.arange(len(z), dtype=np.int32)
        self.normals = _gradients(rough, z, y, x)
        self.points = first + voxel * np.stack([x, y, z], axis=1)
        self.away = np.clip(rough[z, y, x], -INSIDE * voxel, OUTSIDE * voxel).astype(np.float64)
        owners = exact[z, y, x]
        far = owners < 0
        if far.any():
            found = cKDTree(points[close]).query(self.points[far], workers=usable_cores())[1]
            owners[far] = owner[found]
        self.owner = owners.astype(np.uint8)
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


class _Distance:
    """Signed distances of points from a solid and what it wears, on a lattice."""

    def __init__(self, solid: Solid, wires: Wires | None, voxel: float) -> None:
        self.solid, self.wires, self.voxel = solid, wires, voxel

    def __call__(self, points: Float64, reach: float, near: NDArray[np.bool_] | None = None,
                 ) -> tuple[Float64, NDArray[np.uint8]]:
        """As `Solid.distance`."""
        out, owner = self.solid.distance(points, reach, near)
        if self.wires is not None:
            away = self.wires.distance(points, reach, self.voxel)
            owner[away < out] = WORN
            out = np.minimum(out, away)
        return out, owner


def _coarse(distance: _Distance, half: NDArray[np.int64], step: float) -> tuple[Float64, Float32]:
    """First point of a coarse lattice, and signed distances [z, y, x], clipped at three steps."""
    axes = [(np.arange(2 * count + 1) - count) * step for count in half]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).transpose(2, 1, 0, 3)
    shape = grid.shape[:3]
    near = np.zeros(shape, bool)
    cell = np.rint(distance.solid.head.points / step).astype(np.int64) + half
    cell = np.clip(cell, 0, 2 * half)
    near[cell[:, 2], cell[:, 1], cell[:, 0]] = True
    near = ndimage.binary_dilation(near, np.ones((3, 3, 3)), iterations=2)
    found, _ = distance(grid.reshape(-1, 3), 3 * step, near.ravel())
    out = np.clip(found, -3 * step, 3 * step).reshape(shape)
    # Deep within the head no sample is near: all that free space does not reach is inside.
    free, _ = ndimage.label(out > 0)
    out[(out > 0) & (free != free[0, -1, 0])] = -3 * step
    return np.array([axis[0] for axis in axes]), out.astype(np.float32)


def _cropped(first: Float64, distance: Float32, step: float) -> tuple[Float64, Float32]:
    """The part of a lattice that holds the surface."""
    box = np.argwhere(np.abs(distance) < 2 * step)
    low = np.maximum(box.min(axis=0) - 1, 0)
    high = np.minimum(box.max(axis=0) + 2, np.array(distance.shape))
    part = distance[tuple(slice(a, b) for a, b in zip(low, high, strict=True))]
    return first + step * low[::-1], np.ascontiguousarray(part)


def _finer(distance: _Distance, first: Float64, coarse: Float32, step: float,
           ) -> tuple[Float64, Float32]:
    """The same with half the step, exact near the surface."""
    out = _doubled(coarse)
    z, y, x = np.nonzero(np.abs(out) < 1.75 * step)
    points = first + 0.5 * step * np.stack([x, y, z], axis=1)
    found, _ = distance(points, 2 * step)
    old = out[z, y, x]
    out[z, y, x] = np.where(np.isfinite(found), np.clip(found, -3 * step, 3 * step), old)
    return first, out


def _doubled(coarse: Float32) -> Float32:
    """A lattice [z, y, x] with the points between its points."""
    out = coarse
    for axis in range(3):
        low, high = (np.take(out, np.arange(out.shape[axis] - 1) + k, axis) for k in (0, 1))
        shape = list(out.shape)
        shape[axis] = 2 * shape[axis] - 1
        wide = np.empty(shape, np.float32)
        even = [slice(None)] * 3
        even[axis] = slice(0, None, 2)
        wide[tuple(even)] = out
        even[axis] = slice(1, None, 2)
        wide[tuple(even)] = 0.5 * (low + high)
        out = wide
    return out


def _gradients(distance: Float32, z: NDArray[np.int64], y: NDArray[np.int64],
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


def shell_of(solid: Solid, points: int, wires: Wires | None = None) -> Shell:
    """The shell of a solid and what it wears on a lattice of ``points`` points to two units."""
    return Shell(solid, 2.0 / points, wires)
