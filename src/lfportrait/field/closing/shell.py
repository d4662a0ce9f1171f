"""The new surface as lattice points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from ...arrays import Bool, Float32, Float64, Int64
from ...simd.threads import side_by_side
from ..geometry.chart import Chart, at_places, nearest_cells, normals_of, smoothed
from ..grid import Cut, VoxelField
from ..kernels.march import C0
from ..training.lattice import dilated
from .fitted_head import Ears
from .photos import Photos

SHELL = 5.0  # Voxels of the shell's thickness.
FRINGE = -2.0
"""Voxels outside of a guessed surface from which on what photos see along it is its fringe."""
FRONT = np.radians(60.0)
"""Angle from the front up to which what photos see at grazing angles keeps its colors."""
WELL, FAIRLY = 0.25, 0.2
"""Cosines to a surface from which on photos show where it lies, and which colors it has."""
OUTWARDS = 2.0  # Voxels before the surface up to which lattice points are added.
_AROUND_EARS = 15
"""Cells a side around those of an ear's points in which lattice points may belong to it."""
_PART = 1 << 17  # Lattice points that are looked up at a time.
FACED, SURELY = 0.5, 4
"""What stands out from a guessed surface stays where at least so many photos see a surface that
faces them at such a cosine: an ear, but no fringe."""
PAST = 0.2
"""Share of the photos that must see past a place for a fitted ear not to reach there: mattes of
single photos lack parts of ears."""
STEEP = 4.0  # Optical depth of a voxel one voxel below the new surface; at most twice that.


@dataclass(frozen=True)
class Shell:
    """The surface that is new.

    Attributes
    ----------
    chart, distance : Of the whole surface, float64 [V, U], world units.
    cosine : float64 [V, U], between the chart's rays and the surface's normals.
    colors : float64 [V, U, 3] in [0, 1].
    gap : bool [V, U], where it is new.
    voxel : Of the field, world units.
    guessed : Whether what was trained beside the new surface is a guess, and goes unless several
        photos see it well; else it stays where any photo sees it.
    """

    chart: Chart
    distance: Float64
    cosine: Float64
    colors: Float64
    gap: Bool
    voxel: float
    guessed: bool = False
    ears: Ears | None = None
    yields: Float64 | None = None
    fringe: float = FRINGE

    def depth(self, points: Float64) -> tuple[Float64, Float64]:
        """How deep points [N, 3] lie within, in voxels (-inf beside the gap), and places [2, N]."""
        places, away = self.chart.places(points)
        row, column = np.rint(places).astype(np.int64)
        rows, columns = self.gap.shape
        inside = (row >= 0) & (row < rows)
        inside &= self.gap[np.clip(row, 0, rows - 1), column % columns]
        deep = np.full(len(points), -np.inf)
        deep[inside] = ((at_places(self.distance, places[:, inside]) - away[inside])
                        * at_places(self.cosine, places[:, inside]) / self.voxel)
        if self.ears is not None:
            ear = -self.ears.distance(points)[0] / self.voxel
            deep = np.where(ear > -OUTWARDS, np.maximum(deep, ear), deep)
        return deep, places

    def yielding(self, deep: Float64, places: Float64) -> Bool:
        """Which points, so deep and at places [2, N], go whatever photos see there, [N]."""
        if self.yields is None:
            return np.zeros(len(deep), bool)
        return np.asarray(deep < nearest_cells(self.yields, places))

    def by_ears(self, points: Float64, voxels: float = np.inf) -> Bool:
        """Which of points [N, 3] lie less far outside ears, by default as far as is known, [N]."""
        if self.ears is None:
            return np.zeros(len(points), bool)
        return np.asarray(self.ears.distance(points)[0] < voxels * self.voxel)

    def cells(self, field: VoxelField, outwards: float) -> Int64:
        """Empty lattice points (x, y, z) that may be part of it, int64 [N, 3].

        They lie up to ``outwards`` voxels before the surface.
        """
        around = {"size": 3, "mode": ("nearest", "wrap")}
        voxels = self.voxel / ndimage.minimum_filter(self.cosine, **around)
        low = np.where(self.gap, ndimage.minimum_filter(self.distance, **around)
                       - (SHELL + 0.1) * voxels, np.inf)
        high = np.where(self.gap, ndimage.maximum_filter(self.distance, **around)
                        + (outwards + 0.1) * voxels, -np.inf)
        inwards = (SHELL / self.cosine + 1) * self.voxel
        corners = [self.chart.points(self.distance + by)[self.gap]
                   for by in (3 * self.voxel, -inwards)]
        if self.ears is not None:
            ears = self.ears.points[self.ears.own]
            places, away = self.chart.places(ears)
            rows, columns = low.shape
            row, column = np.rint(places).astype(np.int64)
            at = np.clip(row, 0, rows - 1), column % columns
            near, far = np.full(low.shape, np.inf), np.full(low.shape, -np.inf)
            reach = (SHELL + outwards) * self.voxel
            np.minimum.at(near, at, away - reach)
            np.maximum.at(far, at, away + reach)
            # Cells are two voxels wide at the surface, and less further in.
            around["size"] = _AROUND_EARS
            low = np.minimum(low, ndimage.minimum_filter(near, **around))
            high = np.maximum(high, ndimage.maximum_filter(far, **around))
            corners.append(ears)
        return self.chart.cells_between(field, low, high, np.concatenate(corners))

    def coefficients(self, points: Float64, places: Float64, basis: int) -> Float32:
        """Coefficients of the colors at points [N, 3], places [2, N]: the same from all sides.

        Float32 [N, 3, B].
        """
        colors = np.stack([at_places(self.colors[..., k], places) for k in range(3)], axis=-1)
        if self.ears is not None and self.ears.colors is not None:
            # Behind an ear lies hair, whose colors a chart has there.
            away, sample = self.ears.distance(points)
            near = np.abs(away) < SHELL * self.voxel
            colors[near] = self.ears.colors[sample[near]]
        sh = np.zeros((len(points), 3, basis), np.float32)
        sh[:, :, 0] = (colors - 0.5) / C0
        return sh

    def turn(self, places: Float64) -> Float64:
        """Angles [N] of places [2, N] from the front, in [0, pi]."""
        columns = np.rint(places[1]).astype(np.int64) % len(self.chart.angle)
        return np.abs(np.asarray(self.chart.angle[columns], np.float64))

    def normals(self, points: Float64, places: Float64) -> Float64:
        """Outward normals [N, 3] of the surface at points [N, 3], which are at places [2, N]."""
        normal = normals_of(self.chart, smoothed(self.distance, np.ones_like(self.gap), 1.0))
        found = np.stack([at_places(normal[..., k], places) for k in range(3)], axis=-1)
        if self.ears is not None:
            away, sample = self.ears.distance(points)
            near = away < OUTWARDS * self.voxel
            found[near] = self.ears.normals[sample[near]]
        return found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9)


def _density(deep: Float64, voxel: float) -> Float32:
    """Densities that fall through zero at the surface."""
    return np.asarray(np.clip(STEEP * deep, -STEEP, 2.0 * STEEP) / voxel, np.float32)


def with_shell(field: VoxelField, shell: Shell, photos: Photos, cut: Cut | None,
               ) -> tuple[VoxelField, int]:
    """The field with the shell; what lies outside of it goes. Also the number of new points."""
    chart, voxel = shell.chart, shell.voxel
    corners = chart.points(shell.distance + 3 * voxel)[shell.gap]
    if shell.ears is not None:
        margin = OUTWARDS * voxel * np.array([[-1.0], [1.0]])[..., None]
        corners = np.concatenate([corners, *(shell.ears.points[shell.ears.own] + margin)])
    field = _widened(field, corners.min(axis=0), corners.max(axis=0))
    density, sh = _changed(field, shell, photos)
    cells, deep, places = _new_cells(field, shell, cut)
    points = _points(field, cells)
    kept = ~photos.past(points, nearly=not shell.guessed) | (deep < 0)
    kept |= shell.by_ears(points, 0.5) & ~_past_ears(points, shell, photos)
    # Points beside those that stay are empty, but have colors: between a point and none at all a
    # ray would see gray.
    beside = ~kept & _beside(field.links.shape, cells, kept)
    fresh = np.where(beside, np.float32(0), _density(deep, voxel))[kept | beside]
    cells, places, points = (cells[kept | beside], places[:, kept | beside],
                             points[kept | beside])
    links = field.links.copy()
    links[tuple(cells.T[::-1])] = np.arange(len(cells), dtype=np.int32) + len(density)
    return VoxelField(links, np.concatenate([density, fresh]),
                      np.concatenate([sh, shell.coefficients(points, places, field.basis)]),
                      field.center,
                      field.radius, field.frame, field.background), len(cells)


def _beside(shape: tuple[int, ...], cells: Int64, chosen: Bool) -> Bool:
    """Which cells (x, y, z) [N, 3] have one of the chosen ones among their 26 neighbours, [N]."""
    grid = np.zeros(shape, np.bool_)
    grid[tuple(cells[chosen].T[::-1])] = True
    return np.asarray(dilated(grid)[tuple(cells.T[::-1])], np.bool_)


def _past_ears(points: Float64, shell: Shell, photos: Photos) -> Bool:
    """Which of points [N, 3] by ears many photos see past, as behind a free lobe, bool [N].

    What is torn they see past as well: that says nothing.
    """
    found = shell.by_ears(points)
    if shell.ears is not None and found.any():
        there = points[found]
        found[found] = (photos.past(there, nearly=False, share=PAST)
                        & ~shell.ears.replaced(there))
    return found


def _changed(field: VoxelField, shell: Shell, photos: Photos) -> tuple[Float32, Float32]:
    """Densities and coefficients of the rows there are: what photos saw of the surface stays."""
    density, sh = field.density.copy(), field.sh.copy()
    points = field.lattice_points()
    deep, places = shell.depth(points)
    near = (deep > -np.inf) & (deep < SHELL)
    seen, fresh = photos.seen(points[near]), _density(deep[near], shell.voxel)
    dim = np.flatnonzero(near)[seen < 2]
    sh[dim] = shell.coefficients(points[dim], places[:, dim], field.basis)
    if shell.guessed:
        outwards = shell.normals(points[near], places[:, near])
        well = photos.seen(points[near], outwards, WELL) >= photos.enough
        well |= photos.faced(points[near], FACED) >= SURELY
        torn = np.False_ if shell.ears is None else shell.ears.replaced(points[near])
        fresh[_past_ears(points[near], shell, photos)] = -STEEP / shell.voxel
        well &= ~(shell.yielding(deep[near], places[:, near]) | torn)
        # What they see of a true ear is better than a fitted one, however they look at it.
        ear = (seen > 0) & shell.by_ears(points[near]) & ~torn
        hardly = (seen > 0) & (deep[near] > shell.fringe) & ~torn | ear
        # What photos look along they see as solid however thin it is: from aside it is haze.
        density[near] = np.where(well | ear, density[near], np.where(
            hardly, np.maximum(density[near], fresh), fresh))
        # What photos look along they locate, but what they say of its colors is gray: these come
        # from around. A chin, from below, has no other ones than those.
        colored = well | hardly
        asked = hardly & ~well & (shell.turn(places[:, near]) >= FRONT)
        colored[asked] = photos.seen(points[near][asked], outwards[asked],
                                     FAIRLY) >= photos.enough
        near[near] = ~colored
        sh[near] = shell.coefficients(points[near], places[:, near], field.basis)
        return density, sh
    # Outlines, each of which a single photo sees, stay where they are on the surface.
    new = ((seen == 0) & (~photos.past(points[near]) | (deep[near] < 0))
           | (seen < 2) & (deep[near] < -1.5))
    near[near], fresh = new, fresh[new]
    density[near] = np.where(fresh > 0, np.maximum(density[near], fresh), fresh)
    return density, sh


def _new_cells(field: VoxelField, shell: Shell, cut: Cut | None) -> tuple[Int64, Float64, Float64]:
    """Lattice cells (x, y, z) [N, 3] that the shell needs, how deep they lie, places [2, N]."""
    def part(cells: Int64) -> tuple[Int64, Float64, Float64]:
        points = _points(field, cells)
        deep, places = shell.depth(points)
        new = (deep > -OUTWARDS) & (deep < SHELL)
        if cut is not None:
            new &= cut.above(points) > -2 * shell.voxel
        return cells[new], deep[new], places[:, new]

    cells = shell.cells(field, OUTWARDS)
    # Part by part: there may be millions.
    found = side_by_side(part, np.array_split(cells, 1 + len(cells) // _PART))
    return (np.concatenate([part[0] for part in found]),
            np.concatenate([part[1] for part in found]),
            np.concatenate([part[2] for part in found], axis=1))


def _points(field: VoxelField, cells: Int64) -> Float64:
    """World positions of lattice cells (x, y, z) [N, 3]."""
    return np.asarray(field.bounds[0] + field.spacing * (cells + 0.5), np.float64)


def _widened(field: VoxelField, low: Float64, high: Float64) -> VoxelField:
    """The same field in a box that holds the corners ``low`` and ``high`` as well."""
    spacing = field.spacing
    before = np.maximum(np.ceil((field.bounds[0] - low) / spacing), 0).astype(int)
    after = np.maximum(np.ceil((high - field.bounds[1]) / spacing), 0).astype(int)
    if not (before.any() or after.any()):
        return field
    links = np.pad(field.links, list(zip(before[::-1], after[::-1])), constant_values=-1)
    return replace(field, links=links, center=field.center + 0.5 * (after - before) * spacing,
                   radius=field.radius + 0.5 * (after + before) * spacing)
