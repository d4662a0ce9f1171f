"""What is painted from: the version of a painting that fits a sitter.

Spectacles are taken off, a turned face is seen from the front where that is nearer to the sitter,
the forehead is bared, an eye that cannot be made out is painted as the other one is, eyes that look
apart look the same way, and are shut where the sitter's are.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from ..face import FacePose
from .exemplar import Exemplar
from .gaze import with_even_eyes, with_parallel_eyes
from .lids import Lids, asked_lids, closed
from .turned import frontalised, suited
from .worn import bared, without_spectacles

__all__ = ["as_painted", "fitting", "from_the_front"]

Points = NDArray[np.floating]


def as_painted(exemplar: Exemplar, wear: Sequence[str] = ()) -> Exemplar:
    """The exemplar for photos whose face is turned as its own and has open eyes."""
    return bared(_plain(exemplar, wear), fringe=True)


def fitting(exemplar: Exemplar, points: Points, photo: NDArray[np.generic], eyes: str = "auto",
            wear: Sequence[str] = ()) -> Exemplar:
    """The exemplar's version that fits a photo.

    Parameters
    ----------
    exemplar
        The painting.
    points
        [68, 2] in pixels, of the photo's face.
    photo
        uint8 or float in [0, 1], [H, W, 3].
    eyes
        ``"painted"`` leaves the painting's eyes open.
    wear
        What is left on: ``"spectacles"``.

    Raises
    ------
    UserError
        As `suited`.
    """
    chosen = _with_both_eyes(bared(suited(_plain(exemplar, wear), points), fringe=True))
    return closed(chosen, asked_lids(chosen, points, photo)) if eyes == "auto" else chosen


def from_the_front(exemplar: Exemplar, pose: FacePose, fringe: bool, lids: Lids,
                   wear: Sequence[str] = ()) -> Exemplar:
    """The exemplar's version for a head.

    Parameters
    ----------
    exemplar, pose
        The painting, and how its face is turned.
    fringe
        Whether a painted fringe is taken off (`bared`).
    lids
        Which eyes are shut.
    wear
        What is left on: ``"spectacles"``.

    Raises
    ------
    UserError
        As `frontalised`.
    """
    front = bared(frontalised(_plain(exemplar, wear), pose), fringe)
    return closed(_with_both_eyes(front), lids)


def _with_both_eyes(exemplar: Exemplar) -> Exemplar:
    return with_parallel_eyes(with_even_eyes(exemplar))


def _plain(exemplar: Exemplar, wear: Sequence[str]) -> Exemplar:
    if "spectacles" in wear:
        return exemplar
    with ThreadPoolExecutor(1, "regions") as aside:
        # Of who wears no spectacles the regions are asked for next: they are kept.
        aside.submit(exemplar.regions)
        return without_spectacles(exemplar)
