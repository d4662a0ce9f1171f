"""A surface as a graph of cells, and regions that are decided on it as a whole.

A network or a color says of some places for sure what they are, of others hardly, of those that no
photo saw nothing. Asked place by place, the ends of what was seen come out as regions of their own.
So what is known is carried over the surface: a random walker (Grady 2006; with priors 2005) goes
from cell to cell, easily between cells of one color, hardly across an edge, and a cell is what most
walkers from it come to first. Its chances x minimize

    sum w_ij (x_i - x_j)^2 + sum a_i (x_i - p_i)^2

over the edges ij and the cells i, with votes p and their trust a: a sparse linear system.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg
from scipy.spatial import cKDTree

from ..arrays import Float32, Float64, Int64

__all__ = ["SurfaceGraph"]

Floats = NDArray[np.floating]

REACH = 1.8
"""Cells whose middles are nearer than this many sides are neighbors."""
CONTRAST = 0.08
"""Distance of colors (sRGB in [0, 1]) across which a walker goes 0.6 times as easily."""
LEAST = 0.01
"""So easily it goes across any edge."""
LOOSE = 1e-6
"""Weight of the mean of all votes, which holds cells that nothing hangs together with."""
ACCURACY = 1e-4
"""Relative, of the solution."""


@dataclass(frozen=True)
class SurfaceGraph:
    """C cells of N places of a surface.

    Attributes
    ----------
    cell
        int64 [N], the cell of each place.
    count
        float64 [C], places of each cell.
    edges
        int64 [E, 2], neighbors.
    ease
        float64 [E] in (0, 1], of a walker's step between them.
    """

    cell: Int64
    count: Float64
    edges: Int64
    ease: Float64

    @staticmethod
    def over(points: Floats, colors: Floats, side: float) -> SurfaceGraph:
        """The graph of a surface.

        Parameters
        ----------
        points
            [N, 3], places of it.
        colors
            [N, 3], sRGB in [0, 1]; NaN where none is known: there all steps are easy.
        side
            Of a cell, in the unit of the points.
        """
        places = np.floor((points - points.min(axis=0)) / side).astype(np.int64)
        number = np.ravel_multi_index(tuple(places.T), tuple(places.max(axis=0) + 1))
        _, cell, count = np.unique(number, return_inverse=True, return_counts=True)
        middle, color = (np.stack([np.bincount(cell, part) for part in values.T], axis=1)
                         / count[:, None] for values in (points, colors))
        edges = cKDTree(middle).query_pairs(REACH * side, output_type="ndarray").astype(np.int64)
        away = ((color[edges[:, 0]] - color[edges[:, 1]]) ** 2).sum(axis=1)
        ease = np.exp(-0.5 * np.nan_to_num(away) / CONTRAST ** 2)
        return SurfaceGraph(cell, count.astype(np.float64), edges, LEAST + (1 - LEAST) * ease)

    def decided(self, votes: Floats, trust: Floats) -> Float32:
        """What places are, float32 [N] in [0, 1], from votes.

        Parameters
        ----------
        votes
            [N] in [0, 1].
        trust
            [N], their weight over that of a step within one color; somewhere above 0.
        """
        cells = len(self.count)
        weight = np.bincount(self.cell, trust, cells) / self.count
        pull = np.bincount(self.cell, trust * votes, cells) / self.count
        first, second = self.edges.T
        steps = sparse.coo_array((self.ease, (first, second)), (cells, cells)).tocsr()
        steps = steps + steps.T
        mean = float(pull.sum() / max(float(weight.sum()), 1e-12))
        diagonal = np.asarray(steps.sum(axis=1)).ravel() + weight + LOOSE
        found, _ = linalg.cg((sparse.diags_array(diagonal) - steps).tocsr(), pull + LOOSE * mean,
                             np.full(cells, mean), rtol=ACCURACY, maxiter=2000,
                             M=sparse.diags_array(1.0 / diagonal))
        return np.clip(found, 0, 1).astype(np.float32)[self.cell]
