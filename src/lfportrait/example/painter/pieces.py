"""Initialise the patch search: rigid pieces of the exemplar of the same material and tone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...labels import MATERIALS
from ..kernels.seeds import nearest_sites
from ..surface_guide import Sites
from .materials import ExemplarMaterials, into

__all__ = ["pieces"]

Float32 = NDArray[np.float32]

PIECE = 0.3
"""Side of the pieces that the search begins with, over the exemplar's face size."""
PLACES, R2 = 16, (0.7548776662, 0.5698402910)
"""So many places are tried for a piece, one after the other of this sequence."""
FAR, AWAY = 2.0, 0.05
"""Breadth of where these lie, over the face's size, and the tone that so far away costs."""


def pieces(material: NDArray[np.int64], theirs: ExemplarMaterials, wanted: Float32, plane: Float32,
           tone: Float32, size: float) -> Float32:
    """Rigid pieces of like material for the search to begin with, places float32 [N, 2].

    Pieces lie around jittered sites of the plane [N, 2] and come from well inside the same
    material, near the guided place or some way off: alike, but not the same next to each other. Of
    a few such places that is taken whose tone is the nearest to the one asked for, so that a dark
    piece does not lie beside a light one where the sitter is all alike.

    Parameters
    ----------
    material
        int64 [N], what the sitter's places are mostly (`mainly`).
    theirs
        The exemplar's.
    wanted, plane
        float32 [N, 2], the guided places in the exemplar and those in the plane; pixels.
    tone
        float32 [N], asked for.
    size
        Of the exemplar's face in these pixels.
    """
    side = PIECE * size
    sites = Sites.around(plane, side)
    number = np.empty(len(plane), np.int32)
    nearest_sites(plane, np.float32(side), sites.first, sites.points, number)
    middles = sites.points.reshape(-1, 2)
    count = np.maximum(np.bincount(number, minlength=len(middles)), 1)
    guided = np.stack([np.bincount(number, wanted[:, axis], len(middles)) / count
                       for axis in range(2)], axis=-1)
    asked = np.bincount(number, tone, len(middles)) / count
    votes = np.bincount(number * len(MATERIALS) + material,
                        minlength=len(middles) * len(MATERIALS))
    kinds = votes.reshape(len(middles), -1).argmax(axis=1)
    best, chosen = np.full(len(middles), np.inf), np.zeros((len(middles), 2))
    for turn in range(PLACES):
        # The R2 sequence: places that lie evenly, in another order for each site.
        chance = (sites.chances.reshape(-1, 2) + turn * np.array(R2)) % 1
        place = guided + FAR * size * (chance - 0.5)
        there = theirs.deep[kinds, *_pixels(place, theirs)]
        off = np.abs(theirs.tone.reshape(-1)[there] - asked)
        off += AWAY / size * np.linalg.norm(place - guided, axis=1)
        better = off < best - 1e-6
        best[better], chosen[better] = off[better], place[better]
    y, x = _pixels(chosen, theirs)
    found, width = theirs.deep[material, y[number], x[number]], theirs.tone.shape[1]
    piece = np.stack([found % width, found // width], axis=1) + np.float32(0.5)
    piece += plane - middles[number]
    return into(material, theirs, np.asarray(piece, np.float32))


def _pixels(places: NDArray[np.floating], theirs: ExemplarMaterials,
            ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the exemplar's pixels at places [N, 2] (x, y), or next to them."""
    height, width = theirs.tone.shape
    return (np.clip(places[:, 1], 0, height - 1).astype(np.int64),
            np.clip(places[:, 0], 0, width - 1).astype(np.int64))
