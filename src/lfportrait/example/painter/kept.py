"""Cache of the materials of paintings."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cache import kept_arrays, key_of
from ...labels import BY_HAND, PICTURE_LABELS
from ...labels import FEATURES as FACE_FEATURES
from ..exemplar import Exemplar
from ..guides.regions import Regions
from .picture_materials import (
    EARS,
    FEATURES,
    GROUND,
    HAIR,
    MATERIALS,
    NECK,
    SKIN,
    painted_shares,
)

__all__ = ["known_shares"]

MOST = 30
"""Paintings that are kept: six megabytes for one of 768 x 1024."""
FEW, APART = 500, 10.0
"""Two parts of the hair, of more pixels than this, differ if their colors do by this in Lab."""
STEPS = np.float32(255)
"""Shares are kept in so many steps: the labels that they come from have no more."""


def known_shares(exemplar: Exemplar, regions: Regions, labels: NDArray[np.uint8],
                 strict: bool = True) -> NDArray[np.float32]:
    """`painted_shares`, from the user's cache where they have been found before.

    Parameters
    ----------
    exemplar, regions, labels, strict
        As there; ``labels`` are the regions' own, uint8 [h, w, K].

    Returns
    -------
    shares
        float32 [h, w, 7] in [0, 1] by `MATERIALS`, in steps of 1/255.
    """
    if exemplar.covered is not None and exemplar.bared is not None:
        return _bared_shares(exemplar, regions, exemplar.covered, exemplar.bared, strict)

    def find() -> dict[str, NDArray[Any]]:
        shares = painted_shares(exemplar, regions, labels, strict)
        return {"shares": np.asarray(shares * STEPS + np.float32(0.5), np.uint8)}

    key = key_of(__name__, exemplar.image, exemplar.landmarks,
                 regions.person, regions.hair, strict)
    # A file keeps rounded numbers: the first run continues with the numbers that the next one
    # reads.
    kept = kept_arrays("materials", key, find, most=MOST)["shares"]
    shares = kept.astype(np.float32) / STEPS
    if exemplar.by_hand is not None:
        _paint_over(shares, exemplar.by_hand, labels)
    return shares


def _paint_over(shares: NDArray[np.float32], by_hand: NDArray[np.uint8],
                labels: NDArray[np.uint8]) -> None:
    """Let regions that were painted over by hand be what was painted, in place.

    What is skin by hand leaves the face its brows, eyes, nose and lips, and its ears; a hat is
    painted nowhere.
    """
    for name, material in (("hair", HAIR), ("hat", FEATURES), ("neck", NECK), ("skin", SKIN),
                           ("background", GROUND)):
        here = by_hand == BY_HAND.index(name)
        if name == "skin":
            own, ears = np.zeros_like(shares[here]), shares[here][:, EARS]
            face = labels[here][:, [PICTURE_LABELS.index(one) for one in FACE_FEATURES]].sum(
                axis=1, dtype=np.float32)
            own[:, FEATURES] = np.minimum(face / STEPS, 1 - ears)
            own[:, EARS] = ears
            own[:, SKIN] = 1 - own[:, FEATURES] - ears
            shares[here] = own
        else:
            shares[here] = np.eye(len(MATERIALS), dtype=np.float32)[material]


def _one_cloth(image: NDArray[np.uint8], shares: NDArray[np.float32], own: NDArray[np.bool_],
               above: NDArray[np.bool_]) -> None:
    """Let the smaller of two parts of the hair be painted nowhere if their colors differ; in place.

    ``own`` [h, w] was taken for hair, ``above`` is the hat or linen over the forehead: hair of both
    would have patches.
    """
    from skimage.color import rgb2lab

    if min(own.sum(), above.sum()) < FEW:
        return
    middles = [np.median(rgb2lab(image[part][::max(1, int(part.sum()) // FEW)][None])[0], axis=0)
               for part in (own, above)]
    if np.linalg.norm(middles[0] - middles[1]) > APART:
        less = own if own.sum() < above.sum() else above
        shares[..., FEATURES] += shares[..., HAIR] * less
        shares[..., HAIR] *= ~less


def _bared_shares(exemplar: Exemplar, regions: Regions, covered: Exemplar,
                  bared: NDArray[np.float32], strict: bool) -> NDArray[np.float32]:
    """Shares of a painting whose forehead was bared: skin there, hair above, else as before.

    They are not found in the bared picture: its forehead is no sample of the painter's skin.
    """
    before = covered.regions()
    shares = known_shares(covered, before, before.labels(), strict)
    if regions.hair is not None:
        own = shares[..., HAIR].copy()
        more = np.clip(regions.hair - own, 0, 1)[..., None]
        shares += more * (np.eye(len(MATERIALS), dtype=np.float32)[HAIR] - shares)
        _one_cloth(exemplar.image, shares, own > 0.5, more[..., 0] > 0.5)
    shares += bared[..., None] * (np.eye(len(MATERIALS), dtype=np.float32)[SKIN] - shares)
    return shares
