"""Draw the generic head's mesh on a painting, to check its pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...face import FacePose, generic_depth
from .frontal import COARSE
from .seen import clearness, painted_places

__all__ = ["head_mesh"]

Float64 = NDArray[np.float64]

_SPACING = 0.07
"""Distance of the mesh's lines in the head's units: a dozen across the face."""


def head_mesh(landmarks: NDArray[np.floating], pose: FacePose) -> list[Float64]:
    """Lines of the generic face on a painting, as far as its painter saw them.

    Parameters
    ----------
    landmarks
        [68, 2], of the painting.
    pose
        Of its face.

    Returns
    -------
    lines
        float64 [K, 2] each, pixels (x, y), K at least 2: lines down and across the face.
    """
    every = max(1, round(_SPACING * pose.scale / COARSE))
    # The face's middle is on a line.
    half = every * max(1, int(0.4 * pose.scale / COARSE / every))
    x, y = np.meshgrid(np.arange(-half, half + 1) * COARSE / pose.scale,
                       np.arange(0.5, -0.62, -COARSE / pose.scale))
    points = np.stack([x, y, generic_depth(x, y)], axis=-1)
    places = painted_places(points, np.asarray(landmarks, np.float64), pose)
    seen = (clearness(points, pose) > 0.05) & ((x / 0.4) ** 2 + ((y + 0.06) / 0.58) ** 2 < 1)
    lines: list[Float64] = []
    for line, shown in [*zip(places[::every], seen[::every]),
                        *zip(places[:, ::every].swapaxes(0, 1), seen[:, ::every].T)]:
        ends = np.flatnonzero(np.diff(shown, prepend=False, append=False))
        lines += [line[first:last] for first, last in zip(ends[::2], ends[1::2])
                  if last - first > 1]
    return lines
