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
    blur: float = 0.06
    """Sigma of the appearance guide's Gaussian blur over the face's size (`face_size`)."""
    grid: int = 4
    """Evaluate the position guide every Nth pixel, bilinear between; 1 = every pixel."""
    stroke_scale: float = 0.0
    """Exemplar pixels per target pixel; 0 = from the sizes of the faces, 1 if they are similar."""
    background_appearance: float = 0.05
    """Weight of the appearance guide outside the person, against 1 on the face."""
    skin_appearance: float = 0.1
    """Weight of the appearance guide on forehead and ears."""
    hair_appearance: float = 0.1
    """Weight of the appearance guide in the hair."""
    body_appearance: float = 0.1
    """Weight of the appearance guide on neck and clothes."""
    background_position: float = 0.4
    """Weight of the position guide outside the person, against 1 on the face."""
    hair_position: float = 1.0
    """Weight of the position guide in the hair."""
    body_position: float = 0.5
    """Weight of the position guide on neck and clothes."""
    outline: float = 4.0
    """Added weight of the position guide along the outline of the person, 0 to 10."""
    label_weight: float = 40.0
    """Penalty for copying from a wrong region (hair for skin, lips for skin, ...), 0 to 200."""
    contours: bool = True
    """Use hairline and outline of the head, with the landmarks, in the position guide."""
    aside: float = 20.0
    """For faces turned by more than this angle, guide by the visible part of a generic head instead
    of hidden landmarks; in degrees, 90 = never."""
    view_gain: float = 10.0
    """Factor of `blit.min_improvement` in the views of a capture, 1 to 20: high values suppress
    strokes that jump between views."""
    table: TableConfig = field(default_factory=TableConfig)
    """Look-up table."""
    blit: BlitConfig = field(default_factory=BlitConfig)
    """Synthesis."""
    seed: tyro.conf.Suppress[int] = 0
    """Seed of the chunks' jitter."""
