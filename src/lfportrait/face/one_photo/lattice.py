"""A solid as a voxel field: lattice points in a shell around its surface."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ...arrays import Bool, Float32, Float64
from ...field import VoxelField
from ...measure import usable_cores
from .beard import BEARD
from .collar import HIGHER, Collar
from .solid import BODY, HAIR, HEAD, WORN, Solid, above_jaw, ear_light, scalp
from .wires import Wires

Places = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]

OUTSIDE, INSIDE = 2.0, 4.0  # Voxels before and behind the surface that are kept.
DEEP = 2  # Points of the coarser lattices from free space, beyond which nothing is kept.
COARSE = 4  # Voxels to a step of the lattice that the surface is looked for on.
CLOSE = 3.5  # Voxels from the surface up to which distances are exact.
DETAIL = 0.0045
"""Voxels from which on points between exact ones are looked at exactly, too, portrait units: what
the solid is made of (`samples.STEP`, `parts.CELL`) has no detail between finer ones; what it wears
has."""
CRUMB = 0.01  # What is apart from all else and smaller than this part of it is no person.
APART = 4  # Points of that lattice between the two, at least.
BLADE = 0.03  # What of a body is thinner than twice this beside a neck is none, portrait units.
STEEP = 4.0  # Optical depth of a voxel one voxel below the surface; at most twice that.
CHIN = 0.01  # Height above the model's chin (metres) below which there is throat and neck.
UNDERSIDE = 0.008  # How far below the jaw's edge a face goes on, metres.
_MANY, _THREADS = 50_000, 4
"""Points from which on it pays to ask for them on another core, and how many cores are asked at
most: each goes through the maps of all pieces."""
REACH = np.array([1.35, 1.45, 1.15])
"""Half edges of the box that may hold something, portrait units."""


class Shell:
    """Lattice points around a surface.

    Attributes
    ----------
    links : int32 [Z, Y, X], rows of the points.
    points : float64 [N, 3].
    away : float64 [N], signed distances, positive outside.
    owner : uint8 [N], what they belong to (`solid.HEAD`, `HAIR`, `BODY`, `WORN`,
        `beard.BEARD`).
    normals : float64 [N, 3], outward.
    scalp : bool [N], what belongs to the head and lies where hair grows.
    face : bool [N], what belongs to the head and lies above the chin.
    whole_face : bool [N], what belongs to the head and lies above the jaw's edge.
    light : float64 [N], how much of it reaches them within ears.
    collar : Where the neck ends.
    center, radius : Of the lattice's box.
    voxel : Distance of points.
    """

    def __init__(self, solid: Solid, voxel: float, wires: Wires | None = None) -> None:
        self.voxel = voxel
        self.collar = Collar.of(solid.head, solid.neck[:3])
        distance = _Distance(solid, wires, voxel)
        step = COARSE * voxel
        half = np.ceil(REACH / step).astype(int)
        first, coarse = _coarse(distance, half, step)
        first, coarse = _cropped(first, _closed(coarse)[0], step)
        middle, owner = _finer(distance, first, coarse, step)
        middle = _without_blades(middle, owner == BODY, self.collar, first, 0.5 * step)
        middle = _without_crumbs(middle, owner == WORN, owner == HEAD, 1.5 * step)
        self._fill(distance, first, *_closed(middle), owner)
        self.scalp = self.owner == HEAD
        rest = solid.head.at_rest(self.on[self.scalp])
        self.light = np.ones(len(self.owner))
        self.light[self.scalp] = ear_light(solid.head.rest, rest)
        self.face = self.scalp.copy()
        self.whole_face = self.face.copy()
        self.face[self.face] = rest[:, 1] > CHIN
        self.whole_face[self.whole_face] = above_jaw(rest, UNDERSIDE)
        self.scalp[self.scalp] = scalp(rest)

    def _fill(self, distance: _Distance, first: Float64, middle: Float32, near: Bool,
              owner: NDArray[np.int8]) -> None:
        """The fine lattice over one [z, y, x] of twice its step whose first point is ``first``.

        ``near`` is where free space is not far, ``owner`` what its points belong to, or -1.
        """
        voxel = self.voxel
        rough = _doubled(middle)
        size, exact = np.array(rough.shape), np.full(rough.shape, -1, np.int8)
        if voxel > DETAIL:
            # The surface itself exactly, what lies around it between the coarser lattice's points.
            at = np.nonzero((rough > -CLOSE * voxel) & (rough < CLOSE * voxel))
            away, of = distance(_places(first, voxel, at), 2 * CLOSE * voxel)
            hidden = ~near[tuple(one // 2 for one in at)]
            away[hidden] = np.minimum(away[hidden], -INSIDE * voxel)
            rough[at] = np.clip(away, -2 * CLOSE * voxel, 2 * CLOSE * voxel)
            exact[at] = of
        elif distance.wires is not None:
            at, away = _beside(distance.wires, rough, first, voxel)
            nearer = away < rough[at]
            at = tuple(one[nearer] for one in at)
            rough[at], exact[at] = away[nearer], WORN
        # Where distances jump the shell is closed all the same.
        inside = rough < 0
        mask = _grown(inside, 1)
        mask &= _grown(~inside, 2, True)
        mask |= (rough > -INSIDE * voxel) & (rough < OUTSIDE * voxel)
        at = np.nonzero(mask)
        self.links = np.full(size, -1, np.int32)
        self.links[at] = np.arange(len(at[0]), dtype=np.int32)
        self.normals = _gradients(rough, *at)
        self.points = _places(first, voxel, at)
        self.away = np.clip(rough[at], -INSIDE * voxel, OUTSIDE * voxel).astype(np.float64)
        owners = owner[tuple(one // 2 for one in at)]
        owners = np.where(exact[at] < 0, owners, exact[at])
        far = owners < 0
        if far.any():
            known = np.nonzero(owner >= 0)
            tree = cKDTree(_places(first, 2 * voxel, known))
            owners[far] = owner[known][tree.query(self.points[far], workers=usable_cores())[1]]
        self.owner = owners.astype(np.uint8)
        # Finer than the coarser lattice there may be crumbs again, of all but thin rims of ears.
        apart = _apart(self.links, self.away < 0) & np.isin(self.owner, (HAIR, BODY, BEARD))
        self.away[apart] = OUTSIDE * voxel
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

    def __call__(self, points: Float64, reach: float, near: Bool | None = None,
                 ) -> tuple[Float64, NDArray[np.uint8]]:
        """As `Solid.distance`, on all cores."""
        cores = max(1, min(_THREADS, usable_cores(), len(points) // _MANY))
        bounds = [len(points) * n // cores for n in range(cores + 1)]
        with ThreadPoolExecutor(cores) as pool:
            found = list(pool.map(lambda since, until: self.solid.distance(
                points[since:until], reach, None if near is None else near[since:until]),
                bounds[:-1], bounds[1:]))
        out, owner = (np.concatenate(part) for part in zip(*found, strict=True))
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
    return np.array([axis[0] for axis in axes]), out.astype(np.float32)


def _cropped(first: Float64, distance: Float32, step: float) -> tuple[Float64, Float32]:
    """The part of a lattice that holds the surface."""
    box = np.argwhere(np.abs(distance) < 2 * step)
    low = np.maximum(box.min(axis=0) - 1, 0)
    high = np.minimum(box.max(axis=0) + 2, np.array(distance.shape))
    part = distance[tuple(slice(a, b) for a, b in zip(low, high, strict=True))]
    return first + step * low[::-1], np.ascontiguousarray(part)


def _finer(distance: _Distance, first: Float64, coarse: Float32, step: float,
           ) -> tuple[Float32, NDArray[np.int8]]:
    """The same with half the step, exact near the surface, and what its points belong to, or -1."""
    out = _doubled(coarse)
    at = np.nonzero(np.abs(out) < 1.75 * step)
    found, of = distance(_places(first, 0.5 * step, at), 2 * step)
    out[at] = np.where(np.isfinite(found), np.clip(found, -3 * step, 3 * step), out[at])
    owner = np.full(out.shape, -1, np.int8)
    owner[at] = of
    return out, owner


def _without_crumbs(distance: Float32, worn: Bool, head: Bool, away: float) -> Float32:
    """Distances [z, y, x] of the person alone: what is small and apart lies ``away`` outside.

    Shreds of a matte, and of a neck beside a collar, float otherwise. What is ``worn`` stays, and
    so does what is thin of a ``head``, as an ear's rim, of which a coarse lattice shows pieces.
    """
    pieces, count = ndimage.label(distance < 0)
    if count < 2:
        return distance
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    small = sizes < CRUMB * sizes.max()
    small[np.unique(pieces[worn])] = False
    small[np.unique(pieces[head & _grown(~small[pieces] & (pieces > 0), APART)])] = False
    crumbs = _grown(small[pieces] & (pieces > 0), 2)
    return np.where(crumbs, np.float32(away), distance)


def _apart(links: NDArray[np.int32], inside: Bool) -> Bool:
    """Which rows [N] of a lattice [z, y, x] lie ``inside``, in small pieces apart from the rest."""
    one, two = [], []
    for axis in range(3):
        along = np.moveaxis(links, axis, 0)
        both = (along[1:] >= 0) & (along[:-1] >= 0)
        rows = along[1:][both], along[:-1][both]
        both = inside[rows[0]] & inside[rows[1]]
        one.append(rows[0][both])
        two.append(rows[1][both])
    ends = np.concatenate(one), np.concatenate(two)
    count = len(inside)
    pieces = connected_components(sparse.coo_array((np.ones(len(ends[0]), np.int8), ends),
                                                   shape=(count, count)), directed=False)[1]
    sizes = np.bincount(pieces[inside], minlength=count)[pieces]
    return np.asarray(inside & (sizes < CRUMB * sizes.max(initial=0)))


def _without_blades(distance: Float32, body: Bool, collar: Collar, first: Float64, step: float,
                    ) -> Float32:
    """Distances [z, y, x] without what is thin of a body around its neck.

    Where a photo shows a collar beside a jaw, the neck cuts most of it away: a blade is left.
    """
    height = first[1] + step * np.arange(distance.shape[1]) - collar.middle[1]
    rows = np.flatnonzero(np.abs(height) < 2 * HIGHER)
    if not len(rows):
        return distance
    part = np.s_[:, rows[0]:rows[-1] + 1]
    solid, reach = distance[part] < 0, max(1, round(BLADE / step))
    # Opened with a cube: what is left of the person is thick.
    thick = _grown(~_grown(~solid, reach), reach)
    pieces = ndimage.label(solid & body[part] & ~thick)[0]
    # The thin edge of a shoulder stays; a blade stands out farther.
    out = np.unique(pieces[~_grown(thick, 2 * reach)])
    thin = np.isin(pieces, out[out > 0])
    at = np.nonzero(thin)
    thin[at] = collar.holds(_places(first + step * np.array([0, rows[0], 0]), step, at))
    if not thin.any():
        return distance
    other = solid & ~_grown(thin, 1)
    found = distance.copy()
    found[part][_grown(thin, reach + 2) & ~_grown(other, 1)] = 3 * step
    return found


def _beside(wires: Wires, rough: Float32, first: Float64, voxel: float) -> tuple[Places, Float64]:
    """A lattice's points (z, y, x) near wires, which are thinner than its steps, and how far."""
    reach = 2 * CLOSE * voxel
    low = np.floor((wires.points.min(axis=0) - reach - first) / voxel)[::-1].astype(int)
    high = np.ceil((wires.points.max(axis=0) + reach - first) / voxel)[::-1].astype(int) + 1
    low, high = (np.clip(end, 0, rough.shape) for end in (low, high))
    part = rough[tuple(slice(a, b) for a, b in zip(low, high, strict=True))]
    z, y, x = (one + start for one, start in zip(np.nonzero(np.abs(part) < CLOSE * voxel), low,
                                                 strict=True))
    return (z, y, x), wires.distance(_places(first, voxel, (z, y, x)), reach, voxel)


def _closed(distance: Float32) -> tuple[Float32, Bool]:
    """Distances [z, y, x] without cavities and what lies deep inside; where free space is near.

    Deep within the head no sample is near; pieces end within others, and far inside their distances
    are small. Nobody sees that, but it would be half of all points.
    """
    spaces, _ = ndimage.label(distance > 0)
    ends = [spaces[tuple(slice(None) if k != axis else end for k in range(3))]
            for axis in range(3) for end in (0, -1)]
    free = np.isin(spaces, np.setdiff1d(np.concatenate([np.unique(one) for one in ends]), 0))
    near = _grown(free, DEEP) & (free | (spaces == 0))
    return np.where(near, distance, min(float(distance.min()), 0.0)), near


def _grown(values: Bool, reach: int, beyond: bool = False) -> Bool:
    """Where a value [z, y, x] within ``reach`` points along each axis is true."""
    out = values.copy()
    for axis in range(3):
        along = np.moveaxis(out, axis, 0)
        for _ in range(reach):
            before = along.copy(order="K")
            along[1:] |= before[:-1]
            along[:-1] |= before[1:]
            along[[0, -1]] |= beyond
    return out


def _places(first: Float64, step: float, at: tuple[NDArray[np.int64], ...]) -> Float64:
    """Positions [N, 3] of a lattice's points (z, y, x)."""
    z, y, x = at
    return np.asarray(first + step * np.stack([x, y, z], axis=1))


def _doubled(coarse: Float32) -> Float32:
    """A lattice [z, y, x] with the points between its points."""
    out = np.empty([2 * count - 1 for count in coarse.shape], np.float32)
    out[::2, ::2, ::2] = coarse
    for axis, lines in enumerate((out[:, ::2, ::2], out[:, :, ::2], out)):
        along = np.moveaxis(lines, axis, 0)
        np.add(along[:-1:2], along[2::2], out=along[1::2])
        along[1::2] *= 0.5
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
