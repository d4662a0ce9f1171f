"""Regions painted in their own way: another exemplar for the hair, less of it on the lips."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import UserError
from .guides.labels import LABELS
from .guides.regions import find_regions

__all__ = ["RegionStyle", "mix_regions", "read_region"]

Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class RegionStyle:
    """What one region gets.

    Attributes
    ----------
    region
        Of `labels.LABELS`.
    style
        Another exemplar, or "" for the one of the whole picture.
    strength
        0 leaves the photo, 1 gives the painting.
    """

    region: str
    style: str
    strength: float


def read_region(text: str) -> RegionStyle:
    """Read ``REGION=STYLE:STRENGTH``, ``REGION=STYLE``, ``REGION=STRENGTH`` or ``REGION=off``.

    Raises
    ------
    UserError
        If it is none of these.
    """
    region, sign, rest = text.partition("=")
    if not sign or region not in LABELS:
        raise UserError(f"can't read the region {text!r}: write REGION=STYLE:STRENGTH, for example "
                        f"hair=other.png:0.5 or lips=0.3; regions are {', '.join(LABELS)}")
    if rest == "off":
        return RegionStyle(region, "", 0.0)
    style, _, number = rest.rpartition(":") if ":" in rest else ("", "", rest)
    try:
        strength = float(number)
    except ValueError:
        # No number: all of it is the style (a path may hold colons).
        return RegionStyle(region, rest, 1.0)
    if not 0.0 <= strength <= 1.0:
        raise UserError(f"the strength in {text!r} must lie between 0 and 1")
    return RegionStyle(region, style, strength)


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
    labels = find_regions(photo, landmarks).labels()
    plain = photo[..., :3].astype(np.float32) / np.float32(255)
    out = np.array(painted, np.float32)
    for choice in choices:
        share = labels[..., LABELS.index(choice.region), None] / np.float32(255)
        wanted = others[choice.style] if choice.style else painted
        out += share * (plain + np.float32(choice.strength) * (wanted - plain) - out)
    return np.clip(out, 0, 1)
