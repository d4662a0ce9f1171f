"""SIFT features of photos, and their matching in two rounds.

The features are OpenCV's SIFT as square roots of their parts (Arandjelovic and Zisserman 2012,
"Three things everyone should know to improve object retrieval"), stored in whole numbers. Products
of whole numbers below 2^24 are exact in float32, so the matches don't depend on the threads.

Most pairs of photos around a head show nothing in common. A first round compares the few hundred
largest features of all pairs, in a hundredth of the time; only pairs that it finds alike, and every
photo's best ones, are compared in full (Wu 2013, "Towards linear-time incremental structure from
motion").
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import cv2
import numpy as np

from ...arrays import Bool, Float32, Int64, UInt8, UInt32
from ...simd.threads import side_by_side

FEWEST = 15
"""Matches of a pair of photos that are worth checking, and must be left then, as COLMAP has it."""

Matches = UInt32

# Contrast of the weakest feature, for 8 bits and three layers an octave: as COLMAP has it.
_CONTRAST = 0.02
_UNIT = 512.0
# A match is nearer than this part of the second best, and not farther than this (unit length 1).
_RATIO, _FARTHEST = 0.8, 0.7
# The first round: largest features of a photo; matches that make a pair likely (the noise of a dark
# room has 5 to 15); best pairs of each photo that are compared whatever they have, and photos
# before and after in the order of names.
_FEW, _ALIKE, _BEST, _BESIDE = 700, 14, 12, 2
# Before one wall full of things everything is alike (4,357 of 4,371 pairs of a sweep). Where half
# of the likely pairs have so many matches, each photo is compared with its best pairs and with so
# many others, spread evenly from the most alike to the least. A sweep before a plain wall has 65
# and needs all of its pairs: with a part of them it could not be placed.
_PLENTY, _SPREAD = 75, 12
# Photos that are kept of a dense sweep: so many at least, and others until each is at least half as
# like so many as to the one that it is most like.
_FEWEST_KEPT, _AROUND = 56, 20
# Up to so many photos, all pairs are compared in full.
_ALL = 20
# What lies within so many pixels of one place in two photos has not moved; the mean share of such
# matches in a pair from which on the camera has not either.
_STILL, _STOOD_STILL = 1.5, 0.1
# Photos that are asked for that, before all are compared.
_ASKED = 32


@dataclass(frozen=True)
class Features:
    """Features of one photo."""

    places: Float32  # float32 [K, 2], pixels (x right, y down), pixel centres at +0.5.
    descriptors: UInt8  # uint8 [K, 128], of length 512 within rounding.
    large: Int64  # int64 [F], indices of the largest features, F at most 700.


def sift_features(image: UInt8, most: int, mask: UInt8 | None = None,
                  contrast: float = _CONTRAST) -> Features:
    """The strongest SIFT features, ``most`` at most, of a photo uint8 [H, W, 3].

    There are none where ``mask``, uint8 [H, W], is zero, nor of less contrast than ``contrast``.
    """
    grey = cv2.cvtColor(np.ascontiguousarray(image[..., :3]), cv2.COLOR_RGB2GRAY)
    sift: Any = getattr(cv2, "SIFT_create")(  # noqa: B009 (not in OpenCV's type stubs)
        contrastThreshold=contrast, enable_precise_upscale=True)
    points, raw = sift.detectAndCompute(grey, mask)
    # Threads find them in any order: strongest first, and ties by their place.
    order = sorted(range(len(points)), key=lambda number: (
        -points[number].response, points[number].pt, points[number].angle))[:most]
    found = [points[number] for number in order]
    if raw is None or not found:
        return Features(np.zeros((0, 2), np.float32), np.zeros((0, 128), np.uint8),
                        np.zeros(0, np.int64))
    raw = raw[order]
    roots = np.sqrt(raw / np.maximum(raw.sum(1, keepdims=True), 1e-9))
    places = np.array([point.pt for point in found], np.float32) + np.float32(0.5)
    sizes = np.array([point.size for point in found])
    return Features(places, np.minimum(_UNIT * roots + 0.5, 255).astype(np.uint8),
                    np.argsort(-sizes, kind="stable")[:_FEW])


def match_features(one: UInt8, other: UInt8) -> Matches:
    """Pairs of descriptors that are each other's nearest, clearly before the second.

    Of uint8 [K, 128] and [L, 128] of two photos; uint32 [M, 2], indices into both.
    """
    if len(one) < 2 or len(other) < 2:
        return np.zeros((0, 2), np.uint32)
    a, b = one.astype(np.float32), other.astype(np.float32)
    likeness = a @ b.T
    rows = np.arange(len(a))
    nearest = likeness.argmax(1)
    best = likeness[rows, nearest]
    likeness[rows, nearest] = -1.0
    second = likeness.max(1)
    # Squared distances of descriptors of unit length.
    apart = 2.0 - 2.0 * np.minimum(best / _UNIT**2, 1.0)
    beside = 2.0 - 2.0 * np.minimum(second / _UNIT**2, 1.0)
    good = np.flatnonzero((apart < _RATIO**2 * beside) & (apart < _FARTHEST**2))
    back = (b[nearest[good]] @ a.T).argmax(1)
    good = good[back == good]
    return np.stack([good, nearest[good]], 1).astype(np.uint32)


def enough(matches: dict[tuple[int, int], Matches]) -> dict[tuple[int, int], Matches]:
    """The pairs of photos with at least `FEWEST` matches."""
    return {pair: own for pair, own in matches.items() if len(own) >= FEWEST}


def camera_stood_still(features: list[Features], matches: dict[tuple[int, int], Matches]) -> bool:
    """Whether photos are of one camera on a tripod, before which the person turned.

    Then what is behind the person lies at one place in all photos: in 0.97 of the matches of a head
    before a room, while photos taken around a person have at most 0.07 in a pair, 0.001 in all.
    """
    shares = [float(_still(features, pair, own).mean()) for pair, own in matches.items()
              if len(own)]
    return bool(shares) and float(np.mean(shares)) > _STOOD_STILL


def camera_stands_still(features: list[Features]) -> bool:
    """Whether photos are of one camera on a tripod (`camera_stood_still`), by a few pairs of them.

    This is known before all pairs are compared; only the largest features are.
    """
    count = len(features)
    pairs = [(i, (i + count // 3) % count) for i in range(0, count, max(1, count // _ASKED))]
    large = [replace(own, places=own.places[own.large], descriptors=own.descriptors[own.large])
             for own in features]
    return camera_stood_still(large, {(i, j): match_features(large[i].descriptors,
                                                             large[j].descriptors)
                                      for i, j in pairs})


def without_still(features: list[Features], matches: dict[tuple[int, int], Matches],
                  ) -> dict[tuple[int, int], Matches]:
    """The matches of features that lie at one place in no two photos.

    All matches of a feature go that has been still once: its others are wrong, and more than right
    ones are left of the person.
    """
    still = [np.zeros(len(own.places), bool) for own in features]
    for pair, own in matches.items():
        at_rest = own[_still(features, pair, own)]
        for photo, numbers in zip(pair, at_rest.T):
            still[photo][numbers] = True
    return {(one, other): own[~still[one][own[:, 0]] & ~still[other][own[:, 1]]]
            for (one, other), own in matches.items()}


def _still(features: list[Features], pair: tuple[int, int], matches: Matches) -> Bool:
    """Which of the matches of a pair of photos lie at one place in both."""
    one, other = (features[photo].places[matches[:, side], :2] for side, photo in enumerate(pair))
    return np.asarray(np.abs(one - other).max(axis=1, initial=0.0) < _STILL)


def likeness(features: list[Features], on_progress: Callable[[int, int], None] | None = None,
             ) -> Int64:
    """How many of their largest features two photos share, of all pairs: int64 [V, V].

    Half of these features are compared first. Only where they do not show that two photos are alike
    (fewer than `_ALIKE` matches) all of them are, and matches up to that are counted.
    ``on_progress`` is called with the number of pairs looked at, and of all.
    """
    count = len(features)
    alike = np.zeros((count, count), np.int64)
    large = [own.descriptors[own.large] for own in features]
    half = [own[:_FEW // 2] for own in large]

    def compared(pair: tuple[int, int]) -> int:
        i, j = pair
        found = len(match_features(half[i], half[j]))
        if found < _ALIKE and max(len(large[i]), len(large[j])) > _FEW // 2:
            found = min(len(match_features(large[i], large[j])), _ALIKE)
        return found

    every = list(combinations(range(count), 2))
    for first in range(0, len(every), 100):
        if on_progress is not None:
            on_progress(first, len(every))
        some = every[first:first + 100]
        for (i, j), found in zip(some, side_by_side(compared, some)):
            alike[i, j] = alike[j, i] = found
    return alike


def _plenty(alike: Int64) -> bool:
    """Whether half of the likely pairs of photos have matches in plenty."""
    likely = alike[alike >= _ALIKE]
    return bool(len(likely)) and bool(np.median(likely) >= _PLENTY)


def worth_placing(alike: Int64) -> Int64:
    """The photos, int64 [K] in order, of a dense sweep that are enough: others lie between them.

    In a sweep of 96 frames over 28 degrees before a wall full of things, each photo is at least
    half as like (`likeness`) 35 others as to the one that it is most like. Fields of 56 of them, or
    of 42, are as good, inside the arc and beyond it, as fields of all. Photos from all around a
    head have 10 such others, of an arc with 1.75 degrees between two photos 13: all of these count.
    So do all of a sweep before a plain wall: with few features each photo helps to find the focal
    length. One after the other, that photo is taken which is least like those taken before.
    """
    count = len(alike)
    if not _plenty(alike):
        return np.arange(count)
    best = np.maximum(alike.max(axis=1), 1)
    relative = alike / np.sqrt(best[:, None] * best)
    around = float((relative >= 0.5).sum(axis=1).mean())
    wanted = max(_FEWEST_KEPT, round(_AROUND * count / max(around, 1e-9)))
    if wanted >= count:
        return np.arange(count)
    kept = [int(relative.sum(axis=1).argmax())]
    nearest = relative[kept[0]].copy()
    while len(kept) < wanted:
        nearest[kept] = np.inf
        kept.append(int(nearest.argmin()))
        nearest = np.maximum(nearest, relative[kept[-1]])
    return np.sort(kept)


def likely_pairs(alike: Int64) -> list[tuple[int, int]]:
    """Pairs (i, j), i < j, of photos that may show the same, by their `likeness`; in order."""
    count = len(alike)
    chosen = (alike >= _ALIKE) & ~_plenty(alike)
    for i in range(count):
        ranked = np.argsort(-alike[i], kind="stable")
        chosen[i, ranked[:_BEST]] = True
        likely = ranked[_BEST:][alike[i, ranked[_BEST:]] >= _ALIKE]
        chosen[i, likely[np.linspace(0, len(likely) - 1, min(_SPREAD, len(likely))).astype(int)]
               ] = True
        chosen[i, i + 1:i + 1 + _BESIDE] = True
    chosen |= chosen.T
    return [(i, j) for i, j in combinations(range(count), 2) if chosen[i, j] or count <= _ALL]


def neighbouring_pairs(count: int, reach: int = 12) -> list[tuple[int, int]]:
    """Each photo with those that follow it, and with those 2, 4, 8, ... farther on, in order."""
    pairs = {(i, j) for i in range(count) for j in range(i + 1, min(i + reach + 1, count))}
    pairs |= {(i, i + 2**k) for i in range(count) for k in range(12) if i + 2**k < count}
    return sorted(pairs)
