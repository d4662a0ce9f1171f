"""A painted skin becomes a field's colours: looked up at first, then fitted exactly.

A lattice point takes the colour of the surface point above it, along the normal of the head's large
shape. That is all a preview needs. Between lattice points, though, strokes are soft: so the charts
themselves become the views of a least-squares fit (`fit.ColorModel`), each trusted where it owns
the surface. No two of them disagree, so nothing is averaged away.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..capture import Camera
from ..example.skin import Painting, Skin
from ..field import VoxelField
from .fit import ColorModel
from .views import StyleView

__all__ = ["chart_views", "look_up_rows"]

Float32 = NDArray[np.float32]

BEFORE, BEHIND = 2.5, 7.0
"""Lattice points up to so many voxels before a chart's surface, and under it, take its colour."""


def row_places(field: VoxelField, skin: Skin) -> Float32:
    """Place in the skin's atlas of each lattice row, float32 [N, 2]; NaN where there is none."""
    points = np.ascontiguousarray(field.lattice_points(), np.float32)
    voxel = float((2.0 * field.radius / np.array(field.links.shape[::-1])).mean())
    return skin.atlas.locate(points, BEFORE * voxel, BEHIND * voxel)[0]


def look_up_rows(model: ColorModel, painting: Painting, places: Float32) -> None:
    """Give a model's rows the painting's colours at their places; marks them as seen."""
    found = painting.at(places)
    known = np.isfinite(found[:, 0])
    model.colors[known] = found[known]
    model.seen[known] = 1.0


def chart_views(field: VoxelField, painting: Painting, background: float) -> list[StyleView]:
    """The charts as views of a fit: what they should show, and the lattice rows behind it."""
    atlas = painting.skin.atlas
    own = atlas.own
    views = []
    for n, (x0, y0, x1, y1, dx, dy) in enumerate(atlas.boxes.tolist()):
        there = slice(y0 + dy, y1 + dy), slice(x0 + dx, x1 + dx)
        camera = atlas.cameras[n]
        camera = Camera(camera.pose, camera.focal, camera.center - np.array([x0, y0]),
                        np.array([x1 - x0]), np.array([y1 - y0]))
        weights = field.sample_weights(camera, 0, inside=atlas.owner[there] >= 0)
        alpha = weights.alpha.reshape(y1 - y0, x1 - x0)
        shown = (alpha[..., None] * picture + (1 - alpha[..., None]) * np.float32(background)
                 for picture in (atlas.color[there], painting.color[there]))
        content, example = (np.asarray(picture, np.float32) for picture in shown)
        trust = np.where(own[there], np.float32(1), np.float32(0))
        views.append(StyleView(content, example, alpha, trust, weights))
    return views
