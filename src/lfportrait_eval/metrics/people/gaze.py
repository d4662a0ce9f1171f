"""Where painted eyes look: the place of each iris between the corners of its eye.

MediaPipe's landmarker finds irises beside its face mesh. On paint it may see none, or what a face
ought to have: so the darkest blob between the lids is also looked for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage
from skimage.draw import polygon2mask

from lfportrait import models
from lfportrait.face import face_mesh

__all__ = ["Eyes", "apart", "dark_gaze", "eyes_seen", "gaze_found"]

Float64 = NDArray[np.float64]

FULL = 45.0
"""Degrees by which an eye is turned whose iris lies at a corner, about."""
PARALLEL = {"iris": (8.5, 0.0), "dark": (6.0, 0.0)}
"""Degrees (right, down) that parallel eyes seem apart, as their inner corners reach further from
the iris: medians of the people and paintings that were looked at, whose eyes are open."""
CLOSED = 0.15
"""Eyes less open than this are closed: theirs were 0.03, those of open ones 0.29 at least."""
_EYES = ((33, 133, 468, 159, 145), (362, 263, 473, 386, 374))
"""Left and right corner, middle of the iris, upper and lower lid in MediaPipe's mesh; the picture's
left eye first."""
_OUTLINES = (slice(36, 42), slice(42, 48))
_SIDE, _ROOM = 768, 1.56
"""Side of the picture of a face that is looked at, and its width over that of the landmarks."""
_DARK = 0.3
"""Share of an eye's opening that an iris takes, about."""


@dataclass(frozen=True)
class Eyes:
    """What the landmarker sees of a pair of eyes.

    Attributes
    ----------
    gaze
        float64 [2, 2]: for the picture's left and right eye, degrees to the right and downwards
        along the line of its corners.
    opening
        float64 [2], distance of their lids over that of their corners.
    """

    gaze: Float64
    opening: Float64

    @property
    def closed(self) -> bool:
        """Whether both are closed; nothing can be said of where they look."""
        return bool(self.opening.mean() < CLOSED)


def eyes_seen(image: NDArray[np.uint8], landmarks: NDArray[np.floating]) -> Eyes | None:
    """Both eyes by the landmarker's irises and lids.

    Parameters
    ----------
    image
        uint8 [H, W, 3], sRGB.
    landmarks
        [68, 2] pixels of the face that is meant: a picture of it alone is looked at.

    Returns
    -------
    eyes
        None if no face is found there, or the landmarker is not at hand.
    """
    if not models.available("face-landmarker"):
        return None
    low, high = landmarks.min(axis=0), landmarks.max(axis=0)
    half = 0.5 * _ROOM * float((high - low).max())
    middle = 0.5 * (low + high) - [0.0, 0.1 * (high[1] - low[1])]
    box = (*(middle - half), *(middle + half))
    close = np.asarray(Image.fromarray(image).transform(
        (_SIDE, _SIDE), Image.Transform.EXTENT, box, Image.Resampling.BICUBIC))
    mesh = face_mesh(close)
    if mesh is None:
        return None
    gaze: list[Float64] = []
    opening: list[float] = []
    for left, right, iris, upper, lower in _EYES:
        gaze.append(_turned(mesh[iris], mesh[left], mesh[right]))
        opening.append(float(np.linalg.norm(mesh[upper] - mesh[lower]))
                       / max(float(np.linalg.norm(mesh[left] - mesh[right])), 1e-9))
    return Eyes(np.array(gaze), np.array(opening))


def _turned(iris: Float64, left: Float64, right: Float64) -> Float64:
    """Degrees [2], to the right and downwards, of an iris between an eye's corners, [2] each."""
    along = 0.5 * (right - left)
    away = iris - 0.5 * (left + right)
    across = np.array([-along[1], along[0]])
    return FULL * np.array([away @ along, away @ across]) / max(float(along @ along), 1e-9)


def dark_gaze(image: NDArray[np.uint8], landmarks: NDArray[np.floating]) -> Float64:
    """Direction of both eyes by the darkest blob between the lids.

    Parameters
    ----------
    image
        uint8 [H, W, 3], sRGB.
    landmarks
        [68, 2] pixels.

    Returns
    -------
    float64 [2, 2] as `Eyes.gaze`; NaN where an eye is too small to tell.
    """
    return np.array([_dark(image, np.asarray(landmarks[part], np.float64)) for part in _OUTLINES])


def _dark(image: NDArray[np.uint8], outline: Float64) -> Float64:
    """`dark_gaze` of one eye, by its outline [6, 2]."""
    width = float(np.linalg.norm(outline[3] - outline[0]))
    if width < 8:
        return np.full(2, np.nan)
    # Lashes and the shade in the corners are as dark as an iris, but thin.
    luma = ndimage.gaussian_filter(image @ np.array([0.299, 0.587, 0.114]), 0.06 * width)
    middle = outline.mean(axis=0)
    inside = polygon2mask(image.shape[:2], (middle + 1.1 * (outline - middle))[:, ::-1] - 0.5)
    if inside.sum() < 20:
        return np.full(2, np.nan)
    dark = inside & (luma <= np.quantile(luma[inside], _DARK))
    parts, count = ndimage.label(dark)
    sizes = ndimage.sum_labels(dark, parts, np.arange(1, count + 1))
    y, x = ndimage.center_of_mass(parts == 1 + int(np.argmax(sizes)))
    return _turned(np.array([x, y]) + 0.5, outline[0], outline[3])


def apart(gaze: NDArray[np.floating], real: NDArray[np.floating] | None, by: str) -> float:
    """How much further painted eyes look apart than they should, in degrees.

    Parameters
    ----------
    gaze, real
        [2, 2] degrees of both eyes, painted and real; None where the real ones are closed: then
        the painted ones should be parallel.
    by
        ``iris`` or ``dark``, how they were found.
    """
    wanted = PARALLEL[by] if real is None else real[1] - real[0]
    return float(np.linalg.norm((gaze[1] - gaze[0]) - wanted))


def gaze_found(painted: NDArray[np.uint8], real: NDArray[np.uint8],
               landmarks: NDArray[np.floating]) -> dict[str, float]:
    """How much further painted eyes look apart than the real ones, and whether lids are kept.

    Parameters
    ----------
    painted, real
        uint8 [H, W, 3], the same view.
    landmarks
        [68, 2] pixels of the real view.

    Returns
    -------
    figures
        Degrees: ``iris`` by the landmarker's irises, NaN if it finds no face; ``dark`` by the
        darkest blobs between the lids; ``gaze``, the first, or where there is none the second; NaN
        if the painted eyes are closed as the sitter's. ``lids``: how much more or less open the
        eyes are than the sitter's, lids over corners.
    """
    there, own = (eyes_seen(image, landmarks) for image in (painted, real))
    dark = apart(dark_gaze(painted, landmarks), dark_gaze(real, landmarks), "dark")
    if there is None or own is None:
        return {"gaze": dark, "iris": np.nan, "dark": dark, "lids": np.nan}
    lids = abs(float((there.opening - own.opening).mean()))
    if not own.closed:
        iris = apart(there.gaze, own.gaze, "iris")
    elif there.closed:
        iris = dark = np.nan
    else:
        iris = apart(there.gaze, None, "iris")
        dark = apart(dark_gaze(painted, landmarks), None, "dark")
    return {"gaze": iris, "iris": iris, "dark": dark, "lids": lids}
