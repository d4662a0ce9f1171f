"""What two photos have in common: which of their matches one geometry of two views explains.

The estimators are OpenCV's MAGSAC++ (Barath et al. 2020, "MAGSAC++, a fast, reliable and accurate
robust estimator"), and the decisions between them are COLMAP's (Schoenberger and Frahm 2016,
"Structure-from-motion revisited"): where a homography explains nearly as many matches as the
epipolar geometry, the two photos are of a plane, or from one place, and determine no more. COLMAP's
own estimators find the same matches, in eight times the time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["Lens", "TwoViews", "two_views"]

_ROUGH = 8.0
"""Pixels that a match may lie off a rough geometry: more than it may in the end."""
_OFF = 3.0
"""Pixels that a match may lie off its geometry. By 4, as COLMAP has it, MAGSAC++ keeps a tenth more
matches of real photos than COLMAP does, which are the worst ones."""
_CONFIDENCE, _TRIALS = 0.9999, 2000
"""Trials are enough for a third of right matches."""
_FLAT = 0.8
"""Part of the epipolar geometry's matches which a homography explains if that is all there is."""
_FITS = 0.95
"""Part of them which known lenses explain, if they are as noted."""
_SHARE = 0.25
"""Part of a pair's matches that must be explained."""

Float32 = NDArray[np.float32]
Bools = NDArray[np.bool_]
Lens = tuple[float, tuple[int, int]]
"""Focal length in pixels, and size (width, height) of the photo."""


@dataclass(frozen=True)
class TwoViews:
    """The geometry of two views.

    Attributes
    ----------
    kind : COLMAP's name of it: ``CALIBRATED`` (with `essential`), ``UNCALIBRATED`` (with
        `fundamental`) or ``PLANAR_OR_PANORAMIC`` (with `homography`).
    inliers : bool [M], the matches that it explains.
    fundamental, essential, homography : float64 [3, 3] each, by pixels, by image planes at distance
        1, and by pixels; zero where it is not known.
    """

    kind: Literal["CALIBRATED", "UNCALIBRATED", "PLANAR_OR_PANORAMIC"]
    inliers: Bools
    fundamental: NDArray[np.float64]
    essential: NDArray[np.float64]
    homography: NDArray[np.float64]


def _robust(estimate: Any, one: NDArray[Any], other: NDArray[Any], *options: Any,
            ) -> tuple[NDArray[np.float64], Bools]:
    """A matrix [3, 3] and its inliers [M] by one of OpenCV's estimators, zero where it fails."""
    try:
        matrix, mask = estimate(one, other, *options)
    except cv2.error:  # places that determine nothing
        matrix = mask = None
    if matrix is None or mask is None or matrix.shape != (3, 3):
        return np.zeros((3, 3)), np.zeros(len(one), bool)
    return np.asarray(matrix, np.float64), np.asarray(mask.ravel() > 0)


def _plausible(one: Float32, other: Float32) -> Bools:
    """Which matches [M] one fundamental matrix explains within a few pixels, found in a hurry.

    It takes half a millisecond to see that nothing explains most of a pair's matches.
    """
    return _robust(cv2.findFundamentalMat, one, other, cv2.USAC_FAST, _ROUGH, 0.999, 500)[1]


def two_views(one: Float32, other: Float32, fewest: int,
              lenses: tuple[Lens, Lens] | None = None) -> TwoViews | None:
    """The geometry that explains the matches of two photos; always the same for the same matches.

    Parameters
    ----------
    one, other : float32 [M, 2], pixels.
    fewest : Matches that must be explained.
    lenses : Of both photos, if these are known.

    Returns
    -------
    geometry : None if none explains enough.
    """
    near = np.flatnonzero(_plausible(one, other))
    if len(near) < fewest:
        return None
    one, other, count = one[near], other[near], len(one)
    zero = np.zeros((3, 3))
    fundamental, explained = _robust(cv2.findFundamentalMat, one, other, cv2.USAC_MAGSAC, _OFF,
                                     _CONFIDENCE, _TRIALS)
    homography, flat = _robust(cv2.findHomography, one, other, cv2.USAC_FAST, _OFF, None, 500,
                               0.999)
    kind: Literal["CALIBRATED", "UNCALIBRATED", "PLANAR_OR_PANORAMIC"] = "UNCALIBRATED"
    inside, essential = explained, zero
    if lenses is not None:
        matrix, known = _by_lenses(one, other, lenses)
        # Lenses that are not as noted explain fewer.
        if known.sum() >= max(fewest, _FITS * explained.sum()):
            kind, inside, essential = "CALIBRATED", known, matrix
    if flat.sum() > _FLAT * inside.sum():
        kind = "PLANAR_OR_PANORAMIC"
        inside = flat if flat.sum() > inside.sum() else inside
    if inside.sum() < max(fewest, _SHARE * count):
        return None
    inliers = np.zeros(count, bool)
    inliers[near[inside]] = True
    return TwoViews(kind, inliers, fundamental, essential,
                    homography if kind == "PLANAR_OR_PANORAMIC" else zero)


def _by_lenses(one: Float32, other: Float32, lenses: tuple[Lens, Lens],
               ) -> tuple[NDArray[np.float64], Bools]:
    """The essential matrix of known lenses, and its inliers."""
    planes = [(places - np.array(size, np.float64) / 2) / focal
              for places, (focal, size) in zip((one, other), lenses)]
    off = 2 * _OFF / (lenses[0][0] + lenses[1][0])
    return _robust(cv2.findEssentialMat, planes[0], planes[1], np.eye(3), cv2.USAC_MAGSAC,
                   _CONFIDENCE, off, _TRIALS)
