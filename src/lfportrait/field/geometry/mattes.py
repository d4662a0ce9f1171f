"""Mattes that all photos agree on: outlines of the field, or of a solid, along each photo's edges.

A matte errs here and there by a few pixels, each photo at other places. A field that is trained
roughly has weighed all of them: rendered into a photo, its opacity is right within a pixel or two
nearly everywhere, and the photo's edges say the rest (`refined_mattes`,
`lfportrait.capture.refine_matte`). Held-out photos get theirs in the same way, from a field that
never saw them.

Where a network's mattes contradict each other, the photos themselves define the object: a solid
from the depth of the training photos (`find_solid`) is outlined in every photo, held-out ones
included, and each outline is laid along that photo's own edges (`cut_out`). Where the mattes agree,
the same solid shows what in them lies far from the person (`trim`).

The solid: depth maps are fused to signed distances on a lattice (Curless and Levoy 1996). Planes
that the object stands on or before - a table, a wall - have the object and all cameras on one side
and little on the other; they are found by RANSAC and cut off. What then hangs together about the
origin is the object, less those parts that hardly any matte of the network calls person, if most
mattes call the rest so.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from ...arrays import Array, Float32, Float64, Floats, UInt8, box_about
from ...capture import Camera, Capture, holes_of, mattes_share, refine_matte, views_share
from ...progress import Progress, note
from ...simd.threads import side_by_side
from ..grid import VoxelField
from ..kernels.depth_maps import fuse_distance, outline_distance
from .sweep import DepthMap, stacked, sweep_depth

Plane = Float32

_EMPTY = 12  # of a matte, 0 to 255: less is empty
_AGREE = 0.8  # Overlap with a rough outline below which a photo's edges are not followed.


def along_edges(image: UInt8, coarse: Plane, cell: int) -> tuple[Plane, bool]:
    """Lay a rough matte, right within a few cells, along its photo's edges.

    The photo is uint8 [H, W, 3], mattes float32 [H, W] in [0, 1]; ``cell`` as for `refine_matte`.
    Also whether the edges agree with the rough matte; where they do not, the matte is that itself,
    steeper.
    """
    box = box_about(coarse > 0.02, max(coarse.shape) // 24)
    if box is None:
        return coarse, True
    matte = coarse.copy()
    matte[box] = refine_matte(image[box], coarse[box], cell, calm=True)
    both = ((matte > 0.5) & (coarse > 0.5)).sum()
    either = ((matte > 0.5) | (coarse > 0.5)).sum()
    if both < _AGREE * either:
        return np.clip(2.0 * coarse - 0.5, 0, 1).astype(np.float32), False
    return matte, True


def refined_mattes(field: VoxelField, capture: Capture,
                   clear: Sequence[UInt8] | None = None) -> list[UInt8]:
    """Mattes uint8 [H, W] of photos, from a field that was trained with rougher ones.

    A photo's own where its edges contradict the field; what is behind the person must be known.
    ``clear``: mattes whose empty parts stay empty but for their edges, as the gap behind an ear's
    lobe, which a coarse field fills.
    """
    assert capture.alphas is not None
    given = capture.alphas
    bricks = field.bricks  # which all views share
    assert len(bricks.links)

    def refined(view: int) -> UInt8:
        opacity, cell = _opacity(field, capture, view)
        matte, follows = along_edges(capture.images[view], opacity, cell)
        if not follows:
            return given[view]
        if clear is not None:
            matte[cv2.dilate(clear[view], np.ones((2 * cell + 1,) * 2, np.uint8)) < _EMPTY] = 0.0
        return np.asarray(255.0 * matte + 0.5, np.uint8)

    return side_by_side(refined, range(len(capture)))


def _opacity(field: VoxelField, capture: Capture, view: int) -> tuple[Plane, int]:
    """The field's opacity in one photo, [H, W], and the photo's pixels to a cell."""
    camera = capture.cameras[view]
    distance = float(np.linalg.norm(camera.position[0] - field.center))
    voxel = float(field.spacing.max()) * float(camera.focal.max()) / distance
    small = field.depth(camera.scaled(min(1.0, 1.0 / voxel)))[0]
    large = cv2.resize(small, capture.images[view].shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return np.clip(large, 0.0, 1.0).astype(np.float32), max(2, round(0.5 * voxel))


_OUTLINE = 256  # height or width in which outlines are drawn
_FEW = 48  # photos whose depth is enough to see what lies far from the object
_ALIKE = 0.75  # overlap with the outline from which a matte is thought to show the same


def cut_out(capture: Capture, mattes: Sequence[Floats],
            progress: Progress | None = None) -> list[Plane] | None:
    """Cut the object at the origin out of photos by its geometry: float32 [H, W] in [0, 1] each.

    Of a network's mattes many may be wrong. None where the photos show no object at the origin
    (`find_solid`).
    """
    solid = _solid(capture, mattes, progress)
    if solid is None:
        return None
    note(progress, "cutting out the object: outlines")
    # Coarse mattes: a slope three spacings wide at the outline.
    outlines = [np.asarray(np.clip(0.5 - _outlined(capture, view, solid) / (3.0 * solid.spacing),
                                   0, 1), np.float32) for view in range(len(capture))]
    with ThreadPoolExecutor(2) as workers:
        results = list(workers.map(_cut, capture.images, outlines))
    without = [capture.names[view] for view, coarse in enumerate(outlines) if coarse.max() < 0.5]
    if without:
        warnings.warn(f"{len(without)} of {len(capture)} photos do not show the object and are "
                      f"ignored: {_listed(without)}", stacklevel=2)
    plain = [capture.names[view] for view, (_, follows) in enumerate(results) if not follows]
    if plain:
        warnings.warn(f"the edges of {len(plain)} of {len(capture)} photos contradict the shape of "
                      f"the object; its own outline is used there: {_listed(plain)}",
                      stacklevel=2)
    return [matte for matte, _ in results]


def _listed(names: list[str]) -> str:
    return ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")


def trim(capture: Capture, mattes: Sequence[Floats],
         progress: Progress | None = None) -> list[Plane]:
    """Remove from mattes, most of them right, what is far from the object by the photos' depth.

    Of [H, W] in [0, 1]; float32. One that the object's outline does not resemble stays as it is,
    and all do where the photos show no object. What changes is not along the photo's edges
    (`lfportrait.capture.refine_changes`).
    """
    given = [np.asarray(matte, np.float32) for matte in mattes]
    solid = _solid(capture, given, progress, _FEW)
    if solid is None:
        return given

    def trimmed(view: int, distance: Plane) -> Plane:
        matte = given[view]
        person, inside = matte > 0.5, distance < 0
        if (person & inside).sum() < _ALIKE * (person | inside).sum():
            return matte
        # Two and a half spacings, 6 mm on a head, are left to hair.
        return np.asarray(matte * np.clip(5.5 - 2.0 * distance / solid.spacing, 0, 1))

    return side_by_side(lambda view: trimmed(view, _outlined(capture, view, solid)),
                        range(len(capture)), most=4)


def _solid(capture: Capture, mattes: Sequence[Floats],
           progress: Progress | None, most: int | None = None) -> Solid | None:
    """The object as the training photos show it, or ``most`` of them spread evenly."""
    views = capture.training()
    if most is not None and len(views) > most:
        views = views[np.linspace(0, len(views) - 1, most).astype(int)]
    note(progress, "cutting out the object: depth")
    maps = sweep_depth(capture, views, REACH)
    votes = [np.asarray(cv2.resize(np.asarray(mattes[view], np.float32), item.depth.shape[::-1],
                                   interpolation=cv2.INTER_AREA), np.float32)
             for view, item in zip(views, maps)]
    return find_solid(maps, votes)


def _outlined(capture: Capture, view: int, solid: Solid) -> Plane:
    """Distance of the pixels of one photo to the outline, float32 [H, W] (`Solid.outline`)."""
    height, width = capture.images[view].shape[:2]
    camera = capture.cameras[view].scaled(min(1.0, _OUTLINE / max(height, width)))
    distance = solid.outline(camera)
    distance[holes_of(distance < 0)] = -1e-3 * solid.spacing
    return np.asarray(cv2.resize(distance, (width, height), interpolation=cv2.INTER_CUBIC),
                      np.float32)


def _cut(image: UInt8, coarse: Plane) -> tuple[Plane, bool]:
    """The matte laid along the photo's edges, and whether these agree with the outline."""
    return along_edges(image, coarse, max(2, round(max(coarse.shape) / 256)))


REACH = 1.8
"""Half of the lattice's edge in world units: a head is about one in radius, shoulders reach on."""

_SIZE, _THICK = 144, 3.0
_FOCUS = 0.6  # radius about the origin in which the object is looked for
_PERSON = 0.4  # share of the votes below which what stands at the origin is no person
_DOUBT = 0.25  # share of the object's usual vote below which a surface is something else's
_HIDDEN = 0.85  # and above which a point without depth is inside

Points = Float64


@dataclass(frozen=True)
class Solid:
    """Signed distances to an object on a cubic lattice about the origin."""

    # first, spacing: Coordinate of the first point along x, y and z, distance of the points, in
    # world units.
    first: float
    spacing: float
    # float32 [N, N, N] (z, y, x) in [-1, 1], in units of three spacings, below zero inside.
    distance: Float32

    @functools.cached_property
    def _clear(self) -> UInt8:
        return _clearance(self.distance)

    def outline(self, camera: Camera) -> Float32:
        """The least distance along the ray of each pixel of one view.

        float32 [H, W] in world units, negative where the object is, at most three spacings.
        """
        height, width = int(camera.height[0]), int(camera.width[0])
        least = outline_distance(self.distance, self._clear, self.first, self.spacing,
                                 camera.row(0), height, width)
        return np.asarray(least * np.float32(_THICK * self.spacing), np.float32)


def _clearance(distance: Float32) -> UInt8:
    """For each cell, how many cells away the nearest one is that is not empty, at most 255."""
    empty = distance >= 1.0
    cells = ndimage.minimum_filter(empty, size=2, origin=-1, mode="nearest")
    steps = ndimage.distance_transform_cdt(cells, "chessboard")
    return np.minimum(steps, 255).astype(np.uint8)


def backing_planes(points: Points, persons: Float32, cameras: Points, usual: float) -> Float64:
    """Planes that have the object and the cameras before them, float64 [P, 4], three at most.

    They are unit normals and offsets: ``normal . x > offset`` before the plane. Of points of
    surfaces, float64 [K, 3], ``persons`` says how much the mattes call each of them the person, and
    ``usual`` how much they call the object so: a plane that they call so nearly as much is part of
    it (a back, a chest).
    """
    random = np.random.default_rng(0)
    near = np.linalg.norm(points, axis=1) < REACH + 0.2
    points, persons = points[near], persons[near]
    found: list[Float64] = []
    while len(found) < 3 and len(points) >= 500:
        chosen = random.permutation(len(points))[:6000]
        sample = points[chosen]
        corners = sample[random.integers(0, len(sample), (1500, 3))]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normals, axis=1)
        normals = normals[length > 1e-3] / length[length > 1e-3, None]
        offsets = np.einsum("ij,ij->i", normals, corners[length > 1e-3, 0])
        turned = offsets > 0
        normals[turned], offsets[turned] = -normals[turned], -offsets[turned]
        ahead = np.einsum("ij,kj->ik", cameras, normals) > offsets
        usable = (ahead.mean(axis=0) > 0.95) & (offsets < -0.25)
        for plane in found:  # the thickness of a table is no second table
            usable &= normals @ plane[:3] < 0.8
        normals, offsets = normals[usable], offsets[usable]
        if not len(normals):
            break
        support = np.zeros(len(normals))
        for index, (normal, offset) in enumerate(zip(normals, offsets)):
            height = sample @ normal - offset
            behind = np.mean(height < -0.06)
            support[index] = np.mean(abs(height) < 0.03) if behind < 0.1 else 0.0
        best = int(support.argmax())
        height = points @ normals[best] - offsets[best]
        on = abs(height) < 0.03
        middle = points[on].mean(axis=0)
        # What an object stands on reaches beyond it, other than its own base.
        reach = np.quantile(np.linalg.norm(points[on] - height[on, None] * normals[best]
                                           - offsets[best] * normals[best], axis=1), 0.9)
        if support[best] < 0.04 or reach < 1.0 or persons[on].mean() > 0.8 * usual:
            break
        normal = np.linalg.svd(points[on] - middle, full_matrices=False)[2][2]
        normal = normal if normal @ middle < 0 else -normal
        found.append(np.append(normal, normal @ middle))
        keep = points @ normal - normal @ middle > 0.06
        points, persons = points[keep], persons[keep]
    return np.array(found).reshape(-1, 4)


def find_solid(maps: list[DepthMap], mattes: list[Float32]) -> Solid | None:
    """The object at the origin, by depth maps of V views and mattes of their size in [0, 1].

    None if nothing of known depth is near the origin, or if most mattes see no person in what is.
    """
    if not maps:
        return None
    spacing = 2.0 * REACH / _SIZE
    axis = REACH * (2.0 * (np.arange(_SIZE) + 0.5) / _SIZE - 1.0)
    depths, sizes = stacked([np.nan_to_num(item.depth, posinf=0.0) for item in maps])
    total, count, person, seen = fuse_distance(
        axis, np.stack([item.camera.row(0) for item in maps]), depths, stacked(mattes)[0], sizes,
        _THICK * spacing)
    known = count >= 2
    mean = total / np.maximum(count, 1)
    shell = known & (mean < 0) & (seen > 0)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij", sparse=True)
    radius = np.sqrt(x * x + y * y + z * z)
    if (shell & (radius < 2 * _FOCUS)).sum() < 200:
        return None
    # How much the mattes call a place of the surface the person, over its surroundings.
    vote = (ndimage.gaussian_filter(person, 2.0)
            / np.maximum(ndimage.gaussian_filter(seen, 2.0), 1e-4)).astype(np.float32)
    usual = float(np.median(vote[shell & (radius < 1.0)]))
    if usual < _PERSON:
        return None
    surface = known & (seen > 0) & (abs(mean) < 1.0 / _THICK)
    planes = backing_planes(axis[np.argwhere(surface)[:, ::-1]], vote[surface],
                            np.concatenate([item.camera.position for item in maps]), usual)
    before = np.full(shell.shape, np.inf)
    for a, b, c, offset in planes:
        before = np.minimum(before, a * x + b * y + c * z - offset)
    ahead = before > 1.5 * spacing
    own = shell & ahead & (vote >= _DOUBT * usual)
    # Depth gives nothing hidden inside, nor on textureless surfaces. There the mattes vote as for a
    # visual hull: the views before which the point lies in the person's place.
    share = _hull_share(maps, mattes)
    hidden = ~known & ahead & (share >= _HIDDEN * np.median(share[shell & (radius < 1.0)]))
    parts, _ = ndimage.label(own | hidden)
    sizes = np.bincount(parts[own & (radius < 2 * _FOCUS)], minlength=1)
    if len(sizes) < 2 or not sizes[1:].any():
        return None
    whole = parts == sizes[1:].argmax() + 1
    near = ndimage.binary_dilation(whole, iterations=3) & (before > 0.5 * spacing)
    value = np.where(known, mean, np.where(whole, -1.0, 1.0))
    return Solid(float(axis[0]), spacing, np.where(near, value, 1.0).astype(np.float32))


def _hull_share(maps: list[DepthMap], mattes: list[Float32]) -> Float32:
    """The mean matte over the views that see every second point; 0 for under a quarter of them."""
    cameras = Camera.concatenate([item.camera for item in maps])
    share = mattes_share(cameras, mattes, REACH, _SIZE // 2)
    # Every eighth point is enough to know what the pictures show.
    inside = views_share(cameras, REACH, _SIZE // 8)
    return np.asarray(np.where(_larger(inside, 8) < 0.25, 0.0, _larger(share, 2)), np.float32)


def _larger(lattice: Array, factor: int) -> Array:
    """Each point repeated along z, y and x."""
    for axis in range(3):
        lattice = np.repeat(lattice, factor, axis)
    return lattice
