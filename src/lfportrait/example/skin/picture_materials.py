"""What a picture is made of, pixel by pixel: shares of skin, hair, neck, clothes and background.

Regions of the picture tell most of it. What lies below the jaw is told by its colour and place.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..exemplar import Exemplar
from ..guides.appearance import grey
from ..guides.blurs import broad_blur, enlarged, gaussian_blur, shrunk
from ..guides.labels import LABELS, soft_face
from ..guides.regions import Regions
from .sitter import skin_distance

__all__ = ["CLOTHES", "FEATURES", "GROUND", "HAIR", "MATERIALS", "NECK", "PLAIN", "SKIN",
           "material_shares", "painted_shares", "picture_shares"]

Float32 = NDArray[np.float32]

MATERIALS = ("skin", "hair", "neck", "clothes", "background", "features")
SKIN, HAIR, NECK, CLOTHES, GROUND, FEATURES = range(6)
PLAIN = 0.08
"""A background whose colours deviate by no more than this (standard deviation) is plain."""
BARE = 1.12
"""Down to here (brows 0, chin 1) it may be neck in the chin's shadow."""
CHEEKS = 0.15, 0.6
"""The skin that a neck is compared with lies between these (brows 0, chin 1)."""
LIKE_SKIN = (0.05, 3.0), (0.015, 3.5)
"""Blurs, over the face's size, and how far from the skin's colours a neck may be then."""
LIKE_HAIR = ((0.015, 2.5),)
"""The same for hair."""
LIKE_PLAIN = ((0.025, 1.5),)
"""The same for a plain background."""
FAR = 0.3
"""Far from the jaw it must be nearer by this share."""
PURER, LEAST_CHROMA = 1.1, 10.0
"""So many times the chroma of the face's purest tenth, or of greys, is a collar's, no neck's."""
SMALL = 3
"""Hair that the networks overlook is looked for in a picture so many times smaller."""
LIKE_GROUND = 1.2
"""Clothes of an exemplar less far from its background's colours than this are taken for it."""


def material_shares(labels: NDArray[np.uint8]) -> Float32:
    """Shares of `MATERIALS`, float32 [..., 6], by soft labels, uint8 [..., K]: a body is neck."""
    share = labels.astype(np.float32) / np.float32(255)
    named = {name: share[..., n] for n, name in enumerate(LABELS)}
    out = np.zeros((*labels.shape[:-1], len(MATERIALS)), np.float32)
    for name in ("brows", "eyes", "nose", "lips"):
        out[..., FEATURES] += named[name]
    out[..., SKIN], out[..., HAIR], out[..., NECK] = named["skin"], named["hair"], named["body"]
    out[..., GROUND] = named["background"]
    out /= np.maximum(out.sum(axis=-1, keepdims=True), np.float32(1e-3))
    return out


def picture_shares(picture: Exemplar, regions: Regions, labels: NDArray[np.uint8],
                   strict: bool = True) -> Float32:
    """Shares of `MATERIALS` of a picture with its soft labels, float32 [h, w, 6].

    Below the jaw, what is of the face's colour, or right below it, is neck, the rest clothes; and
    where the background is plain, what looks like it there is background.

    Parameters
    ----------
    picture, regions, labels
        Painting or photo, and what is known of it.
    strict
        For heads, whose necks are seen from all sides: a neck must be alike the cheeks, the more
        so the further away, or lie in the chin's shadow; what hangs there may be hair; and paper in
        the colour of skin is skin. Else all right below the jaw is neck: for photos, whose bodies
        are painted of it.
    """
    shares = material_shares(labels)
    # Labels fall off gently beyond the outline: what lies there is background all the same.
    shares[regions.person < 0.5] = np.eye(len(MATERIALS), dtype=np.float32)[GROUND]
    body = shares[..., NECK] > 0.02
    if not body.any():
        return shares
    image = picture.image.astype(np.float32) / np.float32(255)
    right, down = regions.frame.local(image.shape[:2])
    if strict:
        plain = _cheeks(picture, labels, down)
        # Shoulders and chest may be bare, but coats are larger.
        far = np.clip((np.hypot(right / 0.8, np.maximum(down - 0.8, 0)) - 0.5) / 0.5, 0, 1)
        alike = _alike(image, plain, body, picture.size, LIKE_SKIN,
                       np.asarray(1 - FAR * far, np.float32))
        pure = _pure(image, plain, picture.size)
        alike *= 1 - pure
    else:
        plain = _plain_skin(labels)
        alike = _alike(image, plain, body, picture.size, LIKE_SKIN[:1])
    bare, other = shares[..., NECK] * alike, shares[..., NECK] * (1 - alike)
    ground = _like_plain_ground(image, labels, body, picture.size)
    shares[..., GROUND] += ground * (other if strict else other + bare)
    other *= 1 - ground
    shadow = np.asarray(np.clip((BARE - down) / 0.15, 0, 1), np.float32)
    if strict:
        if regions.hair is not None:
            shares[..., HAIR] += other * regions.hair
            other *= 1 - regions.hair
        # Not beside the chin: there a collar's edge is as dark.
        half = 0.5 * regions.frame.width / regions.frame.height
        shadow *= np.clip((0.85 * half - np.abs(right)) / 0.1, 0, 1)
        shadow *= _darker(image, plain, picture.size, 0.25)
        shadow *= 1 - pure
    else:
        bare *= 1 - ground
    shares[..., NECK] = bare + shadow * other
    shares[..., CLOTHES] = (1 - shadow) * other
    return shares


def _plain_skin(labels: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Skin without features, [h, w]."""
    features = labels[..., [LABELS.index(n) for n in ("brows", "eyes", "nose", "lips")]]
    return np.asarray((labels[..., LABELS.index("skin")] > 200) & (features.sum(-1) < 30))


def _alike(image: Float32, sample: NDArray[np.bool_], places: NDArray[np.bool_], size: float,
           tests: tuple[tuple[float, float], ...], allowed: Float32 | None = None) -> Float32:
    """How much places are of a sample's colours, [h, w]; 0 elsewhere, 1 if the sample is small.

    Several blurs and limits: strokes by their mean, the edge of a collar by itself; ``allowed``
    [h, w] scales the limits.
    """
    chosen = places | sample
    scale = 1.0 if allowed is None else allowed[chosen]
    out = np.zeros(places.shape, np.float32)
    out[chosen] = np.min([_near(skin_distance(_blurred(image, blur * size)[chosen], sample[chosen]),
                                limit * scale) for blur, limit in tests], axis=0)
    return out


def _like_plain_ground(image: Float32, labels: NDArray[np.uint8], body: NDArray[np.bool_],
                       size: float) -> Float32:
    """How much the body looks like the background, [h, w]; 0 where that is not plain."""
    behind = labels[..., LABELS.index("background")] > 250
    if not behind.any() or image[behind].std(axis=0).max() >= PLAIN:
        return np.zeros(body.shape, np.float32)
    return _alike(image, behind, body, size, LIKE_PLAIN)


def _cheeks(picture: Exemplar, labels: NDArray[np.uint8], down: NDArray[np.floating],
            ) -> NDArray[np.bool_]:
    """The part of the face that is bare, [h, w].

    A forehead may lie under a fringe, or a mask's hair that is none to the network, and a chin
    under a beard. What lies beside the face and is skin to the labels may be locks or a hat.
    """
    inside = soft_face(labels.shape[:2], picture.landmarks) > 230
    return np.asarray(_plain_skin(labels) & (down > CHEEKS[0]) & (down < CHEEKS[1]) & inside)


def _darker(image: Float32, plain: NDArray[np.bool_], size: float, share: float) -> Float32:
    """Where it is darker than all but a share of the plain skin, [h, w]."""
    light = grey(_blurred(image, LIKE_SKIN[-1][0] * size))
    if not plain.any():
        return np.ones_like(light)
    return np.asarray(np.clip((np.quantile(light[plain], share) - light) / 0.05, 0, 1), np.float32)


def _pure(image: Float32, plain: NDArray[np.bool_], size: float) -> Float32:
    """Where colours are purer than the plain skin's, [h, w]: shade makes none purer."""
    from skimage.color import rgb2lab

    if not plain.any():
        return np.zeros(plain.shape, np.float32)
    blurred = rgb2lab(np.clip(_blurred(image, LIKE_SKIN[-1][0] * size), 0, 1))
    chroma = np.hypot(blurred[..., 1], blurred[..., 2])
    most = PURER * max(float(np.quantile(chroma[plain], 0.9)), LEAST_CHROMA)
    return np.asarray(np.clip((chroma - most) / (0.1 * most) + 0.5, 0, 1), np.float32)


def _overlooked(exemplar: Exemplar, regions: Regions, labels: NDArray[np.uint8],
                skin: Float32) -> Float32:
    """Shares of ``skin`` [h, w] that are hair, by their colours: hair's, not the cheeks'.

    Highlights are skin. Strokes are blurred anyway: a third of the size shows as much.
    """
    _, down = regions.frame.local(skin.shape)
    face = soft_face(skin.shape, exemplar.landmarks).astype(np.float32) / np.float32(255)
    face[down < 0] = 0
    part, size = np.s_[::SMALL, ::SMALL], exemplar.size / SMALL
    image = np.stack([shrunk(plane / np.float32(255), SMALL)
                      for plane in np.moveaxis(exemplar.image.astype(np.float32), -1, 0)],
                     axis=-1)
    plain = _cheeks(exemplar, labels, down)[part]
    known, looked_at = labels[part][..., LABELS.index("hair")] > 200, (skin > 0.02)[part]
    hair = 1 - _alike(image, plain, looked_at, size, LIKE_SKIN)
    hair *= _alike(image, known, looked_at, size, LIKE_HAIR)
    hair *= _darker(image, plain, size, 0.75)
    hair *= 1 - gaussian_blur(np.ascontiguousarray(face[part]), LIKE_SKIN[-1][0] * size)
    return skin * enlarged(hair, SMALL, skin.shape)


def painted_shares(exemplar: Exemplar, regions: Regions, labels: NDArray[np.uint8],
                   strict: bool = True) -> Float32:
    """Shares of `MATERIALS` of a painting, float32 [h, w, 6]: `picture_shares`, and a little more.

    What is dark and unlike the cheeks around the face is hair: a fringe, a hat, locks at the
    temples that the networks overlook. Clothes of the colours of the background are background
    beside the neck.
    """
    shares = picture_shares(exemplar, regions, labels, strict)
    covered = _overlooked(exemplar, regions, labels, shares[..., SKIN])
    shares[..., HAIR] += covered
    shares[..., SKIN] -= covered
    behind, worn = shares[..., GROUND] > 0.98, shares[..., CLOTHES] > 0.02
    if not worn.any() or behind.sum() < 50:
        return shares
    chosen = behind | worn
    alike = np.zeros(behind.shape, np.float32)
    alike[chosen] = skin_distance(exemplar.image[chosen] / np.float32(255),
                                  behind[chosen]) < LIKE_GROUND
    alike = gaussian_blur(alike, 0.008 * max(behind.shape))
    ground = shares[..., CLOTHES] * np.clip(2 * alike - np.float32(0.5), 0, 1)
    shares[..., GROUND] += ground
    shares[..., CLOTHES] -= ground
    return shares


def _near(distance: Float32, limit: NDArray[np.floating] | float) -> Float32:
    """1 for small distances, 0 for large ones, one half at the limit."""
    return np.asarray(1 / (1 + np.exp(np.clip((distance - limit) / 0.4, -30, 30))), np.float32)


def _blurred(image: Float32, sigma: float) -> Float32:
    """A picture [H, W, 3] blurred."""
    return np.stack([broad_blur(np.ascontiguousarray(image[..., c]), sigma) for c in range(3)],
                    axis=-1)
