"""Result of a published transfer method: picture, times, intermediates."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfportrait.files import write_image

__all__ = ["Painted"]


@dataclass
class Painted:
    """A picture stylised by a published method.

    Attributes
    ----------
    image
        float32 [H, W, 3] in [0, 1].
    seconds
        ``precalculation_seconds`` (once per style), ``guides_seconds`` and ``synthesis_seconds``
        (per picture).
    pictures
        Intermediates by name, uint8 or float in [0, 1].
    """

    image: NDArray[np.float32]
    seconds: dict[str, float]
    pictures: dict[str, NDArray[Any]] = field(default_factory=dict, repr=False)

    def dump(self, folder: str | Path) -> None:
        """Write the result and every intermediate as a picture into ``folder``."""
        for name, picture in {**self.pictures, "result": self.image}.items():
            write_image(Path(folder) / f"{name}.png", picture)
