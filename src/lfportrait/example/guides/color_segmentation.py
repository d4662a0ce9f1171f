"""Two-class segmentation of a portrait by colors and a prior, for pictures where networks fail.

GrabCut in small (Rother et al. 2004): color histograms of the two classes, a smoothness term that
is weak across edges, and an exact minimum cut, a few times over on a picture of about 128 pixels.
The soft result follows the picture's edges by a guided filter (He et al. 2010).
"""

import functools

import cv2
import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter, zoom

from ...arrays import Bool, Float32, Int32, Int64
from ...color import LUMA

BINS = 14


def resize(values: Float32, shape: tuple[int, ...]) -> Float32:
    """Resample a plane [h, w] to ``shape`` (H, W, ...), bilinear, area-averaged when shrinking."""
    picture = Image.fromarray(np.asarray(values, np.float32))
    return np.asarray(picture.resize((shape[1], shape[0]), Image.Resampling.BILINEAR), np.float32)


def guided_filter(guide: Float32, values: Float32, radius: int, epsilon: float) -> Float32:
    """Smooth ``values`` [H, W] along the edges of the grey ``guide`` [H, W]."""

    def mean(plane: Float32) -> Float32:
        side = 2 * radius + 1
        return np.asarray(cv2.blur(plane, (side, side), borderType=cv2.BORDER_REPLICATE),
                          np.float32)

    centre, average = mean(guide), mean(values)
    variance = mean(guide * guide) - centre ** 2
    slope = (mean(guide * values) - centre * average) / (variance + epsilon)
    offset = average - slope * centre
    return np.asarray(np.clip(mean(slope) * guide + mean(offset), 0, 1), np.float32)


def _histogram(cells: Int64, weights: Float32) -> Float32:
    """Smoothed color distribution of the weighted pixels, [BINS^3]."""
    counts = np.bincount(cells.ravel(), weights.ravel().astype(np.float64), BINS ** 3)
    smooth = gaussian_filter(counts.reshape(BINS, BINS, BINS), 0.8)
    return np.asarray((smooth / max(smooth.sum(), 1e-9)).ravel() + 1e-4, np.float32)


def _cells(image: Float32) -> Int64:
    """Histogram cell of every pixel, colors in [0, 1]."""
    index = np.minimum((image * BINS).astype(np.int64), BINS - 1)
    return (index[..., 0] * BINS + index[..., 1]) * BINS + index[..., 2]


def overlap(image: Float32, first: Float32, second: Float32) -> float:
    """Bhattacharyya overlap in [0, 1] of the colors of two soft regions of [H, W, 3]."""
    cells = _cells(image)
    one, two = _histogram(cells, first), _histogram(cells, second)
    return float(np.sqrt(one / one.sum() * two / two.sum()).sum())


_PAIRS = ((slice(None), slice(0, -1), slice(None), slice(1, None), 1.0),
          (slice(0, -1), slice(None), slice(1, None), slice(None), 1.0),
          (slice(0, -1), slice(0, -1), slice(1, None), slice(1, None), 0.7),
          (slice(0, -1), slice(1, None), slice(1, None), slice(0, -1), 0.7))
"""Rows and columns of neighbours, of the first and the second one, and how near they are."""


def _bonds(image: Float32, smoothness: float) -> Float32:
    """What it costs to part neighbours: both ways, one kind of `_PAIRS` after the other."""
    spread = max(float(np.mean((image[:, 1:] - image[:, :-1]) ** 2)) * 6, 1e-4)
    found = []
    for a, b, c, d, near in _PAIRS:
        difference = ((image[a, b] - image[c, d]) ** 2).sum(axis=-1)
        weight = (smoothness * near * (0.1 + 0.9 * np.exp(-difference / spread))).ravel()
        found += [weight, weight]
    return np.concatenate(found)


@functools.lru_cache(maxsize=16)
def _edges(height: int, width: int) -> tuple[Int32, Int32, Int64]:
    """The graph of a picture by rows: column of each edge, each row's first, and their order.

    Edges are ordered from those of `_bonds`, then those from the source to each pixel and from each
    pixel to the sink. SciPy takes no arrays that are read only.
    """
    index = np.arange(height * width).reshape(height, width)
    source, sink = index.size, index.size + 1
    rows, columns = [], []
    for a, b, c, d, _ in _PAIRS:
        first, second = index[a, b].ravel(), index[c, d].ravel()
        rows += [first, second]
        columns += [second, first]
    rows += [np.full(index.size, source), index.ravel()]
    columns += [index.ravel(), np.full(index.size, sink)]
    row, column = np.concatenate(rows), np.concatenate(columns)
    order = np.lexsort((column, row))
    starts = np.searchsorted(row[order], np.arange(sink + 2))
    return column[order].astype(np.int32), starts.astype(np.int32), order


def _minimum_cut(bonds: Float32, unary: Float32) -> Bool:
    """Labels of least energy: ``unary`` > 0 pulls a pixel into the class."""
    # Here: a twentieth of a second, for what networks have mostly seen.
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import breadth_first_order, maximum_flow

    pull = unary.ravel()
    source, sink = pull.size, pull.size + 1
    columns, starts, order = _edges(*unary.shape)
    capacity = np.concatenate([bonds, np.maximum(pull, 0), np.maximum(-pull, 0)])
    graph = csr_matrix((np.rint(capacity * 1000).astype(np.int32)[order], columns, starts),
                       shape=(sink + 1, sink + 1))
    residual = graph - maximum_flow(graph, source, sink).flow
    residual.data = np.maximum(residual.data, 0)
    residual.eliminate_zeros()
    reached = breadth_first_order(residual, source, return_predecessors=False)
    inside = np.zeros(sink + 1, bool)
    inside[reached] = True
    return inside[:source].reshape(unary.shape)


SIZE = 128  # Longer side of the picture that is cut.
SURE = 0.02  # Probabilities below this and above 1 - this are final.
ROUNDS = 3  # Times that colors and labels are estimated in turn.
REACH = 2.5  # Largest log likelihood ratio that a color may have.


def separate(image: Float32, prior: Float32, *, smoothness: float = 3.0,
             blur: float = 0.0) -> Float32:
    """Soft mask of the class that ``prior`` hints at, float32 [H, W] in [0, 1].

    Parameters
    ----------
    image, prior : float32 [H, W, 3] in [0, 1], and [H, W], probability of the class.
    smoothness : Strength of the term that keeps neighbours together.
    blur : Sigma in pixels of the picture that is cut of the blur before colors are compared:
        drawings show hair as a density of strokes.
    """
    shrink = SIZE / max(image.shape[:2])
    shape = (max(8, round(image.shape[0] * shrink)), max(8, round(image.shape[1] * shrink)))
    small = np.stack([resize(image[..., c], shape) for c in range(3)], axis=-1)
    belief = resize(prior, shape)
    if blur > 0:
        small = np.stack([gaussian_filter(small[..., c], blur) for c in range(3)], axis=-1)
    cells = _cells(small)
    fixed_in, fixed_out = belief > 1 - SURE, belief < SURE
    odds = np.log(np.clip(belief, 0.01, 0.99) / np.clip(1 - belief, 0.01, 0.99))
    soft = np.asarray(belief ** 4 / (belief ** 4 + (1 - belief) ** 4), np.float32)
    bonds = _bonds(small, smoothness)
    for _ in range(ROUNDS):
        inside, outside = _histogram(cells, soft), _histogram(cells, 1 - soft)
        unary = np.clip(np.log(inside / outside)[cells], -REACH, REACH) + odds
        unary = np.where(fixed_in, 50, np.where(fixed_out, -50, unary)).astype(np.float32)
        before, soft = soft, _minimum_cut(bonds, unary).astype(np.float32)
        if np.array_equal(soft, before):
            break  # the next round would find the same colors, and the same labels
    rough = np.clip(zoom(soft, np.array(image.shape[:2]) / shape, order=1), 0, 1)
    rough = resize(gaussian_filter(rough, 1.0 / shrink * 0.5).astype(np.float32), image.shape[:2])
    luma = np.asarray(image @ LUMA)
    return guided_filter(luma, rough, max(2, round(1.0 / shrink)), 1e-3)
