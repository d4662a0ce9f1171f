"""Options of a color mix: parsed, and resolved for a field."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import tyro

from ...labels import RegionStyle, RegionValue, read_regions

__all__ = ["MixConfig", "plain"]

_Words = tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]]
"""Words of an option that may be given several times, and several words at a time."""


@dataclass(frozen=True)
class MixConfig:
    """Mix of the photo's and the paintings' colors in a stylised field."""

    strength: float = 1.0
    """0 leaves the photo's colors, 1 gives the painting's."""
    identity: float = 0.0
    """Share of the photo's own light and shade in the painting, with the painting's tones and
    colors: 0 (none) to 1."""
    region: _Words = ()
    """Strength or style of one region: NAME=NUMBER multiplies its strength (0 keeps the
    photo, above 1 exaggerates, 4 at most), NAME=STYLE or NAME=STYLE:NUMBER paints it in another
    style of the file, e.g. hair=2 lips=0.5; where regions overlap, the last one wins."""
    style: str = ""
    """Style of all other regions; by default the first in the file."""
    keep_colors: bool = False
    """Keep the photo's colors: use only light and shade of the painting."""
    keep: _Words = ()
    """Regions that stay as in the photo, e.g. eyes lips."""

    def arguments(self) -> dict[str, Any]:
        """The same as arguments of `StyledField.mix`.

        Raises
        ------
        UserError
            If a region is not of the form NAME=VALUE.
        """
        regions: dict[str, RegionValue] = dict(read_regions(self.region))
        return {"strength": self.strength, "identity": self.identity, "regions": regions,
                "keep_colors": self.keep_colors, "style": self.style or None,
                "keep": tuple(name for words in self.keep for name in words)}


def plain(choices: Mapping[str, RegionStyle]) -> dict[str, Any]:
    """Choices as `StyledField.mix` takes them and a JSON file holds them."""
    return {name: [choice.style, choice.strength] if choice.style else choice.strength
            for name, choice in choices.items()}
