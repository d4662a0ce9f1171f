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
from ..surface_guide import HeadPlane
from .hair import hair_by_place

__all__ = ["skin_regions"]

Float32 = NDArray[np.float32]

SIDE = 512
"""Side in pixels of the picture that the features are drawn in."""


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
