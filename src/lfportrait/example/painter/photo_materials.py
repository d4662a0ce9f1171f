"""Materials of a photo, and their tones in the exemplar's paint (`photo`).

The photo says itself what is hair, neck, clothes and background; what the exemplar does not show
is painted with what comes nearest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..exemplar import Exemplar, face_size
from ..guides.appearance import grey, skin_distance
from ..guides.blurs import broad_blur, gaussian_blur
from ..guides.regions import Regions
from .looks import BLUR, contours
from .materials import STAND_INS, ExemplarMaterials, matched_looks
from .picture_materials import CLOTHES, GROUND, HAIR, PLAIN, SKIN, picture_shares

__all__ = ["has_plain_ground", "photo_looks", "photo_shares"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

ODD = 3.5
"""On the head above the brows, what is no hair and further from the skin's color is worn."""
GROUND_TRUST = 4.0, 0.05
"""Weight of the tone in a plain background (paper), and in others, against 1 on edges."""
LEAST_TRUST = 0.5
"""The same where the photo is plain: borders of paint follow its shading."""
HAIR_TRUST = 0.4
"""The same of tone and detail in the hair: its strokes are the exemplar's."""


def photo_shares(photo: NDArray[np.uint8], regions: Regions, labels: NDArray[np.uint8],
                 position: Float32, painted: Float32, present: NDArray[np.bool_]) -> Float32:
    """Shares of `MATERIALS` of a photo, of those that the exemplar has.

    Parameters
    ----------
    photo, regions, labels
        uint8 [H, W, 3], and its regions and labels (uint8 [H, W, len(PICTURE_LABELS)]).
    position
        float32 [H, W, 2], exemplar pixels; no NaN.
    painted
        float32 [h, w, 7], `painted_shares`.
    present
        bool [7], what the exemplar shows enough of; others stand in for the rest.

    Returns
    -------
    float32 [H, W, 7].
    """
    shares = picture_shares(Exemplar(photo, regions.landmarks), regions, labels, strict=False)
    if regions.hair is None:
        # A shaven head, or a statue's hair: there is hair where the exemplar has it.
        height, width = painted.shape[:2]
        x = np.clip(position[..., 0], 0, width - 1).astype(np.int64)
        y = np.clip(position[..., 1], 0, height - 1).astype(np.int64)
        hair = painted[y, x, HAIR] * shares[..., SKIN]
        shares[..., HAIR] += hair
        shares[..., SKIN] -= hair
    else:
        _, down = regions.frame.local(photo.shape[:2])
        _set_apart(photo, shares, np.asarray(down, np.float32))
    for material, stand_in in STAND_INS:
        if not present[material]:
            shares[..., stand_in] += shares[..., material]
            shares[..., material] = 0
    return shares


def _set_apart(photo: NDArray[np.uint8], shares: Float32, down: Float32) -> None:
    """What is worn on the head (sunglasses, hats) may look like hair or like clothes; in place.

    ``down`` [H, W] is 0 at the brows and 1 at the chin.
    """
    high = (down < -0.12) & (shares[..., SKIN] > 0.3)
    face = (down > 0.2) & (down < 0.8) & (shares[..., SKIN] > 0.95)
    chosen = high | face
    if not high.any() or face.sum() < 50:
        return
    away = skin_distance(photo[chosen] / np.float32(255), face[chosen])
    worn = np.zeros(down.shape, np.float32)
    worn[chosen] = 1 / (1 + np.exp(np.clip((ODD - away) / 0.3, -30, 30)))
    worn *= np.clip((-0.12 - down) / 0.08, 0, 1).astype(np.float32)
    worn = gaussian_blur(worn, 1.0) * shares[..., SKIN]
    shares[..., SKIN] -= worn
    shares[..., HAIR] += 0.5 * worn
    shares[..., CLOTHES] += 0.5 * worn


def has_plain_ground(theirs: ExemplarMaterials) -> bool:
    """Whether the exemplar's background is plain, as paper is."""
    behind = theirs.shares[..., GROUND] > 0.9
    return bool(behind.any() and theirs.luma[behind].std() < PLAIN)


def photo_looks(photo: NDArray[np.uint8], landmarks: Float64, shares: Float32,
                theirs: ExemplarMaterials) -> tuple[Float32, Float32, Float32]:
    """Tones of a photo in the exemplar's paint, and their confidence.

    Parameters
    ----------
    photo, landmarks, shares
        uint8 [H, W, 3], its [68, 2], and its `photo_shares` [H, W, 7].
    theirs
        The exemplar's.

    Returns
    -------
    tone, detail, trust
        float32 [H, W]; the background of the photo says nothing, a plain one is to stay plain.
    """
    shape, face = photo.shape[:2], face_size(landmarks)
    luma = grey(photo)
    fine = luma - broad_blur(luma, BLUR * face)
    tone, detail = (plane.reshape(shape) for plane in matched_looks(
        luma.reshape(-1), fine.reshape(-1), shares.reshape(-1, shares.shape[-1]), theirs,
        theirs.luma))
    ground = shares[..., GROUND]
    behind = theirs.shares[..., GROUND] > 0.9
    if behind.any():
        tone = tone + ground * np.float32(np.median(theirs.luma[behind]))
    _, strong = contours(luma, np.ones_like(luma), face)
    trust = np.maximum(strong, np.float32(LEAST_TRUST))
    trust *= 1 - ground - np.float32(1 - HAIR_TRUST) * shares[..., HAIR]
    trust += np.float32(GROUND_TRUST[0 if has_plain_ground(theirs) else 1]) * ground
    return tone, detail, np.ascontiguousarray(trust, np.float32)
