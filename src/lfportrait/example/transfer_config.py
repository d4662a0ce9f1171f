"""Parameters of the example-based transfer."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import tyro

from .styleblit import BlitConfig
from .table import TableConfig
from .worn import Wear

__all__ = ["TransferConfig"]


@dataclass(frozen=True)
class TransferConfig:
    """Parameters of the example-based transfer; lengths are relative to the face."""

    quality: Literal["fast", "best"] = "fast"
    """fast: StyleBlit alone, a tenth of a second. best: patch synthesis outside the face, without
    repeated rows and stripes, in seconds; only for photos in `lfportrait transfer`. It uses patch
    search: see the note on patents in docs/methods.md."""
    extent: Literal["picture", "head", "face"] = "picture"
    """Painted area: the whole picture, the head (person), or the face alone (as in the paper)."""
    strength: float = 1.0
    """0 leaves the photo, 1 gives the painting."""
    eyes: Literal["auto", "painted"] = "auto"
    """auto: eyes that are closed in a photo are painted closed; painted: open, as in the painting.
    For photos only; a frame of a video that blinks is painted open."""
    wear: tuple[Wear, ...] = ()
    """Put on the sitter of a photo what the painting's wears: hat, spectacles."""
    aside: float = 20.0
    """For faces turned by more than this angle, guide by the visible part of a generic head instead
    of hidden landmarks; in degrees, 90 = never."""
    table: TableConfig = field(default_factory=TableConfig)
    """Look-up table."""
    blit: BlitConfig = field(default_factory=BlitConfig)
    """Synthesis."""
    seed: tyro.conf.Suppress[int] = 0
    """Seed of the chunks' jitter."""
