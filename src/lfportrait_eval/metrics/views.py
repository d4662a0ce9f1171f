"""Views that are measured: whether they agree, and whether the head in them is still the person.

A point that two views see should look alike in both. For views i and j along a path, the stylised
view j is warped backwards into view i: each pixel of i is lifted to the surface by the real field's
depth and looked up where j sees that point. The pixels that count, M, are those whose surface both
views see: covered, not occluded (the two depths agree within 1 %) and away from depth edges::

    RMSE_ij = sqrt( sum M |O_i - W(O_j)|^2 / (3 sum M) )

Beside the raw error stand the floor, the same on the photoreal renders (resampling, highlights),
and the contrast-normalised error, divided by the standard deviation of O_i in M, which takes away
the reward for flat colors. The flow comes from the geometry alone: it is the same for every
method that is compared.

Identity: landmarks found in the stylised view against those in the real one. Contours: correlation
of the gradients of both. Both are plain figures without training; patches are in `patches`,
features and FID in `features`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.draw import polygon2mask

from lfportrait.arrays import Bool, Float32, Float64, UInt8
from lfportrait.capture import Camera
from lfportrait.example import face_size
from lfportrait.field import Rendering, VoxelField
from lfportrait.share import sweep_cameras

from .patches import PatchIndex

Comparison = Callable[[Float32, Float32, Bool], float]
"""Two pictures [H, W, 3], and the pixels that count -> a distance of them there, such as LPIPS."""

_TOLERANCE = 0.01


def _smooth(depth: Float32) -> Bool:
    """Pixels away from depth edges: all eight neighbours covered, and no step between them.

    A step shows in the second difference; a slanted surface does not.
    """
    padded = np.pad(np.asarray(depth, np.float64), 1, mode="edge")
    middle = padded[1:-1, 1:-1]
    covered = np.isfinite(ndimage.maximum_filter(depth, 3, mode="nearest"))
    with np.errstate(invalid="ignore"):
        across = np.abs(padded[1:-1, :-2] - 2 * middle + padded[1:-1, 2:])
        down = np.abs(padded[:-2, 1:-1] - 2 * middle + padded[2:, 1:-1])
        return covered & (np.maximum(across, down) < _TOLERANCE * middle)


def warp(image: NDArray[Any], cameras: Camera, source: int, target: int,
         depth_source: Float32, depth_target: Float32,
         ) -> tuple[Float32, Bool]:
    """Warp a view float [H, W, 3] backwards into another by depth.

    float32 [H', W', 3], the source's colors in the target view, bilinear; 0 where invalid; and bool
    [H', W']: both views see the same surface there, away from depth edges. Depths float32 [H, W]
    lie along the optical axis, infinite where there is no surface.
    """
    height, width = depth_target.shape
    valid = _smooth(depth_target)
    rows, columns = np.nonzero(valid)
    origins, directions = cameras.rays(target, np.stack([columns + 0.5, rows + 0.5], 1))
    along = depth_target[valid] / (directions @ cameras.pose[target, :3, 2])
    pixels, depth = cameras[source].project(origins + along[:, None] * directions)
    x, y, z = pixels[0, :, 0] - 0.5, pixels[0, :, 1] - 0.5, depth[0]
    source_height, source_width = depth_source.shape
    # A pixel's breadth of rounding is no reason to lose the border.
    x = np.where(np.abs(x - np.rint(x)) < 1e-6, np.rint(x), x)
    y = np.where(np.abs(y - np.rint(y)) < 1e-6, np.rint(y), y)
    inside = (z > 0) & (x >= 0) & (y >= 0) & (x <= source_width - 1) & (y <= source_height - 1)
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    surface = ndimage.map_coordinates(
        np.where(np.isfinite(depth_source), depth_source, 0.0), [y, x], order=1, mode="nearest")
    clear = _smooth(depth_source)[np.rint(y).astype(np.intp), np.rint(x).astype(np.intp)]
    seen = inside & clear & (np.abs(surface - z) < _TOLERANCE * z)
    warped = np.zeros((height, width, image.shape[2]), np.float32)
    places = rows[seen], columns[seen]
    for channel in range(image.shape[2]):
        warped[(*places, channel)] = ndimage.map_coordinates(
            np.asarray(image[..., channel], np.float32), [y[seen], x[seen]], order=1,
            mode="nearest")
    kept = np.zeros((height, width), bool)
    kept[places] = True
    return warped, kept


def pair_error(target: NDArray[Any], warped: NDArray[Any], valid: Bool,
               ) -> tuple[float, float]:
    """RMSE of a pair over the valid pixels, and the same over the target's contrast.

    Both NaN where no pixel is valid; the second also where that contrast is below one grey level.
    """
    if not valid.any():
        return float("nan"), float("nan")
    wanted = target[valid].astype(np.float64)
    rmse = float(np.sqrt(((wanted - warped[valid]) ** 2).mean()))
    contrast = float(np.sqrt(wanted.var(axis=0).mean()))
    return rmse, rmse / contrast if contrast > 1 / 255 else float("nan")


def view_pairs(count: int, gap: int) -> list[tuple[int, int]]:
    """Pairs (earlier, later) of views ``gap`` apart along a path."""
    return [(view, view + gap) for view in range(count - gap)]


def consistency(stylised: Sequence[NDArray[Any]], renderings: Sequence[Rendering],
                cameras: Camera, gaps: Iterable[int] = (1, 7, 10),
                compare: Mapping[str, Comparison] | None = None) -> dict[str, Any]:
    """Consistency of stylised views along a path, over short and long gaps.

    For ``gap_1``, ``gap_7``, ..., ``extremes``: ``rmse``, ``floor_rmse`` (the real field),
    ``normalised``, ``floor_normalised``, ``valid`` (share of the surface's pixels that count),
    ``pairs``, and those of ``compare``; means over the pairs.

    Parameters
    ----------
    stylised : V stylised views, float [H, W, 3] in [0, 1].
    renderings : The same views of the real field: colors for the floor, depths for the warps.
    cameras : V cameras, in order along an arc.
    gaps : Distances between the views of a pair; those that are too long are left out. The two
        outermost views are always compared, as ``extremes``.
    compare : Further distances by name, of a stylised view and the other one warped into it.
    """
    count = len(stylised)
    if not (len(renderings) == len(cameras) == count):
        raise ValueError("views, renderings and cameras must have one entry each")
    groups = {f"gap_{gap}": view_pairs(count, gap) for gap in gaps if 0 < gap < count}
    if count > 1:
        groups["extremes"] = [(0, count - 1)]
    return {name: _group(pairs, stylised, renderings, cameras, compare or {})
            for name, pairs in groups.items()}


def _group(pairs: list[tuple[int, int]], stylised: Sequence[NDArray[Any]],
           renderings: Sequence[Rendering], cameras: Camera,
           compare: Mapping[str, Comparison]) -> dict[str, float]:
    """Means over the pairs of one gap."""
    rows = []
    for first, second in pairs:
        target, source = renderings[first], renderings[second]
        both = np.concatenate([stylised[second], np.clip(source.color, 0, 1)], axis=2)
        warped, valid = warp(both, cameras, second, first, source.depth, target.depth)
        surface = max(int(np.isfinite(target.depth).sum()), 1)
        rows.append((*pair_error(np.asarray(stylised[first]), warped[..., :3], valid),
                     *pair_error(np.clip(target.color, 0, 1), warped[..., 3:], valid),
                     float(valid.sum()) / surface,
                     *(distance(np.asarray(stylised[first], np.float32), warped[..., :3], valid)
                       if valid.any() else float("nan") for distance in compare.values())))
    # Pairs without a common surface count for nothing.
    means = known_means(np.array(rows))
    names = ("rmse", "normalised", "floor_rmse", "floor_normalised", "valid", *compare)
    return {**dict(zip(names, map(float, means))), "pairs": len(pairs)}


def known_means(rows: Float64) -> Float64:
    """Means of each column's finite values; NaN where it has none."""
    known = np.isfinite(rows)
    totals = np.where(known, rows, 0.0).sum(axis=0)
    return np.where(known.any(axis=0), totals / np.maximum(known.sum(axis=0), 1), np.nan)


Detector = Callable[[UInt8], Float64 | None]

_OUTER_EYES = (36, 45)
_INNER = slice(17, 68)


def face_region(shape: tuple[int, ...], landmarks: NDArray[np.floating]) -> Bool:
    """The face between jaw and brows, which every method paints; bool [H, W]."""
    outline = np.concatenate([landmarks[:17], landmarks[17:27][::-1]])
    return np.asarray(polygon2mask(shape[:2], outline[:, ::-1]), bool)


def landmark_error(found: NDArray[np.floating], wanted: NDArray[np.floating]) -> float:
    """Mean distance of the 51 inner landmarks over the distance of the outer eye corners.

    Landmarks are [68, 2] pixels, iBUG order; the eyes are those of ``wanted``.
    """
    eyes = float(np.linalg.norm(wanted[_OUTER_EYES[0]] - wanted[_OUTER_EYES[1]]))
    return float(np.linalg.norm(found[_INNER] - wanted[_INNER], axis=1).mean()) / max(eyes, 1e-9)


def identity(stylised: Sequence[UInt8], real: Sequence[UInt8],
             detect: Detector) -> dict[str, float]:
    """Landmark error between stylised and real pictures of the same views, uint8 [H, W, 3] each.

    ``nme`` (mean over the views where both faces are found, NaN if there is none), ``detected``
    (share of the faces found in the real views that are found in the stylised ones), ``views``
    (faces found in the real views). ``detect`` gives landmarks [68, 2] of a picture, or None.
    """
    errors, views = [], 0
    for painted, photo in zip(stylised, real, strict=True):
        wanted = detect(photo)
        if wanted is None:
            continue
        views += 1
        found = detect(painted)
        if found is not None:
            errors.append(landmark_error(found, wanted))
    return {"nme": float(np.mean(errors)) if errors else float("nan"),
            "detected": len(errors) / views if views else float("nan"), "views": views}


def contour_correlation(a: NDArray[Any], b: NDArray[Any], mask: Bool) -> float:
    """Correlation in [-1, 1] of the gradient magnitudes (grey, sigma 1.5) of two pictures."""
    strengths = [ndimage.gaussian_gradient_magnitude(
        np.asarray(image, np.float64) @ (0.299, 0.587, 0.114), 1.5)[mask] for image in (a, b)]
    if min(strength.std() for strength in strengths) < 1e-9:
        return float("nan")
    return float(np.corrcoef(strengths)[0, 1])


Pictures = list[Float32]

FACE = 0.145
"""Size of a face (`lfportrait.example.face_size`) in a view framed like a sweep, over the width of
the picture: 0.14 to 0.15 on the heads that were measured."""


def arc_cameras(field: VoxelField, degrees: Sequence[float] | NDArray[np.floating],
                size: int) -> Camera:
    """Cameras framed like a sweep of a field, of ``size`` pixels a side.

    A yaw of 0 ``degrees`` is the front, positive yaws are towards +x.
    """
    front = sweep_cameras(0.0, 1, size, field)
    # A sweep's cameras differ in yaw alone: turn the frontal one about the vertical axis.
    poses = []
    for yaw in np.radians(degrees):
        turn = np.eye(4)
        turn[0, 0] = turn[2, 2] = np.cos(yaw)
        turn[0, 2], turn[2, 0] = np.sin(yaw), -np.sin(yaw)
        poses.append(turn @ front.pose[0])
    return Camera(np.array(poses), front.focal[0], front.center[0], front.width[0], front.height[0])


_AWAY = 4.4
"""Distance of cameras from the middle of the head, in the field's units."""


def head_cameras(landmarks: NDArray[np.floating], degrees: Sequence[float] | NDArray[np.floating],
                 size: int, *, room: float = 1.0,
                 back: float = 0.13) -> Camera:
    """Cameras whose pictures the head fills, so that strokes are as large as in an exemplar.

    Parameters
    ----------
    landmarks : [68, 3] in space.
    degrees, size : Yaw of each camera, and pixels a side of its picture.
    room : Height of what is seen, over 2.3 times the distance of brows and chin.
    back : How far the middle lies behind the landmarks' mean, in the same heights: 0.13 for views
        from the front, a quarter where profiles shall not lose the back of the head.
    """
    brows, chin = float(np.nanmean(landmarks[17:27, 1])), float(np.nanmin(landmarks[:, 1]))
    high = 2.3 * (brows - chin)
    middle = np.nanmean(landmarks, axis=0) + high * np.array([0.0, 0.1, -back])
    return Camera.arc(np.asarray(degrees, np.float64), distance=_AWAY, width=size, height=size,
                      focal=size * _AWAY / (room * high), target=middle)


def face_unit(field: VoxelField, size: int, landmarks: NDArray[np.floating] | None = None) -> float:
    """Size of the face in pixels in a frontal view of ``size`` pixels framed like a sweep.

    Without ``landmarks`` [68, 3] in space the size that heads usually have (`FACE`).
    """
    if landmarks is None:
        return FACE * size
    pixels, _ = arc_cameras(field, [0.0], size).project(np.asarray(landmarks, np.float64))
    return face_size(pixels[0])


@dataclass(frozen=True)
class Arc:
    """The real field seen along an arc: what stylised fields are measured against."""

    cameras: Camera  # V cameras in order, an odd number for a view from the front.
    real: list[Rendering]  # V renderings.

    @staticmethod
    def of(field: VoxelField, cone: float = 40.0, views: int = 21, size: int = 384,
           say: Callable[[str], None] = lambda text: None) -> Arc:
        """Render an arc of so many degrees, with some views of ``size`` pixels on it, evenly apart.

        ``say`` is called with what is being done.
        """
        cameras = arc_cameras(field, np.linspace(-cone / 2, cone / 2, views), size)
        real = []
        for view in range(views):
            say(f"view {view + 1} of {views}")
            real.append(field.render(cameras, view))
        return Arc(cameras, real)

    @property
    def masks(self) -> list[Bool]:
        """Where the head is, bool [H, W] each."""
        return [shot.alpha > 0.5 for shot in self.real]

    def seen(self, styled: VoxelField) -> Pictures:
        """The same views of a stylised field, float32 [H, W, 3] in [0, 1] each."""
        return [np.clip(styled.render(self.cameras, view).color, 0, 1)
                for view in range(len(self.real))]

    def consistency(self, painted: Pictures) -> dict[str, dict[str, float]]:
        """How well the stylised views agree (`consistency.consistency`)."""
        return consistency(painted, self.real, self.cameras)

    def contours(self, painted: Pictures) -> float:
        """Contours kept in the middle view, in [-1, 1] (`likeness.contour_correlation`)."""
        middle = len(self.real) // 2
        return contour_correlation(painted[middle], np.clip(self.real[middle].color, 0, 1),
                                   self.masks[middle])


def views_fidelity(styled: VoxelField, patches: PatchIndex,
                   degrees: Sequence[float] = (0.0, 45.0), size: int = 768,
                   seed: int = 0) -> float:
    """Patch fidelity of views of a stylised field, as large as an exemplar's own picture.

    Mean over views at some yaws, ``size`` pixels wide and high, of `PatchIndex.fidelity` on the
    head (opacity over 0.5), in delta E.
    """
    cameras = arc_cameras(styled, degrees, size)
    shots = [styled.render(cameras, view) for view in range(len(cameras))]
    return float(np.mean([patches.fidelity(np.clip(shot.color, 0, 1), shot.alpha > 0.5, seed=seed)
                          for shot in shots]))
