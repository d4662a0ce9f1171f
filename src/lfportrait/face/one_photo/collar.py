"""The end of a neck, around which a collar stands and clothes begin.

What a body wears goes round its neck: on the surface it changes with the way from the neck's end
more than around it. Laid out so, as a picture whose rows go round, what the front shows goes on
behind: by means over windows that are wider around the neck than down.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from ...arrays import Bool, Float64
from .samples import MeshSamples

NECK_END = -0.015
"""Height above the model's chin (metres) at which its neck begins to go over into the body's."""
BESIDE, LOWER, HIGHER = 0.25, 0.05, 0.35
"""How far beside a neck, and below and above its end, a collar may stand, portrait units."""
ROW, TURNS = 0.02, 96
"""Steps of a picture of what is around a neck: down, portrait units, and how many around it."""
WINDOWS = ((1.0, 2.0), (1.4, 4.0), (2.0, 8.0), (2.5, 16.0), (16.0, 48.0))
"""Deviations of ever wider means there, in steps down and around."""
FEW = 0.02  # Part of a window that must be known to say half of what is there.
MIRRORED = 0.3  # Weight of what the other side shows.
SURE = (0.2, 0.5)
"""What is known less well than this part of the best says nothing, from the second on all."""


class Collar(NamedTuple):
    """The ring in which a neck ends, portrait units."""

    middle: Float64  # float64 [3].
    radius: float
    normal: Float64  # float64 [3], up the neck.

    @staticmethod
    def of(head: MeshSamples, normal: Float64) -> Collar:
        """The one of a head whose neck has a direction [3]."""
        ring = head.points[np.abs(head.rest[:, 1] - NECK_END) < 0.0015]
        middle = 0.5 * (ring.min(axis=0) + ring.max(axis=0))
        radius = float(np.linalg.norm((ring - middle)[:, ::2], axis=1).max())
        return Collar(middle, radius, normal)

    def holds(self, points: Float64) -> Bool:
        """Whether points [N, 3] lie beside the neck or over its end."""
        to = points - self.middle
        beside, above = np.linalg.norm(to[:, ::2], axis=1), to @ self.normal
        return np.asarray((beside < self.radius + BESIDE) & (above > -LOWER) & (above < HIGHER))

    def around(self, points: Float64) -> Float64:
        """Where points [N, 3] are around the neck, [N, 2]: how far down, and how far around.

        Down is the way from the ring, be it below or beside it, portrait units; above it is less
        than 0. Around is from -0.5 to 0.5, 0 in front.
        """
        to = points - self.middle
        above = to @ self.normal
        beside = to - above[:, None] * self.normal
        forward = np.array([0.0, 0.0, 1.0])
        forward -= (forward @ self.normal) * self.normal
        forward /= max(float(np.linalg.norm(forward)), 1e-9)
        across, ahead = beside @ np.cross(self.normal, forward), beside @ forward
        out = np.maximum(np.hypot(across, ahead) - self.radius, 0)
        down = np.hypot(out, np.minimum(above, 0)) - np.maximum(above, 0)
        return np.stack([down, np.arctan2(across, ahead) / (2 * np.pi)], axis=1)


def spread_around(places: Float64, values: Float64, weights: Float64) -> Float64:
    """Values [N, C] everywhere around a neck, by the known ones.

    Parameters
    ----------
    places : float64 [N, 2], of `Collar.around`.
    values, weights : float64 [N, C] and [N], how well they are known; the best ones count in full.
    """
    weights = weights / max(float(weights.max(initial=0.0)), 1e-9)
    weights = weights * np.clip((weights - SURE[0]) / (SURE[1] - SURE[0]), 0, 1)
    row = (places[:, 0] - places[:, 0].min()) / ROW
    column = (places[:, 1] + 0.5) * TURNS
    size = int(row.max()) + 2, TURNS
    flat = np.ravel_multi_index((np.rint(row).astype(int), np.rint(column).astype(int) % TURNS),
                                size)
    count = np.maximum(np.bincount(flat, minlength=size[0] * TURNS), 1)
    known = np.column_stack([weights[:, None] * values, weights])
    cells = np.stack([(np.bincount(flat, one, len(count)) / count).reshape(size)
                      for one in known.T])
    # What one side hides is as on the other, or a shirt at a throat would go round a jacket.
    cells += MIRRORED * (1 - cells[-1]) * np.roll(cells[..., ::-1], 1, axis=2)
    total = known.sum(axis=0)
    out = np.zeros(cells[:-1].shape) + (total[:-1] / max(total[-1], 1e-9))[:, None, None]
    for down, about in WINDOWS[::-1]:
        wide = ndimage.gaussian_filter(cells, (0, down, about), mode=("nearest", "nearest", "wrap"),
                                       truncate=3.0)
        trust = wide[-1] / (wide[-1] + FEW)
        out += trust * (wide[:-1] / np.maximum(wide[-1], 1e-9) - out)
    turned = np.concatenate([out, out[..., :1]], axis=2)  # its ends meet
    return np.stack([ndimage.map_coordinates(one, [row, column], order=1, mode="nearest")
                     for one in turned], axis=1)
