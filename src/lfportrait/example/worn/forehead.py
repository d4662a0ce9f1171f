"""Where a painted forehead is covered or shaded: linen, a hat's brim and its shade.

A forehead is bare where its colors and its light are those of cheeks and nose. What has others,
hangs down from above and is more than a wrinkle is a cover; what of it is hair is told apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numba
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...labels import PICTURE_LABELS
from ..exemplar import Exemplar
from ..guides.filters import disk
from ..guides.regions import Regions
from ..painter.picture_materials import SmallPicture

__all__ = ["HIDES", "Forehead", "covered_forehead"]

Float32 = NDArray[np.float32]
Bools = NDArray[np.bool_]

HAIRLINE, TEMPLE, ROUND = 0.54, 0.86, 2.0
"""A forehead ends this far above the brows (chin -1), and this far from its middle over half the
face's width, in a superellipse of this power."""
HIGH = 0.64
"""The same height of a forehead that is hidden."""
HIDES = 0.3
"""A forehead is hidden if no less than this share of it is covered by something else than hair."""
CROWN = 1.15, 0.95, 0.0
"""A head ends this far from its middle over half the face's width, and this far above the brows;
hair that a hat covers begins above this."""
BROWS = 0.03
"""It begins this far above the brows' middle: what lies lower is brows and lids."""
BLUR = 0.02
"""Colors are compared blurred by so much over the face's size."""
LIGHT = 0.4
"""How much light counts against hue and chroma."""
FEW, MOST = 50, 1500
"""A smaller sample of skin says nothing; of a larger one a part will do."""
NEAR, USUAL = 0.02, 0.95
"""A color's distance is that to the nearest of the sample, this share of it left out; so far apart
are the sample's own, but for the rest."""
OTHER, LEAST_OTHER = 1.2, 0.5
"""What is further than this times that, and a little more in Lab, is no skin."""
THICK = 0.04
"""What is narrower, over the face's height, is a wrinkle."""
STRIP = 0.2
"""Skin below a hat, down to the brows, that is no higher than this over the face's height: the edge
of a shade runs through it."""


@dataclass(frozen=True)
class Forehead:
    """What is known of a painted forehead.

    Attributes
    ----------
    covered
        float32 [h, w] in [0, 1], where it is not bare.
    bare
        float32 [h, w] in [0, 1], skin of the face.
    lit
        The same with the nose: its light goes on there.
    crown
        float32 [h, w] in [0, 1], where the head is above the forehead and beside it.
    share
        Of the forehead that is covered, in [0, 1].
    other
        Of the forehead that is covered or shaded by something else than hair, in [0, 1].
    """

    covered: Float32
    bare: Float32
    lit: Float32
    crown: Float32
    share: float
    other: float


def covered_forehead(exemplar: Exemplar, regions: Regions, labels: NDArray[np.uint8]) -> Forehead:
    """Where the forehead of a painting seen from the front, or nearly so, is covered or shaded.

    Parameters
    ----------
    exemplar, regions, labels
        The painting, its regions, and its labels uint8 [h, w, len(PICTURE_LABELS)].
    """
    small = SmallPicture(exemplar, regions, labels)
    right, down = small.part(small.right), small.part(small.down)
    half = 0.5 * regions.frame.width / regions.frame.height
    around, high = (((np.abs(right) / (TEMPLE * half)) ** ROUND
                     + (np.maximum(-down, 0) / top) ** ROUND) for top in (HAIRLINE, HIGH))
    features = _features(small, labels)
    oval = (around < 1) & (down < 0)
    flesh = (small.part(small.face) > 0.7) | oval
    sample = _sample(small, labels)
    unlike, light = _unlike(small, sample, flesh)
    # Linen on the brows themselves is lighter than skin.
    forehead = oval & (down < np.where(light, 0, -BROWS)) & (~features | light)
    hair = small.part(labels[..., PICTURE_LABELS.index("hair")]) > 100
    cover = forehead & unlike
    cover = _from_above(cover, forehead, max(1, round(THICK * regions.frame.height / small.factor)))
    whole = max(float(forehead.sum()), 1.0)
    share, other = float(cover.sum()) / whole, float((cover & ~hair).sum()) / whole
    bare = flesh & ~features & ~unlike & ~cover & ~hair
    if other >= HIDES:
        cover |= _strip(cover, oval & (down < 0) & ~features, round(
            STRIP * regions.frame.height / small.factor))
        bare &= ~cover
        # Where hair begins under a hat nobody knows: as high as on most heads.
        cover |= (high < 1) & (down < 0) & ~oval
    crown = np.hypot(right / (CROWN[0] * half), np.maximum(-down, 0) / CROWN[1]) < 1
    crown &= (down < CROWN[2]) & (around > 1) & ~cover
    covered, skin, lit, head = (small.whole(plane.astype(np.float32)) for plane in (
        cover, bare, bare | sample & flesh & ~unlike, crown))
    return Forehead(covered, skin, lit, head, share, other)


def _features(small: SmallPicture, labels: NDArray[np.uint8]) -> Bools:
    """Brows and what else is no plain skin, of the small picture."""
    part = small.part(labels)
    numbers = [PICTURE_LABELS.index(name) for name in ("brows", "eyes", "nose", "lips")]
    return np.asarray(part[..., numbers].sum(axis=-1, dtype=np.int64) > 40)


def _sample(small: SmallPicture, labels: NDArray[np.uint8]) -> Bools:
    """Cheeks and nose: a nose is lit as a forehead is."""
    nose = small.part(labels[..., PICTURE_LABELS.index("nose")]) > 200
    # Its ridge, without nostrils and their shade.
    nose &= small.part(small.down) < 0.45
    return small.cheeks | nose


def _unlike(small: SmallPicture, sample: Bools, where: Bools) -> tuple[Bools, Bools]:
    """What has other colors than a sample of skin, and what of this is lighter, bool [h, w].

    Skin has a painter's lights, shades and hues, so colors are compared with the nearest ones of
    the sample, and these with each other. Looked at is ``where``.
    """
    from scipy.spatial import cKDTree
    from skimage.color import rgb2lab

    unlike = np.zeros(where.shape, bool)
    if sample.sum() < FEW:
        return unlike, unlike
    lab = rgb2lab(np.clip(small.blurred(BLUR), 0, 1)) * [LIGHT, 1.0, 1.0]
    skin = lab[sample][::max(1, int(sample.sum()) // MOST)]
    tree, near = cKDTree(skin), [max(1, round(NEAR * len(skin)))]
    own = np.quantile(tree.query(skin, k=near)[0], USUAL)
    away = tree.query(lab[where], k=near, workers=numba.get_num_threads())[0][:, 0]
    unlike[where] = away > OTHER * own + LEAST_OTHER
    return unlike, unlike & (lab[..., 0] > np.quantile(skin[:, 0], USUAL))


def _strip(cover: Bools, forehead: Bools, most: int) -> Bools:
    """What of a forehead lies below a cover in columns where that is ``most`` rows at most."""
    below = forehead & ~cover & (np.maximum.accumulate(cover, axis=0))
    count = below.sum(axis=0)
    # Single columns are as their neighbours are.
    thin = cv2.morphologyEx((count <= most).astype(np.uint8)[None], cv2.MORPH_OPEN,
                            np.ones((1, max(1, most // 2)), np.uint8))[0] > 0
    return np.asarray(below & thin)


def _from_above(cover: Bools, forehead: Bools, radius: int) -> Bools:
    """The part of a cover that hangs down from the forehead's upper edge, without wrinkles."""
    kernel = disk(radius)
    # Beyond the forehead it may go on.
    beyond = cover | ~forehead
    opened = cv2.morphologyEx(beyond.astype(np.uint8), cv2.MORPH_OPEN, kernel) > 0
    closed = cv2.morphologyEx(opened.astype(np.uint8), cv2.MORPH_CLOSE, kernel) > 0
    pieces, _ = ndimage.label(closed & forehead)
    rows = np.arange(len(forehead))[:, None]
    top = forehead & (rows < np.where(forehead.any(axis=0), forehead.argmax(axis=0), 0)
                      + 2 * radius)
    kept = np.unique(pieces[top & (pieces > 0)])
    return np.asarray(np.isin(pieces, kept[kept > 0]))
