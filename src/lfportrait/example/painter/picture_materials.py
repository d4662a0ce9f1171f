"""Materials of a picture: per-pixel shares of skin, hair, neck, clothes, background, ears.

Most of it follows from the picture's regions. What lies below the jaw is classified by its color
and place, and so is a beard; ears by their place alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ...labels import FEATURES as FACE_FEATURES
from ...labels import MATERIALS, PICTURE_LABELS
from ..exemplar import Exemplar
from ..guides.filters import gaussian_blur, skin_distance
from ..guides.regions import Regions
from .headwear import part_headwear
from .small_picture import (
    CHEEKS,
    CLOTHES,
    EARS,
    FEATURES,
    GROUND,
    HAIR,
    LIKE_SKIN,
    NECK,
    PLAIN,
    SKIN,
    SmallPicture,
    near_to,
)

__all__ = ["CLOTHES", "EARS", "FEATURES", "GROUND", "HAIR", "MATERIALS", "NECK", "PLAIN", "SKIN",
           "SmallPicture",
           "material_shares", "painted_shares", "picture_shares"]

Float32 = NDArray[np.float32]

BARE = 1.12
"""Down to here (brows 0, chin 1) it may be neck in the chin's shadow."""
LIKE_HAIR = ((0.015, 2.5),)
"""The same for hair."""
FAR = 0.3
"""Far from the jaw it must be nearer by this share."""
BEARD = 0.7, 1.0
"""Chin and lip so far from the cheeks' hue, over its spread, begin to be bearded, and are."""
MOUSTACHE = 0.4, 0.7
"""The same of the lip's way to the chin, over the way to the cheeks: it is, and it is not."""
EAR, EAR_BEGINS = (-0.15, 0.75), 0.9
"""Ears lie between these (brows 0, chin 1), and this far from the middle, over half the width."""
FEW = 30
"""Fewer pixels than this have no color."""
CLOTH, LEAST_CLOTH = (1.5, 4.0), 0.5
"""Most clothes lie so near to their middle color; what is so far from most is none of them, if no
more than the other part is."""
SAME, COMPARED = 6.0, 2000
"""Colors (Lab) that are so near are the same; and how many of each material are compared."""
BARED, OTHER_HUE = (0.05, 0.7), 12.0
"""So much of the clothes is bare skin, if that is so far from the rest in hue and chroma (Lab)."""
LIKE_GROUND = 1.2
"""Clothes of an exemplar less far from its background's colors than this are taken for it."""


def material_shares(labels: NDArray[np.uint8]) -> Float32:
    """Shares of `MATERIALS`, float32 [..., 7], by soft labels, uint8 [..., K]: a body is neck."""
    share = labels.astype(np.float32) / np.float32(255)
    named = {name: share[..., n] for n, name in enumerate(PICTURE_LABELS)}
    out = np.zeros((*labels.shape[:-1], len(MATERIALS)), np.float32)
    for name in FACE_FEATURES:
        out[..., FEATURES] += named[name]
    out[..., SKIN], out[..., HAIR], out[..., NECK] = named["skin"], named["hair"], named["body"]
    out[..., GROUND] = named["background"]
    # Added plane by plane: numpy is slow in adding up a handful of neighbours.
    total = out[..., SKIN] + out[..., HAIR] + out[..., NECK] + out[..., GROUND] + out[..., FEATURES]
    out /= np.maximum(total, np.float32(1e-3))[..., None]
    return out


def picture_shares(picture: Exemplar, regions: Regions, labels: NDArray[np.uint8],
                   strict: bool = True) -> Float32:
    """Shares of `MATERIALS` of a picture with its soft labels, float32 [h, w, 7].

    Below the jaw, what is of the face's color, or right below it, is neck, the rest clothes; and
    where the background is plain, what looks like it there is background.

    Parameters
    ----------
    picture, regions, labels
        Painting or photo, and what is known of it.
    strict
        For heads, whose necks are seen from all sides: a neck must be alike the cheeks, the more
        so the further away, or lie in the chin's shadow; what hangs there may be hair; and paper in
        the color of skin is skin. Else all right below the jaw is neck: for photos, whose bodies
        are painted of it.
    """
    return _shares(SmallPicture(picture, regions, labels), regions, strict)


def _shares(small: SmallPicture, regions: Regions, strict: bool) -> Float32:
    """`picture_shares` of a picture that has been made small."""
    shares = material_shares(small.labels)
    # Labels fall off gently beyond the outline: what lies there is background all the same.
    shares[regions.person < 0.5] = np.eye(len(MATERIALS), dtype=np.float32)[GROUND]
    body = shares[..., NECK] > 0.02
    if not body.any():
        return shares
    right, down = small.right, small.down
    if strict:
        plain = small.cheeks
        # Shoulders and chest may be bare, but coats are larger.
        far = np.clip((np.hypot(right / 0.8, np.maximum(down - 0.8, 0)) - 0.5) / 0.5, 0, 1)
        alike = small.alike(plain, small.part(body), LIKE_SKIN,
                            np.asarray(1 - FAR * small.part(far), np.float32))
        pure = small.whole(small.pure(plain))
        alike = small.whole(alike) * (1 - pure)
    else:
        plain = small.plain_skin()
        alike = small.whole(small.alike(plain, small.part(body), LIKE_SKIN[:1]))
    bare, other = shares[..., NECK] * alike, shares[..., NECK] * (1 - alike)
    ground = small.whole(small.like_plain_ground(body))
    shares[..., GROUND] += ground * (other if strict else other + bare)
    other *= 1 - ground
    shadow = np.asarray(np.clip((BARE - down) / 0.15, 0, 1), np.float32)
    # Not beside the chin: there a collar's edge is as dark.
    half = 0.5 * regions.frame.width / regions.frame.height
    shadow *= np.clip(((0.85 if strict else 1.05) * half - np.abs(right)) / 0.1, 0, 1)
    if strict:
        if regions.hair is not None:
            shares[..., HAIR] += other * regions.hair
            other *= 1 - regions.hair
        shadow *= small.whole(small.darker(plain, 0.25))
        shadow *= 1 - pure
    else:
        bare *= 1 - ground
    shares[..., NECK] = bare + shadow * other
    shares[..., CLOTHES] = (1 - shadow) * other
    return shares


def _overlooked(small: SmallPicture, skin: Float32) -> Float32:
    """Shares of ``skin`` [h, w] that are hair, by their colors: hair's, not the cheeks'.

    Highlights are skin.
    """
    face = np.where(small.part(small.down) < 0, np.float32(0), small.part(small.face))
    plain = small.cheeks
    known = small.part(small.labels[..., PICTURE_LABELS.index("hair")]) > 200
    looked_at = small.part(skin) > 0.02
    hair = 1 - small.alike(plain, looked_at, LIKE_SKIN)
    hair *= small.alike(known, looked_at, LIKE_HAIR)
    hair *= small.darker(plain, 0.75)
    hair *= 1 - gaussian_blur(np.ascontiguousarray(face), LIKE_SKIN[-1][0] * small.size)
    return skin * small.whole(hair)


def _beard(small: SmallPicture, skin: Float32) -> Float32:
    """Shares of ``skin`` [h, w] that are a beard.

    Chin and upper lip under a beard are alike, and both are of another hue than the cheeks; shade
    is not, and paint that differs from chin to lip is none. What is more like that chin than like
    the cheeks is beard.
    """
    points, plain = small.points, small.cheeks
    chin = _between(small, points[57], points[8], (0.25, 0.9), 0.6)
    lip = _between(small, points[33], points[51], (0.2, 0.85), 1.2)
    low = (small.part(small.down) > CHEEKS[1] - 0.05) & (small.part(skin) > 0.02)
    if min(part.sum() for part in (plain, chin, lip)) < FEW:
        return np.zeros_like(skin)
    chosen = low | plain | chin | lip
    colors = small.blurred(LIKE_SKIN[0][0] / 2)[chosen]
    sure = _bearded(*(colors[part[chosen]] for part in (plain, chin, lip)))
    if sure == 0:
        return np.zeros_like(skin)
    beard = np.zeros(low.shape, np.float32)
    to_plain, to_chin = (skin_distance(colors, part[chosen]) for part in (plain, chin))
    beard[chosen] = sure * np.clip(0.5 + (to_plain - to_chin) / 0.4, 0, 1)
    return skin * small.whole(beard * low)


def _bearded(plain: Float32, chin: Float32, lip: Float32) -> float:
    """How surely chin and upper lip are bearded, by colors [N, 3] of theirs and of plain skin.

    Chroma over lightness is compared, which shade leaves as it is.
    """
    from skimage.color import rgb2lab

    looks = [lab[..., 1:] / (lab[..., :1] + 10) for lab in (
        rgb2lab(np.clip(part, 0, 1)) for part in (plain, chin, lip))]
    skin, chin, lip = (np.median(part, axis=0) for part in looks)
    apart = min(float(np.linalg.norm(part - skin)) for part in (chin, lip))
    spread = np.linalg.norm(looks[0].std(axis=0)) + 0.02
    unlike = np.linalg.norm(lip - chin) / max(apart, 1e-3)
    (least, most), (alike, other) = BEARD, MOUSTACHE
    return float(np.clip((apart / spread - least) / (most - least), 0, 1)
                 * np.clip((other - unlike) / (other - alike), 0, 1))


def _beside(small: SmallPicture, regions: Regions) -> Float32:
    """Where ears are, if they show: beside the face, from the brows to the mouth; [h, w]."""
    upright = np.clip(np.minimum(small.down - EAR[0], EAR[1] - small.down) / 0.05 + 0.5, 0, 1)
    half = 0.5 * regions.frame.width / regions.frame.height
    aside = np.clip((np.abs(small.right) / half - EAR_BEGINS) / 0.05 + 0.5, 0, 1)
    return np.asarray(upright * aside * np.clip(2 * (0.75 - small.face), 0, 1), np.float32)


def _between(small: SmallPicture, top: NDArray[np.floating], bottom: NDArray[np.floating],
             along: tuple[float, float], across: float) -> NDArray[np.bool_]:
    """A part of the way from one landmark to another, so wide to both sides; of a small picture."""
    way = (bottom - top) / max(float((bottom - top) @ (bottom - top)), 1e-6)
    rows, columns = small.factor * np.indices(small.image.shape[:2])
    x, y = columns - top[0], rows - top[1]
    down, right = x * way[0] + y * way[1], x * way[1] - y * way[0]
    return np.asarray((down > along[0]) & (down < along[1]) & (np.abs(right) < across))


def painted_shares(exemplar: Exemplar, regions: Regions, labels: NDArray[np.uint8],
                   strict: bool = True) -> Float32:
    """Shares of `MATERIALS` of a painting, float32 [h, w, 7]: `picture_shares`, and a little more.

    What is dark and unlike the cheeks around the face is hair: a fringe, a hat, locks at the
    temples that the networks overlook. Clothes of the colors of the background are background
    beside the neck, and clothes are of one cloth. For heads (``strict``), a beard is a feature of
    the face, and ears are no skin. For photos neck and clothes are as for heads; the rest is none.
    """
    small = SmallPicture(exemplar, regions, labels)
    shares = _shares(small, regions, strict)
    if not strict:
        known = _shares(small, regions, True)
        collar = np.maximum(shares[..., NECK] - known[..., NECK], 0)
        # A brown coat has a shaded cheek's colors, but is worn all the same.
        coat = np.minimum(collar, np.maximum(known[..., CLOTHES] - shares[..., CLOTHES], 0))
        shares[..., NECK] -= collar
        shares[..., CLOTHES] += coat
        shares[..., FEATURES] += collar - coat
    covered = _overlooked(small, shares[..., SKIN])
    shares[..., HAIR] += covered
    shares[..., SKIN] -= covered
    if strict:
        beard = _beard(small, shares[..., SKIN])
        shares[..., FEATURES] += beard
        shares[..., SKIN] -= beard
        shares[..., EARS] = shares[..., SKIN] * _beside(small, regions)
        shares[..., SKIN] -= shares[..., EARS]
    part_headwear(small, shares)
    _hide_ground(small, shares)
    _bare_shoulders(small, shares)
    _part_clothes(small, shares)
    return shares


def _hide_ground(small: SmallPicture, shares: Float32) -> None:
    """Let clothes of the colors of the background be background, in place."""
    behind, worn = shares[..., GROUND] > 0.98, shares[..., CLOTHES] > 0.02
    if not worn.any() or behind.sum() < 50:
        return
    there = small.part(behind)
    chosen = there | small.part(worn)
    alike = np.zeros(there.shape, np.float32)
    alike[chosen] = skin_distance(small.image[chosen], there[chosen]) < LIKE_GROUND
    alike = small.whole(gaussian_blur(alike, 0.008 * max(there.shape)))
    ground = shares[..., CLOTHES] * np.clip(2 * alike - np.float32(0.5), 0, 1)
    shares[..., GROUND] += ground
    shares[..., CLOTHES] -= ground


def _bare_shoulders(small: SmallPicture, shares: Float32) -> None:
    """Let lit skin that was taken for clothes be painted nowhere, in place.

    A lit shoulder is paler than the cheeks that a neck is compared with, but has the colors of a
    forehead or a nose. Only where its hue is not the clothes', and it is lit: a coat may be as
    brown as shaded skin, and linen as white as a highlight.
    """
    from skimage.color import rgb2lab

    worn = small.part(shares[..., CLOTHES]) > 0.5
    skin = small.part(shares[..., [SKIN, NECK, EARS]].sum(axis=-1)) > 0.8
    if min(worn.sum(), skin.sum()) < FEW:
        return
    image = np.clip(small.blurred(LIKE_HAIR[0][0] * 2), 0, 1)
    ours, theirs = (rgb2lab(image[part][::max(1, int(part.sum()) // COMPARED)][None])[0]
                    for part in (worn, skin))
    away = cKDTree(theirs).query(ours, k=min(3, len(theirs)))[0][:, -1]
    bare = (away < SAME) & (ours[:, 0] > np.median(theirs[:, 0]))
    if not BARED[0] < bare.mean() < BARED[1]:
        return
    middles = [np.median(ours[part], axis=0) for part in (bare, ~bare)]
    if np.linalg.norm((middles[0] - middles[1])[1:]) < OTHER_HUE:
        return
    like = np.zeros(worn.shape, np.float32)
    to_bare, to_cloth = (np.linalg.norm(rgb2lab(image[worn][None])[0] - middle, axis=1)
                         for middle in middles)
    like[worn] = to_bare < to_cloth
    taken = shares[..., CLOTHES] * small.whole(like)
    shares[..., FEATURES] += taken
    shares[..., CLOTHES] -= taken


def _part_clothes(small: SmallPicture, shares: Float32) -> None:
    """Let what is far from most of the clothes' colors be none, in place.

    Hands, a bare chest, the shade beside a neck, a collar: on a sitter's shoulder they would be
    stains. They are painted nowhere.
    """
    worn = small.part(shares[..., CLOTHES]) > 0.5
    if worn.sum() < FEW:
        return
    colors = small.blurred(LIKE_HAIR[0][0] * 2)[worn]
    most = skin_distance(colors, np.ones(len(colors), bool)) < CLOTH[0]
    like = np.ones(worn.shape, np.float32)
    like[worn] = near_to(skin_distance(colors, most), CLOTH[1])
    if most.sum() < FEW or like[worn].mean() < LEAST_CLOTH:
        return
    stains = shares[..., CLOTHES] * (1 - small.whole(like))
    shares[..., FEATURES] += stains
    shares[..., CLOTHES] -= stains
