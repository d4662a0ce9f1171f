"""Per-region styles of a photo: another exemplar or strength for hair, lips and so on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..labels import GROUPS, LABELS, PICTURE_LABELS, RegionStyle, members
from .exemplar import Exemplar
from .guides.regions import find_regions
from .painter.picture_materials import CLOTHES, EARS, NECK, SKIN, picture_shares

__all__ = ["mix_regions"]

Float32 = NDArray[np.float32]


def mix_regions(photo: NDArray[np.uint8], landmarks: NDArray[np.floating], painted: Float32,
                choices: Sequence[RegionStyle], others: dict[str, Float32]) -> Float32:
    """Blend paintings of one photo by its soft regions.

    Parameters
    ----------
    photo
        uint8 [H, W, 3].
    landmarks
        [68, 2] of the photo.
    painted
        float32 [H, W, 3] in [0, 1], the painting of all other regions.
    choices
        What regions get; later ones win.
    others
        The photo painted by the other exemplars, by `RegionStyle.style`.

    Returns
    -------
    float32 [H, W, 3] in [0, 1].
    """
    shares = _region_shares(photo, landmarks, [choice.region for choice in choices])
    plain = photo[..., :3].astype(np.float32) / np.float32(255)
    out = np.array(painted, np.float32)
    for choice in choices:
        share = shares[choice.region][..., None]
        wanted = others[choice.style] if choice.style else painted
        out += share * (plain + np.float32(choice.strength) * (wanted - plain) - out)
    return np.clip(out, 0, 1)


def _region_shares(photo: NDArray[np.uint8], landmarks: NDArray[np.floating],
                   names: Sequence[str]) -> dict[str, Float32]:
    """How far each pixel lies in each region, float32 [H, W] by its name.

    The labels of pictures (`PICTURE_LABELS`) do not separate ears from skin, nor neck from clothes:
    where one of those is asked for, they are parted as a painter parts them.
    """
    regions = find_regions(photo, landmarks)
    labels = regions.labels()
    found = {name: labels[..., n] / np.float32(255) for n, name in enumerate(PICTURE_LABELS)}
    if any(name in ("ears", "skin", "neck", "clothes") for name in names):
        picture = Exemplar(np.ascontiguousarray(photo[..., :3]),
                           np.asarray(landmarks, np.float64), "")
        parts = picture_shares(picture, regions, labels)
        for whole, (one, two), columns in (("skin", ("skin", "ears"), (SKIN, EARS)),
                                           ("body", GROUPS["body"], (NECK, CLOTHES))):
            first, second = (parts[..., column] for column in columns)
            share = first / np.maximum(first + second, np.float32(1e-3))
            known = found[whole]
            found[one], found[two] = known * share, known * (1 - share)
    return {name: np.asarray(sum(found[part] for part in (
        (name,) if name in found else members(name, LABELS))), np.float32) for name in names}
