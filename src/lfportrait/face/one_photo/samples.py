"""A mesh as dense samples: signed distances from it, and its depth maps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from ...arrays import Bool, Float64
from ...measure import usable_cores
from ..head_prior import with_normals
from .parts import Parts

STEP = 0.010  # Distance of samples, portrait units (2 mm).

OBLIQUE, AROUND = 0.7, 24
"""Cosine up to which the nearest sample does not say on which side a place lies; how many do then.
"""
NEAR, OPPOSITE = 17, 0.0
"""How many samples around one are compared with it, itself among them, and the mean cosine of their
normals below which it is turned over. On both sides of a thin sheet that is about zero."""
BLOCK = 3  # Width of a cell, in steps, around which all of a sample's neighbours lie.


@dataclass(frozen=True)
class MeshSamples:
    """Samples of a closed surface."""

    # points, normals: float64 [N, 3], portrait frame.
    points: Float64
    normals: Float64
    tree: cKDTree  # Of the points.
    rest: Float64  # float64 [N, 3], where the samples lie on the model's mean (`HeadPrior.rest`).

    @staticmethod
    def of(points: Float64, triangles: NDArray[np.int32], rest: Float64) -> MeshSamples:
        """Samples of a mesh, closely enough that none of its triangles is left out."""
        normals = with_normals(points, triangles)
        corners = points[triangles]
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        steps = np.clip(np.ceil(sides / STEP), 1, 12).astype(int)
        places: list[Float64] = []
        directions: list[Float64] = []
        found: list[Float64] = []
        for count in np.unique(steps):
            weights = _barycentric(int(count))
            chosen = triangles[steps == count]
            for values, out in ((points, places), (normals, directions), (rest, found)):
                out.append(np.einsum("sk,tki->tsi", weights, values[chosen]).reshape(-1, 3))
        normal = np.concatenate(directions)
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]
        at, there = np.concatenate(places), np.concatenate(found)
        tree = _tree(at)
        good = ~_turned_over(normal, at, tree)
        if good.all():
            return MeshSamples(at, normal, tree, there)
        return MeshSamples(at[good], normal[good], _tree(at[good]), there[good])

    def distance(self, points: Float64, reach: float) -> Float64:
        """Signed distances [N] of points [N, 3], positive outside; ``reach`` or more: far outside.

        Near the surface the distance from the nearest sample's plane, which is smooth.
        """
        return self.nearest(points, reach)[0]

    def nearest(self, points: Float64, reach: float) -> tuple[Float64, NDArray[np.int64]]:
        """The same, and rows of the samples nearest to the points, [N]; one too many if far."""
        out = np.full(len(points), np.inf)
        length, nearest = self.tree.query(points, distance_upper_bound=reach,
                                          workers=usable_cores())
        near = np.flatnonzero(np.isfinite(length))
        to = points[near] - self.points[nearest[near]]
        along = (to * self.normals[nearest[near]]).sum(axis=1)
        away = np.where(self._within(points[near], along, length[near]), -1, 1) * length[near]
        share = np.clip((length[near] / STEP - 1.0) / 2.0, 0, 1)
        out[near] = share * away + (1 - share) * along
        return out, nearest

    def _within(self, points: Float64, along: Float64, length: Float64) -> Bool:
        """Which points lie inside, [N]; ``along`` is by the nearest sample alone.

        Beside the edge of a thin ear that one looks elsewhere: there all those around decide, each
        by the angle that it fills (as a winding number).
        """
        inside = along < 0
        unsure = np.flatnonzero((np.abs(along) < OBLIQUE * length) & (length > 0.5 * STEP))
        if len(unsure):
            far, which = self.tree.query(points[unsure], min(AROUND, len(self.points)),
                                         workers=usable_cores())
            to = points[unsure, None] - self.points[which]
            angle = (to * self.normals[which]).sum(axis=2) / np.maximum(far, 1e-9) ** 3
            inside[unsure] = angle.sum(axis=1) < 0
        return inside

    def at_rest(self, points: Float64) -> Float64:
        """Where the samples nearest to points [N, 3] lie on the model's mean, [N, 3]."""
        return self.rest[self.tree.query(points, workers=usable_cores())[1]]


def _tree(points: Float64) -> cKDTree:
    # Balanced, it takes four times as long to be asked.
    return cKDTree(points, 32, compact_nodes=False, balanced_tree=False)


def _turned_over(normals: Float64, points: Float64, tree: cKDTree) -> Bool:
    """Which samples [N] face away from those around them, as in a fold of an ear's rim.

    Their inner side would be a thread of matter that leads out of the ear.
    """
    turned = np.zeros(len(points), bool)
    unsure = np.flatnonzero(~_among_like(normals, points))
    if len(unsure):
        around = tree.query(points[unsure], min(NEAR, len(points)), workers=usable_cores())[1]
        mean = np.zeros((len(unsure), 3))
        for which in around[:, 1:].T:
            mean += normals[which] / (around.shape[1] - 1)
        turned[unsure] = (mean * normals[unsure]).sum(axis=1) < OPPOSITE
    return turned


def _among_like(normals: Float64, points: Float64) -> Bool:
    """Samples [N] none of whose neighbours' normals can be opposite to theirs: almost all.

    In blocks of cells, by the least and largest of each component: a fraction of the time that it
    takes to look for neighbours.
    """
    place = np.floor(points / (BLOCK * STEP)).astype(np.int64)
    place -= place.min(axis=0) - 1
    strides = np.array([1, place[:, 0].max() + 2, 0])
    strides[2] = strides[1] * (place[:, 1].max() + 2)
    keys = place @ strides
    order = np.argsort(keys, kind="stable")
    cells, first = np.unique(keys[order], return_index=True)
    low = np.minimum.reduceat(normals[order], first, axis=0)
    high = np.maximum.reduceat(normals[order], first, axis=0)
    least, most = low.copy(), high.copy()
    for offset in np.ndindex(3, 3, 3):
        other = cells + (np.array(offset) - 1) @ strides
        row = np.minimum(np.searchsorted(cells, other), len(cells) - 1)
        there = cells[row] == other
        least[there] = np.minimum(least, low[row])[there]
        most[there] = np.maximum(most, high[row])[there]
    cell = np.searchsorted(cells, keys)
    worst = np.minimum(normals * least[cell], normals * most[cell]).sum(axis=1)
    return np.asarray(worst >= OPPOSITE)


def _barycentric(count: int) -> Float64:
    """Weights [S, 3] of places in a triangle whose sides have ``count`` steps."""
    i, j = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    low = i + j < count
    i, j = i[low], j[low]
    upper = np.stack([(i + 1 / 3) / count, (j + 1 / 3) / count], axis=1)
    inner = i + j < count - 1
    lower = np.stack([(i[inner] + 2 / 3) / count, (j[inner] + 2 / 3) / count], axis=1)
    flat = np.concatenate([upper, lower])
    return np.column_stack([1 - flat.sum(axis=1), flat])


def depth_maps(samples: MeshSamples, parts: Parts, chosen: Bool | None = None,
               ) -> tuple[Float64, Float64]:
    """Nearest and farthest depth [h, w] of samples in each cell of a grid; NaN where none is."""
    points = samples.points if chosen is None else samples.points[chosen]
    places, depth = parts.places(points)
    height, width = parts.inside.shape
    row, column = np.rint(places).astype(np.int64)
    within = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    index, depth = (row * width + column)[within], depth[within]
    near, far = np.full(height * width, np.inf), np.full(height * width, -np.inf)
    np.minimum.at(near, index, depth)
    np.maximum.at(far, index, depth)
    near, far = near.reshape(height, width), far.reshape(height, width)
    # Single cells between samples.
    filled = ndimage.binary_closing(np.isfinite(near), np.ones((3, 3)))
    gaps = filled & ~np.isfinite(near)
    near[gaps] = ndimage.minimum_filter(near, 3)[gaps]
    far[gaps] = ndimage.maximum_filter(far, 3)[gaps]
    seen = np.isfinite(near) & np.isfinite(far)
    return np.where(seen, near, np.nan), np.where(seen, far, np.nan)
