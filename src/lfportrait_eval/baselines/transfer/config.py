"""Parameters of the published methods of transfer, and what they hand back."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from numpy.typing import NDArray

from lfportrait.files import write_image


@dataclass(frozen=True)
class FaceBlitConfig:
    """FaceBlit as published, with its own defaults and units (8-bit guides)."""

    background: bool = True
    """Paint the whole picture; otherwise only the face."""
    threshold: int = 50
    """Largest guide error inside a chunk of the face, 0 to 200."""
    background_threshold: int = 10
    """Largest guide error inside a chunk of the rest, 0 to 200."""
    position_weight: int = 10
    """Weight of one step (1/256 of the picture) of the position guide."""
    appearance_weight: int = 2
    """Weight of one grey level of the appearance guide."""
    window: int = 30
    """Search window of the table: exemplar pixels to each side of a cell's place."""
    table: Literal["sweep", "exhaustive"] = "sweep"
    """exhaustive: search every window for every cell, as published; sweep: the same table,
    faster."""
    radius: int = 1
    """Voting window: 0 none, 1 is 3 x 3, 2 is 5 x 5."""
    mask_blur: int = 20
    """Side in pixels of the box that softens the mask of the face."""


@dataclass(frozen=True)
class FaceStyleConfig:
    """Guided patch synthesis after FaceStyle."""

    style_weight: float = 1.0
    """Weight of the colors' agreement between overlapping patches, 0.2 to 4."""
    appearance_weight: float = 0.3
    """Weight of the appearance guide, 0 to 2: high keeps the sitter's features, and above 1 the
    photo shows through."""
    segment_weight: float = 1.5
    """Weight of the segmentation guide, 0 to 4."""
    position_weight: float = 12.0
    """Weight of the position guide, 0 to 20: high keeps features in place."""
    uniformity: float = 3500.0
    """Penalty on exemplar pixels used more often than the average, 0 to 15000: low repeats
    patches, high spreads them over the whole exemplar."""
    votes: int = 4
    """Alternations of search and voting on each level, 1 to 10."""
    passes: int = 2
    """Passes of the search in each alternation, 1 to 6."""
    reach: int = 16
    """Widest random step of the search on the finest level, in pixels."""
    coarsest: int = 32
    """The pyramid ends where the shorter side would fall below this."""
    final_3x3: bool = True
    """Finish with patches of 3 x 3 pixels, which blur less."""
    seed: tyro.conf.Suppress[int] = 0
    """Seed of the random search."""


@dataclass(frozen=True)
class NetworkConfig:
    """Full-frame network of one style after Futschik et al. (2019)."""

    checkpoint: Path | None = None
    """File of the trained network: loaded if it exists, otherwise written after training."""
    photos: Path | None = None
    """Folder of training portraits; by default embedded heads and the photo itself."""
    teacher: Literal["facestyle", "styleblit"] = "facestyle"
    """Method that paints the training examples."""
    pairs: int = 24
    """Number of training examples (photos with small rotations and shifts); use hundreds for
    production."""
    budget: float = 240.0
    """Seconds of training, without the teacher's time."""
    steps: int = 0
    """Training steps instead of seconds (reproducible); 0 = by seconds."""
    size: int = 384
    """Longer side of the pictures that the network sees, in pixels."""
    width: int = 24
    """Channels of the first layer, 4 to 64."""
    rate: float = 5e-4
    """Learning rate."""
    adversarial: float = 0.5
    """Weight of the discriminator, 0 to 1: higher is sharper and less faithful."""
    seed: tyro.conf.Suppress[int] = 0
    """Seed of examples and weights."""
    device: tyro.conf.Suppress[str] = "auto"
    """Where the network computes, a choice of ``--device``."""


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
