"""Parameters of the published methods of transfer, and what they hand back."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import tyro
from numpy.typing import NDArray

from lfportrait.arrays import Float32
from lfportrait.files import write_image

from ..config import BaselineConfig


@dataclass(frozen=True)
class FaceBlitConfig:
    """FaceBlit as published, with its own weights and units (8-bit guides)."""

    background: bool = True
    """Paint the whole picture; otherwise only the face."""
    table: Literal["sweep", "exhaustive"] = "sweep"
    """exhaustive: search every window for every cell, as published; sweep: the same table,
    faster."""


@dataclass(frozen=True)
class FaceStyleConfig(BaselineConfig):
    """Guided patch synthesis after FaceStyle."""

    usual_steps = 4
    passes: int = 2
    """Passes of the search in each alternation, 1 to 6."""
    seed: tyro.conf.Suppress[int] = 0
    """Seed of the random search."""


@dataclass(frozen=True)
class NetworkConfig(BaselineConfig):
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
    """Seconds of training without the teacher's time, if no steps are given."""
    size: int = 384
    """Longer side of the pictures that the network sees, in pixels."""
    width: int = 24
    """Channels of the first layer, 4 to 64."""
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

    image: Float32
    seconds: dict[str, float]
    pictures: dict[str, NDArray[Any]] = field(default_factory=dict, repr=False)

    def dump(self, folder: str | Path) -> None:
        """Write the result and every intermediate as a picture into ``folder``."""
        for name, picture in {**self.pictures, "result": self.image}.items():
            write_image(Path(folder) / f"{name}.png", picture)
