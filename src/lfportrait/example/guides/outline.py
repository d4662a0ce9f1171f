"""Outline matching: move the position guide so that region edges coincide.

Rays find the head's outline and hairline every 15 degrees, and between them, at ears, neck and
shoulders, moving least squares only guesses. So signed distances from the edge of a region are
compared in both pictures, and places near the edge move along the exemplar's distance until both
agree: what is three pixels outside the target's head is looked for three pixels outside the
exemplar's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..kernels.guides import distances, snap
from .filters import gaussian_blur, shrunk

__all__ = ["EdgeMatch", "signed_distance", "signed_distances"]

Float32 = NDArray[np.float32]

FAR = 250.0
"""Distances are known up to so many cells."""


def signed_distance(mask: Float32, cell: int = 4) -> Float32:
    """Signed distance in pixels from the edge of ``mask`` [H, W], positive inside.

    Returns
    -------
    float32 [ceil(H / cell), ceil(W / cell)], at the middles of blocks of ``cell`` pixels.
    """
    small = np.ascontiguousarray(shrunk(np.ascontiguousarray(mask, np.float32), cell))
    return signed_distances(small[None], [FAR])[0] * np.float32(cell)


def signed_distances(masks: Float32, far: Sequence[float]) -> Float32:
    """Signed distances in cells from the edges of several masks [K, h, w], up to ``far`` each."""
    out = np.empty_like(masks)
    distances(masks, np.minimum(far, FAR).astype(np.float32), out)
    return out


@dataclass
class EdgeMatch:
    """The exemplar's side of the match.

    Attributes
    ----------
    distance
        float32 [h, w], the exemplar's signed distances, slightly smoothed.
    reach, most
        See `example.kernels.outline.snap`, in exemplar pixels.
    cell
        Side of a cell of ``distance`` in pixels.
    """

    distance: Float32
    reach: float
    most: float
    cell: int = 4

    @staticmethod
    def of(mask: Float32, reach: float, most: float, cell: int = 4) -> EdgeMatch | None:
        """The match to the edge of ``mask`` [H, W]; None where it has none."""
        if not 0.01 < float(mask.mean()) < 0.99:
            return None
        # Unevenness finer than the strokes would tear the guide.
        return EdgeMatch(gaussian_blur(signed_distance(mask, cell), 1.0), reach, most, cell)

    def move(self, nodes: Float32, mask: Float32, grid: int, scale: float) -> None:
        """Move the guide's nodes in place.

        Parameters
        ----------
        nodes
            float32 [h, w, 2], places in exemplar pixels of every ``grid``-th target pixel.
        mask
            float32 [H, W], the same region in the target.
        scale
            Exemplar pixels per target pixel.
        """
        self.pull(nodes, signed_distance(mask, grid), grid, scale)

    def far(self, grid: int, scale: float) -> float:
        """Distance in cells of ``grid`` target pixels beyond which nothing moves."""
        return 3.1 * self.reach / (scale * grid) + 4.0

    def pull(self, nodes: Float32, distance: Float32, grid: int, scale: float,
             keep: float = 0.0) -> None:
        """`move` by the target's signed distances in pixels, [ceil(H / grid), ceil(W / grid)].

        For ``keep`` see `example.kernels.outline.snap`, in exemplar pixels.
        """
        # As smooth as the exemplar's.
        sigma = max(self.cell / (scale * grid), 0.5)
        own = gaussian_blur(distance, sigma) * np.float32(scale)
        # Cells lie around the pixels (i + 0.5) * grid, nodes at i * grid + 0.5.
        rows, columns = nodes.shape[:2]
        share = np.float32(0.5 - 0.5 / grid)
        more = max(0, rows - own.shape[0]), max(0, columns - own.shape[1])
        padded = np.pad(own, ((1, more[0]), (1, more[1])), mode="edge")[:rows + 1, :columns + 1]
        along = padded[:, :-1] * share + padded[:, 1:] * (1 - share)
        wanted = np.ascontiguousarray(along[:-1] * share + along[1:] * (1 - share))
        before = nodes.copy()
        snap(nodes, wanted, self.distance, self.cell, np.float32(self.reach),
             np.float32(self.most), np.float32(keep), 4)
        for c in range(2):
            moved = np.ascontiguousarray(nodes[..., c] - before[..., c])
            nodes[..., c] = before[..., c] + gaussian_blur(moved, 1.0)
