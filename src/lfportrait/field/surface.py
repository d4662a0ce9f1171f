"""The surface of a field: a point cloud, a colored mesh, or a graph of cells.

A network or a color says of some places for sure what they are, of others hardly, of those that no
photo saw nothing. Asked place by place, the ends of what was seen come out as regions of their own.
So what is known is carried over the graph (`SurfaceGraph`): a random walker (Grady 2006; with
priors 2005) goes from cell to cell, easily between cells of one color, hardly across an edge, and a
cell is what most walkers from it come to first. Its chances x minimize

    sum w_ij (x_i - x_j)^2 + sum a_i (x_i - p_i)^2

over the edges ij and the cells i, with votes p and their trust a: a sparse linear system.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage, sparse
from scipy.spatial import cKDTree

from ..arrays import Array, Bool, Float32, Float64, Floats, Int32, Int64, UInt8, box_about
from ..color import to_uint8
from ..errors import UserError
from .grid import VoxelField
from .kernels.march import C0, lattice_of_world
from .kernels.surface import depth_from_outside, seen_colors, sh_bases

_FRONT = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class PointCloud:
    """Lattice points that hold matter."""

    # positions, normals: float32 [K, 3], in the world; normals of unit length, out of the matter.
    positions: Float32
    normals: Float32
    colors: UInt8  # uint8 [K, 3], sRGB.
    opacity: Float32  # float32 [K], part of the light that a step of one voxel takes.


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh with one color and one normal a vertex."""

    # vertices, normals: float32 [V, 3], in the world; normals of unit length, outwards.
    vertices: Float32
    normals: Float32
    faces: Int32  # int32 [F, 3], counter-clockwise seen from outside.
    colors: UInt8  # uint8 [V, 3], sRGB.


def _unit(vectors: Array, instead: Array) -> Array:
    """Vectors [K, 3] at unit length; ``instead`` where there is no direction."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 1e-12, vectors / np.maximum(length, 1e-12), instead)


def field_points(field: VoxelField, opacity: float = 0.1, color: str = "mean") -> PointCloud:
    """The lattice points whose voxel takes at least ``opacity`` of the light.

    Raises `UserError` if there are none.

    Parameters
    ----------
    opacity : See above, 0 to 1.
    color : ``"mean"``: the coefficient of degree 0, a point's mean over all directions.
        ``"seen"``: its color in the direction from which it is looked at (`_gaze`).
    """
    size = np.array(field.links.shape[::-1])
    spacing = 2.0 * field.radius / size
    taken = 1.0 - np.exp(-np.maximum(field.density, 0.0) * float(spacing.mean()))
    rows = np.flatnonzero(taken >= opacity)
    if not len(rows):
        raise UserError(f"no point of the field is as opaque as {opacity:g}; lower --level")
    place = np.empty((len(field.density), 3), np.int32)
    z, y, x = np.nonzero(field.links >= 0)
    place[field.links[z, y, x]] = np.stack([x, y, z], axis=1)
    place = place[rows]
    slope = np.empty((len(rows), 3))
    # Sobel's operator: the neighbours' neighbours count as well, as single densities are noisy.
    padded = np.pad(field.links, 1, constant_values=-1)
    values = np.append(field.density, np.float32(0.0))
    around = np.array([(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)])
    near = np.stack([values[padded[place[:, 2] + 1 + k, place[:, 1] + 1 + j, place[:, 0] + 1 + i]]
                     for i, j, k in around], axis=1)
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        weight = around[:, axis] * np.prod(2 - np.abs(around[:, others]), axis=1)
        slope[:, axis] = near @ weight / spacing[axis]
    positions = field.center + field.radius * (2.0 * (place + 0.5) / size - 1.0)
    normals = _unit(-slope, _unit(positions - field.center, _FRONT))
    if color == "mean":
        shown = C0 * field.sh[rows, :, 0] + 0.5
    else:
        bases = np.empty((len(rows), field.basis), np.float32)
        sh_bases(_gaze(normals), bases)
        shown = np.einsum("kcb,kb->kc", field.sh[rows], bases) + 0.5
    return PointCloud(positions.astype(np.float32), normals.astype(np.float32), to_uint8(shown),
                      taken[rows].astype(np.float32))


def _gaze(normals: Float64) -> Float64:
    """The direction in which somebody looks who sees a surface with the given normals, [K, 3].

    Against the normal, but rather level and rather from the front, as people are photographed: in
    directions that no photo looked in, a field's coefficients say nothing.
    """
    return _unit(-(normals * (1.0, 0.5, 1.0) + (0.0, 0.0, 0.5)), -_FRONT)


def _cropped(field: VoxelField, margin: int) -> tuple[Float32, Int64]:
    """Density [z, y, x] about the filled lattice points, and the first point's place (z, y, x)."""
    box = box_about(field.links >= 0)
    if box is None:
        raise UserError("the field is empty; reconstruct it again")
    values = np.append(np.maximum(field.density, 0.0), np.float32(0.0)).astype(np.float32)
    return (np.pad(values[field.links[box]], margin),
            np.array([side.start for side in box]) - margin)


def _looked_from() -> Int64:
    """Steps (z, y, x) in which light comes in: level and from above.

    Not from below: people are cut off there, and one would look into the shell.
    """
    steps = [(z, y, x) for z in (-1, 0, 1) for y in (-1, 0) for x in (-1, 0, 1) if z or y or x]
    return np.array(steps)


def _largest_pieces(faces: Int32, count: int, least: float) -> Bool:
    """Faces of the connected pieces with at least ``least`` of the largest one's faces."""
    edges = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = sparse.coo_matrix((np.ones(len(edges), bool), edges.T), shape=(count, count))
    _, piece = sparse.csgraph.connected_components(graph, directed=False)
    sizes = np.bincount(piece[faces[:, 0]], minlength=piece.max() + 1)
    return np.asarray((sizes >= least * sizes.max())[piece[faces[:, 0]]])


def field_mesh(field: VoxelField, level: float | None = None, smooth: float = 1.5,
               least: float = 0.05) -> Mesh:
    """The surface of a field by marching cubes, with the colors seen there.

    It is the surface as seen from outside, closed, nothing within; of a field with a background,
    where walls of a room would hide all else, that of the density itself, inner walls included.
    Raises `UserError` if the field has no such surface.

    Parameters
    ----------
    level : Opacity at the surface, 0 to 1: of all that light passes on its way there from
        outside (0.5 by default), or, of a room, of a step of one voxel (0.1 by default).
    smooth : Standard deviation in voxels by which the opacity is smoothed first; 0 does not.
    least : Connected pieces with fewer faces than this part of the largest one's are dropped.
    """
    from skimage.measure import marching_cubes

    outer = field.background is None
    if level is None:
        level = 0.5 if outer else 0.1
    if not 0.0 < level < 1.0 or smooth < 0.0:
        raise UserError(f"--level must lie between 0 and 1 and --smooth not below 0, not at "
                        f"{level:g} and {smooth:g}")
    density, first = _cropped(field, 2 + int(np.ceil(2 * smooth)))
    size = np.array(field.links.shape[::-1])
    spacing = 2.0 * field.radius / size
    if outer:
        opaque = depth_from_outside(density, spacing[::-1], _looked_from())
    else:
        opaque = density * np.float32(spacing.mean())
    np.negative(np.expm1(-opaque, out=opaque), out=opaque)
    if smooth > 0.0:
        # The rim of padding stays outside.
        ndimage.gaussian_filter(opaque, smooth, output=opaque, truncate=2.0, mode="nearest")
    if not opaque.min() < level < opaque.max():
        raise UserError(f"the field has no surface at an opacity of {level:g}; try another --level")
    # Opaque is inside: outwards the values fall.
    points, faces, normals, _ = marching_cubes(opaque, level, gradient_direction="descent",
                                               allow_degenerate=False)
    faces = faces[_largest_pieces(faces, len(points), least)]
    used, faces = np.unique(faces, return_inverse=True)
    faces = faces.reshape(-1, 3).astype(np.int32)
    # From (z, y, x) to (x, y, z), which turns the faces over.
    place = (points[used] + first)[:, ::-1].astype(np.float64)
    vertices = field.center + field.radius * (2.0 * (place + 0.5) / size - 1.0)
    normals = _unit(normals[used][:, ::-1] / spacing, _FRONT)
    return Mesh(vertices.astype(np.float32), normals.astype(np.float32), faces,
                to_uint8(_seen(field, vertices, normals, float(spacing.mean()))))


def _seen(field: VoxelField, points: Float64, normals: Float64, voxel: float) -> Float32:
    """Color of surface points as seen from outside, float32 [K, 3]: short rays along `_gaze`."""
    scale, offset = lattice_of_world(field.center, field.radius, field.links.shape)
    color = np.empty((len(points), 4), np.float32)
    gaze = _gaze(normals)
    seen_colors(field.links, field.density, field.sh, scale, offset, points - 2.0 * voxel * gaze,
                gaze, 12, 0.5 * voxel, color)
    lost = color[:, 3] < 0.02
    if lost.any() and not lost.all():
        # A few points of a smoothed surface lie over a gap: they take their neighbour's color.
        from scipy.spatial import cKDTree

        _, nearest = cKDTree(points[~lost]).query(points[lost])
        color[lost] = color[~lost][nearest]
    return color[:, :3]


REACH = 1.8  # Cells whose middles are nearer than this many sides are neighbors.
CONTRAST = 0.08
"""Distance of colors (sRGB in [0, 1]) across which a walker goes 0.6 times as easily."""
LEAST = 0.01  # So easily it goes across any edge.
LOOSE = 1e-6  # Weight of the mean of all votes, which holds cells that nothing hangs together with.
ACCURACY = 1e-4  # Relative, of the solution.


@dataclass(frozen=True)
class SurfaceGraph:
    """C cells of N places of a surface."""

    cell: Int64  # int64 [N], the cell of each place.
    count: Float64  # float64 [C], places of each cell.
    edges: Int64  # int64 [E, 2], neighbors.
    ease: Float64  # float64 [E] in (0, 1], of a walker's step between them.

    @staticmethod
    def over(points: Floats, colors: Floats, side: float) -> SurfaceGraph:
        """The graph of a surface's places [N, 3] in cells of this side.

        Colors [N, 3] are sRGB in [0, 1], NaN where none is known: there all steps are easy.
        """
        places = np.floor((points - points.min(axis=0)) / side).astype(np.int64)
        number = np.ravel_multi_index(tuple(places.T), tuple(places.max(axis=0) + 1))
        _, cell, count = np.unique(number, return_inverse=True, return_counts=True)
        middle, color = (np.stack([np.bincount(cell, part) for part in values.T], axis=1)
                         / count[:, None] for values in (points, colors))
        edges = cKDTree(middle).query_pairs(REACH * side, output_type="ndarray").astype(np.int64)
        away = ((color[edges[:, 0]] - color[edges[:, 1]]) ** 2).sum(axis=1)
        ease = np.exp(-0.5 * np.nan_to_num(away) / CONTRAST ** 2)
        return SurfaceGraph(cell, count.astype(np.float64), edges, LEAST + (1 - LEAST) * ease)

    def decided(self, votes: Floats, trust: Floats, accuracy: float = ACCURACY) -> Float32:
        """What places are, float32 [N] in [0, 1], from votes [N] in [0, 1].

        ``trust`` [N] is their weight over that of a step within one color; somewhere above 0.
        """
        cells = len(self.count)
        weight = np.bincount(self.cell, trust, cells) / self.count
        pull = np.bincount(self.cell, trust * votes, cells) / self.count
        first, second = self.edges.T
        steps = sparse.coo_array((self.ease, (first, second)), (cells, cells)).tocsr()
        steps = steps + steps.T
        mean = float(pull.sum() / max(float(weight.sum()), 1e-12))
        diagonal = np.asarray(steps.sum(axis=1)).ravel() + weight + LOOSE
        found = _solved(steps, diagonal, pull + LOOSE * mean, np.full(cells, mean), accuracy)
        return np.clip(found, 0, 1).astype(np.float32)[self.cell]


def _solved(steps: sparse.csr_array, diagonal: Float64, wanted: Float64, start: Float64,
            accuracy: float) -> Float64:
    """What solves (diagonal - steps) x = wanted, [C], by conjugate gradients.

    SciPy's take their sums from a library that starts threads for it: where cores are busy that
    takes ten times as long.
    """
    found, enough = start, accuracy ** 2 * float((wanted * wanted).sum())
    left = wanted - diagonal * found + steps @ found
    along, size = np.zeros_like(found), 1.0
    for _ in range(2000):
        if float((left * left).sum()) <= enough:
            break
        scaled = left / diagonal
        last, size = size, float((left * scaled).sum())
        along = scaled + size / last * along
        moved = diagonal * along - steps @ along
        length = size / float((along * moved).sum())
        found, left = found + length * along, left - length * moved
    return found
