"""Result of a transfer: the picture and its intermediates as pictures."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..files import write_image
from ..labels import PICTURE_LABELS
from .guides.position import Guides
from .styleblit import Synthesis

__all__ = ["TransferResult", "dump_transfer"]

Float32 = NDArray[np.float32]

LABEL_COLORS = np.array([[0.8, 0.2, 0.2], [0.2, 0.3, 0.9], [0.9, 0.8, 0.2], [0.9, 0.3, 0.8],
                          [0.3, 0.75, 0.4], [0.95, 0.55, 0.15], [0.4, 0.4, 0.5], [0, 0, 0]])
LEVEL_COLORS = np.array([[0, 0, 0], [0.5, 0, 0.5], [0.2, 0.2, 0.9], [0.1, 0.6, 0.8],
                          [0.2, 0.75, 0.3], [0.8, 0.8, 0.2], [1, 0.6, 0.2], [1, 0.9, 0.8],
                          [1, 1, 1]])


def position_picture(position: NDArray[np.floating], shape: tuple[int, int]) -> NDArray[Any]:
    """Positions as red (x) and green (y), as the paper shows them; black without a position."""
    height, width = shape
    picture = np.zeros((*position.shape[:2], 3), np.float32)
    picture[..., :2] = np.nan_to_num(position / np.array([width, height], np.float32))
    return picture


def chunk_picture(shift: NDArray[np.floating], level: NDArray[np.uint8]) -> NDArray[Any]:
    """Chunks by level (own look-up black, coarse light), their borders drawn."""
    picture = LEVEL_COLORS[np.minimum(level, len(LEVEL_COLORS) - 1)]
    border = np.zeros(level.shape, bool)
    border[:, 1:] |= (shift[:, 1:] != shift[:, :-1]).any(axis=-1)
    border[1:] |= (shift[1:] != shift[:-1]).any(axis=-1)
    return picture * np.where(border, 0.6, 1.0)[..., None]


@dataclass
class TransferResult:
    """A stylised picture with everything that led to it.

    Attributes
    ----------
    image
        float32 [H, W, 3] in [0, 1].
    guides
        Position, appearance, labels and anchor of the target.
    mask
        float32 [H, W], where the synthesis covers the photo.
    synthesis
        Chunk shifts, levels and table error.
    seconds
        ``table_seconds`` and ``regions_seconds`` (segmentation by networks): pre-calculation of
        the style and of the photo; ``guides_seconds``, ``synthesis_seconds`` (with voting and
        blending).
    """

    image: Float32
    guides: Guides
    mask: Float32
    synthesis: Synthesis
    seconds: dict[str, float]
    exemplar_shape: tuple[int, int] = (0, 0)
    style_appearance: Float32 | None = field(default=None, repr=False)

    def dump(self, folder: str | Path) -> None:
        """Write every intermediate as a picture into ``folder``."""
        dump_transfer(self, Path(folder))


def dump_transfer(result: TransferResult, folder: Path) -> None:
    """Write guides, labels, table error, chunks and mask of ``result`` into ``folder``.

    Files: ``position.png``, ``appearance.png``, ``style_appearance.png``, ``labels.png``,
    ``table_error.png`` (white = 100), ``chunks.png``, ``synthesis.png``, ``mask.png``,
    ``result.png``.
    """
    guides, synthesis = result.guides, result.synthesis
    error = np.where(np.isfinite(synthesis.error), synthesis.error, 0)
    labels = guides.labels.astype(np.float32) / 255
    pictures = {
        "position": position_picture(guides.position, result.exemplar_shape),
        "appearance": 0.5 + guides.appearance,
        "labels": labels @ LABEL_COLORS[:len(PICTURE_LABELS)],
        "table_error": error / 100,
        "chunks": chunk_picture(synthesis.shift, synthesis.level),
        "synthesis": synthesis.image,
        "mask": result.mask,
        "result": result.image,
    }
    if result.style_appearance is not None:
        pictures["style_appearance"] = 0.5 + result.style_appearance
    for name, picture in pictures.items():
        write_image(folder / f"{name}.png", picture)
