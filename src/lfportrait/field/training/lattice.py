"""Lattices while they are trained: begun, refined, rid of what is not attached, averaged.

A lattice is a link table int32 [Z, Y, X] into rows; while training there is one more row, the last,
for empty points: zero density, zero color.

Steps follow the errors of a few thousand rays, so that densities and colors wander about what all
rays together ask for. Their mean over the last part of the training does not (Polyak and Juditsky
1992), and rates need not fall as low for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage

from ...arrays import Bool, Float32, Float64, Int32, box_about
from ..kernels import bricks
from ..kernels.march import lattice_of_world


def dilated(points: Bool, steps: int = 1) -> Bool:
    """Points, and all that are at most ``steps`` from one along each axis: bool [Z, Y, X].

    It is `scipy.ndimage.binary_dilation` by a cube, axis by axis.
    """
    out = np.zeros(points.shape, bool)
    box = box_about(points, steps)
    if box is None:
        return out
    grown = points[box].copy()
    for axis in range(3):
        before = [slice(None)] * 3
        behind = [slice(None)] * 3
        before[axis], behind[axis] = slice(None, -1), slice(1, None)
        for _ in range(steps):
            last = grown.copy()
            grown[tuple(behind)] |= last[tuple(before)]
            grown[tuple(before)] |= last[tuple(behind)]
    out[box] = grown
    return out


def labelled(points: Bool) -> tuple[Int32, int]:
    """Pieces of points that touch, also across corners: their numbers from 1, and how many.

    It is `scipy.ndimage.label` with a cube. int32 [Z, Y, X], 0 elsewhere.
    """
    out = np.zeros(points.shape, np.int32)
    box = box_about(points)
    if box is None:
        return out, 0
    out[box], count = ndimage.label(points[box], np.ones((3, 3, 3), bool))
    return out, int(count)


def box_shape(resolution: int, radius: Float64) -> tuple[int, int, int]:
    """Lattice points along z, y, x of a box: ``resolution`` to two world units."""
    x, y, z = (max(8, round(resolution * float(r))) for r in radius)
    return z, y, x


@dataclass
class Lattice:
    """Density and color rows on a sparse lattice in a box."""

    links: Int32  # int32 [Z, Y, X], row of each lattice point, -1 where it is empty.
    density: Float32  # float32 [N + 1], the last one zero.
    rows: Float32  # float32 [N + 1, width], color coefficients channel by channel, zero-padded.
    # center, radius: float64 [3] (x, y, z), the box.
    center: Float64
    radius: Float64

    @staticmethod
    def filled(points: Bool, density: float, width: int, center: Float64,
               radius: Float64) -> Lattice:
        """Grey matter of one density on the given points, bool [Z, Y, X]."""
        count = int(points.sum())
        links = np.full(points.shape, -1, np.int32)
        links[points] = np.arange(count, dtype=np.int32)
        values = np.full(count + 1, density, np.float32)
        values[-1] = 0.0
        # The box as the field's file keeps it, so that a field is the same once it was saved.
        box = [np.asarray(side, np.float32).astype(np.float64) for side in (center, radius)]
        return Lattice(links, values, np.zeros((count + 1, width), np.float32), *box)

    @property
    def count(self) -> int:
        """Number of rows N, the empty one not counted."""
        return len(self.density) - 1

    @property
    def voxel(self) -> float:
        """Distance between lattice points along x in world units."""
        return 2.0 * float(self.radius[0]) / self.links.shape[2]

    def geometry(self) -> tuple[Int32, Int32, Float64]:
        """What rays are cast through: brick table, brick links, size and place of the lattice.

        The last is float64 [9]: points along x, y, z; scale and offset of lattice coordinates.
        """
        table, links = bricks.brick_table(self.links, self.count)
        depth, height, width = self.links.shape
        scale, offset = lattice_of_world(self.center, self.radius, (depth, height, width))
        return table, links, np.concatenate([np.array([width, height, depth], float), scale,
                                             offset])

    def neighbours(self) -> Int32:
        """int32 [N, 6]: next along x, y, z, previous along x, y, z; the row itself without one."""
        found = np.empty((self.count, 6), np.int32)
        found[:] = np.arange(self.count, dtype=np.int32)[:, None]
        bricks.fill_neighbours(self.links, found)
        return found

    def attached(self, loose: Bool | None = None, among: Bool | None = None) -> Bool:
        """Lattice points within two steps of the large connected pieces of solid matter.

        Crumbs that float beside them come from slivers of the mattes. Solid is what takes a
        twentieth of the light along one voxel; a piece - across gaps of two points, because thin
        things are torn while they are learnt - is large if it has a five-thousandth of the largest
        one's points, and three at least. Of the points ``loose``, bool [Z, Y, X], only those that
        hang together with the largest piece without a gap count. ``among``, bool [Z, Y, X]: as if
        the lattice had only these points.
        """
        solid = self._points(self.density * self.voxel > 0.05)
        if among is not None:
            solid &= among
        if loose is not None and (solid & loose).any():
            pieces, _ = labelled(solid)
            solid &= ~loose | (pieces == np.bincount(pieces[solid]).argmax())
        pieces, count = labelled(dilated(solid))
        if count > 1:
            sizes = np.bincount(pieces[solid], minlength=count + 1)
            solid &= (sizes >= max(3, sizes.max() // 5000))[pieces]
        if not count:
            return self.links >= 0 if among is None else among & (self.links >= 0)
        return dilated(solid, 2)

    def seen(self, weights: Float32, least: float) -> Bool:
        """Points whose row has more than ``least`` of ``weights`` [N + 1], and their neighbours."""
        return dilated(self._points(weights > least)) & (self.links >= 0)

    def _points(self, rows: Bool) -> Bool:
        """The points of marked rows, bool [N + 1]: bool [Z, Y, X]."""
        points = np.empty(self.links.shape, bool)
        bricks.mark_points(self.links, rows, points)
        return points

    def kept(self, keep: Bool) -> Lattice:
        """The same lattice with only the points in ``keep``, bool [Z, Y, X]."""
        keep = keep & (self.links >= 0)
        stays = np.zeros(len(self.density), bool)
        stays[self.links[keep]] = True
        order = np.flatnonzero(stays)
        # Empty points, -1, find the last place, which is that of the empty row.
        place = np.full(len(self.density), -1, np.int32)
        place[order] = np.arange(len(order), dtype=np.int32)
        rows = np.append(order, self.count)
        return Lattice(place[self.links], self.density[rows], self.rows[rows], self.center,
                       self.radius)

    def cropped(self, keep: Bool) -> tuple[Lattice, Bool]:
        """The same lattice in a box about the points in ``keep``, and ``keep`` in that box.

        Rows of points outside stay, without a link.
        """
        part = box_about(keep, 2)
        if part is None:
            return self, keep
        low, end = np.array([(side.start, side.stop) for side in part[::-1]], float).T
        spacing = 2.0 * self.radius / self.links.shape[::-1]
        radius = 0.5 * spacing * (end - low)
        center = self.center - self.radius + spacing * low + radius
        box = [side.astype(np.float32).astype(np.float64) for side in (center, radius)]
        links = np.ascontiguousarray(self.links[part])
        return Lattice(links, self.density, self.rows, *box), keep[part]

    def refined(self, shape: tuple[int, int, int], keep: Bool) -> Lattice:
        """Trilinear interpolation on a lattice of ``shape`` points, where ``keep`` holds here."""
        # Coarse cell and place inside it of each fine plane, per axis (z, y, x).
        low, part = [], []
        for new, old in zip(shape, self.links.shape):
            place = (np.arange(new) + 0.5) / new * old - 0.5
            low.append(np.clip(np.floor(place).astype(int), 0, old - 2))
            part.append(np.clip(place - low[-1], 0.0, 1.0).astype(np.float32))
        longest = max(shape)
        links, density, rows = bricks.refine_rows(
            self.links, self.density, self.rows, np.ascontiguousarray(keep),
            np.stack([np.resize(plane, longest) for plane in low]),
            np.stack([np.resize(plane, longest) for plane in part]), shape)
        return Lattice(links, density, rows, self.center, self.radius)


STATES = 50  # States that a whole level would give; neighbouring ones differ little.


class Average:
    """Sums of densities and colors.

    Parameters
    ----------
    lattice : Whose states are added.
    columns : Values of a row that are colors, from the first on; the others are left alone.

    Attributes
    ----------
    density, rows : float32 [N + 1] and [N + 1, columns], sums of the states.
    count : Number of states.
    """

    def __init__(self, lattice: Lattice, columns: int) -> None:
        self.density = np.zeros_like(lattice.density)
        self.rows = np.zeros((len(lattice.rows), columns), np.float32)
        self.count = 0

    @staticmethod
    def due(before: float, done: float, share: float) -> bool:
        """Whether a state is added between two moments, in shares of a level that are done.

        ``share`` is the last part of the level that counts.
        """
        return done > 1.0 - share and int(STATES * done) > int(STATES * before)

    def add(self, lattice: Lattice) -> None:
        """Add a state."""
        self.density += lattice.density
        bricks.add_rows(self.rows, lattice.rows)
        self.count += 1

    def put(self, lattice: Lattice) -> None:
        """Give the lattice the mean of its states; nothing changes if none was added."""
        if self.count:
            np.divide(self.density, self.count, out=lattice.density)
            bricks.put_means(self.rows, self.rows.shape[1], np.float32(self.count), lattice.rows, 0)

    @property
    def state(self) -> dict[str, Any]:
        """For a checkpoint."""
        return {"average_density": self.density, "average_rows": self.rows,
                "average_count": np.array(self.count)}

    @staticmethod
    def restored(state: dict[str, Any], lattice: Lattice) -> Average | None:
        """From a checkpoint, None where it has none.

        Raises `ValueError` if it belongs to another lattice.
        """
        if "average_count" not in state:
            return None
        found = Average(lattice, state["average_rows"].shape[1])
        if (found.rows.shape != state["average_rows"].shape
                or found.density.shape != state["average_density"].shape):
            raise ValueError("averages of another lattice")
        found.density, found.rows = state["average_density"], state["average_rows"]
        found.count = int(state["average_count"])
        return found
