"""A picture made small, whose colors are compared; and the numbers of the materials."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...labels import FEATURES as FACE_FEATURES
from ...labels import PICTURE_LABELS
from ..exemplar import Exemplar
from ..guides.filters import broad_blur, enlarged, grey, shrunk, skin_distance
from ..guides.regions import Regions, soft_face

__all__ = ["CHEEKS", "CLOTHES", "EARS", "FEATURES", "GROUND", "HAIR", "LIKE_SKIN", "NECK", "PLAIN",
           "SKIN", "SmallPicture", "near_to"]

Float32 = NDArray[np.float32]

SKIN, HAIR, NECK, CLOTHES, GROUND, FEATURES, EARS = range(7)
PLAIN = 0.08
"""A background whose colors deviate by no more than this (standard deviation) is plain."""
CHEEKS = 0.15, 0.6
"""The skin that a neck is compared with lies between these (brows 0, chin 1)."""
LIKE_PLAIN = ((0.025, 1.5),)
"""The same for a plain background."""
PURER, LEAST_CHROMA = 1.1, 10.0
"""So many times the chroma of the face's purest tenth, or of greys, is a collar's, no neck's."""
LOOKED_AT = 30.0
"""Colors are compared in a picture whose face is at least of this size: all of it is blurred."""
LIKE_SKIN = (0.05, 3.0), (0.015, 3.5)
"""Blurs, over the face's size, and how far from the skin's colors a neck may be then."""


class SmallPicture:
    """A picture as small as its colors may be compared in, which are blurred anyway.

    Parameters
    ----------
    picture
        Painting or photo.
    regions, labels
        What is known of it.

    Attributes
    ----------
    image
        float32 [h / factor, w / factor, 3] in [0, 1].
    factor
        How much smaller it is.
    shape
        Height and width of the picture.
    size
        Of its face, in the small picture's pixels.
    right, down
        float32 [h, w], the picture's pixels in the face's frame.
    """

    def __init__(self, picture: Exemplar, regions: Regions, labels: NDArray[np.uint8]) -> None:
        self.factor = int(np.clip(picture.size / LOOKED_AT, 1, 3))
        self.image: Float32 = np.stack(
            [shrunk(plane / np.float32(255), self.factor)
             for plane in np.moveaxis(picture.image.astype(np.float32), -1, 0)], axis=-1)
        self.shape = picture.image.shape[0], picture.image.shape[1]
        self.size = picture.size / self.factor
        self.points, self.labels = picture.landmarks, labels
        self.right, self.down = regions.frame.local(self.shape)
        self._blurred: dict[float, Float32] = {}

    @functools.cached_property
    def face(self) -> Float32:
        """The face without its forehead, soft; float32 [h, w] of the picture in [0, 1]."""
        return soft_face(self.shape, self.points).astype(np.float32) / np.float32(255)

    @functools.cached_property
    def cheeks(self) -> NDArray[np.bool_]:
        """The part of the face that is bare, of the small picture.

        A forehead may lie under a fringe, or a mask's hair that is none to the network, and a chin
        under a beard. What lies beside the face and is skin to the labels may be locks or a hat.
        """
        down = self.part(self.down)
        return np.asarray(self.plain_skin() & (down > CHEEKS[0]) & (down < CHEEKS[1])
                          & (self.part(self.face) > np.float32(230 / 255)))

    def plain_skin(self) -> NDArray[np.bool_]:
        """Skin without features, of the small picture."""
        labels = self.part(self.labels)
        features = labels[..., [PICTURE_LABELS.index(name) for name in FACE_FEATURES]]
        skin = labels[..., PICTURE_LABELS.index("skin")]
        return np.asarray((skin > 200) & (features.sum(-1) < 30))

    def part(self, plane: NDArray[Any]) -> NDArray[Any]:
        """Every Nth pixel of a plane of the picture, [h, w]."""
        return plane[::self.factor, ::self.factor]

    def whole(self, plane: Float32) -> Float32:
        """A small plane as large as the picture."""
        return enlarged(plane, self.factor, self.shape)

    def blurred(self, sigma: float) -> Float32:
        """The small picture blurred; ``sigma`` over the face's size."""
        if sigma not in self._blurred:
            self._blurred[sigma] = np.stack(
                [broad_blur(np.ascontiguousarray(self.image[..., c]), sigma * self.size)
                 for c in range(3)], axis=-1)
        return self._blurred[sigma]

    def alike(self, sample: NDArray[np.bool_], places: NDArray[np.bool_],
              tests: tuple[tuple[float, float], ...], allowed: Float32 | None = None) -> Float32:
        """How much places are of a sample's colors; 0 elsewhere, 1 if the sample is small.

        Several blurs and limits: strokes by their mean, the edge of a collar by itself;
        ``allowed`` scales the limits. All planes are small, [h, w].
        """
        chosen = places | sample
        scale = 1.0 if allowed is None else allowed[chosen]
        out = np.zeros(places.shape, np.float32)
        out[chosen] = np.min([near_to(skin_distance(self.blurred(blur)[chosen], sample[chosen]),
                                    limit * scale) for blur, limit in tests], axis=0)
        return out

    def like_plain_ground(self, body: NDArray[np.bool_]) -> Float32:
        """How much the body looks like the background; 0 where that is not plain."""
        behind = self.part(self.labels[..., PICTURE_LABELS.index("background")]) > 250
        if not behind.any() or self.image[behind].std(axis=0).max() >= PLAIN:
            return np.zeros(behind.shape, np.float32)
        return self.alike(behind, self.part(body), LIKE_PLAIN)

    def darker(self, plain: NDArray[np.bool_], share: float) -> Float32:
        """Where it is darker than all but a share of the plain skin."""
        light = grey(self.blurred(LIKE_SKIN[-1][0]))
        if not plain.any():
            return np.ones_like(light)
        least = np.quantile(light[plain], share)
        return np.asarray(np.clip((least - light) / 0.05, 0, 1), np.float32)

    def pure(self, plain: NDArray[np.bool_]) -> Float32:
        """Where colors are purer than the plain skin's: shade makes none purer."""
        from skimage.color import rgb2lab

        if not plain.any():
            return np.zeros(plain.shape, np.float32)
        colors = rgb2lab(np.clip(self.blurred(LIKE_SKIN[-1][0]), 0, 1))
        chroma = np.hypot(colors[..., 1], colors[..., 2])
        most = PURER * max(float(np.quantile(chroma[plain], 0.9)), LEAST_CHROMA)
        return np.asarray(np.clip((chroma - most) / (0.1 * most) + 0.5, 0, 1), np.float32)


def near_to(distance: Float32, limit: NDArray[np.floating] | float) -> Float32:
    """1 for small distances, 0 for large ones, one half at the limit."""
    return np.asarray(1 / (1 + np.exp(np.clip((distance - limit) / 0.4, -30, 30))), np.float32)
