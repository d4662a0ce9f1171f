"""What a painting was found to be made of, kept in the user's cache as its regions are.

It takes a tenth of a preview in a new process, and depends on the painting alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..keys import code_hash, kept_arrays, key_of
from . import guides
from .exemplar import Exemplar
from .guides.regions import Regions
from .skin import picture_materials
from .skin.picture_materials import painted_shares

__all__ = ["known_shares"]

MOST = 30
"""Paintings that are kept: six megabytes for one of 768 x 1024."""
STEPS = np.float32(255)
"""Shares are kept in so many steps: the labels that they come from have no more."""


def known_shares(exemplar: Exemplar, regions: Regions, labels: NDArray[np.uint8],
                 strict: bool = True) -> NDArray[np.float32]:
    """`painted_shares`, float32 [h, w, 7], of a painting and its regions' labels; kept."""
    def find() -> dict[str, NDArray[Any]]:
        shares = painted_shares(exemplar, regions, labels, strict)
        return {"shares": np.asarray(shares * STEPS + np.float32(0.5), np.uint8)}

    code = code_hash(Path(guides.__file__).parent, Path(picture_materials.__file__))
    key = key_of(exemplar.image, exemplar.landmarks, regions.person, regions.hair, strict, code)
    # A file keeps rounded numbers: the first run goes on with those that the next will find.
    kept = kept_arrays("materials", key, find, most=MOST)["shares"]
    return kept.astype(np.float32) / STEPS
