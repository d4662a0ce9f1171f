"""How well stylised views agree with each other, warped by the field's own depth and poses.

A point that two views see should look alike in both. For views i and j along a path, the stylised
view j is warped backwards into view i: each pixel of i is lifted to the surface by the real field's
depth and looked up where j sees that point. The pixels that count, M, are those whose surface both
views see: covered, not occluded (the two depths agree within 1 %) and away from depth edges::

    RMSE_ij = sqrt( sum M |O_i - W(O_j)|^2 / (3 sum M) )

Beside the raw error stand the floor, the same on the photoreal renders (resampling, highlights),
and the contrast-normalised error, divided by the standard deviation of O_i in M, which takes away
the reward for flat colors. The flow comes from the geometry alone: it is the same for every
method that is compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lfportrait.capture import Camera
from lfportrait.field import Rendering

__all__ = ["Comparison", "consistency", "pair_error", "view_pairs", "warp"]

Comparison = Callable[[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]], float]
"""Two pictures [H, W, 3], and the pixels that count -> a distance of them there, such as LPIPS."""

_TOLERANCE = 0.01


def _smooth(depth: NDArray[np.float32]) -> NDArray[np.bool_]:
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
         depth_source: NDArray[np.float32], depth_target: NDArray[np.float32],
         ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Warp a view backwards into another by depth.

    Parameters
    ----------
    image
        float [H, W, 3], seen from view ``source``.
    cameras, source, target
        The two views.
    depth_source, depth_target
        float32 [H, W], depth along the optical axis, infinite where there is no surface.

    Returns
    -------
    warped
        float32 [H', W', 3], the source's colors in the target view, bilinear; 0 where invalid.
    valid
        bool [H', W']: both views see the same surface there, away from depth edges.
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


def pair_error(target: NDArray[Any], warped: NDArray[Any], valid: NDArray[np.bool_],
               ) -> tuple[float, float]:
    """RMSE of a pair over the valid pixels, and the same over the target's contrast.

    Returns
    -------
    rmse, normalised
        Both NaN where no pixel is valid; the second also where the target's contrast is below one
        grey level.
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

    Parameters
    ----------
    stylised
        V stylised views, float [H, W, 3] in [0, 1].
    renderings
        The same views of the real field: colors for the floor, depths for the warps.
    cameras
        V cameras, in order along an arc.
    gaps
        Distances between the views of a pair; those that are too long are left out. The two
        outermost views are always compared, as ``extremes``.
    compare
        Further distances by name, of a stylised view and the other one warped into it.

    Returns
    -------
    figures
        For ``gap_1``, ``gap_7``, ..., ``extremes``: ``rmse``, ``floor_rmse`` (the real field),
        ``normalised``, ``floor_normalised``, ``valid`` (share of the surface's pixels that count),
        ``pairs``, and those of ``compare``; means over the pairs.
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
    table = np.array(rows)
    known = np.isfinite(table)
    totals = np.where(known, table, 0.0).sum(axis=0)
    means = np.where(known.any(axis=0), totals / np.maximum(known.sum(axis=0), 1), np.nan)
    names = ("rmse", "normalised", "floor_rmse", "floor_normalised", "valid", *compare)
    return {**dict(zip(names, map(float, means))), "pairs": len(pairs)}
