"""The 68 facial landmarks (iBUG order): files, and MediaPipe's 478 points mapped to them.

0-16 the jaw from the ear on the picture's left to the other, 17-21 and 22-26 the brows, 27-30 the
bridge of the nose, 31-35 its base, 36-41 and 42-47 the eyes, 48-59 the lips outside, 60-67 inside.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Float64
from ..errors import UserError
from ..files import atomic_write

__all__ = ["FROM_MEDIAPIPE", "read_landmarks", "write_landmarks"]

FROM_MEDIAPIPE = np.array([
    127, 234, 132, 58, 172, 136, 149, 148, 152, 377, 378, 365, 397, 288, 361, 454, 356,  # jaw
    70, 63, 105, 66, 107, 336, 296, 334, 293, 300,  # brows
    168, 197, 5, 4, 75, 97, 2, 326, 305,  # nose
    33, 160, 158, 133, 153, 144, 362, 385, 387, 263, 373, 380,  # eyes
    61, 40, 37, 0, 267, 270, 291, 321, 314, 17, 84, 91,  # lips, outside
    78, 82, 13, 312, 308, 317, 14, 87,  # lips, inside
])
"""For each of the 68 points, the number of the MediaPipe face-mesh vertex that stands for it.

Mirror images of each other on both sides; among the vertices near each point those that lie nearest
to the landmarks of 14 painted and sculpted portraits. The jaw's are all on the mesh's outline.
"""


_LEAN = {
    17: (1.2, -5.0), 18: (0.1, -1.2), 19: (-2.9, -0.6), 20: (-4.0, -1.6), 21: (-4.5, -4.9),  # brow
    28: (0.0, 2.5), 29: (0.0, 2.9),  # nose
    36: (2.2, -1.2), 40: (0.9, -2.0), 41: (1.0, -2.0),  # eye
    49: (-1.9, 0.2), 59: (-1.9, -1.5),  # lips
}
_MIRROR = {17: 26, 18: 25, 19: 24, 20: 23, 21: 22, 36: 45, 40: 47, 41: 46, 49: 53, 59: 55}


def centred(points: Float64) -> Float64:
    """Landmarks [68, 2] that both networks found, without the lean that their mean has.

    Where the networks put brows, lids and bridge differs from where people put them. The table
    holds the median differences over 13 painted and sculpted portraits, made symmetric, in
    hundredths of the distance of the outer eye corners along the line of the eyes and across. On a
    portrait left out of the medians the inner landmarks' mean error falls from 2.8 to 2.5 of these.
    """
    lean = np.zeros((68, 2))
    for k, (along, across) in _LEAN.items():
        lean[k] = along, across
        if k in _MIRROR:
            lean[_MIRROR[k]] = -along, across
    x, y = 0.01 * (points[45] - points[36])
    return np.asarray(points - lean @ np.array([[x, y], [-y, x]]), np.float64)


def read_landmarks(path: str | Path) -> Float64:
    """Read 68 landmarks, ``x y`` a line, in pixels.

    Returns
    -------
    points
        float64 [68, 2] (x right, y down).

    Raises
    ------
    UserError
        If the file is missing or does not hold 68 pairs of numbers.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        lines = [line.replace(",", " ").split() for line in text.splitlines()]
        points = np.array([[float(value) for value in line] for line in lines if line])
    except OSError as error:
        raise UserError(f"can't read {path}: {error.strerror}") from error
    except ValueError as error:
        raise UserError(f"{path} does not hold landmarks: write 68 lines of `x y`") from error
    if points.shape != (68, 2) or not np.isfinite(points).all():
        raise UserError(f"{path} does not hold 68 landmarks: write 68 lines of `x y` in iBUG order")
    return points


def write_landmarks(path: str | Path, points: NDArray[Any]) -> None:
    """Write landmarks [68, 2], ``x y`` a line, in pixels."""
    with atomic_write(path) as stream:
        stream.write("".join(f"{x:.2f} {y:.2f}\n" for x, y in points).encode())
