"""Cache of the materials of paintings."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cache import kept_arrays, key_of
from ..exemplar import Exemplar
from ..guides.regions import Regions
from .picture_materials import HAIR, MATERIALS, SKIN, painted_shares

__all__ = ["known_shares"]

MOST = 30
"""Paintings that are kept: six megabytes for one of 768 x 1024."""
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

    key = key_of("example.painter.picture_materials", exemplar.image, exemplar.landmarks,
                 regions.person, regions.hair, strict)
    # A file keeps rounded numbers: the first run continues with the numbers that the next one
    # reads.
    kept = kept_arrays("materials", key, find, most=MOST)["shares"]
    return kept.astype(np.float32) / STEPS


def _bared_shares(exemplar: Exemplar, regions: Regions, covered: Exemplar,
                  bared: NDArray[np.float32], strict: bool) -> NDArray[np.float32]:
    """Shares of a painting whose forehead was bared: skin there, hair above, else as before.

    They are not found in the bared picture: its forehead is no sample of the painter's skin.
    """
    before = covered.regions()
    shares = known_shares(covered, before, before.labels(), strict)
    if regions.hair is not None:
        more = np.clip(regions.hair - shares[..., HAIR], 0, 1)[..., None]
        shares += more * (np.eye(len(MATERIALS), dtype=np.float32)[HAIR] - shares)
    shares += bared[..., None] * (np.eye(len(MATERIALS), dtype=np.float32)[SKIN] - shares)
    return shares
