"""Soft regions of a skin: what `lfportrait restyle --region` and `--keep` name.

Features are drawn from the landmarks as the front sees them; hair, ears and clothes are the
skin's own; the neck is what lies below the jaw and is neither.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...capture import Camera
from ...labels import FEATURES, PICTURE_LABELS, SURFACE_LABELS
from ..guides.regions import FaceFrame, region_labels
from ..painter.light import Cells
from ..surface_guide import HeadPlane

__all__ = ["SURFACE_LABELS", "below_hair", "hair_by_place", "skin_regions", "with_strands",
           "without_bays"]

Float32 = NDArray[np.float32]

HAIRLINE = 0.64, 88.0
"""Where hair begins: above the brows (chin -1) in the middle; at their height, in degrees."""
LOCKS = ((0.03, 11), (0.025, 29), (0.02, 67))
"""Locks that hair ends in at the nape: lengths over the face's height, numbers around a head."""
BAY, BAY_CELL = 0.15, 0.03
"""Bays of skin less than twice so wide close, and the cells that this is looked at in; over the
face's height."""
STRAND, STRAND_CELL = 0.04, 0.01
"""Gaps in hair less than twice so wide are strands of it, and the cells that this is looked at in;
over the face's height."""
SIDE = 512
"""Side in pixels of the picture that the features are drawn in."""


def hair_by_place(plane: HeadPlane, flat: Float32) -> Float32:
    """Where hair is on most heads, float32 [N]: around the forehead, down to ears and nape.

    Parameters
    ----------
    plane, flat
        The head's unwrapping, and places [N, 2] in it.
    """
    up, angle = -flat[:, 1] / plane.height, _angle(plane, flat)
    # A superellipse: round at the temples, then down to the sideburns.
    middle, side = HAIRLINE
    around = (np.maximum(up, 0) / middle) ** 3 + (angle / side) ** 3
    above = np.clip((np.cbrt(around) - 1) / 0.15 + 0.5, 0, 1) * (up > 0)
    # Below the brows it leaves the cheeks, and begins behind the ears.
    begins = side + (100 - side) * np.clip(-up / 0.25, 0, 1)
    behind = np.clip((angle - begins) / 10 + 0.5, 0, 1) * (up <= 0)
    behind *= np.clip((up + _hair_end(plane, flat)) / 0.1, 0, 1)
    return np.asarray(above + behind, np.float32)


def below_hair(plane: HeadPlane, flat: Float32) -> Float32:
    """Where a head has hair only if it is long, float32 [N] in [0, 1]: around jaw and neck.

    Arguments as for `hair_by_place`.
    """
    down, angle = flat[:, 1] / plane.height, _angle(plane, flat)
    # Down to the chin in the middle; beside the eyes it leaves the cheeks.
    cheek = np.clip((angle - 45) / 15, 0, 1)
    beside = np.where(angle < 90, 0.1 + 0.25 * np.clip((angle - 60) / 25, 0, 1),
                      _hair_end(plane, flat))
    end = (1 - cheek) * (0.95 - 0.2 * (np.minimum(angle, 55) / 55) ** 2) + cheek * beside
    return np.asarray(np.clip((down - end) / 0.1, 0, 1), np.float32)


def without_bays(plane: HeadPlane, flat: Float32, hair: Float32) -> Float32:
    """Hair [N] that has closed over narrow bays and islands of skin, float32 [N].

    The painter's locks and the head's hairline leave them between each other. Arguments as for
    `hair_by_place`; ``hair`` [N] in [0, 1].
    """
    cells = Cells.over(flat, BAY_CELL * plane.height)
    return np.maximum(hair, cells.closed(hair, round(BAY / BAY_CELL)))


def with_strands(plane: HeadPlane, flat: Float32, hair: Float32, known: NDArray[np.bool_],
                 ) -> Float32:
    """Hair [N] by color, with its strands that shine or lie in shade, float32 [N].

    They have the colors of skin, or half of them: painted so they would be streaks of skin, or of
    the painter's hairline. But bare skin is broader. Arguments as for `hair_by_place`; ``hair`` [N]
    in [0, 1] closes over gaps where it is ``known``, bool [N], and no others.
    """
    cells = Cells.over(flat, STRAND_CELL * plane.height)
    # Between what is hair for sure; cells at a strand's edge are half filled.
    sure = np.clip(2 * hair - 1, 0, 1)
    gaps = 2 * cells.gaps(sure, known, round(STRAND / STRAND_CELL))
    return np.asarray(np.where(known, np.minimum(hair + gaps, 1), hair), np.float32)


def _angle(plane: HeadPlane, flat: Float32) -> Float32:
    """Degrees from the middle of the face, [N]."""
    return np.asarray(np.degrees(np.abs(flat[:, 0]) / plane.radius), np.float32)


def _hair_end(plane: HeadPlane, flat: Float32) -> Float32:
    """How far down short hair grows (brows 0, chin 1), [N]; a level line would show.

    Sideburns to the middle of the ears, behind them to their lobes, and on to the nape, where it
    ends in locks of several breadths: an even edge would be that of a cap.
    """
    angle = _angle(plane, flat)
    behind, nape = np.clip((angle - 90) / 15, 0, 1), np.clip((angle - 100) / 60, 0, 1)
    turns = flat[:, 0] / np.float32(2 * np.pi * plane.radius)
    # Straight sides, as strokes have: triangles, not waves.
    locks = sum(size * (2 * np.abs(2 * ((count * turns + 0.3) % 1) - 1) - 1)
                for size, count in LOCKS)
    return np.asarray(0.35 + 0.2 * behind + 0.25 * nape * nape * (3 - 2 * nape)
                      + np.clip((angle - 110) / 20, 0, 1) * locks, np.float32)


def skin_regions(plane: HeadPlane, camera: Camera, points: Float32, normals: Float32,
                 flat: Float32, hair: Float32 | None, ears: Float32,
                 clothes: Float32) -> NDArray[np.uint8]:
    """Soft labels of a skin's places, uint8 [N, R] by `SURFACE_LABELS`.

    Parameters
    ----------
    plane
        The head's unwrapping, with its landmarks.
    camera
        That sees the face from the front.
    points, normals
        float32 [N, 3], the places and the large shape's normals there.
    flat
        float32 [N, 2], unwrapped places.
    hair, ears, clothes
        float32 [N] in [0, 1]; hair None: by place.
    """
    features = _features(plane, camera, points, normals)
    hair = hair_by_place(plane, flat) if hair is None else hair
    depth = flat[:, 1] / np.float32(plane.height)
    # Behind the cheeks the jaw ends higher.
    angle = np.abs(flat[:, 0]) / np.float32(plane.radius)
    jaw = np.where(angle > 1.2, np.float32(0.75), np.float32(1.0))
    neck = np.clip((depth - jaw) / np.float32(0.1), 0, 1)
    out = np.zeros((len(points), len(SURFACE_LABELS)), np.float32)
    rest = np.ones(len(points), np.float32)
    for name, share in (*((name, features[:, n]) for n, name in enumerate(FEATURES)),
                        ("clothes", clothes), ("ears", ears * (1 - hair)), ("hair", hair),
                        ("neck", neck)):
        out[:, SURFACE_LABELS.index(name)] = rest * share
        rest = rest * (1 - share)
    out[:, SURFACE_LABELS.index("skin")] = rest
    return np.asarray(out * 255 + 0.5, np.uint8)


def _features(plane: HeadPlane, camera: Camera, points: Float32, normals: Float32) -> Float32:
    """Brows, eyes, nose and lips at points on the front, float32 [N, 4]."""
    marks = plane.landmarks.copy()
    marks[~plane.known] = marks[plane.known].mean(axis=0)
    pixels, _ = camera.project(marks)
    low, high = pixels[0].min(axis=0), pixels[0].max(axis=0)
    scale = 0.8 * SIDE / float((high - low).max())
    shift = SIDE / 2 - scale * (low + high) / 2
    drawn = pixels[0] * scale + shift
    flat = np.ones((SIDE, SIDE), np.float32)
    labels = region_labels(flat, None, drawn, FaceFrame.of(drawn))
    places, _ = camera.project(points.astype(np.float64))
    x, y = np.moveaxis((places[0] * scale + shift).astype(np.int64), -1, 0)
    inside = (x >= 0) & (y >= 0) & (x < SIDE) & (y < SIDE) & (normals[:, 2] > 0)
    inside &= points[:, 2] > float(np.nanmin(plane.landmarks[:, 2]))
    out = np.zeros((len(points), len(FEATURES)), np.float32)
    chosen = labels[y[inside], x[inside]][:, [PICTURE_LABELS.index(name) for name in FEATURES]]
    out[inside] = chosen / np.float32(255)
    return out
