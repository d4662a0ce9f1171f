"""Approximate surfaces of a room: depth maps by plane sweep, fused on a lattice.

Photos without mattes have no visual hull to start from, and a field that starts as even haze
settles into haze. So small copies of the photos are matched first (Collins 1996; plane sweep with
normalised cross-correlation): for each view, planes at evenly spaced inverse depths are warped into
its neighbours, the best agreement wins, and depths that the neighbours' own maps confirm are kept.
Fused, they say where space is empty and where surfaces are, and in what color.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from ...arrays import Array, Bool, Float32, Float64, Int64
from ...capture import Camera, Capture
from ...simd.threads import side_by_side
from ..kernels.depth_maps import confirm_depth, fuse_depth, match_planes
from ..kernels.march import C0
from ..training.lattice import box_shape

_SIZE, _PLANES, _NEIGHBOURS, _WINDOW = 192, 64, 4, 7


@dataclass(frozen=True)
class DepthMap:
    """A small view with what is known of its depth."""

    camera: Camera  # Its camera, one view.
    image: Float32  # float32 [h, w, 3], sRGB in [0, 1].
    # float32 [h, w], distance along the optical axis in world units, NaN where it is not known.
    depth: Float32

    def points(self) -> Float64:
        """The known points in the world, float64 [K, 3]."""
        row, column = np.nonzero(np.isfinite(self.depth))
        along = self.depth[row, column][:, None]
        pixels = np.stack([column + 0.5, row + 0.5], 1)
        local = np.column_stack([(pixels - self.camera.center[0]) / self.camera.focal[0],
                                 np.ones(len(row))]) * along
        return np.asarray(local @ self.camera.pose[0, :3, :3].T + self.camera.pose[0, :3, 3])


def sweep_depth(capture: Capture, views: Int64, reach: float = 0.0, *,
                endless: bool = False, planes: int = _PLANES) -> list[DepthMap]:
    """Depth maps of the given views, each with only what its neighbours confirm.

    Parameters
    ----------
    views : The views, which are each other's neighbours.
    reach : The planes of each view are dense up to this distance from the origin and few beyond;
        by default they are the same for all views and as dense far away.
    endless : Have the planes go on to infinity, so that a wall is found however far it is.
    """
    small = [small_view(capture, int(view)) for view in views]
    cameras = [item.camera for item in small]
    position = np.stack([camera.position[0] for camera in cameras])
    forward = np.stack([camera.pose[0, :3, 2] for camera in cameras])
    distance = np.linalg.norm(position, axis=1)
    if reach > 0:
        near, far = np.maximum(distance - reach, 0.3 * distance), 2.0 * (distance + reach)
    else:
        near = np.full(len(small), 0.3 * distance.min())
        far = np.full(len(small), 6.0 * np.median(distance))
    # The best plane is never the last one: there is one more, beyond infinity.
    least = -1.0 / (planes * near) if endless else 1.0 / far
    inverse = np.linspace(least, 1.0 / near, planes, axis=1)
    neighbours = [_neighbours(view, position, forward) for view in range(len(small))]
    greys = [item.image.mean(axis=2) for item in small]
    found = side_by_side(lambda view: _match(
        greys, cameras, view, neighbours[view], inverse[view]), range(len(small)))
    if endless:
        found = [np.maximum(one, np.float32(1e-3)) for one in found]
    steps = inverse[:, 1] - inverse[:, 0]
    sure = side_by_side(lambda view: _confirmed(view, found, cameras, neighbours[view], steps),
                        range(len(small)))
    return [DepthMap(item.camera, item.image, depth) for item, depth in zip(small, sure)]


def small_view(capture: Capture, view: int) -> DepthMap:
    """A small copy of a view, its depth unknown."""
    image = capture.images[view]
    scale = min(1.0, _SIZE / max(image.shape[:2]))
    camera = capture.cameras[view].scaled(scale)
    size = (int(camera.width[0]), int(camera.height[0]))
    pixels = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32) / 255.0
    return DepthMap(camera, pixels, np.full(pixels.shape[:2], np.nan, np.float32))


def stacked(pictures: Sequence[Array]) -> tuple[Float32, Int64]:
    """Pictures [h, w] of any sizes as kernels take them, and their rows and columns, int64 [K, 2].

    float32 [K, H, W]: each in its upper left corner, zero elsewhere.
    """
    sizes = np.array([picture.shape for picture in pictures], np.int64)
    stack = np.zeros((len(pictures), *sizes.max(axis=0)), np.float32)
    for whole, picture in zip(stack, pictures):
        whole[:picture.shape[0], :picture.shape[1]] = picture
    return stack, sizes


def _neighbours(view: int, position: Float64, forward: Float64) -> list[int]:
    """The nearest views that see the scene from a sufficiently different place."""
    away = np.linalg.norm(position - position[view], axis=1)
    reach = float(np.linalg.norm(position[view]))
    cosine = forward @ forward[view]
    good = (away > 0.08 * reach) & (cosine > 0.7)
    order = np.argsort(np.where(good, away, np.inf))
    return [int(other) for other in order[:_NEIGHBOURS] if good[other]]


def _match(greys: list[Float32], cameras: list[Camera], view: int,
           neighbours: list[int], inverse: Float64) -> Float32:
    """Inverse depth with the best agreement, float32 [h, w], NaN where none is good."""
    reference = greys[view]
    height, width = reference.shape
    if not neighbours:
        return np.full((height, width), np.nan, np.float32)
    window = (_WINDOW, _WINDOW)
    mean = cv2.boxFilter(reference, -1, window)
    variance = cv2.boxFilter(reference * reference, -1, window) - mean * mean
    # The better half: the others may look past an edge.
    half = max(1, len(neighbours) // 2)
    scratch = tuple(np.empty(shape, np.float32) for shape in (
        (height, width), (height, width), (half, height, width), (3, width + 8), (3, width),
        (2, width), width))
    pictures, sizes = stacked([greys[other] for other in neighbours])
    far, slopes = zip(*[_homographies(cameras[view], cameras[other]) for other in neighbours])
    warps = np.stack(far) + inverse[:, None, None, None] * np.stack(slopes)
    top, below, above = np.empty((3, height, width), np.float32)
    winner = np.empty((height, width), np.int32)
    match_planes(reference, mean, variance, pictures, sizes, warps, scratch, top, winner, below,
                 above)
    bend = np.minimum(below + above - 2.0 * top, -1e-6)
    shift = np.clip(0.5 * (below - above) / bend, -0.5, 0.5)
    value = inverse[0] + (winner + shift) * (inverse[1] - inverse[0])
    good = (top > 0.6) & (variance > 2e-5) & (winner > 0) & (winner < len(inverse) - 1)
    return np.where(good, value, np.nan).astype(np.float32)


def _intrinsics(camera: Camera) -> Float64:
    return np.array([[camera.focal[0, 0], 0.0, camera.center[0, 0] - 0.5],
                     [0.0, camera.focal[0, 1], camera.center[0, 1] - 0.5], [0.0, 0.0, 1.0]])


def _homographies(reference: Camera, other: Camera) -> tuple[Float64, Float64]:
    """Matrices A and B: A + B / d leads from the reference's pixels to the other's, at depth d."""
    turn = other.pose[0, :3, :3].T @ reference.pose[0, :3, :3]
    shift = other.pose[0, :3, :3].T @ (reference.pose[0, :3, 3] - other.pose[0, :3, 3])
    lens, back = _intrinsics(other), np.linalg.inv(_intrinsics(reference))
    return lens @ turn @ back, lens @ np.outer(shift, [0.0, 0.0, 1.0]) @ back


def _confirmed(view: int, found: list[Float32], cameras: list[Camera],
               neighbours: list[int], steps: Float64) -> Float32:
    """Depth where a neighbour's own map agrees within a plane and a half; NaN elsewhere."""
    depth = (1.0 / found[view]).astype(np.float32)
    if not neighbours:
        return np.full_like(depth, np.nan)
    confirmed = np.empty(depth.shape, bool)
    inverses, sizes = stacked([found[other] for other in neighbours])
    confirm_depth(found[view], cameras[view].row(0),
                  np.stack([cameras[other].row(0) for other in neighbours]), inverses, sizes,
                  1.5 * np.maximum(steps[neighbours], steps[view]), confirmed)
    return np.where(confirmed, depth, np.float32(np.nan))


def scene_box(maps: list[DepthMap], least: float, most: float) -> tuple[Float64, Float64] | None:
    """Center and radius [3] of a box about nine tenths of the points, or None without points.

    The box reaches at least ``least`` and at most ``most`` from the origin along each axis.
    """
    points = np.concatenate([item.points() for item in maps])
    if len(points) < 500:
        return None
    low, high = np.quantile(points, 0.01, axis=0), np.quantile(points, 0.99, axis=0)
    margin = 0.08 * (high - low)
    low = np.clip(low - margin, -most, -least)
    high = np.clip(high + margin, least, most)
    return 0.5 * (low + high), 0.5 * (high - low)


def continued(sums: Float32, sigma: float, least: float) -> Float32:
    """Means by ``sums`` [h, w, 1 + C], from ever wider surroundings where there are none; or 0.

    The first of the sums is the weight, of which surroundings must have the ``least``.
    """
    result = np.zeros((*sums.shape[:2], sums.shape[2] - 1), np.float32)
    there = np.zeros(sums.shape[:2], bool)
    while not there.all() and sigma < 2 * max(there.shape):
        wide = np.asarray(cv2.GaussianBlur(sums, (0, 0), sigma))
        now = ~there & (wide[..., 0] > least)
        result[now] = wide[now, 1:] / wide[now, :1]
        there |= now
        sigma *= 1.7
    return result


def _completed(depth: Float32) -> Float32:
    """Depth with its holes filled from ever wider surroundings, in inverse depth."""
    known = np.isfinite(depth)
    inverse = np.where(known, 1.0 / np.where(known, depth, 1.0), 0.0).astype(np.float32)
    around = continued(np.dstack([known, inverse]).astype(np.float32), 1.5, 0.02)[..., 0]
    filled = np.where(known, inverse, around)
    # A view without any known depth votes for nothing: its surface is at no distance.
    return np.where(filled > 0, 1.0 / np.maximum(filled, 1e-6), 0.0).astype(np.float32)


@dataclass(frozen=True)
class Surfaces:
    """What depth maps say of the points of a lattice."""

    keep: Bool  # bool [Z, Y, X], points that may hold matter.
    solid: Bool  # bool [Z, Y, X], points where surfaces are seen.
    color: Float32  # float32 [Z, Y, X, 3], zeroth harmonic of the surfaces' color, zero elsewhere.


def fuse(maps: list[DepthMap], resolution: int, center: Float64, radius: Float64) -> Surfaces:
    """The votes of all maps on a lattice with ``resolution`` points to two world units."""
    shape = box_shape(resolution, radius)
    x, y, z = (center[i] + radius[i] * (2.0 * (np.arange(shape[2 - i]) + 0.5) / shape[2 - i] - 1.0)
               for i in range(3))
    empty, solid, unsure = (np.zeros(shape, np.int16) for _ in range(3))
    color = np.zeros((*shape, 3), np.float32)
    margin = 1.5 * 2.0 / resolution
    for item in maps:
        fuse_depth(x, y, z, item.camera.row(0), _completed(item.depth),
                   np.isfinite(item.depth), item.image, margin, 0.1, empty, solid, unsure, color)
    surface = (solid >= 2) & (solid >= 0.3 * empty)
    likely = (solid + unsure >= 2) & (solid + unsure >= empty)
    keep = ndimage.binary_dilation(surface, np.ones((3, 3, 3), bool)) | likely
    mean = color / np.maximum(solid, 1)[..., None]
    harmonic = np.where(surface[..., None], (mean - 0.5) / C0, 0.0).astype(np.float32)
    return Surfaces(keep, surface, harmonic)
