"""Materials of a sitter's head, and their tones in an exemplar's paint.

The materials come from the exemplar's where the guide leads, and from the sitter itself where that
is known better: hair, clothes, ears.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..painter.materials import FEW, STAND_INS, ExemplarMaterials, matched_looks, mostly
from ..painter.picture_materials import (
    CLOTHES,
    EARS,
    FEATURES,
    GROUND,
    HAIR,
    NECK,
    SKIN,
    material_shares,
)
from .hair import below_hair, hair_by_place, without_bays
from .sitter import Skin

__all__ = ["SHOWN", "sitter_looks", "sitter_shares"]

Float32 = NDArray[np.float32]
Bools = NDArray[np.bool_]

MIDDLING = 0.25, 0.75
"""Hair that no photo saw has tones between these quantiles of what they saw."""
JAW = 0.7
"""Below this (brows 0, chin 1) what hangs beside a head leaves a neck bare, above it a cheek."""
SHARP = 8.0
"""How much narrower skin's way into neck is than the guide makes it."""
SHOWN = 0.4
"""Cosine to the best photo from which on a place counts in the distribution of the sitter's
tones."""
DARKEST = 0.12
"""Skin beside the face is no darker than all but this share of the exemplar's: in the mean that is
shade, but a painter's deepest shade has hard edges, which on a neck or a back look like stains."""
EITHER = 0.51
"""Share of ears in what a sitter's ears are painted of; the rest is skin."""


def sitter_shares(skin: Skin, labels: NDArray[np.uint8], present: Bools) -> Float32:
    """Shares of `MATERIALS` of a skin's N places, float32 [N, 7]; no background, no features.

    Features are painted with the face; elsewhere nobody wants an eye.

    Parameters
    ----------
    skin
        Of the sitter.
    labels
        uint8 [N, K], the exemplar's where the guide leads.
    present
        bool [7], what the exemplar shows; others stand in for the rest.
    """
    shares = material_shares(labels)
    shares[:, SKIN] += shares[:, FEATURES]
    shares[:, FEATURES] = 0
    if skin.hair is None:
        # A shaven head, or a statue's: the painter's hair, where hair is, and none on the neck.
        below = skin.once("below hair", lambda: below_hair(skin.plane, skin.flat))
        hanging = shares[:, HAIR] * below
        neck = np.clip((skin.flat[:, 1] / skin.plane.height - JAW) / 0.1, 0, 1)
        shares[:, HAIR] -= hanging
        shares[:, NECK] += hanging * neck
        shares[:, SKIN] += hanging * (1 - neck)
        common = skin.once("hair by place", lambda: hair_by_place(skin.plane, skin.flat))
        wanted = np.maximum(common, shares[:, HAIR])
        wanted = (1 - below) * without_bays(skin.plane, skin.flat, wanted)
        more = np.maximum(wanted - shares[:, HAIR], 0)
        shares *= (1 - more)[:, None]
        shares[:, HAIR] += more
    else:
        rest = np.maximum(1 - shares[:, HAIR], np.float32(1e-3))
        shares[:, [SKIN, NECK]] *= ((1 - skin.hair) / rest)[:, None]
        shares[:, GROUND] *= 1 - skin.hair
        # What the exemplar has as hair and the sitter does not is skin.
        bare = shares[:, [SKIN, NECK, GROUND]].sum(axis=1)
        shares[:, SKIN] += np.maximum(1 - skin.hair - bare, 0)
        shares[:, HAIR] = skin.hair
    # Hair covers ears: an ear that is painted with hair was taken for hair in `sitter.py`.
    ears = skin.ears if skin.hair is None else skin.ears * (1 - skin.hair)
    shares *= (1 - ears)[:, None]
    # Skin or the painter's ears, whichever is more alike.
    shares[:, SKIN] += (1 - EITHER) * ears
    shares[:, EARS] += EITHER * ears
    shares *= (1 - skin.clothes)[:, None]
    shares[:, CLOTHES] = skin.clothes
    shares[:, NECK] += shares[:, GROUND]
    shares[:, GROUND] = 0
    shares /= np.maximum(shares.sum(axis=-1, keepdims=True), np.float32(1e-3))
    for one, other in ((SKIN, NECK), *(((HAIR, SKIN), (HAIR, NECK)) if skin.hair is None else ())):
        _parted(shares, one, other)
    for material, stand_in in STAND_INS:
        if not present[material]:
            shares[:, stand_in] += shares[:, material]
            shares[:, material] = 0
    return shares


def _parted(shares: Float32, one: int, other: int) -> None:
    """Let one material end where another begins, in place.

    A guide that is stretched makes a broad band of half one and half the other, and so does hair
    that is known by its place alone. The exemplar has such places along a line alone, and patches
    would repeat that line.
    """
    both = shares[:, one] + shares[:, other]
    part = shares[:, one] / np.maximum(both, np.float32(1e-6))
    shares[:, one] = both * np.clip(SHARP * (part - np.float32(0.5)) + np.float32(0.5), 0, 1)
    shares[:, other] = both - shares[:, one]


def sitter_looks(skin: Skin, shares: Float32, theirs: ExemplarMaterials) -> tuple[Float32, Float32]:
    """Tones and detail of a skin's places as the exemplar would have them, float32 [N] each."""
    tone, detail = matched_looks(skin.tone, skin.detail, shares, theirs, shown=skin.seen > SHOWN,
                                 darkest=DARKEST)
    hair = shares[:, HAIR]
    inside = mostly(hair, skin.seen > SHOWN)
    if inside.sum() >= FEW:
        # A field that was closed behind is darker there or lighter: nobody knows how much.
        kept = np.clip(tone, *np.quantile(tone[inside], MIDDLING))
        tone += hair * (1 - skin.seen) * (kept - tone)
    return tone, detail * skin.seen
