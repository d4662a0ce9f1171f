"""Square cells of an unwrapped head or a photo, and light that is extrapolated over them.

Statistics of a neighbourhood go across charts. The painted face's light and shade goes on beside
it: tones of patches come from the photo. Where the painter's light falls otherwise, the face ends
in his shade and they would begin in full light, or the reverse: a seam along the cheek.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from ...arrays import Bool, Float32, Float64

CELL = 0.03  # Side of the cells that light is extrapolated in, over the face's height.
BLUR, REACH = 1.5, 12.0  # Sigma of its blur, and how far it reaches, in cells.

MEET, SEAM, FADES = 0.15, 1.0, 12.0
"""A cell lies at the border of two parts if each has this share of what is around it; sigma of the
blur that leaves out single strokes, and how far a step of colors is evened out, in cells."""
DARKER_STEP, LIGHTER_STEP = 0.2, 0.3
"""No more of a step is evened out: what is much darker in the face may be a beard or a brow."""


@dataclass(frozen=True)
class Cells:
    """A grid over N places of the unwrapped head."""

    # float64 [N, 2], column and row of each in cells; whole numbers are the cells' middles.
    places: Float64
    shape: tuple[int, int]  # Rows and columns.

    @staticmethod
    def over(flat: Float32, side: float) -> Cells:
        """Of unwrapped places [N, 2]; ``side`` of a cell in their unit."""
        # Axis by axis: many times as fast as the ends of both at once.
        places = (flat.astype(np.float64) - [axis.min() for axis in flat.T]) / side
        columns, rows = (int(np.ceil(axis.max())) + 1 for axis in places.T)
        return Cells(places, (rows, columns))

    def closed(self, values: Float32, reach: int) -> Float32:
        """Values [N] after a closing by a disk of ``reach`` cells, float32 [N]."""
        return self._at(ndimage.grey_closing(self._filled(values), footprint=_disk(reach),
                                             mode="nearest"))

    def gaps(self, values: Float32, known: Bool, reach: int) -> Float32:
        """What a closing by a disk of ``reach`` cells adds to values [N], float32 [N].

        Nothing at edges that are straight, however steep. Cells without a place that is ``known``,
        bool [N], take the nearest one's value.
        """
        if not known.any():
            return np.zeros(len(values), np.float32)
        filled = self._filled(values, known)
        kernel = np.asarray(_disk(reach), np.uint8)
        closed = cv2.morphologyEx(filled, cv2.MORPH_CLOSE, kernel, borderType=cv2.BORDER_REPLICATE)
        return self._at(np.asarray(closed - filled, np.float64))

    def opened(self, values: Float32, reach: int) -> Float32:
        """Values [N] after an opening by a disk of ``reach`` cells, float32 [N]."""
        return self._at(ndimage.grey_opening(self._filled(values), footprint=_disk(reach),
                                             mode="nearest"))

    def joined(self, values: Float32, seeds: Bool) -> Float32:
        """Values [N] of what hangs together with seeds, bool [N]; 0 elsewhere.

        What is above one half hangs together, and has its slopes of two cells with it.
        """
        means = self._filled(values)
        pieces, count = ndimage.label(means > 0.5)
        kept = np.zeros(count + 1, bool)
        row, column = np.rint(self.places[seeds, ::-1]).astype(int).T
        kept[pieces[row, column]] = True
        kept[0] = False
        return self._at(means * ndimage.binary_dilation(kept[pieces], iterations=2))

    def _filled(self, values: Float32, known: Bool | None = None) -> Float64:
        """Means [rows, columns] of the cells' known places (all if None); else the nearest's."""
        found, means = self._means(values, np.ones(len(values), bool) if known is None else known)
        _, nearest = ndimage.distance_transform_edt(~found, return_indices=True)
        return np.asarray(means[tuple(nearest)], np.float64)

    def extrapolated(self, values: Float32, inside: Bool, blur: float, reach: float) -> Float32:
        """Values [N] of the places inside (bool [N]), extrapolated and fading outside, float32 [N].

        ``blur`` and ``reach``: sigma of their blur, and how far they reach; in cells.
        """
        known, means = self._means(values, inside)
        if not known.any():
            return np.zeros(len(values), np.float32)
        weight = ndimage.gaussian_filter(known.astype(np.float64), blur)
        means = ndimage.gaussian_filter(means, blur) / np.maximum(weight, 1e-6)
        away, nearest = ndimage.distance_transform_edt(~known, return_indices=True)
        fade = np.clip(1 - away / reach, 0, 1)
        means = ndimage.gaussian_filter(means[tuple(nearest)], blur)
        return self._at(means * fade * fade * (3 - 2 * fade))

    def step(self, values: Float32, inside: Bool, beside: Bool, blur: float, reach: float,
             ) -> Float32:
        """How much higher values [N] are inside than beside, along the border; float32 [N].

        It fades away from there; 0 where the two do not meet. ``blur`` and ``reach`` as in
        `extrapolated`.
        """
        sums, near = [], np.ones(self.shape, bool)
        for part in (inside, beside):
            known, means = self._means(values, part)
            weight = ndimage.gaussian_filter(known.astype(np.float64), blur)
            sums.append(ndimage.gaussian_filter(means, blur) / np.maximum(weight, 1e-6))
            near &= weight > MEET
        if not near.any():
            return np.zeros(len(values), np.float32)
        weight = ndimage.gaussian_filter(near.astype(np.float64), blur)
        higher = ndimage.gaussian_filter((sums[0] - sums[1]) * near, blur)
        higher /= np.maximum(weight, 1e-6)
        away, nearest = ndimage.distance_transform_edt(~near, return_indices=True)
        fade = np.clip(1 - away / reach, 0, 1)
        return self._at(ndimage.gaussian_filter(higher[tuple(nearest)], blur)
                        * fade * fade * (3 - 2 * fade))

    def _means(self, values: Float32, inside: Bool,
               ) -> tuple[Bool, Float64]:
        """Cells that hold places inside, and the means of their values; 0 in others."""
        row, column = np.rint(self.places[inside, ::-1]).astype(int).T
        number, size = row * self.shape[1] + column, self.shape[0] * self.shape[1]
        count = np.bincount(number, minlength=size)
        total = np.bincount(number, values[inside], size)
        means = np.asarray(total / np.maximum(count, 1), np.float64)
        return (count > 0).reshape(self.shape), means.reshape(self.shape)

    def _at(self, grid: Float64) -> Float32:
        """A grid's values at the places, float32 [N]."""
        found = ndimage.map_coordinates(grid, self.places[:, ::-1].T, order=1, mode="nearest")
        return np.asarray(found, np.float32)


def _disk(reach: int) -> Bool:
    """A disk of cells."""
    y, x = np.mgrid[-reach:reach + 1, -reach:reach + 1]
    return np.asarray(np.hypot(y, x) <= reach)


def light_beside(flat: Float32, height: float, painted: Bool, more: Float32, known: Bool,
                 most: float = np.inf) -> Float32:
    """How much lighter places beside a painted face are to become, float32 [N]; 0 in the face.

    Parameters
    ----------
    flat, height : float32 [N, 2], places of a photo, or of the unwrapped head; the face's in their
        unit.
    painted, known : bool [N], places of the face, and those of them that say so.
    more : float32 [N], luma of the paint there, less the tones that were asked for.
    most : Nothing becomes lighter or darker by more: beyond it is a cast shadow, not light.
    """
    light = Cells.over(flat, CELL * height).extrapolated(more, known, BLUR, REACH)
    return np.where(painted, np.float32(0), np.clip(light, -most, most))


def evened_beside(flat: Float32, height: float, painted: Bool, beside: Float32, color: Float32,
                  ) -> Float32:
    """Colors of patches that begin as a painted face ends, float32 [N, 3].

    Patches have the tones that were asked for as far as the painter has such paint; of other hues,
    or in a few broad tones, they meet the face in a hard edge. Their broad colors become the face's
    along the border; their strokes stay.

    Parameters
    ----------
    flat, height : float32 [N, 2], places of the unwrapped head; the face's height in their unit.
    painted : bool [N], places of the face.
    beside : float32 [N] in [0, 1], how far others are to go on as it ends.
    color : float32 [N, 3] in [0, 1], the paint of all.
    """
    cells = Cells.over(flat, CELL * height)
    out, outside = color.copy(), (beside > 0.5) & ~painted
    weight = np.where(painted, np.float32(0), beside)
    for channel in range(3):
        step = cells.step(color[:, channel], painted, outside, SEAM, FADES)
        out[:, channel] += weight * np.clip(step, -DARKER_STEP, LIGHTER_STEP)
    return np.clip(out, 0, 1)
