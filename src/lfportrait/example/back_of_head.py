"""Synthesise the back of head and neck, which no exemplar shows, from the parts it does show.

An exemplar shows a head from the front. Behind the cheeks the surface is divided into cells around
jittered sites of the anchor plane, and each cell is a piece of the exemplar's hair (or of its neck)
as it is, at a place of its own: rigid pieces keep their strokes, pieces from different places do
not repeat in bands, and sites that lie on the surface are the same in every view.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from ..labels import PICTURE_LABELS
from .exemplar import Exemplar
from .guides.filters import broad_blur, grey
from .guides.regions import Regions
from .kernels.seeds import nearest_sites, seed_points

__all__ = ["Patchwork", "Sites"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

HAIR, NECK = 0, 1
"""Materials of the pieces; -1 stands for a place that the exemplar shows."""
CROWN = np.radians(75.0)
"""Angle from the forward direction from which the head above the brows is patchwork."""
BEHIND_EARS = np.radians(125.0)
"""And below the brows: the jaw's ends lie at 90 degrees, ears up to 115, a cell reaches 8."""
NAPE = np.radians(100.0)
"""And below the ears."""
SPREAD = 0.35
"""Pieces come from places up to this far from the guided one, over the exemplar's face size."""
SIDE = 0.3
"""Side of a cell over the exemplar's face size."""
ALIKE = 0.35
"""Share of the places that pieces of the neck come from: the plainest, most like the rest."""
SHOULDER = np.radians(50.0)
"""Angle from which what an exemplar without shoulders does not show is patchwork."""
EDGE = 0.35
"""Clothes are what lies further inside the person than this, over the exemplar's face size."""
SHORT = 1.4
"""An exemplar that ends less deep than this (brows 0, chin 1) shows no shoulders."""


@dataclass
class Sites:
    """Jittered sites of cells of the anchor plane.

    Attributes
    ----------
    points
        float32 [Y, X, 2], in exemplar pixels.
    chances
        float32 [Y, X, 2], two random numbers in [0, 1) of each.
    first
        The first cell (column, row).
    """

    points: Float32
    chances: Float32
    first: tuple[int, int]

    @staticmethod
    def around(places: Float32, side: float) -> Sites:
        """The sites of all cells of ``side`` pixels that hold one of the places [N, 2]."""
        low, high = np.floor(places.min(axis=0) / side), np.floor(places.max(axis=0) / side)
        first = int(low[0]) - 1, int(low[1]) - 1
        shape = int(high[1]) - first[1] + 2, int(high[0]) - first[0] + 2, 2
        points, chances = np.empty(shape, np.float32), np.empty(shape, np.float32)
        seed_points(0, 0, *first, points)
        seed_points(1, 0, *first, chances)
        return Sites(points * np.float32(side), np.asarray(chances - np.floor(chances)), first)


class Patchwork:
    """Pieces of one exemplar for what it does not show.

    Parameters
    ----------
    exemplar
        The painting.
    regions
        Of the exemplar.
    """

    def __init__(self, exemplar: Exemplar, regions: Regions) -> None:
        self.side, self.spread = SIDE * exemplar.size, SPREAD * exemplar.size
        luma = grey(exemplar.image)
        self._mean = broad_blur(luma, 0.6 * self.side)
        self._contrast = np.sqrt(np.maximum(
            broad_blur(luma * luma, 0.6 * self.side) - self._mean ** 2, 0))
        self.short = regions.lowest() < SHORT
        right, down = regions.frame.local(regions.person.shape)
        hair = (regions.hair if regions.hair is not None
                else regions.person * (down < -0.35).astype(np.float32))
        neck = regions.labels()[..., PICTURE_LABELS.index("body")] > 127
        if self.short:
            # Beside the chin such a mask may well hold background.
            neck &= np.abs(right) < 0.45
        found = (self._deep(hair > 0.5, 1.0), self._deep(neck, ALIKE))
        self.places = np.stack([place if place is not None else _everywhere(hair.shape)
                                for place in found])
        # Chunks of what lies near the edge spill over it.
        self.inside = distance_transform_edt(
            np.pad(regions.person > 0.5, 1, mode="edge"))[1:-1, 1:-1] > EDGE * exemplar.size
        self.known = np.array([place is not None for place in found])

    def _deep(self, region: NDArray[np.bool_], share: float) -> Float32 | None:
        """For every pixel the nearest one deep inside a region, [h, w, 2] (x, y); None: no room.

        Only the ``share`` of plainest places count.
        """
        depth = distance_transform_edt(np.pad(region, 1))[1:-1, 1:-1]
        if depth.max() < 0.2 * self.side:
            return None
        deep = depth >= min(0.6 * self.side, 0.7 * float(depth.max()))
        # Plain pieces that are alike meet without a break.
        odd = self._contrast + np.abs(self._mean - np.median(self._mean[deep]))
        chosen = deep & (odd <= np.quantile(odd[deep], share))
        _, index = distance_transform_edt(~chosen, return_indices=True)
        return np.asarray(np.moveaxis(index, 0, -1)[..., ::-1] + 0.5, np.float32)

    def materials(self, angle: Float64, depth: Float64,
                  bare: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Material of sites, [N].

        Parameters
        ----------
        angle, depth
            [N], from forward, and below the brows (1 = chin).
        bare
            [N], where the guide finds the exemplar's background or its edge.
        """
        out = np.full(angle.shape, -1)
        out[np.where(depth < 0, angle > CROWN, (angle > BEHIND_EARS) & (depth < 0.7))] = HAIR
        out[(depth >= 0.7) & (angle > np.where(depth < 1, NAPE, CROWN))] = NECK
        if self.short:
            out[(depth > 1.25) & (angle > SHOULDER)] = NECK
            # Clothes that it does show go on.
            out[(depth > 1.1) & ~bare] = -1
        return np.where((out >= 0) & self.known[out], out, -1)

    def pieces(self, wanted: Float32, chances: Float32, material: NDArray[np.int64]) -> Float32:
        """Where in the exemplar the pieces of sites come from, [N, 2].

        Parameters
        ----------
        wanted
            float32 [N, 2], where the guide would look.
        chances
            float32 [N, 2], random numbers in [0, 1).
        material
            [N], not negative.
        """
        near = wanted + np.float32(2 * self.spread) * (chances - np.float32(0.5))
        rows, columns = self.places.shape[1:3]
        x = np.clip(near[:, 0], 0, columns - 1).astype(np.int64)
        y = np.clip(near[:, 1], 0, rows - 1).astype(np.int64)
        return np.asarray(self.places[material, y, x], np.float32)

    def nearest(self, places: Float32, sites: Sites) -> NDArray[np.int32]:
        """Flat number of the site nearest to each of the places [N, 2]."""
        out = np.empty(len(places), np.int32)
        nearest_sites(places, np.float32(self.side), sites.first, sites.points, out)
        return out


def _everywhere(shape: tuple[int, ...]) -> Float32:
    """Every pixel's own middle, [h, w, 2]."""
    return np.asarray(np.moveaxis(np.indices(shape[:2]), 0, -1)[..., ::-1] + 0.5, np.float32)
