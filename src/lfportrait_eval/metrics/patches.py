"""How far a picture's patches are from the nearest patches of an exemplar.

The search is exact over all patches of the exemplar (`kernels.nearest_patch`), and the patches are
spread evenly: the picture is divided into squares, and each gives one patch, at a random place. A
plain random sample of as many scatters several times as much.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfportrait.arrays import Bool, Float32, Int64

from .kernels import nearest_patches

COMPONENTS = 15
"""Main components that a patch is known by."""
LEAF = 32
"""Patches of a leaf of the tree, about."""
SAMPLES = 8000
"""Patches looked up by default."""


def lab(image: NDArray[Any]) -> Float32:
    """A picture [H, W, 3], uint8 or float in [0, 1], in CIE Lab, float32."""
    from skimage.color import rgb2lab

    values = image.astype(np.float64) / 255.0 if image.dtype == np.uint8 else image
    return np.ascontiguousarray(rgb2lab(np.clip(values, 0.0, 1.0)), np.float32)


def spread_places(allowed: Bool, samples: int, seed: int = 0) -> Int64:
    """About ``samples`` places spread evenly over a mask [H, W]: one in each of equal squares.

    int64 [N, 2], rows and columns, square by square; all places if there are fewer.
    """
    side = max(1, int(np.sqrt(allowed.sum() / max(samples, 1))))
    height, width = allowed.shape
    corners = np.stack(np.meshgrid(np.arange(0, height, side), np.arange(0, width, side),
                                   indexing="ij"), axis=-1).reshape(-1, 2)
    inside = np.random.default_rng(seed).integers(0, side, corners.shape)
    places = corners + inside
    places = places[(places < (height, width)).all(axis=1)]
    return np.asarray(places[allowed[places[:, 0], places[:, 1]]], np.int64)


class PatchIndex:
    """All patches of one exemplar, to look up the nearest ones of any picture's.

    It is [h, w, 3], uint8 or float in [0, 1]; ``size`` is the side of a patch in pixels, odd.
    """

    def __init__(self, exemplar: NDArray[Any], size: int = 7) -> None:
        self.size = size
        self.picture = lab(exemplar)
        patches = self._patches(self.picture)
        count = patches.shape[0] * patches.shape[1]
        every = max(1, count // 20000)
        some = patches.reshape(count, *patches.shape[2:])[::every].reshape(-1, 3 * size * size)
        self.mean = some.mean(axis=0)
        _, vectors = np.linalg.eigh(np.cov(some - self.mean, rowvar=False)
                                    + 1e-9 * np.eye(some.shape[1]))
        self.basis = np.ascontiguousarray(vectors[:, ::-1][:, :COMPONENTS], np.float32)
        rows, columns = np.divmod(np.arange(count), patches.shape[1])
        self.keys, self.order, self.leaf = _leaves(self._short(self.picture, rows, columns))
        self.low, self.high = _boxes(self.keys, self.leaf)

    def _patches(self, picture: Float32) -> Float32:
        """All patches, float32 [h, w, 3, size, size], a view."""
        return np.lib.stride_tricks.sliding_window_view(picture, (self.size, self.size),
                                                        axis=(0, 1))

    def _short(self, picture: Float32, rows: Int64, columns: Int64) -> Float32:
        """Short vectors of patches: main components, and the length of what they leave out."""
        patches = self._patches(picture)
        out = np.empty((len(rows), COMPONENTS + 1), np.float32)
        for first in range(0, len(rows), 16384):
            part = slice(first, first + 16384)
            values = patches[rows[part], columns[part]].reshape(-1, self.mean.size) - self.mean
            out[part, :-1] = values @ self.basis
            left = (np.einsum("nd,nd->n", values, values)
                    - np.einsum("nd,nd->n", out[part, :-1], out[part, :-1]))
            out[part, -1] = np.sqrt(np.maximum(left, 0))
        return out

    def distances(self, image: NDArray[Any], rows: Int64, columns: Int64) -> Float32:
        """Distances of patches to the exemplar's nearest, float32 [Q].

        They are root mean square differences in CIE Lab over a patch's pixels (delta E). ``rows``
        and ``columns`` [Q] are the patches' first pixels, faster where neighbours follow each
        other.
        """
        picture = lab(image)
        out = np.empty(len(rows), np.float32)
        height, width = self.picture.shape[:2]
        nearest_patches(_padded(picture), picture.shape[1], rows, columns,
                        self._short(picture, rows, columns).ravel(), _padded(self.picture), width,
                        height, self.size, self.keys.ravel(), self.order, self.leaf,
                        self.low.ravel(), self.high.ravel(), out)
        return np.asarray(np.sqrt(out / self.size ** 2), np.float32)

    def fidelity(self, image: NDArray[Any], mask: Bool | None = None, *,
                 samples: int = SAMPLES, seed: int = 0) -> float:
        """Mean of `distances`; see `patch_fidelity`."""
        half = self.size // 2
        shape = image.shape[0] - 2 * half, image.shape[1] - 2 * half
        allowed = (np.ones(shape, bool) if mask is None else
                   np.asarray(mask, bool)[half:half + shape[0], half:half + shape[1]])
        rows, columns = np.ascontiguousarray(spread_places(allowed, samples, seed).T)
        return float(self.distances(image, rows, columns).mean()) if len(rows) else float("nan")


def _padded(picture: Float32) -> Float32:
    """A picture's values and 16 more, flat."""
    return np.concatenate([picture.ravel(), np.zeros(16, np.float32)])


def _leaves(keys: Float32) -> tuple[Float32, Int64, Int64]:
    """Vectors [N, C] in the order of a tree's leaves, that order, and each leaf's first.

    Every node is cut at the median of the component that spreads most.
    """
    order = np.arange(len(keys))
    borders = [0, len(keys)]
    while (borders[1] - borders[0]) > LEAF and len(keys) >= 2 * len(borders):
        finer = [0]
        for first, last in pairwise(borders):
            part = keys[order[first:last]]
            widest = int(np.argmax(part.max(axis=0) - part.min(axis=0)))
            middle = (last - first) // 2
            order[first:last] = order[first:last][np.argpartition(part[:, widest], middle)]
            finer += [first + middle, last]
        borders = finer
    return np.ascontiguousarray(keys[order]), order, np.asarray(borders, np.int64)


def _boxes(keys: Float32, leaf: Int64) -> tuple[Float32, Float32]:
    """Least and largest components of all nodes of a tree, float32 [2 L, C] each."""
    count = len(leaf) - 1
    low, high = (np.empty((2 * count, keys.shape[1]), np.float32) for _ in range(2))
    low[count:] = np.minimum.reduceat(keys, leaf[:-1])
    high[count:] = np.maximum.reduceat(keys, leaf[:-1])
    while count > 1:
        half = count // 2
        low[half:count] = np.minimum(low[count:2 * count:2], low[count + 1:2 * count:2])
        high[half:count] = np.maximum(high[count:2 * count:2], high[count + 1:2 * count:2])
        count = half
    low[0], high[0] = low[1], high[1]
    return low, high


def patch_fidelity(image: NDArray[Any], exemplar: NDArray[Any],
                   mask: Bool | None = None, *,
                   samples: int = SAMPLES, seed: int = 0) -> float:
    """Mean distance of a picture's patches to their nearest patches of the exemplar.

    Root mean square difference in CIE Lab over a patch's pixels (delta E), mean over the patches; 0
    for a picture copied from the exemplar. NaN where the mask leaves nothing.

    Parameters
    ----------
    image, exemplar : [H, W, 3] and [H', W', 3], uint8 or float in [0, 1].
    mask : bool [H, W], where the middles of the patches may lie; everywhere by default.
    samples : Patches looked up, about; see `spread_places`.
    """
    return PatchIndex(exemplar).fidelity(image, mask, samples=samples, seed=seed)
