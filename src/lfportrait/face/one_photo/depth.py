"""The depth that a portrait photo keeps, laid over the fitted head: true for hair and shoulders.

Phones write how far things are, by two lenses or by a network, of a scale and a zero that are often
not known, and too coarsely for a face. The face's own depth is known from the fitted head, so the
photo's is fitted to it there, in inverse distances, in which both unknowns are linear (as for
monocular depth, Ranftl et al. 2020). Elsewhere it then says where hair, neck and shoulders are.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...arrays import Bool, Float64
from ...capture import Camera
from ...media.depth import DepthMap
from .parts import Parts

RIM = 0.04  # Width along the outline, in portrait units, where depth maps mix person and ground.
NECK = 0.2
"""Length, in portrait units, over which a body leaves the model's neck for the photo's depth."""
SMOOTH = 0.02  # Depth is smoothed over so much, portrait units.
FACE = 0.55  # What of the model lies so far behind its nearest point is face, portrait units.
OFF, FLAT = 0.06, 0.8
"""A depth that is further off in the face (median, portrait units) is none, nor is one that is
further off than this part of the face's own relief (its median deviation)."""
FAR = 4.0  # Median deviations from a line up to which a place agrees with it.
LEAST = 300  # Cells of the face, at least, that it must know.
AHEAD, BEHIND = 0.6, 1.5
"""What lies further before or behind the nearest point of the face is none of the person."""


@dataclass(frozen=True)
class Sensed:
    """A photo's depth on the grid of `Parts`."""

    # float64 [h, w], along the camera's axis, portrait units; NaN where it is not known.
    depth: Float64
    off: float  # Median distance from the face's own depth, portrait units.


def sensed_depth(depth: DepthMap, camera: Camera, parts: Parts, near: Float64) -> Sensed | None:
    """A photo's depth, fitted to the head.

    Parameters
    ----------
    depth : What the photo's file keeps.
    near : float64 [h, w], depth of the fitted head's front on their grid, NaN beside it.

    Returns
    -------
    sensed : None where it does not fit the face.
    """
    inverse = _inverse(depth, camera, parts)
    sure = parts.inside * parts.cell > RIM
    face = sure & np.isfinite(near) & np.isfinite(inverse) & ~parts.hair
    # At its own outline, before hair and neck, it is as uncertain.
    face = ndimage.binary_erosion(face, iterations=max(1, round(RIM / parts.cell)))
    if face.sum() < LEAST:
        return None
    nearest = float(near[face].min())
    face &= near < nearest + FACE
    known, true = inverse[face], 1.0 / near[face]
    if np.ptp(known) <= 0 or np.ptp(true) <= 0:
        return None
    # The map is what is wrong in places, so it is what is explained. But the head is only about
    # right, too: of what agrees, the slopes of both ways are averaged, each of which is too flat.
    slope, zero = _line(true, known)
    away = np.abs(known - slope * true - zero)
    agree = away <= FAR * np.median(away)
    back = _line(known[agree], true[agree])[0] if np.ptp(known[agree]) > 0 else 0.0
    if slope <= 0 or back <= 0:
        return None
    slope = float(np.sqrt(slope / back))
    zero = float(np.median(known - slope * true))
    with np.errstate(divide="ignore", invalid="ignore"):
        found = slope / (inverse - zero)
    off = float(np.median(np.abs(found[face] - near[face])))
    relief = float(np.median(np.abs(near[face] - np.median(near[face]))))
    if not off < min(OFF, FLAT * relief):
        return None
    sure &= (found > nearest - AHEAD) & (found < nearest + BEHIND)
    return Sensed(smoothed(np.where(sure, found, np.nan), SMOOTH / parts.cell), off)


def _inverse(depth: DepthMap, camera: Camera, parts: Parts) -> Float64:
    """Inverse distances along the axis, in the file's unit, on the grid; NaN = unknown."""
    values = np.asarray(depth.values, np.float32)
    known = np.isfinite(values) & (values > 0 if depth.kind == "distance" else values >= 0)
    if depth.confidence is not None:
        known &= depth.confidence > 0.1
    values = np.where(known, values, np.float32(1.0))
    if depth.kind == "distance":
        values = np.float32(1.0) / values
    height, width = parts.inside.shape
    factor = float(parts.camera.focal[0, 0] / camera.focal[0, 0])
    x = (np.arange(width) + 0.5 - parts.camera.center[0, 0]) / factor + camera.center[0, 0]
    y = (np.arange(height) + 0.5 - parts.camera.center[0, 1]) / factor + camera.center[0, 1]
    within = ((x > 0) & (x < int(camera.width[0])))[None] & (
        (y > 0) & (y < int(camera.height[0])))[:, None]
    across, down = depth.ratio((int(camera.width[0]), int(camera.height[0])))
    columns, rows = (np.broadcast_to(place, (height, width)).astype(np.float32) for place in (
        x[None] / across - 0.5, y[:, None] / down - 0.5))

    def moved(numbers: NDArray[np.float32]) -> Float64:
        return np.asarray(cv2.remap(np.ascontiguousarray(numbers), columns, rows,
                                    cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float64)

    # What is known in part only is not blended with what is not.
    out = np.where(within & (moved(known.astype(np.float32)) > 0.99), moved(values), np.nan)
    if depth.along == "ray":
        slant = np.hypot((x - camera.center[0, 0]) / camera.focal[0, 0], 0)[None] ** 2 + (
            ((y - camera.center[0, 1]) / camera.focal[0, 1]) ** 2)[:, None]
        out *= np.sqrt(1.0 + slant)
    return out


def _line(at: Float64, values: Float64) -> tuple[float, float]:
    """The line through points by their least absolute deviations: slope and height."""
    middle, unit = float(np.median(at)), float(np.std(at))
    design = np.column_stack([(at - middle) / unit, np.ones(len(at))])
    weights, found = np.ones(len(at)), np.zeros(2)
    least = 1e-4 * float(np.std(values))
    for _ in range(20):  # reweighted least squares
        scaled = design * weights[:, None]
        solved = np.linalg.lstsq(scaled.T @ design, scaled.T @ values, rcond=None)[0]
        found = np.asarray(solved, np.float64)
        weights = 1.0 / np.maximum(np.abs(values - design @ found), least)
    return float(found[0]) / unit, float(found[1] - found[0] * middle / unit)


def smoothed(values: Float64, sigma: float) -> Float64:
    """A map smoothed over its known places; unknown (NaN) ones stay so."""
    known = np.isfinite(values)
    total = cv2.GaussianBlur(np.where(known, values, 0.0), (0, 0), sigma)
    weight = cv2.GaussianBlur(known.astype(np.float64), (0, 0), sigma)
    return np.asarray(np.where(known, total / np.maximum(weight, 1e-9), np.nan), np.float64)


def hair_squares(sensed: Sensed, middle: Float64, hair: Bool, given: Float64, cell: float,
                 ) -> Float64:
    """Squares of hair's half thicknesses in front, given where the photo's depth is known.

    Parameters
    ----------
    middle : float64 [h, w], depth of the piece's middle.
    hair : bool [h, w].
    given : float64 [h, w], squares that are given already, NaN elsewhere.
    cell : Width of a cell, portrait units.
    """
    thick = np.maximum(middle - sensed.depth, 0.1 * RIM)
    # Next to the skin it goes over into that, as all hair does.
    inner = ndimage.distance_transform_edt(~np.isfinite(given)) * cell > RIM
    return np.where(hair & inner & np.isfinite(thick), thick ** 2, given)


def hair_before(sensed: Sensed, hair: Bool) -> Float64:
    """Depth [h, w] of hair where it is known, 0 elsewhere: nothing of the skull lies before it."""
    return np.where(hair & np.isfinite(sensed.depth), sensed.depth, 0.0)


def middle_behind(sensed: Sensed, front: Float64, middle: Float64, neck: Bool, cell: float,
                  ) -> Float64:
    """Depth of a body's middle for which its front lies where the photo's depth says.

    Parameters
    ----------
    front : float64 [h, w], squares of the half thicknesses in front.
    middle : float64 [h, w], its depth without a photo's.
    neck : bool [h, w], where the body meets the model's neck: there it stays.
    cell : Width of a cell, portrait units.
    """
    wanted = sensed.depth + np.sqrt(np.maximum(front, 0)) - middle
    known = np.isfinite(wanted) & (front > 0)
    if not known.any():
        return middle
    # Beyond what is known, as at the nearest place that is.
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    away = cv2.GaussianBlur(wanted[tuple(nearest)], (0, 0), max(0.5, 1.5 * SMOOTH / cell))
    share = np.clip(ndimage.distance_transform_edt(~neck) * cell / NECK, 0, 1)
    return np.asarray(middle + share * share * (3 - 2 * share) * away, np.float64)
