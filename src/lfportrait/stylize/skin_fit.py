"""A painted skin becomes a field's colors: looked up at first, then fitted.

A lattice point takes the color of the surface point above it, along the normal of the head's large
shape. That is all a preview needs. Between lattice points, though, strokes are soft: so the charts
themselves become the views of a least-squares fit (`fit.ColorModel`), each trusted where it owns
the surface. No two of them disagree, so nothing is averaged away.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ..capture import Camera
from ..example import Painting, Skin
from ..field import VoxelField
from .fit import ColorModel
from .views import StyleView

__all__ = ["chart_camera", "chart_pixels", "chart_views", "for_lattice", "look_up_rows",
           "row_labels", "show_painting"]

Float32 = NDArray[np.float32]

ASIDE = 0.02
"""Weight in the fit of what a chart shows but does not own."""
SMOOTH = 0.75
"""Sigma of the blur, in lattice spacings, of what the lattice shows below a texture. A point that
takes the paint at its place has strokes in it that no lattice can show. In the chart the texture
makes up for them; seen from elsewhere both lie a little apart, and strokes look embossed. On a
scanned head in three manners this is where neighbouring views agree best for their sharpness."""


def for_lattice(painting: Painting, field: VoxelField) -> Painting:
    """A painting low-passed to the field's lattice; finer detail is left to the texture.

    Parameters
    ----------
    painting
        On the field's skin.
    field
        Its lattice's spacing decides.
    """
    atlas, step = painting.skin.atlas, painting.step
    sigma = SMOOTH * float(field.spacing.mean()) * painting.skin.pixels / step
    height, width = painting.color.shape[:2]
    known = (atlas.owner[::step, ::step][:height, :width] >= 0).astype(np.float32)
    sums = cv2.GaussianBlur(painting.color * known[..., None], (0, 0), sigma)
    share = cv2.GaussianBlur(known, (0, 0), sigma)
    color = sums / np.maximum(share, np.float32(1e-3))[..., None]
    return replace(painting, color=np.asarray(color, np.float32))


def look_up_rows(model: ColorModel, painting: Painting) -> None:
    """Give a model's rows the painting's colors at their places; marks them as seen."""
    found = painting.at(painting.skin.rows)
    known = np.isfinite(found[:, 0])
    model.colors[known] = found[known]
    model.seen[known] = 1.0


def row_labels(skin: Skin) -> tuple[NDArray[np.uint8], tuple[str, ...]]:
    """Soft regions of a field's rows, uint8 [N, R], and the regions' names.

    Rows that no chart shows belong to none. Kept with the skin.
    """
    return skin.once("row labels", lambda: _row_labels(skin))


def _row_labels(skin: Skin) -> tuple[NDArray[np.uint8], tuple[str, ...]]:
    labels, names = skin.labels
    owner = skin.atlas.owner
    known = np.flatnonzero(np.isfinite(skin.rows[:, 0]))
    pixel = skin.rows[known].astype(np.int32)
    slot = skin.slots_of(owner[np.clip(pixel[:, 1], 0, owner.shape[0] - 1),
                               np.clip(pixel[:, 0], 0, owner.shape[1] - 1)])
    out = np.zeros((len(skin.rows), len(names)), np.uint8)
    # The last one stands for none, -1.
    out[known] = np.take(np.concatenate([labels, np.zeros_like(labels[:1])]), slot, axis=0)
    return out, names


def chart_views(field: VoxelField, skin: Skin, background: float, step: int = 1,
                ) -> list[StyleView]:
    """The charts as views of a fit, and the lattice rows behind each pixel.

    Parameters
    ----------
    field
        The real field.
    skin
        Of the field.
    background
        Grey level behind the head.
    step
        Use every ``step``-th pixel; a power of two up to 16.
    """
    atlas = skin.atlas
    own = atlas.own
    views = []
    for n in range(len(atlas.boxes)):
        there = chart_pixels(skin, n, step)
        camera = chart_camera(skin, n, step)
        width, height = int(camera.width[0]), int(camera.height[0])
        # The networks look at whole pictures; the fit only at what a chart owns.
        inside = own[there] if step == 1 else atlas.owner[there] >= 0
        weights = field.sample_weights(camera, 0, inside=inside)
        alpha = weights.alpha.reshape(height, width)
        content = _shown(atlas.color[there], alpha, background)
        trust = np.where(own[there], np.float32(1), np.float32(ASIDE)) * alpha
        trust[alpha < 0.05] = 0.0
        views.append(StyleView(content, content, alpha, trust, weights, trust))
    return views


def chart_camera(skin: Skin, n: int, step: int) -> Camera:
    """The camera of the part of a chart that the atlas holds, at every ``step``-th pixel."""
    camera = skin.atlas.cameras[n]
    x0, y0, x1, y1 = skin.atlas.boxes[n, :4].tolist()
    return Camera(camera.pose, camera.focal / step, (camera.center - [x0, y0]) / step,
                  np.array([(x1 - x0) // step]), np.array([(y1 - y0) // step]))


def chart_pixels(skin: Skin, n: int, step: int) -> tuple[slice, slice]:
    """Rows and columns of the atlas that hold every ``step``-th pixel of a chart."""
    x0, y0, x1, y1, dx, dy = (int(value) for value in skin.atlas.boxes[n])
    width, height = (x1 - x0) // step, (y1 - y0) // step
    left, top = x0 + dx + step // 2, y0 + dy + step // 2
    return slice(top, top + height * step, step), slice(left, left + width * step, step)


def show_painting(views: list[StyleView], painting: Painting, background: float,
                  step: int = 1) -> None:
    """Let the charts' views (`chart_views`) ask for a painting's colors."""
    for n, view in enumerate(views):
        rows, columns = chart_pixels(painting.skin, n, 1)
        x0, y0 = columns.start, rows.start
        if step == painting.step:
            picture = painting.color[y0 // step:, x0 // step:][:view.shape[0], :view.shape[1]]
        else:
            # Means of blocks: the middle alone would alias.
            block = step // painting.step
            part = painting.color[y0 // painting.step:, x0 // painting.step:]
            part = part[:view.shape[0] * block, :view.shape[1] * block]
            picture = part.reshape(view.shape[0], block, view.shape[1], block, 3).mean((1, 3))
        view.example = _shown(picture, view.alpha, background)


def _shown(picture: Float32, alpha: Float32, background: float) -> Float32:
    """A picture on the background, by its opacity."""
    opacity = alpha[..., None]
    return np.asarray(opacity * picture + (1 - opacity) * np.float32(background), np.float32)
