"""Notes on differences of sitter and exemplar, a line each: eyes, mouth, stroke size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..capture import Capture
from ..example import Exemplar, asked_lids, closed_words, eye_opening
from ..example.worn import not_worn
from .config import StylizeConfig

__all__ = ["PARTED", "eye_opening", "mouth_opening", "notices"]

Points = NDArray[np.floating]

PARTED = 0.14
"""Height of the gap between the lips over the mouth's width, of a mouth that is open."""
COARSE = 100.0
"""An exemplar whose face is smaller (`face_size`, pixels) is coarse beside a display's rows."""


def _opening(points: Points, pairs: Sequence[tuple[int, int]], ends: tuple[int, int]) -> float:
    """Mean distance of pairs of landmarks over that of two ends; NaN where they are unknown."""
    width = float(np.linalg.norm(points[ends[0]] - points[ends[1]]))
    return float(np.mean([np.linalg.norm(points[a] - points[b]) for a, b in pairs])) / max(
        width, 1e-9)


def mouth_opening(points: Points) -> float:
    """Height of the gap between the lips over the mouth's width, from landmarks [68, 2 or 3]."""
    return _opening(points, ((61, 67), (62, 66), (63, 65)), (48, 54))


def notices(capture: Capture, exemplars: Sequence[Exemplar], config: StylizeConfig) -> list[str]:
    """Notes for the user about the result, one line each."""
    out: list[str] = []
    points = capture.landmarks
    if points is None:
        return out
    for exemplar in exemplars:
        theirs = exemplar.landmarks
        if exemplar.faces > 1:
            out.append(f"{exemplar.name} shows {exemplar.faces} faces, the largest was taken: "
                       "`lfportrait styles add PICTURE --face 2` takes another")
        kept = set(config.keep)
        lids = asked_lids(exemplar, points)
        if any(lids) and "eyes" not in kept:
            them = "them" if all(lids) else "it"
            how = (f"and painted so: --eyes painted opens {them}"
                   if config.on_skin and config.eyes == "auto" else
                   f"but painted open, after {exemplar.name}"
                   + (f": --eyes auto closes {them}" if config.on_skin else ""))
            out.append(f"{closed_words(lids)} closed, {how}, --keep eyes leaves the photo's")
        mouths = mouth_opening(points), mouth_opening(theirs)
        if "lips" not in kept and (mouths[0] > PARTED) != (mouths[1] > PARTED):
            which = "open" if mouths[0] > PARTED else "closed"
            other = "closed" if mouths[0] > PARTED else "open"
            out.append(f"the sitter's mouth is {which}, that of {exemplar.name} is {other}: "
                       "--keep lips leaves the photo's")
        if config.on_skin:
            out += not_worn(exemplar, config.wear)
        if exemplar.size < COARSE:
            out.append(f"the face of {exemplar.name} is only about {3.2 * exemplar.size:.0f} "
                       "pixels wide: its strokes will be coarse on a large display; use a larger "
                       "picture of it")
    return out
