"""Materials of a photo, and their tones in the exemplar's paint (`photo`).

The photo says itself what is hair, neck, clothes and background; what the exemplar does not show
is painted with what comes nearest.
A sitter's beard is hair below the cheeks, which the networks take for skin.
"""

from __future__ import annotations

import cv2
import numpy as np

from ...arrays import Bool, Float32, Float64, UInt8
from ...labels import PICTURE_LABELS
from ..exemplar import Exemplar, face_size
from ..guides.filters import broad_blur, disk, gaussian_blur, grey, skin_distance
from ..guides.regions import Regions
from .materials import BLUR, ExemplarMaterials, contours, matched_looks, stand_in
from .picture_materials import (
    CLOTHES,
    FEATURES,
    GROUND,
    HAIR,
    NECK,
    PLAIN,
    SKIN,
    give,
    picture_shares,
)

FACE = 60.0  # Pixels from the brows to the chin in the picture that is looked at.
CHEEKS, CHIN, REACH = (0.12, 0.45), (0.78, 0.98), (0.3, 2.2)
"""Cheeks, a chin and all of a beard lie between these (brows 0, chin 1)."""
ASIDE = 0.75, 0.4, 1.25  # And so far from the middle, over half the face's width.
BARE = 2.3
"""A chin nearer to the cheeks' colors than this, in standard deviations, is bare, or in shade."""
NEARER = 0.6
"""A beard's distance from the colors of the hair is no more than this share of that from skin's."""
FEW = 30  # Fewer pixels than this have no color.


def grow_beard(photo: UInt8, regions: Regions, labels: UInt8, shares: Float32) -> None:
    """Let a beard be hair, in place in shares [H, W, 7].

    It is what hangs together with a chin that is as the hair is.
    """
    step = max(1, int(regions.frame.height / FACE))
    part = shares[::step, ::step]
    size = part.shape[1], part.shape[0]
    colors = cv2.resize(photo, size, interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    right, down = (plane[::step, ::step] for plane in regions.frame.local(shares.shape[:2]))
    half = 0.5 * regions.frame.width / regions.frame.height
    lips = labels[::step, ::step, PICTURE_LABELS.index("lips")] > 60
    bare = (part[..., SKIN] > 0.9) & (part[..., FEATURES] < 0.05) & ~lips
    cheeks, chin, low = ((down > high) & (down < deep) & (np.abs(right) < aside * half)
                         for (high, deep), aside in zip((CHEEKS, CHIN, REACH), ASIDE))
    cheeks, chin = cheeks & bare, chin & ~lips
    hair = (part[..., HAIR] > 0.8) & (down < CHEEKS[1])
    low &= (part[..., [SKIN, NECK, CLOTHES]].sum(axis=-1) > 0.02) & ~lips
    if min(one.sum() for one in (cheeks, chin, hair)) < FEW:
        return
    chosen = cheeks | chin | hair | low
    to_skin, to_hair = (np.zeros(chosen.shape, np.float32) for _ in range(2))
    for away, sample in ((to_skin, cheeks), (to_hair, hair)):
        away[chosen] = skin_distance(colors[chosen], sample[chosen], 1.0)
    of_chin = float(np.median(to_skin[chin]))
    if of_chin < BARE or np.median(to_hair[chin]) > NEARER * of_chin:
        return
    _, pieces = cv2.connectedComponents((low & (to_hair < NEARER * to_skin)).astype(np.uint8))
    known = np.unique(pieces[chin])
    beard = np.isin(pieces, known[known > 0]).astype(np.float32)
    whole = cv2.resize(gaussian_blur(beard, 0.7), shares.shape[1::-1],
                       interpolation=cv2.INTER_LINEAR)
    for material in (SKIN, NECK, CLOTHES):
        give(shares, shares[..., material] * whole, material, HAIR)


ODD = 3.5  # On the head above the brows, what is no hair and further from the skin's color is worn.
SETTLED = 60.0
"""Pixels from the brows to the chin in the picture in which pieces of a body are found."""
PIECE = 0.18
"""Bare pieces that are nowhere wider than twice this, over the face's height, are none."""
THROAT, CHEST = 1.15, 1.4
"""What reaches above the one is a neck, and below the other clothes (brows 0, chin 1)."""
EARS_FROM = 0.9, 0.06
"""A bare head's ears lie this far from the middle, over half the width, and below the brows."""
FOREHEAD = 0.82, 0.42
"""A bare head's forehead reaches so far to both sides, over half the width, and so high above the
brows, over the face's height; round, as hairlines are."""
GROUND_TRUST = 4.0, 0.05
"""Weight of the tone in a plain background (paper), and in others, against 1 on edges."""
LEAST_TRUST = 0.5  # The same where the photo is plain: borders of paint follow its shading.
DARKEST = 0.05
"""Skin and neck are not darker than all but this share of the exemplar's: crumbs of its outline."""
HAIR_TRUST = 0.4  # The same of tone and detail in the hair: its strokes are the exemplar's.


def photo_shares(photo: UInt8, regions: Regions, labels: UInt8,
                 position: Float32, painted_hair: Float32,
                 present: Bool) -> Float32:
    """Shares of `MATERIALS` of a photo, of those that the exemplar has, float32 [H, W, 7].

    Parameters
    ----------
    photo, regions, labels : uint8 [H, W, 3], and its regions and labels (uint8 [H, W,
        len(PICTURE_LABELS)]).
    position : float32 [H, W, 2], exemplar pixels; no NaN.
    painted_hair : float32 [h, w] in [0, 1], the exemplar's hair, or what it wears instead.
    present : bool [7], what the exemplar shows enough of; others stand in for the rest.
    """
    shares = picture_shares(Exemplar(photo, regions.landmarks), regions, labels, strict=False)
    _settle_body(shares, regions)
    if regions.hair is None:
        # A shaven head, or a statue's hair: there is hair where the exemplar has it, but not on the
        # forehead, where its fringe would be a cap's edge.
        height, width = painted_hair.shape
        x = np.clip(position[..., 0], 0, width - 1).astype(np.int64)
        y = np.clip(position[..., 1], 0, height - 1).astype(np.int64)
        hair = painted_hair[y, x] * shares[..., SKIN] * (1 - _bare(regions, photo.shape[:2]))
        give(shares, hair, SKIN, HAIR)
    else:
        _, down = regions.frame.local(photo.shape[:2])
        _set_apart(photo, shares, np.asarray(down, np.float32))
        grow_beard(photo, regions, labels, shares)
    stand_in(shares, present)
    return shares


def _bare(regions: Regions, shape: tuple[int, int]) -> Float32:
    """Where a bare head's ears and forehead are, float32 [H, W] in [0, 1]: no hair lies there."""
    right, down = regions.frame.local(shape)
    across = np.abs(right) / (0.5 * regions.frame.width / regions.frame.height)
    ears = (np.clip((across - EARS_FROM[0]) / 0.05 + 0.5, 0, 1)
            * np.clip((down - EARS_FROM[1]) / 0.1 + 0.5, 0, 1))
    away = np.hypot(across / FOREHEAD[0], np.minimum(down, 0) / FOREHEAD[1])
    return np.asarray(np.maximum(ears, np.clip((1 - away) / 0.08 + 0.5, 0, 1)), np.float32)


def _settle_body(shares: Float32, regions: Regions) -> None:
    """Let small pieces of a body be what is around them; in place.

    A zip as light as skin is no neck, and the chin's shade on a bare throat is no shirt.
    """
    right, down = regions.frame.local(shares.shape[:2])
    step = max(1, int(regions.frame.height / SETTLED))
    right, down = right[::step, ::step], down[::step, ::step]
    half = 0.5 * regions.frame.width / regions.frame.height
    kernel = disk(PIECE * regions.frame.height / step)
    around = np.ones((7, 7), np.uint8)
    for own, other in ((NECK, CLOTHES), (CLOTHES, NECK)):
        here = shares[::step, ::step, own] > 0.3
        if own == NECK:
            # Whatever begins right below the jaw is a neck.
            sure = cv2.erode(here.astype(np.uint8), kernel) > 0
            sure |= here & (down < THROAT)
        else:
            # Clothes may be narrow, as straps are, but not lie below the chin only.
            sure = here & ((down > CHEST) | (np.abs(right) > half))
        _, parts = cv2.connectedComponents(here.astype(np.uint8), connectivity=4)
        # A little around, for what is soft at its edge.
        kept = cv2.dilate(np.isin(parts, np.setdiff1d(parts[sure], 0)).astype(np.float32), around)
        kept = cv2.resize(kept, shares.shape[1::-1], interpolation=cv2.INTER_LINEAR)
        give(shares, shares[..., own] * (1 - kept), own, other)


def _set_apart(photo: UInt8, shares: Float32, down: Float32) -> None:
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


def photo_looks(photo: UInt8, landmarks: Float64, shares: Float32,
                theirs: ExemplarMaterials) -> tuple[Float32, Float32, Float32]:
    """Tone, detail and their trust of a photo in the exemplar's paint, float32 [H, W] each.

    ``shares`` are its `photo_shares`. The background of the photo says nothing, a plain one is to
    stay plain.
    """
    shape, face = photo.shape[:2], face_size(landmarks)
    luma = grey(photo)
    fine = luma - broad_blur(luma, BLUR * face)
    tone, detail = (plane.reshape(shape) for plane in matched_looks(
        luma.reshape(-1), fine.reshape(-1), shares.reshape(-1, shares.shape[-1]), theirs,
        theirs.luma, darkest=DARKEST))
    ground = shares[..., GROUND]
    behind = theirs.shares[..., GROUND] > 0.9
    if behind.any():
        tone = tone + ground * np.float32(np.median(theirs.luma[behind]))
    _, strong = contours(luma, np.ones_like(luma), face)
    trust = np.maximum(strong, np.float32(LEAST_TRUST))
    trust *= 1 - ground - np.float32(1 - HAIR_TRUST) * shares[..., HAIR]
    trust += np.float32(GROUND_TRUST[0 if has_plain_ground(theirs) else 1]) * ground
    return tone, detail, np.ascontiguousarray(trust, np.float32)
