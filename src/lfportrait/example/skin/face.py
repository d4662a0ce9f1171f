"""The part of a skin that is painted as the face on a photo: guides, look-up table, StyleBlit."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_erosion, gaussian_filter, label

from ...arrays import Bool, Float32
from ...labels import PICTURE_LABELS
from ..guides.filters import (
    broad_blur,
    dilated,
    enlarged,
    gaussian_blur,
    grey,
    match_histogram,
    shrunk,
)
from ..guides.position import Guides, sample_labels
from ..guides.regions import soft_face
from ..kernels.atlas import spread
from ..styleblit import Style, synthesise
from ..surface_guide import SurfaceGuide
from ..transfers import CALM, LABEL_WEIGHT, Transfer
from .sitter import Canvas, Skin

INSIDE = 0.95
"""Share of the exemplar's face (a soft mask) from which on its paint is copied: not its outline."""
FOREHEAD, FRINGE = 0.4, 0.02
"""A forehead, so high over the face's height, has no outline, nor a fringe if less is hair."""
COVERED = 0.3
"""Share of hair in the exemplar's face from which on it is not copied onto a bare one."""
HAIRY = 0.6
"""Share of hair on a sitter's face from which on the exemplar's bare one is not copied onto it."""
DRAWN_OUT = 0.28
"""Nor is the face's paint copied where the guide changes this slowly: beyond the jaw a strip of it
would be drawn out to the neck's back."""
DARKEST, DEEP, SHADE = 0.12, 0.1, 0.03
"""Nor a painter's deep shade at the face's edge: the darkest share of its skin, if it is so much
darker (luma) than half of it, both blurred by so much over the face's size. What goes on beside it
is no darker than that share: shade that ends there is a stain."""
NEAR = 0.06
"""Skin that is so near to features, over the face's size, has their shade or make-up."""
STEADY, EDGE = 0.02, 0.03
"""Sigmas of the blurs for this, and for the edge of what is painted so, over the face's size."""
HOLE = 0.8
"""What the guide does not lead to the face is painted so where so much of what is around it is, and
nowhere else: at a forehead's corner it would take paint from beyond the painter's hairline."""


def deep_shade(transfer: Transfer, inside: Bool, bearded: Float32) -> Bool:
    """Where an exemplar's face is in deep shade from its edge on, bool [h, w].

    ``inside`` is its face, bool [h, w]; ``bearded`` [h, w] in [0, 1], where its dark is no shade.
    """
    exemplar = transfer.exemplar
    step = max(1, int(SHADE * exemplar.size))
    light = gaussian_blur(shrunk(grey(exemplar.image), step), SHADE * exemplar.size / step)
    face, labels = inside[::step, ::step], transfer.labels[::step, ::step]
    eyes, mouth = (dilated(labels[..., [PICTURE_LABELS.index(name) for name in names]]
                           .max(axis=-1) > 40, NEAR * exemplar.size / step)
                   for names in (("brows", "eyes"), ("nose", "lips")))
    beard = bearded[::step, ::step] > 0.1
    skin, shade = face & ~(eyes | mouth | beard), np.zeros_like(face)
    if skin.any():
        usual, deep = np.quantile(light[skin], [0.5, DARKEST])
        parts, _ = label(face & ~mouth & (light < min(deep, usual - DEEP)))
        # What goes on to the eyes is the shade of a whole side.
        wanted = np.setdiff1d(parts[face & ~binary_erosion(face)], [0, *parts[eyes | beard]])
        shade = dilated(np.isin(parts, wanted), 1)
    return np.asarray(enlarged(shade.astype(np.float32), step, inside.shape) > 0.5)


class CopiedFace:
    """The part of an exemplar's face whose paint is copied.

    Parameters
    ----------
    hair, strand : float32 [h, w] in [0, 1], hair in the exemplar, and thin locks over its face.
    bearded : float32 [h, w] in [0, 1], a beard in the exemplar.

    Attributes
    ----------
    planes : float32 [h, w, 3]: the inside of the exemplar's face, what is near it, and hair over
        it.
    labels : uint8 [h, w, K], the exemplar's labels with nothing but background outside of the
        face.
    """

    def __init__(self, transfer: Transfer, hair: Float32, strand: Float32,
                 bearded: Float32) -> None:
        self._transfer, exemplar = transfer, transfer.exemplar
        soft = transfer.face.astype(np.float32) / np.float32(255)
        near = gaussian_filter(soft[::4, ::4], 0.12 * exemplar.size / 4)
        covered = gaussian_filter(hair[::4, ::4], 0.04 * exemplar.size / 4)
        near, covered = (np.repeat(np.repeat(one, 4, 0), 4, 1)[:soft.shape[0], :soft.shape[1]]
                         for one in (near, covered))
        # Above the brows it may end in a bare forehead: there is no outline.
        sides = soft_face(soft.shape, exemplar.landmarks, FOREHEAD) > 255 * INSIDE
        inside = sides & ((soft > INSIDE) | (soft > 0.5) & (covered < FRINGE))
        inside &= ~deep_shade(transfer, inside, bearded)
        # A strand is too thin for the blur, and ends in a rim of its own.
        rim = gaussian_blur(np.ascontiguousarray(strand), max(0.5, STEADY * exemplar.size))
        covered = np.maximum(covered, rim * np.float32(2))
        self.planes = np.stack([inside.astype(np.float32), near, covered], axis=-1)
        # No piece of the face comes from outside of it: dark strokes of the outline as crumbs.
        # Votes look a pixel beyond a piece.
        self.labels = transfer.labels.copy()
        outside = ~binary_erosion(inside, np.ones((3, 3)))
        ground = PICTURE_LABELS.index("background")
        self.labels[outside] = 255 * (np.arange(len(PICTURE_LABELS)) == ground)

    def core(self, skin: Skin, canvas: Canvas, face: Float32, ratio: Float32, size: float) -> Bool:
        """Where the face is painted as on a photo, [N]; the rest is patches.

        ``face`` are float32 [N, 3], `planes` where the guide leads; ``ratio`` [N], how much slower
        than the plane the guide changes; ``size`` the canvas's pixels per pixel of the exemplar.
        """
        # Hair that hangs over the exemplar's cheek is nothing for a bare one.
        bare = 1 if skin.hair is None else 1 - skin.hair
        steady = self._calm(canvas, np.minimum(ratio, 1), STEADY, size)
        core = (face[:, 0] > 0.5) & skin.outwards & (face[:, 2] * bare < COVERED)
        if skin.hair is not None:
            # Nor is a bare forehead or chin for a fringe or a beard.
            core &= skin.hair * (1 - face[:, 2]) < HAIRY
        core &= steady > DRAWN_OUT
        # No crumbs of the exemplar's outline.
        around = self._calm(canvas, core.astype(np.float32), EDGE, size)
        return np.asarray((around > 0.5) & (core | (around > HOLE)))

    def _calm(self, canvas: Canvas, values: Float32, sigma: float, size: float) -> Float32:
        """Values [N] blurred over the surface, ``sigma`` over the face's size."""
        own, sigma = canvas.own, sigma * self._transfer.exemplar.size * size
        planes = canvas.spread(np.stack([values, np.ones_like(values)], axis=1))
        sums, known = (broad_blur(np.ascontiguousarray(planes[..., n] * own), sigma)
                       for n in range(2))
        mean = np.asarray(sums / np.maximum(known, np.float32(1e-3)), np.float32)
        return canvas.gathered(mean, len(values))

    def paint(self, skin: Skin, guide: SurfaceGuide, canvas: Canvas, position: Float32,
              anchor: Float32, ratio: Float32, core: Bool) -> Float32:
        """StyleBlit over the face, [H, W, 3]; 0 elsewhere.

        ``position`` and ``anchor`` [N, 2] are places in the exemplar, by the guide and rigid; the
        others are as for, and from, `core`.
        """
        transfer, config = self._transfer, self._transfer.config
        scale = guide.scale / skin.pixels * canvas.step
        looks = match_histogram(np.ascontiguousarray(skin.appearance[None]), transfer.distribution,
                                np.ones((1, len(skin.index)), np.float32))[0]
        planes = np.concatenate([position, anchor, looks[:, None], ratio[:, None],
                                 skin.seen[:, None], core[:, None]], axis=1)
        picture = np.zeros((*canvas.slots.shape, 3), np.float32)
        for x0, y0, x1, y1, dx, dy in (skin.atlas.boxes // canvas.step).tolist():
            part = slice(y0 + dy, y1 + dy), slice(x0 + dx, x1 + dx)
            slots = canvas.slots[part]
            inside = np.append(core, False)[slots] & (slots >= 0)
            rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
            if not len(rows):
                continue
            # A little around, for the votes.
            crop = (slice(max(rows[0] - 8, 0), rows[-1] + 9),
                    slice(max(columns[0] - 8, 0), columns[-1] + 9))
            values = np.empty((*slots[crop].shape, planes.shape[1]), np.float32)
            spread(planes, np.ascontiguousarray(slots[crop]), np.float32(np.nan), values)
            places = np.ascontiguousarray(values[..., :2])
            labels = sample_labels(transfer.labels, places)
            known = np.nan_to_num(values)
            weights = transfer.weights(np.ones(labels.shape[:2], np.float32), labels, places,
                                       scale)
            weights *= known[..., 5:7]
            guides = Guides(places, np.ascontiguousarray(known[..., 4]), labels,
                            np.ascontiguousarray(values[..., 2:4]))
            style = Style(transfer.appearance, self.labels, transfer.table, transfer.colors(scale))
            result = synthesise(
                guides, weights, LABEL_WEIGHT, style, config.blit,
                transfer.seeds(guides.anchor, None, scale),
                calm=CALM * 255 * config.table.appearance_weight)
            picture[part][crop] = result.image
        return picture
